"""Races on a Dask scheduler with many sleeping workers: experiments a second, and CPU of client and scheduler for each.

The workers are threads of one process, and share the machine with scheduler and race. The experiments sleep for about
so many milliseconds, and their scores are drawn. "asked for" is the part of the workers' time in experiments that
the race asked for.

Run: python benchmarks/dask_workers.py [--workers 64 256] [--milliseconds 60 20 5] [--budget 2000]
"""

import argparse
import contextlib
import os
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

from benchmarks.virtual_workers import Drawn
from mercator_design.race.executors.dask import DaskExecutor
from mercator_design.race.session.events import Measurement
from mercator_design.race.session.runner import RaceRun


def sleep(seconds: float, item: int) -> Measurement:
    draws = np.random.default_rng(item)
    time.sleep(seconds * max(draws.normal(1.0, 0.15), 0.1))
    return Measurement(float(draws.normal()), "")


class Sleeping(Drawn):
    """A race whose experiments sleep."""

    def __init__(self, budget: int, milliseconds: float) -> None:
        super().__init__("halving", budget)
        self.function = partial(sleep, milliseconds / 1e3)


def cpu_of(process: int) -> float:
    """The CPU seconds of a process so far."""
    fields = Path(f"/proc/{process}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def measure(executor: DaskExecutor, scheduler: int, budget: int, milliseconds: float) -> None:
    problem = Sleeping(budget, milliseconds)
    wall, client, other = time.perf_counter(), time.process_time(), cpu_of(scheduler)
    n = len(RaceRun(problem, executor).finish().finished)
    wall, client, other = time.perf_counter() - wall, time.process_time() - client, cpu_of(scheduler) - other
    busy = n * milliseconds / 1e3 / (wall * executor.jobs)
    cells = (f"{n / wall:.0f}", f"{busy:.0%}", f"{1e3 * client / n:.2f}", f"{1e3 * other / n:.2f}")
    print(f"| {executor.jobs} | {milliseconds:g} ms | {' | '.join(cells)} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workers", nargs="+", type=int, default=[64, 256])
    parser.add_argument("--milliseconds", nargs="+", type=float, default=[60, 20, 5])
    parser.add_argument("--budget", type=int, default=2000)
    given = parser.parse_args()
    print("| workers | an experiment | experiments / s | asked for | client [ms] | scheduler [ms] |")
    print("|---" * 6 + "|")
    path = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    for workers in given.workers:
        with tempfile.TemporaryDirectory() as folder:
            file = f"{folder}/scheduler.json"
            python = [sys.executable, "-m"]
            begun = ["--scheduler-file", file, "--no-dashboard"]
            commands = (
                [*python, "distributed.cli.dask_scheduler", *begun, "--port", "0"],
                [*python, "distributed.cli.dask_worker", *begun, "--no-nanny", "--nthreads", str(workers)],
            )
            with contextlib.ExitStack() as stack:
                processes = []
                for command in commands:
                    process = stack.enter_context(subprocess.Popen(command, stderr=subprocess.DEVNULL, env=path))
                    stack.callback(process.terminate)
                    processes.append(process)
                    while not Path(file).exists():
                        time.sleep(0.1)
                executor = stack.enter_context(DaskExecutor(file))
                while executor.jobs < workers:
                    time.sleep(0.1)
                for milliseconds in given.milliseconds:
                    measure(executor, processes[0].pid, given.budget, milliseconds)


if __name__ == "__main__":
    from benchmarks import dask_workers  # by its name, by which worker processes import it

    dask_workers.main()
