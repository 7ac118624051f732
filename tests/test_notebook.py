"""What Python and notebooks show of missions, PFSMs, traces and results: a short line, and a picture."""

import subprocess
import sys

import pytest

import mercator_design as md
from mercator_design.race.elimination.summary import Scores
from mercator_design.race.session.task import RaceResult
from tests.tiers import some

MACHINE = "--nstates 2 --s0 0 --rwm0 20 --n0 1 --n0x0 0 --c0x0 0 --p0x0 0.5 --s1 1"


@pytest.fixture(scope="module")
def values(tmp_path_factory):
    """A value of each kind that a user gets, by its class."""
    mission, pfsm = md.load_mission("aggregation", ["robots=5", "duration=2"]), md.parse_fsm(MACHINE)
    file = tmp_path_factory.mktemp("files") / "fsm.txt"
    file.write_text(f"# mission: <b>\n{MACHINE}\n")
    trace = md.simulate(mission, pfsm, record=True)
    evaluation = md.evaluate(mission, pfsm, seeds=range(40))
    run = md.design(mission, budget=60, seed=1)
    run.finish()
    found = (mission, pfsm, trace, evaluation, evaluation.scores, run, run.result, md.read_fsm(file), mission.objective)
    return {type(one).__name__: one for one in (*found, md.load_robot_model("mercator"), trace.simulator.robot_model)}


LINES = {
    "Mission": "<Mission aggregation: 5 robots, 2 s, maximise robots_in_zone>",
    "Pfsm": "<Pfsm: watermelon, 2 states (exploration, stop), 1 transition>",
    "FsmFile": "<FsmFile of <b>: watermelon, 2 states (exploration, stop), 1 transition>",
    "SimulatedTrace": "<SimulatedTrace of aggregation, seed 1: 5 robots, 20 cycles of 0.1 s>",
    "Evaluation": "<Evaluation: mean ",
    "Scores": "<Scores: mean ",
    "DesignRun": "<DesignRun of aggregation: 60 of 60 experiments, configuration ",
    "RaceResult": "<RaceResult: configuration ",
    "RobotModel": "<RobotModel mercator: ground, heading, neighbours, odometry, proximity, ranges>",
}


@pytest.mark.parametrize("name", LINES)
def test_python_shows_a_line(values, name):
    shown = repr(values[name])
    assert shown.startswith(LINES[name])
    assert len(shown) < 150
    assert "\n" not in shown


def test_what_a_trace_measures_with_is_a_line_too(values):
    assert len(repr(values["SimulatedTrace"].measure)) < 200


def test_a_race_that_runs_has_no_winner_yet():
    with_events = md.design(md.load_mission("aggregation", ["duration=2"]), budget=60)
    next(with_events)
    assert repr(with_events).startswith("<DesignRun of aggregation: ")
    assert repr(with_events).endswith(" of 60 experiments>")
    assert "<svg" not in with_events._repr_html_()
    with_events.close()


@pytest.mark.swept
@pytest.mark.parametrize("name", some([name for name in LINES if name != "RobotModel"], 2))
def test_a_notebook_shows_a_picture(values, name):
    shown = values[name]._repr_html_()
    assert ("<img " in shown) if name in {"Mission", "SimulatedTrace"} else ("<svg " in shown)
    assert "&lt;" in shown.partition("</p>")[0]
    assert "<b>" not in shown
    assert "<script" not in shown
    assert "http://" not in shown.replace("http://www.w3.org/2000/svg", "")


def test_all_classes_that_are_drawn_are_tried(values):
    assert {place.rpartition(":")[2] for place in md._DRAWN} - {"Trace"} == set(LINES) - {
        "SimulatedTrace",
        "RobotModel",
    }


def test_results_without_a_score_have_a_line():
    assert repr(Scores(())) == "<Scores: n=0>"
    assert "<svg" not in Scores(())._repr_html_()
    assert RaceResult(configuration=1, scores=Scores((2.0,)), tests={}, finished=())._repr_html_().count("<svg ") == 1


def test_a_trace_of_tracked_robots_is_a_line(values):
    trace = values["SimulatedTrace"]
    tracked = md.Trace(**{name: getattr(trace, name) for name in md.Trace.__slots__})
    assert repr(tracked) == "<Trace: 5 robots, 20 cycles of 0.1 s>"
    assert "<img" not in tracked._repr_html_()


@pytest.mark.thorough
def test_it_needs_no_notebook_and_draws_only_when_asked():
    code = (
        "import sys, mercator_design as md; pfsm = md.parse_fsm('--nstates 1 --s0 1'); before = {*sys.modules};"
        "print(pfsm._repr_html_().count('<svg'), 'mercator_design.notebook' in before, 'IPython' in sys.modules)"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout == "1 False False\n"
