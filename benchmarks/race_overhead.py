"""What the race itself costs, beside the experiments: time, memory, resuming, idle workers.

Each figure is of a process of its own; times of the race are CPU times, which depend little on what else runs.

    overhead     of one experiment, with an evaluator that costs nearly nothing: sampling, asking, testing, telling, and
                 the journal on disk; of the executors alone
    parts        of one experiment with the default method, with a journal: what each part of the race takes, for a
                 tenth of the budget, three tenths, and all
    methods      of one experiment with each method, without a journal, for a tenth of the budget
    memory       at the end of a race of --large experiments
    resume       the journal of that race read, checked and told anew
    utilisation  part of the time that --jobs threads are in experiments, in a race on a mission with 20 robots

Run: python benchmarks/race_overhead.py [--budget 10000] [--large 200000] [--race 400] [--jobs 2]
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, TypeVar
from unittest.mock import patch

from mercator_design.designer import flavour_space
from mercator_design.fsm.space.structure import PfsmStructure
from mercator_design.missions.mission import load_mission
from mercator_design.race import Configuration, Experiment
from mercator_design.race.executors.dask import DaskExecutor
from mercator_design.race.executors.executor import Executor, Failed
from mercator_design.race.executors.processes import ProcessExecutor
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.race.methods import halving
from mercator_design.race.methods.table import METHODS
from mercator_design.race.proposals.newcomers import Newcomers
from mercator_design.race.proposals.proposals import Proposer
from mercator_design.race.session.events import Measurement
from mercator_design.race.session.journal import Journal
from mercator_design.race.session.record import Record
from mercator_design.race.session.runner import RaceRun
from mercator_design.race.session.task import Problem

T = TypeVar("T")
R = TypeVar("R")
MIB = 1024  # KiB, in which Linux counts


def free(item: tuple[int, int]) -> Measurement:
    """A score that depends on configuration and instance, in under a microsecond."""
    configuration, instance = item
    noise = (configuration * 2654435761 + instance * 40503 * 65537) % 1009 / 1009
    return Measurement((configuration * 7919 % 997) / 997 + 2 * noise, "0123456789abcdef")


class Free(Problem[tuple[int, int]]):
    """PFSMs that cost nothing to run."""

    function = staticmethod(free)

    def __init__(self, budget: int, method: str) -> None:
        space = flavour_space("watermelon", PfsmStructure("watermelon"))
        self.optimizer = METHODS[method](space, budget=budget, seed=1)

    def item(self, experiment: Experiment, configuration: Configuration, *, test: bool = False) -> tuple[int, int]:  # noqa: ARG002
        return experiment.configuration, experiment.instance


def run(record: Record | Journal, executor: Executor, budget: int, method: str = "irace") -> int:
    """A race with the free evaluator; gives how many experiments it had."""
    problem = Free(budget, method)
    if not record.record.start:
        record.begin(problem.start())
    RaceRun(problem, executor, record).finish()
    return problem.optimizer.used


def overhead(budget: int) -> None:
    """Prints the cost of a race, irace's and the default one, without and with a journal."""
    for method in ("irace", "halving"):
        spent: list[float] = []
        with tempfile.TemporaryDirectory() as folder, ThreadExecutor(1) as executor:
            run(Record(), executor, 300, method)  # imports what is imported when it is needed
            for record in (Record(), Journal(Path(folder) / "journal.jsonl", new=True)):
                start = time.process_time()
                n = run(record, executor, budget, method)
                spent.append(1e6 * (time.process_time() - start) / n)
        print(f"{method}, budget {budget}: {spent[0]:.1f} us an experiment, with a journal {spent[1]:.1f} us")


PARTS: dict[str, list[tuple[Any, str]]] = {
    "surrogate": [(Proposer, "propose")],
    "first generation": [(Newcomers, "first")],
    "expectation": [(halving, "by_expectation")],
    "journal": [(Journal, "note")],
}
"""The functions of each part; none calls another one."""
REPEATS = 3


def parts(budget: int) -> None:
    """Prints what each part of a race by the default method takes: of some races the one that took least."""
    _by_part(300)  # imports what is imported when it is needed
    for one in (budget // 10, 3 * budget // 10, budget):
        total, spent = min((_by_part(one) for _ in range(REPEATS)), key=lambda found: found[0])
        spent["all else"] = total - sum(spent.values())
        shares = ", ".join(f"{name} {time:.0f} us ({time / total:.0%})" for name, time in spent.items())
        print(f"halving, budget {one}, with a journal: {total:.0f} us an experiment: {shares}")


def _by_part(budget: int) -> tuple[float, dict[str, float]]:
    """The CPU time of an experiment in a race [us], and of each part."""
    spent = dict.fromkeys(PARTS, 0.0)

    def timed(part: str, function: Callable[..., R]) -> Callable[..., R]:
        def call(*given: Any, **named: Any) -> R:
            start = time.thread_time()
            try:
                return function(*given, **named)
            finally:
                spent[part] += time.thread_time() - start

        return call

    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        for part, functions in PARTS.items():
            for owner, name in functions:
                stack.enter_context(patch.object(owner, name, timed(part, getattr(owner, name))))
        executor = stack.enter_context(ThreadExecutor(1))
        journal = stack.enter_context(Journal(Path(folder) / "journal.jsonl", new=True))
        start = time.process_time()
        n = run(journal, executor, budget, "halving")
        total = time.process_time() - start
    return 1e6 * total / n, {part: 1e6 * time / n for part, time in spent.items()}


def methods(budget: int) -> None:
    """Prints the cost of an experiment with each method, for its budget."""
    for method in METHODS:
        with ThreadExecutor(1) as executor:
            run(Record(), executor, 100, method)
            start = time.process_time()
            n = run(Record(), executor, budget, method)
        print(f"{method}, budget {budget}: {1e6 * (time.process_time() - start) / n:.0f} us an experiment")


def executors(budget: int) -> None:
    """Prints what each executor adds to an experiment."""
    from distributed import LocalCluster

    def report(name: str, executor: Executor) -> None:
        with executor:
            list(executor.run(free, ((0, k) for k in range(100))))
            start = time.perf_counter()
            list(executor.run(free, ((0, k) for k in range(budget))))
        print(f"{name}: {1e6 * (time.perf_counter() - start) / budget:.1f} us an experiment")

    report("this thread", ThreadExecutor(1))
    report("2 threads", ThreadExecutor(2))
    report("2 processes", ProcessExecutor(2))
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster:
        report("2 Dask workers", DaskExecutor(cluster.scheduler_address))


def memory(large: int, folder: str) -> None:
    """Prints the peak memory of a large race, whose journal stays."""
    with Journal(Path(folder) / "journal.jsonl", new=True) as journal, ThreadExecutor(1) as executor:
        n = run(journal, executor, large)
    print(f"memory, {n} experiments: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / MIB:.0f} MiB")


def resuming(large: int, folder: str) -> None:
    """Prints how long it takes to be where that race was."""
    path = Path(folder) / "journal.jsonl"
    wall, start = time.perf_counter(), time.process_time()
    with Journal(path, new=False) as journal, ThreadExecutor(1) as executor:
        read = time.process_time() - start
        n = run(journal, executor, large)
    spent, waited = time.process_time() - start, time.perf_counter() - wall
    lines = path.read_bytes().count(b"\n")
    print(
        f"resume, {lines} events: {spent:.2f} s of CPU ({read:.2f} s to read it, then {n} told), {waited:.2f} s in all"
    )
    print(f"memory: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / MIB:.0f} MiB")


def utilisation(budget: int, jobs: int) -> None:
    """Prints how busy some threads are in a race of 20 robots."""
    from mercator_design.designer import Designer
    from mercator_design.sim.simulate import Simulator

    simulator = Simulator(load_mission("aggregation_20"))
    simulator.rehearse(announce=lambda _: None)
    designer = Designer(simulator, budget=budget, seed=1)
    with _Timed(jobs) as executor:
        executor.busy = []
        wall = time.perf_counter()
        used = len(RaceRun(designer, executor).finish().finished)
        wall = time.perf_counter() - wall
    busy = sum(executor.busy)
    unasked = len(executor.busy) - used
    print(
        f"utilisation, {used} experiments of aggregation_20, {jobs} threads: {busy / (jobs * wall):.1%} in experiments "
        f"({wall:.1f} s, {1e3 * busy / len(executor.busy):.1f} ms an experiment; "
        f"{unasked} more were run that nobody asked for)"
    )


class _Timed(ThreadExecutor):
    """Notes how long each experiment took."""

    busy: list[float]

    def run(self, function: Callable[[T], R], items: Iterable[T | None]) -> Iterator[tuple[int, R | Failed]]:
        def timed(item: T) -> R:
            start = time.perf_counter()
            result = function(item)
            self.busy.append(time.perf_counter() - start)
            return result

        return super().run(timed, items)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--budget", type=int, default=10_000)
    parser.add_argument("--large", type=int, default=200_000)
    parser.add_argument("--race", type=int, default=400)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--only", nargs="+", help=argparse.SUPPRESS)  # what a process of its own is to do
    given = parser.parse_args()
    if given.only:
        name, *arguments = given.only
        what: dict[str, Callable[..., None]] = {
            f.__name__: f for f in (overhead, parts, methods, executors, memory, resuming)
        }
        what[name](int(arguments[0]), *arguments[1:])
        return
    with tempfile.TemporaryDirectory() as folder:
        for arguments in (
            ["overhead", str(given.budget)],
            ["parts", str(given.budget)],
            ["methods", str(given.budget // 10)],
            ["executors", str(given.budget)],
            ["memory", str(given.large), folder],
            ["resuming", str(given.large), folder],
        ):
            subprocess.run([sys.executable, __file__, "--only", *arguments], check=True)
    utilisation(given.race, given.jobs)


if __name__ == "__main__":
    main()
