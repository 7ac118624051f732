"""How well robots kept time, from the logs of their runs: python benchmarks/robot_cycles.py LOG ..."""

import itertools
import statistics
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

from mercator_design.robot.log import read

NEAR = 0.005
"""[s] by which a period may differ."""


def main() -> None:
    print("| log | cycles | within 5 ms of the control period | longest | CPU of a cycle | of the program meanwhile |")
    print("|---|---|---|---|---|---|")
    for path in map(Path, sys.argv[1:]):
        start, *events = read(path)
        cycles = [event for event in events if event["event"] == "cycle"]
        times = [event["time"] for event in cycles]
        periods = [after - before for before, after in itertools.pairwise(times)]
        near = sum(abs(period - start["control_period"]) <= NEAR for period in periods) / len(periods)
        cpu = [_cell([event[name] for event in cycles if name in event]) for name in ("cpu", "program_cpu")]
        kept = f"{100.0 * near:.1f} % | {1000.0 * max(periods):.1f} ms"
        print(f"| {path.name} | {len(cycles)} | {kept} | {' | '.join(cpu)} |")


def _cell(seconds: list[float]) -> str:
    """Median, and what 99 % are below."""
    if not seconds:  # a log from before it was told
        return "?"
    times = sorted(1000.0 * second for second in seconds)
    return f"{statistics.median(times):.2f} ms, 99 % below {times[int(0.99 * len(times))]:.2f}"


if __name__ == "__main__":
    main()
