"""Runs of `mercator-robot run` on the robots of a twin, and where the robots were, by the twin's log."""

import contextlib
import dataclasses
import json
import os
import re
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

from mercator_design.config.writing import dump
from mercator_design.robot.devices.settings import Settings, SwarmSettings, read_settings
from mercator_design.robot.run.network import HEARTBEAT, Speaker
from mercator_design.twin.folder import LOG

Floats: TypeAlias = NDArray[np.float64]

LATE, EARLY = 0.04, 0.01
"""[s] before and after a sample came within which it was measured: the twin may be late, a clock some ms early."""

_COMMAND = [sys.executable, "-c", "from mercator_design.robot.cli import main; main()"]
_READY = 60.0  # [s] that robots may take to be started up
_BEAT = 0.1  # [s] between heartbeats
_SILENCE = 3.0  # [s] of heartbeats that stop robots
_LOOK = 0.05  # [s]
_ENDS = 20.0  # [s] that a program may take to end


@dataclass(frozen=True)
class Plan:
    """Robots to run on a twin.

    mission: Name or path.
    overrides: Of the mission, as of --set.
    seed: Of the twin; robot i draws with 1000 seed + i.
    fsms: The text of fsm.txt of each robot.
    duration: [s]
    options: More of the twin.
    """

    mission: str
    overrides: tuple[str, ...]
    seed: int
    fsms: tuple[str, ...]
    duration: float
    options: tuple[str, ...] = ()


class RunError(Exception):
    """Robots did not run to the end."""


def play(plan: Plan, folder: Path) -> None:
    """Run a plan in real time; logs run0.jsonl, ..., twin.jsonl, and what the twin said at last, twin.txt, are left.

    All robots begin within 0.1 s: they wait for the first heartbeat, which comes when all are started up.

    Raises:
        RunError: if the twin or a robot failed, with what it said.
    """
    folder.mkdir(parents=True, exist_ok=True)
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    line = [*_COMMAND, "twin", plan.mission, "--seed", str(plan.seed), "--folder", str(folder), *plan.options]
    line += [word for override in plan.overrides for word in ("--set", override)]
    with contextlib.ExitStack() as stack:
        said = stack.enter_context((folder / "twin.txt").open("w"))
        twin = stack.enter_context(
            subprocess.Popen(line, env=environment, stdout=subprocess.PIPE, stderr=said, text=True)
        )
        stack.callback(_end, twin)
        for _ in zip(plan.fsms, twin.stdout or (), strict=False):
            pass
        if twin.poll() is not None or not (folder / "0").exists():
            raise RunError(f"the twin failed: {(folder / 'twin.txt').read_text().strip()}")
        robots, ports = [], []
        for number, fsm in enumerate(plan.fsms):
            settings = _awaiting_heartbeats(read_settings(folder / str(number) / "robot.yaml"))
            ports.append(settings.swarm.port)
            file, own, log = (folder / f"{name}{number}" for name in ("fsm", "robot", "run"))
            file.with_suffix(".txt").write_text(fsm)
            own.with_suffix(".yaml").write_text(dump(settings))
            log.with_suffix(".jsonl").unlink(missing_ok=True)
            line = [*_COMMAND, "run", str(file) + ".txt", "--robot", str(own) + ".yaml", "-o", str(log) + ".jsonl"]
            line += ["--duration", str(plan.duration), "--seed", str(1000 * plan.seed + number)]
            messages = stack.enter_context((folder / f"run{number}.txt").open("w"))
            robots.append(stack.enter_context(subprocess.Popen(line, env=environment, stderr=messages)))
            stack.callback(_end, robots[-1])
        _await_logs([folder / f"run{number}.jsonl" for number in range(len(robots))], robots, folder)
        with _heartbeats([port for port in ports if port is not None]):
            for robot in robots:
                robot.wait(plan.duration + _ENDS)
        for number, robot in enumerate(robots):
            if robot.returncode:
                raise RunError(f"robot {number} failed: {(folder / f'run{number}.txt').read_text().strip()}")


def _end(process: subprocess.Popen[Any]) -> None:
    """As Ctrl-C does, or if that does not help, at once."""
    if process.poll() is None:
        process.terminate()
        try:
            process.wait(_ENDS)
        except subprocess.TimeoutExpired:
            process.kill()


def _awaiting_heartbeats(settings: Settings) -> Settings:
    return dataclasses.replace(settings, swarm=SwarmSettings(port=settings.swarm.port, heartbeat=_SILENCE))


def _await_logs(logs: Sequence[Path], robots: Sequence[subprocess.Popen[Any]], folder: Path) -> None:
    """Wait until all robots are started up: then their logs begin."""
    end = time.monotonic() + _READY
    while not all(log.exists() and log.stat().st_size for log in logs):
        for number, robot in enumerate(robots):
            if robot.poll() is not None:
                raise RunError(f"robot {number} failed: {(folder / f'run{number}.txt').read_text().strip()}")
        if time.monotonic() > end:
            raise RunError(f"not all robots were started up within {_READY:g} s")
        time.sleep(_LOOK)


@contextlib.contextmanager
def _heartbeats(ports: Sequence[int]) -> Iterator[None]:
    """Let robots run that listen on UDP ports of this machine."""
    is_over = threading.Event()

    def beat(speakers: Sequence[Speaker]) -> None:
        while not is_over.wait(_BEAT):
            for speaker in speakers:
                speaker.send(HEARTBEAT)

    with contextlib.ExitStack() as stack:
        speakers = [stack.enter_context(Speaker(["127.0.0.1"], port)) for port in ports]
        for speaker in speakers:
            speaker.look_up()
        thread = threading.Thread(target=beat, args=[speakers], daemon=True)
        thread.start()
        try:
            yield
        finally:
            is_over.set()
            thread.join()


def twin_was_late(said: str) -> float:
    """How late a twin ever was [s], by what it said at last; infinite if it did not say."""
    found = re.search(r"at most ([\d.]+) ms late", said)
    return float(found.group(1)) / 1000.0 if found else float("inf")


class Track:
    """Where robots were, by the twin's log.

    start: When the twin began [s since 1970].
    robots: How many there are.
    times: (n,) since then [s].
    poses: (n, robots, 3)
    """

    def __init__(self, log: Path) -> None:
        events: list[dict[str, Any]] = [json.loads(line) for line in log.read_text().splitlines()]
        (clock,) = (event for event in events if event["event"] == "clock")
        poses = [event for event in events if event["event"] == "poses"]
        self.start = datetime.fromisoformat(clock["at"]).timestamp()
        self.robots = len(poses[0]["poses"])
        self.times = np.array([event["time"] for event in poses])
        self.poses: Floats = np.array([event["poses"] for event in poses])

    def around(self, time: float) -> Floats:
        """Poses (times, robots, 3) where a sample may have been measured that came at a time since the start [s]."""
        first, last = np.searchsorted(self.times, [time - LATE, time + EARLY])
        poses: Floats = self.poses[first:last]
        return poses

    def at(self, times: NDArray[np.floating[Any]]) -> Floats:
        """Poses (n, robots, 3) at the logged times nearest to some (n,) since the start [s]."""
        after = np.clip(np.searchsorted(self.times, times), 1, len(self.times) - 1)
        is_before = times - self.times[after - 1] < self.times[after] - times
        poses: Floats = self.poses[after - is_before]
        return poses


def log_of_twin(folder: Path) -> Path:
    """The log of the twin that ran in a folder."""
    return folder / LOG
