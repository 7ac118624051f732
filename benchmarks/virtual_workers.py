"""Simulated workers on a virtual clock, and a race for them whose scores are drawn."""

import heapq
from collections.abc import Callable, Container, Iterable, Iterator
from functools import partial
from typing import Any, Self, TypeVar
from unittest.mock import patch

from mercator_design import seeds
from mercator_design.designer import flavour_space
from mercator_design.fsm.space.structure import PfsmStructure
from mercator_design.race import Configuration, Experiment
from mercator_design.race.executors.executor import Failed
from mercator_design.race.methods.next_batch import NextBatch
from mercator_design.race.methods.optimizer import Optimizer
from mercator_design.race.methods.table import METHODS
from mercator_design.race.session import runner
from mercator_design.race.session.events import Measurement
from mercator_design.race.session.task import Problem

T = TypeVar("T")
R = TypeVar("R")


class Drawn(Problem[int]):
    """A race whose scores are drawn: each configuration has a mean."""

    function = staticmethod(lambda item: Measurement(float(item), ""))  # not called: VirtualExecutor

    def __init__(self, method: str, budget: int) -> None:
        space = flavour_space("watermelon", PfsmStructure("watermelon"))
        self.optimizer = METHODS[method](space, budget=budget, seed=1)

    def item(self, experiment: Experiment, configuration: Configuration, *, test: bool = False) -> int:  # noqa: ARG002
        return seeds.instance_seed(experiment.configuration, "a drawn experiment", experiment.instance)


class VirtualExecutor:
    """Simulated workers with a clock: items take given durations, and the caller its own CPU time.

    One item waits besides those that run, as in `ThreadExecutor`. A caller that thinks gives no items meanwhile, but
    workers go on with what they have. A race that proposes in another thread has a core for it. The function is not
    called: a result is drawn, by the item, with its duration.
    """

    def __init__(self, jobs: int, draw: Callable[[Any], tuple[float, Any]], *, thinking: Callable[[], float]) -> None:
        self.jobs = jobs
        self.now = self.busy = self.thought = 0.0  # [s]
        self.durations: list[float] = []  # of the items, by place
        self._draw, self._thinking = draw, thinking
        self._last = thinking()
        self._patch = patch.object(runner, "NextBatch", partial(_VirtualNextBatch, self))

    def __enter__(self) -> Self:
        self._patch.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._patch.stop()

    def think(self) -> None:
        """Let the CPU time pass that the caller has used."""
        spent = self.elsewhere()
        self.now, self.thought = self.now + spent, self.thought + spent

    def elsewhere(self) -> float:
        """The CPU time [s] that the caller has used; it does not pass here."""
        before, self._last = self._last, self._thinking()
        return self._last - before

    def stop(self) -> None:
        """Do nothing: all items that have begun are running."""

    def run(self, function: Callable[[T], R], items: Iterable[T | None]) -> Iterator[tuple[int, R | Failed]]:  # noqa: ARG002
        numbered = enumerate(items)
        free = [0.0] * self.jobs  # when each worker will have ended what it was given
        running: list[tuple[float, int, Any]] = []  # ends, places and results
        self.elsewhere()
        while True:
            while len(running) < self.jobs + 1:
                place, item = next(numbered, (0, None))
                self.think()
                if item is None:
                    break
                duration, result = self._draw(item)
                begin = max(self.now, heapq.heappop(free))
                heapq.heappush(free, begin + duration)
                heapq.heappush(running, (begin + duration, place, result))
                self.busy += duration
                self.durations.append(duration)
                self.elsewhere()  # the draw is work of a worker
            if not running:
                return
            end, place, result = heapq.heappop(running)
            self.now = max(self.now, end)
            yield place, result
            self.think()


class _VirtualNextBatch(NextBatch):
    """Of a thread that takes the CPU time of its proposals on the clock of simulated workers."""

    def __init__(self, clock: VirtualExecutor, optimizer: Optimizer, known: Container[Experiment]) -> None:
        self._optimizer, self._clock = optimizer, clock
        experiments, configurations = optimizer.upcoming or ([], {})
        self.upcoming = {one: configurations[one.configuration] for one in experiments if one not in known}
        clock.think()
        self._asked = optimizer.ask()
        self._ready = clock.now + clock.elsewhere()

    @property
    def done(self) -> bool:
        return self._clock.now >= self._ready

    def batch(self) -> list[Experiment]:
        self._clock.now = max(self._clock.now, self._ready)
        return self._asked
