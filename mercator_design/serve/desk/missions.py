"""Work on missions for the desk: checks, facts, pictures."""

from dataclasses import dataclass
from functools import partial
from typing import Literal

from mercator_design.config import shipped
from mercator_design.config.loading import text_of
from mercator_design.config.writing import dump
from mercator_design.errors import MercatorError, MissionError, excerpt
from mercator_design.missions.mission import Mission, parse_mission
from mercator_design.serve.desk.findings import MissionFinding, findings, without_folders
from mercator_design.serve.desk.outline import Outline
from mercator_design.serve.jobs.job import Request
from mercator_design.serve.settings import Limits
from mercator_design.sim.checks.no_effect import dead_conditions, no_effect_warnings
from mercator_design.sim.simulate import Simulator

NAME = "mission.yaml"
"""The name of a user's text in messages."""
_BUDGET = 10_000
"""Experiments that suffice for any method."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckedMission:
    """What a check of a job's mission has found."""

    name: str
    direction: str
    robots: int
    duration: float  # [s]
    warnings: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionFacts:
    """What a valid mission is."""

    name: str
    description: str
    source: str
    digest: str
    robots: int
    robot_model: str
    duration: float  # [s] of an experiment
    control_period: float  # [s]
    objective: str
    direction: str
    never_fires: tuple[str, ...]  # conditions of the flavour


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionReview:
    """All mistakes and warnings in a mission, and its facts if it can be read."""

    errors: tuple[MissionFinding, ...]
    warnings: tuple[MissionFinding, ...] = ()
    facts: MissionFacts | None = None


def user_mission(name: str, text: str | None, overrides: tuple[str, ...], limits: Limits) -> Mission:
    """The mission of a user: a shipped one or a text, which may not name files of the service.

    Raises:
        MissionError: It is not valid, or beyond a limit.
    """
    label, source = _labelled(name, text)
    mission = parse_mission(source, name=label, overrides=overrides, files=False)
    if mission.robot_model not in shipped.robot_models():
        where, found = mission.where("robot_model"), excerpt(mission.robot_model)
        raise MissionError(f"{where}: expected the name of a shipped one, found {found}")
    for key, most in (("robots", limits.robots), ("duration", limits.duration)):
        if (value := getattr(mission, key)) > most:
            raise MissionError(f"{mission.where(key)}: expected at most {most:g}, the limit here, found {value:g}")
    return mission


def checked_request(request: Request, text: str | None, limits: Limits) -> CheckedMission:
    """Check the mission of a job, and that a race of it can begin.

    Raises:
        MercatorError: It cannot; with each mistake.
    """
    from mercator_design.designer import Designer

    mission = user_mission(request.mission, text, request.set, limits)
    simulator = Simulator(mission)
    simulator.check_placement()
    Designer(simulator, budget=request.budget, seed=request.seed, flavour=request.flavour, method=request.method)
    return CheckedMission(
        name=mission.name,
        direction=mission.objective.direction,
        robots=mission.robots,
        duration=mission.duration,
        warnings=tuple(map(without_folders, _warnings(simulator, request.flavour))),
    )


def review(name: str, text: str | None, overrides: tuple[str, ...], flavour: str, limits: Limits) -> MissionReview:
    """All that can be said of a mission, which may have mistakes.

    Raises:
        MissionError: There is no shipped mission of the name.
    """
    from mercator_design.designer import Designer

    label, source = _labelled(name, text)
    try:
        mission = user_mission(name, text, overrides, limits)
        simulator = Simulator(mission)
    except MercatorError as error:
        return MissionReview(errors=tuple(findings(error.messages, label, source)))
    errors: list[str] = []
    for attempt in (simulator.check_placement, partial(Designer, simulator, budget=_BUDGET, seed=1, flavour=flavour)):
        try:
            attempt()
        except MercatorError as error:
            errors += error.messages
    return MissionReview(
        errors=tuple(findings(errors, label, source)),
        warnings=tuple(findings(_warnings(simulator, flavour), label, source)),
        facts=_facts(mission, dead_conditions(mission, simulator.robot_model, flavour)),
    )


def picture(
    name: str, text: str | None, overrides: tuple[str, ...], limits: Limits, seed: int, kind: Literal["png", "svg"]
) -> bytes:
    """A mission seen from above.

    Raises:
        MercatorError: It is not valid, or the robots do not fit.
    """
    from mercator_design.view.pictures.preview import picture_of

    simulator = Simulator(user_mission(name, text, overrides, limits))
    return picture_of(simulator, seed=seed, suffix=f".{kind}")


def mission_text(name: str, text: str | None, overrides: tuple[str, ...], limits: Limits) -> str:
    """The text of a mission in which its overrides are; if there are any, with all defaults and without comments.

    Raises:
        MissionError: It is not valid.
    """
    _, source = _labelled(name, text)
    return dump(user_mission(name, text, overrides, limits)) if overrides else source


def raced_mission_text(text: str, model: str, limits: Limits) -> str:
    """The mission of a run folder as a text that names no files.

    Args:
        text: The mission of the run folder.
        model: The text of its robot model.
        limits: Of the service.

    Raises:
        MissionError: It has other files, or its robot model is not a shipped one.
    """
    root = Outline.of(model).root
    name = root.child("name") if root else None
    found = name.content if name is not None and isinstance(name.content, str) else ""
    return mission_text("", text, (f"robot_model={found}",), limits)


def _labelled(name: str, text: str | None) -> tuple[str, str]:
    """What messages call a user's mission, and its text."""
    if text is not None:
        return NAME, text
    if name not in shipped.missions():
        raise MissionError(f"mission: expected the name of a shipped mission, found {excerpt(name)}")
    return name, text_of(shipped.missions()[name], error=MissionError)


def _warnings(simulator: Simulator, flavour: str) -> list[str]:
    """The warnings on a mission, but those for which it is refused."""
    found = [one.message for one in simulator.warnings if not one.is_impossible]
    return [*found, *no_effect_warnings(simulator.mission, simulator.robot_model, flavour)]


def _facts(mission: Mission, never_fires: list[str]) -> MissionFacts:
    return MissionFacts(
        name=mission.name,
        description=mission.description,
        source=mission.source,
        digest=mission.digest,
        robots=mission.robots,
        robot_model=mission.robot_model,
        duration=mission.duration,
        control_period=mission.control_period,
        objective=mission.objective.name,
        direction=mission.objective.direction,
        never_fires=tuple(never_fires),
    )
