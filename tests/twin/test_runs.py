"""`mercator-robot run` on a twin: robots that do their mission, and how soon wheels stop, as the twin sees it."""

import contextlib
import itertools
import shutil
import signal
import subprocess
import time

import numpy as np
import pytest

from mercator_design.fsm import parse
from mercator_design.missions.mission import load_mission
from mercator_design.robot.log import replay
from mercator_design.robot.settings import read_settings
from mercator_design.sim.simulate import Simulator
from tests.robot.ways import in_time
from tests.twin.arenas import QUIET
from tests.twin.processes import EXPLORE, events, start, twin

GATHER = "--nstates 1 --s0 2 --att0 5\n"
APART = "{shape: poses, poses: [[0.36, 0, 0], [-0.18, 0.32, 2], [-0.18, -0.32, 4]]}"
PIPES = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)


@contextlib.contextmanager
def run(folder, number, fsm, duration):
    (folder / "fsm.txt").write_text(fsm)
    line = ["run", folder / "fsm.txt", "--robot", folder / str(number) / "robot.yaml", "--duration", duration]
    line += ["--seed", number, "-o", folder / f"run{number}.jsonl"]
    with start(*line, stderr=subprocess.PIPE) as process:
        try:
            yield process
        finally:
            process.kill()


def spread(poses):
    """Mean distance of robots from each other [m]."""
    places = np.array(poses)[:, :2]
    return np.mean([np.linalg.norm(a - b) for a, b in itertools.combinations(places, 2)])


def until_it_drives(folder):
    until = time.monotonic() + 60.0
    while events(folder, "wheels")[-1]["left"] == 0.0:
        assert time.monotonic() < until
        time.sleep(0.05)


def test_a_run_from_start_to_end(tmp_path):
    in_time(lambda number: a_run_from_start_to_end(tmp_path / str(number)))


def a_run_from_start_to_end(folder):
    folder.mkdir()
    with twin(folder, 1), run(folder, 0, EXPLORE, 1.5) as process:
        _, messages = process.communicate(timeout=60)
        assert process.returncode == 0, messages
        assert "commands end seen after 0.3 s" in messages
    told = events(folder, "wheels")
    assert {event["left"] for event in told} >= {0.0, 0.3}
    assert (told[-1]["left"], told[-1]["right"], told[-1]["by"]) == (0.0, 0.0, "drive_stop")
    decisions = [decision for _, decision in replay(folder / "run0.jsonl")]
    assert len(decisions) == 15
    assert not any(decision.differs for decision in decisions)


def test_a_colour_is_measured(tmp_path):
    """As docs/twin.md has it: all of the floor has one colour, and a copy of robot.yaml stays."""
    file = tmp_path / "mine.yaml"
    with twin(tmp_path, 1, "--set", "floor.background=white", "--set", "floor.zones[0].color=white"):
        shutil.copy(tmp_path / "0" / "robot.yaml", file)
        with start("calibrate", "color", "white", "--seconds", 1, "--robot", file, **PIPES) as process:
            labels, said = process.communicate("\n", timeout=60)
    assert read_settings(file).labels == {"white": (255, 255, 255)}, said
    assert (process.returncode, labels) == (0, "labels:\n  white: [255, 255, 255]\n"), said
    assert "white: 255.0 255.0 255.0, spread 0.0, of " in said
    assert len(events(tmp_path, "wheels")) == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "most"),
    [
        (signal.SIGTERM, 0.25),
        (signal.SIGINT, 0.25),
        (signal.SIGHUP, 0.25),
        (signal.SIGKILL, 0.32),  # 300 ms by the firmware, and two ticks of the twin
        (signal.SIGSTOP, 0.32),
    ],
)
def test_how_soon_wheels_stop_after_a_signal(tmp_path, number, most):
    with twin(tmp_path, 1), run(tmp_path, 0, EXPLORE, 60) as process:
        until_it_drives(tmp_path)
        time.sleep(1.03)
        sent = time.monotonic()
        process.send_signal(number)
        time.sleep(1.0)
        (clock,) = events(tmp_path, "clock")
        last = events(tmp_path, "wheels")[-1]
        assert (last["left"], last["right"]) == (0.0, 0.0)
        assert clock["start"] + last["time"] - sent <= most


FAULT = 20.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "most"),
    [
        ("kind: silence, device: rvr", 0.32),
        ("kind: silence, device: rvr, direction: from_robot", 0.25 + 0.15),
        ("kind: silence, device: proximity", 0.5 + 0.15),
        ("kind: wrong_baud, device: rvr", 0.32),
        ("kind: wrong_baud, device: proximity", 0.5 + 0.15),
        ("kind: port_loss, device: rvr", 0.32),
        ("kind: port_loss, device: proximity", 0.25),
        ("kind: battery, level: 3", 0.25),
    ],
)
def test_how_soon_wheels_stop_after_a_fault(tmp_path, fault, most):
    """By the limits of docs/robot.md."""
    script = tmp_path / "faults.yaml"
    script.write_text(f"schema: 1\nfaults:\n  - {{{fault}, robot: 0, at: {FAULT}}}\n")
    with twin(tmp_path, 1, "--faults", script), run(tmp_path, 0, EXPLORE, 60) as process:
        until_it_drives(tmp_path)
        (clock,) = events(tmp_path, "clock")
        assert time.monotonic() - clock["start"] < FAULT - 1.0
        _, messages = process.communicate(timeout=60)
        assert process.returncode != 0, messages
        time.sleep(0.5)  # by then the RVR stops by itself
    (begun,) = [event["time"] for event in events(tmp_path, "fault")]
    last = events(tmp_path, "wheels")[-1]
    assert (last["left"], last["right"]) == (0.0, 0.0)
    assert 0.0 <= last["time"] - begun <= most, messages


@pytest.mark.slow
def test_three_robots_gather_as_in_the_simulator(tmp_path):
    """Attraction draws no random numbers while it sees others, so there is one way for them to go."""
    mission = load_mission("aggregation", ["duration=30", f"placement={APART}"])
    outcome = Simulator(mission, QUIET).run(parse(GATHER), 1)
    with twin(tmp_path, 3, "--set", f"placement={APART}"), contextlib.ExitStack() as stack:
        runs = [stack.enter_context(run(tmp_path, number, GATHER, 30)) for number in range(3)]
        for each in runs:
            each.communicate(timeout=120)
            assert each.returncode == 0
    poses = [event["poses"] for event in events(tmp_path, "poses")]
    assert spread(poses[0]) == pytest.approx(0.63, abs=0.01)
    assert spread(poses[-1]) == pytest.approx(spread(outcome.trace.poses[-1]), abs=0.04)
    for number in range(3):
        decisions = [decision for _, decision in replay(tmp_path / f"run{number}.jsonl")]
        assert len(decisions) == 300
        assert not any(decision.differs for decision in decisions)
