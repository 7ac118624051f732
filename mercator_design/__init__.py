"""Automatic design of control software for swarms of Mercator robots.

>>> import mercator_design as md
>>> mission = md.load_mission("aggregation", ["robots=5"])
>>> trace = md.simulate(mission, md.parse_fsm("--nstates 1 --s0 0 --rwm0 20"), seed=1)
>>> trace.poses.shape
(1201, 5, 3)

What is imported from here is loaded when it is first used, as robots have few of the packages that it needs. Types are
in `__init__.pyi`; docs/how-to/use-from-python.md has more examples. Plugins import all that they need from here, too.
"""

import importlib
import sys

__version__ = "0.1.0"

_OF_PLUGINS = {
    "Actions": "modules.reference:Actions",
    "Ascending": "config.schema:Ascending",
    "Colour": "config.colours:Colour",
    "Designed": "modules.module:Designed",
    "ExperimentSize": "missions.score_limits:ExperimentSize",
    "FieldError": "config.schema:FieldError",
    "FilePath": "config.schema:FilePath",
    "KnownSwarm": "modules.module:KnownSwarm",
    "Length": "config.schema:Length",
    "NonNegative": "config.schema:NonNegative",
    "OneOf": "config.schema:OneOf",
    "Pattern": "config.schema:Pattern",
    "Positive": "config.schema:Positive",
    "Range": "config.schema:Range",
    "Readings": "modules.reference:Readings",
    "ReferenceModel": "modules.reference:ReferenceModel",
    "Site": "missions.plugins:Site",
    "When": "missions.plugins:When",
    "Written": "modules.module:Written",
    "Zone": "missions.plugins:Zone",
    "Zones": "missions.plugins:Zones",
    "behaviour": "modules.module:behaviour",
    "condition": "modules.module:condition",
    "define_flavour": "modules.flavour:define_flavour",
    "drive": "modules.reference:drive",
    "dynamic": "missions.plugins:dynamic",
    "jittable": "jit:jittable",
    "objective": "missions.plugins:objective",
}
"""Names for those who write plugins; those of missions/ need NumPy, which robots lack."""

_PLACES = {
    "DesignRun": "api:DesignRun",
    "Evaluation": "results.analysis.evaluation:Evaluation",
    "MercatorError": "errors:MercatorError",
    "Mission": "missions.mission:Mission",
    "Pfsm": "fsm.pfsm:Pfsm",
    "RobotModel": "sim.robot_model:RobotModel",
    "Trace": "missions.trace:Trace",
    "design": "api:design",
    "evaluate": "api:evaluate",
    "fresh_instances": "api:fresh_instances",
    "load_mission": "missions.mission:load_mission",
    "load_flavour": "modules.flavour:load_flavour",
    "load_plugin": "plugins.loading:load_plugin",
    "load_robot_model": "sim.robot_model:load_robot_model",
    "parse_fsm": "fsm.text:parse",
    "race": "race",
    "read_fsm": "software.files:read_fsm",
    "simulate": "api:simulate",
    "study": "api:study",
    "sweep": "api:sweep",
    **_OF_PLUGINS,
}
"""Name -> module and the name there; or a package."""

_DRAWN = (
    "api:DesignRun",
    "results.analysis.evaluation:Evaluation",
    "software.files:FsmFile",
    "fsm.pfsm:Pfsm",
    "missions.mission:Mission",
    "missions.trace:Trace",
    "race.elimination.summary:Scores",
    "race.session.task:RaceResult",
)
"""The classes that notebook.py draws."""

__all__ = ["__version__", *_PLACES]  # noqa: PLE0604 - all are texts


def __getattr__(name: str) -> object:
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    place, _, there = _PLACES[name].partition(":")
    try:
        module = importlib.import_module(f"{__name__}.{place}")
    except ModuleNotFoundError as error:
        error.add_note(f"{__name__}.{name} needs the designer; in the clone: pip install '.[design]'")
        raise
    found = getattr(module, there) if there else module
    globals()[name] = found
    _draw_in_notebooks()
    return found


def _draw_in_notebooks() -> None:
    """Give a `_repr_html_`, which notebooks call, to the classes of DRAWN that are imported so far."""
    for place in _DRAWN:
        module, _, there = place.partition(":")
        if found := sys.modules.get(f"{__name__}.{module}"):
            getattr(found, there)._repr_html_ = _html


def _html(value: object) -> str:
    """The HTML that a notebook shows for a value."""
    found: str = importlib.import_module(f"{__name__}.notebook").html_of(value)
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *_PLACES})
