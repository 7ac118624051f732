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
    print("| log | cycles | within 5 ms of the control period | longest | CPU of a cycle: median | 99 % below |")
    print("|---|---|---|---|---|---|")
    for path in map(Path, sys.argv[1:]):
        start, *events = read(path)
        cycles = [event for event in events if event["event"] == "cycle"]
        times = [event["time"] for event in cycles]
        periods = [after - before for before, after in itertools.pairwise(times)]
        near = sum(abs(period - start["control_period"]) <= NEAR for period in periods) / len(periods)
        cpu = sorted(1000.0 * event["cpu"] for event in cycles)
        most = cpu[int(0.99 * len(cpu))]
        print(
            f"| {path.name} | {len(cycles)} | {100.0 * near:.1f} % | {1000.0 * max(periods):.1f} ms "
            f"| {statistics.median(cpu):.2f} ms | {most:.2f} ms |"
        )


if __name__ == "__main__":
    main()
