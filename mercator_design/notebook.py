"""The HTML that a notebook shows for missions, traces, PFSMs and results.

The classes are in rooms below those that draw, so `import mercator_design` gives them a `_repr_html_`, the method by
which notebooks ask for HTML. This module is imported when something is shown.
"""

import base64
from functools import singledispatch

from mercator_design.api import DesignRun, SimulatedTrace
from mercator_design.fsm.pfsm import Pfsm
from mercator_design.missions.mission import Mission
from mercator_design.missions.trace import Trace
from mercator_design.race.elimination.summary import Scores
from mercator_design.race.session.task import RaceResult
from mercator_design.results.analysis.evaluation import Evaluation
from mercator_design.results.experiments.experiment import ShownExperiment
from mercator_design.results.experiments.preview import preview_of
from mercator_design.show.charts import STYLE, Axis, Dot, interval_chart
from mercator_design.show.machines.diagram import diagram_svg
from mercator_design.show.machines.picture import software_svg
from mercator_design.show.markup import escaped
from mercator_design.sim.simulate import Simulator
from mercator_design.software.files import FsmFile

_SEED = 1  # of the instance in the picture of a mission
_MAX_DOTS = 1000  # single scores in a chart


@singledispatch
def html_of(value: object) -> str:
    """The HTML of a value: its line as Python shows it, and a picture below."""
    return f"<p>{escaped(repr(value))}</p>"


@html_of.register
def _mission(mission: Mission) -> str:
    from mercator_design.show.pictures.preview import picture_of

    picture = picture_of(preview_of(Simulator(mission), seed=_SEED), suffix=".png")
    about = f"<p>{escaped(mission.description)}</p>" if mission.description else ""
    return html_of.dispatch(object)(mission) + about + _png(picture)


@html_of.register
def _trace(trace: Trace) -> str:
    from mercator_design.show.pictures.figures import file_of, house_style
    from mercator_design.show.pictures.plots import plots

    if not isinstance(trace, SimulatedTrace):
        return html_of.dispatch(object)(trace)
    simulator = trace.simulator
    shown = ShownExperiment(
        title=f"{simulator.mission.name}, seed {trace.seed}",
        trace=trace,
        robot_model=simulator.robot_model,
        mission=simulator.mission,
        pfsms=(trace.pfsm,),
        pfsm_of=(0,) * trace.robots,
    )
    with house_style():
        picture = file_of(plots([shown], ["trajectories"], caption="trace.replay() plays it"), ".png")
    return html_of.dispatch(object)(trace) + _png(picture)


@html_of.register
def _pfsm(pfsm: Pfsm) -> str:
    return html_of.dispatch(object)(pfsm) + diagram_svg(pfsm)


@html_of.register
def _fsm_file(file: FsmFile) -> str:
    rows = "".join(f"<tr><td>{escaped(key)}</td><td>{escaped(value)}</td></tr>" for key, value in file.header.items())
    table = f"<details><summary>header</summary><table>{rows}</table></details>" if rows else ""
    return html_of.dispatch(object)(file) + diagram_svg(file.pfsm, file.names) + table


@html_of.register
def _scores(scores: Scores) -> str:
    return html_of.dispatch(object)(scores) + _chart(scores)


@html_of.register
def _evaluation(evaluation: Evaluation) -> str:
    return html_of.dispatch(object)(evaluation) + _chart(evaluation.scores)


@html_of.register
def _result(result: RaceResult) -> str:
    return html_of.dispatch(object)(result) + _chart(result.scores)


@html_of.register
def _run(run: DesignRun) -> str:
    line = html_of.dispatch(object)(run)
    return line + _chart(run.result.scores) + software_svg(run.pfsm) if run.has_ended else line


def _chart(scores: Scores) -> str:
    if not scores.values:
        return ""
    dot = Dot("mean", scores.mean, *scores.interval, scores.values[:_MAX_DOTS], quartiles=scores.quartiles)
    return f'<style>{STYLE}</style><div style="max-width: 480px">{interval_chart([dot], Axis("score"))}</div>'


def _png(picture: bytes) -> str:
    return (
        f'<img style="max-width: 100%; width: 480px" src="data:image/png;base64,{base64.b64encode(picture).decode()}">'
    )
