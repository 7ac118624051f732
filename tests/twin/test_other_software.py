"""Behaviour trees and networks on a twin: they decide as the simulator's compiled code does on the same readings."""

import contextlib
import subprocess

import pytest

from benchmarks.twin_perception import decisions
from mercator_design.robot.logs.log import replay
from mercator_design.software.files import fsm_file_text, parse_software
from tests.network.networks import published
from tests.processes import LIMIT
from tests.robot.ways import WAITS, made_in_time
from tests.twin.processes import start, twin

pytestmark = [pytest.mark.thorough, pytest.mark.timing]
APART = "placement={shape: poses, poses: [[0.4, 0, 3.1], [-0.4, 0.1, 0]]}"
TREE = (
    "--nroot 3 --nchildroot 3 --n0 0 --nchild0 2 --n00 6 --c00 5 --p00 0.3 --n01 5 --a01 0 --rwm01 5 --p01 0 "
    "--n1 0 --nchild1 2 --n10 6 --c10 3 --p10 1 --w10 5 --n11 5 --a11 4 --att11 3 --p11 0 "
    "--n2 0 --nchild2 2 --n20 6 --c20 0 --p20 0.5 --n21 5 --a21 0 --rwm21 9 --p21 0"
)


@made_in_time
def test_they_decide_as_in_simulation(tmp_path):
    """A robot with a tree, and one with a network that was published for Mercator."""
    network, _ = published()["transferability-1-evostick-mercator-aggregation-0"]
    softwares = [parse_software(TREE, "maple-mercator"), network]
    with twin(tmp_path, 2, "--set", APART), contextlib.ExitStack() as running:
        for process in [ran(running, tmp_path, number, each) for number, each in enumerate(softwares)]:
            _, messages = process.communicate(timeout=LIMIT)
            assert process.returncode == 0, messages
    for number, names in enumerate([{0, 3, 6, 9}, {0}]):
        log = tmp_path / f"{number}.jsonl"
        cycles = [decision for _, decision in replay(log)]
        assert len(cycles) >= 30
        assert {cycle.differs for cycle in cycles} == {""}
        found = decisions(log)
        assert found.cycles == found.states == found.wheels == len(cycles)
        assert {cycle.state for cycle in cycles} <= names
        assert len({cycle.actions[:2] for cycle in cycles}) > 1
    assert decisions(tmp_path / "0.jsonl").changes > 1


def ran(running, folder, number, software):
    """A run that is killed at the end of a context."""
    (folder / f"{number}.txt").write_text(fsm_file_text(software, {}))
    line = ["run", folder / f"{number}.txt", "--robot", folder / str(number) / "robot.yaml", "--duration", 5]
    process = start(*line, "--seed", number, "-o", folder / f"{number}.jsonl", lead=WAITS, stderr=subprocess.PIPE)
    running.enter_context(process)
    running.callback(process.kill)
    return process
