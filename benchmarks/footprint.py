"""Start and memory of the commands, each in a process of its own.

Prints the wall time of `mdesign --help` (median of 9) and the peak memory and time of a race of 3000 experiments. Short
experiments (--seconds) show the memory of a long race in minutes: it hardly depends on how long they are.
Run: python benchmarks/footprint.py [--mission aggregation] [--budget 3000] [--seconds SECONDS]
"""

import argparse
import resource
import statistics
import subprocess
import sys
import tempfile
import time

MDESIGN = [sys.executable, "-c", "from mercator_design.cli import main; main()"]


def seconds(command: list[str]) -> float:
    """Wall time of a command."""
    start = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--mission", default="aggregation")
    parser.add_argument("--budget", type=int, default=3000)
    parser.add_argument("--seconds", help="duration of the mission [default: its own]")
    given = parser.parse_args()
    race = ["race", given.mission, "--budget", str(given.budget)]
    race += ["--set", f"duration={given.seconds}", "-j", "1"] if given.seconds else []
    starts = [seconds([*MDESIGN, "--help"]) for _ in range(9)]
    print(f"mdesign --help: {1e3 * statistics.median(starts):.0f} ms")
    with tempfile.TemporaryDirectory() as folder:
        spent = seconds([*MDESIGN, *race, "-o", f"{folder}/results"])
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024  # of the largest child, in MiB on Linux
    print(f"mdesign {' '.join(race)}: {spent:.1f} s, peak memory {peak:.0f} MiB")


if __name__ == "__main__":
    main()
