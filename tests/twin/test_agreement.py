"""Robots of a twin without noise decide what the simulator does, and perceive what it senses where they are."""

import pytest

from benchmarks.twin_perception import decisions, perception, run
from mercator_design.modules.flavour import flavour_of
from mercator_design.robot.logs import log as log_module
from mercator_design.robot.logs.log import controller_of, to_lines
from tests.robot.log_events import read
from tests.twin.recorded import ROBOTS, unpack


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    return unpack(tmp_path_factory.mktemp("recorded"))


def check(folder, cycles, changes):
    """That all is as docs/explanation/twin.md says, over at least so many cycles and changes of state of each robot."""
    behaviours = set()
    for robot in range(ROBOTS):
        log = folder / f"run{robot}.jsonl"
        behaviours |= {state.behaviour for state in controller_of(next(log_module.read(log))).software.states}
        decided, seen = decisions(log), perception(folder, robot)
        assert decided.cycles == seen.cycles >= cycles
        assert decided.changes >= changes
        assert decided.states == decided.wheels == decided.cycles
        assert seen.ground >= 0.99 * seen.cycles
        assert seen.proximity >= 0.97 * seen.cycles
        assert seen.neighbours >= 0.85 * seen.cycles
    assert behaviours == {module.name for module in flavour_of("watermelon").numbered("behaviour").values()}


def test_recorded_runs(recorded):
    check(recorded, cycles=120, changes=5)


@pytest.mark.thorough
def test_three_pfsms_for_a_minute(tmp_path):
    run(tmp_path, 60.0)
    check(tmp_path, cycles=600, changes=15)


def test_what_differs_is_found(recorded, tmp_path):
    start, *events = read(recorded / "run0.jsonl")
    log = tmp_path / "log.jsonl"
    cycles = [event for event in events if event["event"] == "cycle"]
    other = [cycles[0] | {"wheels": [0.25, 1.0]}, cycles[1] | {"next_state": 2}, *cycles[2:]]
    log.write_text("".join(to_lines([start, *other])))
    assert decisions(log)[:3] == (len(cycles), len(cycles) - 1, len(cycles) - 1)


def test_perception_elsewhere_differs(recorded, tmp_path):
    """A robot's log against the places of another."""
    for name in ("twin.jsonl", "run1.jsonl"):
        (tmp_path / name).write_bytes((recorded / name).read_bytes())
    (tmp_path / "run1.jsonl").rename(tmp_path / "run0.jsonl")
    seen = perception(tmp_path, 0)
    assert seen.proximity < 0.5 * seen.cycles
