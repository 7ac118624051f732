"""How long it takes from a fault until the wheels are told to rest: each fault by itself, on the devices of a twin.

`python benchmarks/ways_out.py` runs `mercator-robot run` on devices in which the faults of tests/robot/test_ways_out.py
happen, some times each. It prints the least, the median and the most of the times from the fault until the RVR was told
zero, or stopped because it heard nothing. A sensor that is silent has its limit in that time. What else runs on the
machine makes the most longer; the tests hold the least to a bound.
"""

import argparse
import importlib
import random
import signal
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

from mercator_design.robot.run.network import Speaker

WAYS: Any = importlib.import_module("tests.robot.ways")
FAULTS: Any = importlib.import_module("tests.robot.test_ways_out").DEVICE_FAULTS
SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGTSTP")
_PHASE = 0.3  # [s] within which a fault happens, whatever the phase of devices and control cycles is then
_DEAD = 1.0  # [s] after which a robot whose program is dead has stopped


def faults() -> Iterator[tuple[str, Callable[[Any], object], str]]:
    """Name, what happens, and the controller's fault if it is one."""
    for name, (act, _, _) in FAULTS.items():
        yield name, act, ""
    for name in SIGNALS:
        yield name, lambda robot, name=name: robot.process.send_signal(signal.Signals[name]), ""  # type: ignore[misc]
    yield "killed", lambda robot: robot.process.kill(), ""
    yield "suspended", lambda robot: robot.process.send_signal(signal.SIGSTOP), ""
    yield "rvr lost", lambda robot: robot.devices.unplugged.add("rvr"), ""
    yield "rvr hears nothing", lambda robot: robot.devices.deaf.add("rvr"), ""
    yield "swarm told to stop", _stop_swarm, ""
    yield "loop stalls", lambda robot: robot.fault(), "time.sleep(1.0)"


def _stop_swarm(robot: Any) -> None:
    with Speaker(["127.0.0.1"], robot.port) as speaker:
        speaker.stop()


def took(folder: Path, act: Callable[[Any], object], fault: str) -> float:
    """From a fault of a robot that drives until its wheels are told to rest [s]."""
    with WAYS.running(folder, WAYS.ALL, "", fault) as robot:
        robot.drives()
        time.sleep(random.uniform(0.0, _PHASE))
        began = time.monotonic()
        act(robot)
        if robot.process.poll() is None:
            end = time.monotonic() + 12.0
            while time.monotonic() < end and robot.process.poll() is None and not _rests(robot, began):
                time.sleep(0.01)
        time.sleep(_DEAD)
        return float(robot.devices.rests_since()) - began


def _rests(robot: Any, began: float) -> bool:
    """Whether the wheels have rested for a while: of an RVR that hears badly they may only have missed commands."""
    when, left, right = robot.devices.wheels[-1]
    return bool(when > began and left == right == 0.0 and time.monotonic() - when > _DEAD)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("--times", type=int, default=5)
    parser.add_argument("--only", nargs="+", metavar="FAULT", help="Only these.")
    given = parser.parse_args()
    times: int = given.times
    chosen = [each for each in faults() if given.only is None or each[0] in given.only]
    print("| fault | least, s | median, s | most, s |\n|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        for number, (fault, act, controller) in enumerate(chosen):
            found = [took(Path(name) / f"{number}-{k}", act, controller) for k in range(times)]
            row = [fault, *(f"{value:.2f}" for value in (min(found), statistics.median(found), max(found)))]
            print(f"| {' | '.join(row)} |", flush=True)


if __name__ == "__main__":
    main()
