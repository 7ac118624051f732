"""Experiments a second of whole races, against the limit of their engine.

The limit is cores / CPU time of compiled loops in an experiment (of the simulation, and of the objective if it has
one), with as many cores as jobs. For each race:

    ms         CPU of the race for an experiment, and of compiled loops in it
    compiled   part of the CPU that is in compiled loops
    of limit   experiments a second of wall time / limit
    idle       part of the workers' wall time in which they had no experiment
    free       part of the cores that as many threads got that did nothing but compute, before and after the race; the
               limit is that part of the cores. Well below 100 %, only ms and compiled mean something
    ran ahead  experiments that idle workers ran and the race did not ask for

Races: each mission with the default method in threads; on the first mission also each method, and each executor; all
with each number of jobs. Missions of more than 10 robots have the budget --small. A small race before each imports what
is imported when it is needed.

Then races with many simulated workers: their experiments take durations (CPU time) that were measured in the races
before, on a virtual clock. The race itself runs, and its CPU time passes on that clock; messages to workers cost
nothing. Scores are drawn, so that configurations are eliminated as in a race.

    busy             part of the workers' time in experiments
    asked for        the same without experiments that ran ahead in vain
    the race itself  part of the time in which it computed: workers that have ended get nothing then; proposals, which
                     another thread makes meanwhile, not counted

With --milliseconds only these, of experiments of such durations, with a standard deviation of 15 %.

Run: python benchmarks/race_throughput.py [--missions foraging aggregation aggregation_20] [--budget 3000] [--small 500]
         [--methods halving irace ...] [--executors threads processes dask] [--jobs 1 2] [--workers 16 64]
         [--milliseconds 5 20 60]
"""

import argparse
import contextlib
import gc
import hashlib
import logging
import os
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Generic, NamedTuple, Self, TypeVar

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

from benchmarks.virtual_workers import Drawn, VirtualExecutor
from mercator_design import jit
from mercator_design.designer import Designer
from mercator_design.missions.mission import load_mission
from mercator_design.race.executors.executor import Executor, Failed
from mercator_design.race.executors.processes import ProcessExecutor
from mercator_design.race.executors.threads import Stepped, ThreadExecutor
from mercator_design.race.methods.table import METHODS
from mercator_design.race.session.events import Measurement
from mercator_design.race.session.runner import RaceRun
from mercator_design.sim.simulate import Simulator

T = TypeVar("T")
R = TypeVar("R")
EXECUTORS = ("threads", "processes", "dask")
SMALL = 300
"""Budget of the race before each race, which is not measured."""


class Spent(NamedTuple):
    """What an experiment took."""

    process: int
    in_loop: float  # CPU of compiled loops [s]
    cpu: float  # of the thread [s]
    wall: float  # [s]
    total: float  # CPU of the whole process until then [s]


class _Loops(threading.local):
    seconds = 0.0


_LOOPS = _Loops()


@cache
def time_loops() -> None:
    """From now on count the CPU time of compiled code in this process, for each thread."""

    def timed(entry: Callable[..., Any]) -> Callable[..., Any]:
        def loop(*arguments: Any) -> Any:
            start = time.thread_time()
            try:
                return entry(*arguments)
            finally:
                _LOOPS.seconds += time.thread_time() - start

        return loop

    usual = jit._compile  # noqa: SLF001 - nothing in the package should know of this clock
    jit._compile = lambda function: timed(usual(function))  # noqa: SLF001
    for function, entry in jit._compiled.items():  # noqa: SLF001
        jit._compiled[function] = timed(entry)  # noqa: SLF001


class Watch:
    """Measures what the thread spends in its contexts, in all."""

    def __init__(self) -> None:
        time_loops()
        self._in_loop = self._cpu = self._wall = 0.0

    def __enter__(self) -> Self:
        self._in_loop -= _LOOPS.seconds
        self._wall -= time.perf_counter()
        self._cpu -= time.thread_time()
        return self

    def __exit__(self, *_: object) -> None:
        self._cpu += time.thread_time()
        self._wall += time.perf_counter()
        self._in_loop += _LOOPS.seconds

    @property
    def spent(self) -> Spent:
        return Spent(os.getpid(), self._in_loop, self._cpu, self._wall, time.process_time())


@dataclass(frozen=True)
class Timed(Generic[T, R]):
    """A function whose result comes with what it took; also in other processes."""

    function: Callable[[T], R]

    def __call__(self, item: T) -> tuple[R, Spent]:
        with Watch() as watch:
            result = self.function(item)
        return result, watch.spent


@dataclass(frozen=True)
class TimedSteps(Timed[T, R]):
    """The same of a function that also runs in steps, with what its steps took."""

    function: Stepped[T, R]

    def in_steps(self, item: T) -> Generator[None, None, tuple[R, Spent]]:
        steps, watch = self.function.in_steps(item), Watch()
        while True:
            with watch:
                try:
                    next(steps)
                except StopIteration as end:
                    result = end.value
                    break
            yield
        return result, watch.spent


class TimedExecutor:
    """An executor that keeps what its experiments took."""

    def __init__(self, executor: Executor) -> None:
        self._executor = executor
        self.spent: list[Spent] = []

    @property
    def jobs(self) -> int:
        return self._executor.jobs

    def __enter__(self) -> Self:
        self._executor.__enter__()
        return self

    def __exit__(self, kind: type[BaseException] | None, *others: object) -> None:
        self._executor.__exit__(kind, *others)

    def stop(self) -> None:
        self._executor.stop()

    def run(self, function: Callable[[T], R], items: Iterable[T | None]) -> Iterator[tuple[int, R | Failed]]:
        timed = TimedSteps(function) if isinstance(function, Stepped) else Timed(function)
        for place, found in self._executor.run(timed, items):
            if isinstance(found, Failed):
                yield place, found
            else:
                result, spent = found
                self.spent.append(spent)
                yield place, result

    def cpu_elsewhere(self) -> float:
        """CPU seconds of other processes, from the beginning of their first experiment to the end of their last."""
        by_process: dict[int, list[Spent]] = defaultdict(list)
        for one in self.spent:
            if one.process != os.getpid():
                by_process[one.process].append(one)
        return sum(max(o.total for o in own) - min(o.total - o.cpu for o in own) for own in by_process.values())


@contextlib.contextmanager
def executor_of(kind: str, jobs: int) -> Iterator[TimedExecutor]:
    """An executor of this machine whose workers have begun."""
    with contextlib.ExitStack() as stack:
        executor: Executor
        if kind == "threads":
            executor = ThreadExecutor(jobs)
        elif kind == "processes":
            executor = ProcessExecutor(jobs)
        else:
            from distributed import LocalCluster

            from mercator_design.race.executors.dask import DaskExecutor

            cluster = stack.enter_context(
                LocalCluster(n_workers=jobs, threads_per_worker=1, dashboard_address=":0", silence_logs=logging.ERROR)
            )
            executor = DaskExecutor(cluster.scheduler_address)
        yield stack.enter_context(TimedExecutor(executor))


def free_share(jobs: int, seconds: float = 0.3) -> float:
    """The part of as many cores as there are jobs that threads get now which only compute."""
    data, end = bytes(2**20), time.perf_counter() + seconds

    def work() -> None:
        while time.perf_counter() < end:
            hashlib.sha256(data)  # without the GIL

    wall, cpu = time.perf_counter(), time.process_time()
    threads = [threading.Thread(target=work) for _ in range(jobs)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return (time.process_time() - cpu) / (jobs * (time.perf_counter() - wall))


class Throughput(NamedTuple):
    """A race that was measured."""

    rate: float  # experiments that it asked for, a second of wall time
    free: float  # part of the cores that it could have
    durations: list[float]  # CPU seconds of its experiments


SIMULATED_HEAD = (
    "| mission | method | simulated workers | experiments / s | busy | asked for | the race itself |\n"
    + "|---" * 7
    + "|"
)
HEAD = "| mission | method | executor | jobs | experiments / s | ms | compiled | of limit | idle | free | ran ahead |"


def measure(mission: str, method: str, kind: str, jobs: int, budget: int) -> Throughput:
    """Run a race and print its row."""
    simulator = Simulator(load_mission(mission))
    simulator.rehearse(announce=lambda _: None)
    time_loops()
    designer = Designer(simulator, budget=budget, seed=1, method=method)
    with executor_of(kind, jobs) as executor:
        small = Designer(simulator, budget=SMALL, seed=2, method=method)
        RaceRun(small, executor).finish()  # workers also load the kernels
        gc.freeze()  # as `mdesign race` does
        before = free_share(jobs)
        executor.spent.clear()
        wall, cpu = time.perf_counter(), time.process_time()
        n = len(RaceRun(designer, executor).finish().finished)
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        free = 0.5 * (before + free_share(jobs))
        gc.unfreeze()
    cpu += executor.cpu_elsewhere()
    ran = len(executor.spent)
    in_loops, busy = (sum(getattr(one, name) for one in executor.spent) for name in ("in_loop", "wall"))
    rate, per_loop = n / wall, in_loops / ran
    cells = (
        f"{rate:.0f}",
        f"{1e3 * cpu / ran:.2f}, {1e3 * per_loop:.2f}",
        f"{in_loops / cpu:.0%}",
        f"{rate * per_loop / (jobs * free):.0%}",
        f"{1 - busy / (jobs * wall):.0%}",
        f"{free:.0%}",
    )
    print(f"| {mission} | {method} | {kind} | {jobs} | {' | '.join(cells)} | {ran - n} |", flush=True)
    return Throughput(rate, free, [one.cpu for one in executor.spent])


def simulate_workers(mission: str, method: str, workers: int, budget: int, durations: Sequence[float]) -> None:
    """Print how busy many workers would be in a race whose experiments take such durations."""

    def draw(item: int) -> tuple[float, Measurement]:
        random = np.random.default_rng(item)
        return float(random.choice(durations)), Measurement(float(random.normal()), "")

    problem = Drawn(method, budget)
    executor = VirtualExecutor(workers, draw, thinking=time.thread_time)
    start = executor.now
    gc.freeze()  # as `mdesign race` does
    with executor:
        asked = len(RaceRun(problem, executor).finish().finished)
    gc.unfreeze()
    wall = executor.now - start
    share = executor.busy / (workers * wall)
    used = asked / len(executor.durations)
    print(
        f"| {mission} | {method} | {workers} | {asked / wall:.0f} | {share:.0%} | {share * used:.0%} "
        f"| {executor.thought / wall:.0%} |",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--missions", nargs="+", default=["foraging", "aggregation", "aggregation_20"], metavar="NAME")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS), metavar="NAME")
    parser.add_argument("--executors", nargs="+", choices=EXECUTORS, default=list(EXECUTORS))
    parser.add_argument("--jobs", nargs="+", type=int, default=[1, 2])
    parser.add_argument("--workers", nargs="*", type=int, default=[16, 64])
    parser.add_argument(
        "--milliseconds", nargs="*", type=float, help="measure no race, but simulate workers of such experiments"
    )
    parser.add_argument("--budget", type=int, default=3000)
    parser.add_argument("--small", type=int, default=500, help="the budget of missions of more than 10 robots")
    given = parser.parse_args()

    def budget_of(mission: str) -> int:
        return int(given.small if load_mission(mission).robots > 10 else given.budget)

    if given.milliseconds:
        for method in given.methods:  # imports what is imported when it is needed
            with VirtualExecutor(1, lambda item: (0.0, Measurement(item % 97, "")), thinking=time.thread_time) as warm:
                RaceRun(Drawn(method, SMALL), warm).finish()
        print(SIMULATED_HEAD)
        for milliseconds in given.milliseconds:
            durations = milliseconds / 1e3 * np.random.default_rng(1).normal(1.0, 0.15, size=1000).clip(0.1)
            for method in given.methods:
                for workers in given.workers:
                    simulate_workers(f"{milliseconds:g} ms", method, workers, given.budget, durations.tolist())
        return
    first = given.methods[0]
    measured = {}
    print(f"{HEAD}\n{'|---' * (HEAD.count('|') - 1)}|")
    for mission in given.missions:
        for kind in given.executors if mission == given.missions[0] else given.executors[:1]:
            for method in given.methods if mission == given.missions[0] and kind == given.executors[0] else [first]:
                for jobs in given.jobs:
                    measured[mission, method, kind, jobs] = measure(mission, method, kind, jobs, budget_of(mission))
    few, many = min(given.jobs), max(given.jobs)
    for mission, method, kind, jobs in measured:
        if jobs == many > few:
            one, more = measured[mission, method, kind, few], measured[mission, method, kind, many]
            ratio = more.rate / more.free / (one.rate / one.free)
            print(f"* {mission}, {method}, {kind}: {many} jobs are {ratio:.2f} times as fast as {few}")
    if given.workers:
        print(f"\n{SIMULATED_HEAD}")
    for mission in given.missions:
        durations = measured[mission, first, given.executors[0], few].durations
        for method in given.methods:
            for workers in given.workers:
                simulate_workers(mission, method, workers, budget_of(mission), durations)


if __name__ == "__main__":
    from benchmarks import race_throughput  # by its name, by which worker processes import it

    race_throughput.main()
