"""How well robots kept time, from the logs of their runs: python benchmarks/robot_cycles.py LOG ..."""

import itertools
import statistics
import sys
from pathlib import Path
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

from mercator_design.robot.logs.events import CycleDone, RunStarted
from mercator_design.robot.logs.log import read

NEAR = 0.005
"""[s] by which a period may differ."""


class Kept(NamedTuple):
    """How a robot kept time.

    periods: From each control cycle to the next [s].
    near: Fraction of them within `NEAR` of what was told.
    cpu: Processor time of each cycle [s].
    program_cpu: That of the whole program since the cycle before [s].
    """

    periods: list[float]
    near: float
    cpu: list[float]
    program_cpu: list[float]


def kept(log: Path) -> Kept:
    """How a robot kept time, by the log of its run."""
    start, *events = read(log)
    assert isinstance(start, RunStarted)  # noqa: S101
    cycles = [event for event in events if isinstance(event, CycleDone)]
    periods = [after.time - before.time for before, after in itertools.pairwise(cycles)]
    near = sum(abs(period - (start.control_period or 0.0)) <= NEAR for period in periods) / len(periods)
    return Kept(periods, near, [event.cpu for event in cycles], [event.program_cpu or 0.0 for event in cycles])


def most(seconds: list[float]) -> float:
    """What 99 % are below."""
    return sorted(seconds)[int(0.99 * len(seconds))]


def main() -> None:
    print("| log | cycles | within 5 ms of the control period | longest | CPU of a cycle | of the program meanwhile |")
    print("|---|---|---|---|---|---|")
    for path in map(Path, sys.argv[1:]):
        found = kept(path)
        in_time = f"{100.0 * found.near:.1f} % | {1000.0 * max(found.periods):.1f} ms"
        cpu = f"{_cell(found.cpu)} | {_cell(found.program_cpu)}"
        print(f"| {path.name} | {len(found.periods) + 1} | {in_time} | {cpu} |")


def _cell(seconds: list[float]) -> str:
    """Median, and what 99 % are below."""
    return f"{1000.0 * statistics.median(seconds):.2f} ms, 99 % below {1000.0 * most(seconds):.2f}"


if __name__ == "__main__":
    main()
