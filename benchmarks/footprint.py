"""Start and memory of the commands, each in a process of its own.

Prints the wall time of `mdesign --help` (median of 9) and the peak memory and time of a race of 3000 experiments.
Run: python benchmarks/footprint.py [--budget 3000]
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
    parser.add_argument("--budget", type=int, default=3000)
    budget = parser.parse_args().budget
    starts = [seconds([*MDESIGN, "--help"]) for _ in range(9)]
    print(f"mdesign --help: {1e3 * statistics.median(starts):.0f} ms")
    with tempfile.TemporaryDirectory() as folder:
        spent = seconds([*MDESIGN, "race", "aggregation", "--budget", str(budget), "-o", f"{folder}/results"])
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024  # of the largest child, in MiB on Linux
    print(f"mdesign race aggregation --budget {budget}: {spent:.1f} s, peak memory {peak:.0f} MiB")


if __name__ == "__main__":
    main()
