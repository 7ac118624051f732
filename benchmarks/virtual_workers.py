"""Simulated workers on a virtual clock, and a race for them whose scores are drawn."""

import heapq
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Self, TypeVar

from mercator_design import seeds
from mercator_design.designer import flavour_space
from mercator_design.fsm.space.structure import PfsmStructure
from mercator_design.race import Configuration, Experiment
from mercator_design.race.executors.executor import Failed
from mercator_design.race.methods.table import METHODS
from mercator_design.race.session.events import Measurement
from mercator_design.race.session.task import Problem

T = TypeVar("T")
R = TypeVar("R")


class Drawn(Problem[int]):
    """A race whose scores are drawn: each configuration has a mean."""

    function = staticmethod(lambda item: Measurement(float(item), ""))  # not called: VirtualExecutor
    predicts = False  # the clock stands still while the race proposes in another thread

    def __init__(self, method: str, budget: int) -> None:
        space = flavour_space("watermelon", PfsmStructure("watermelon"))
        self.optimizer = METHODS[method](space, budget=budget, seed=1)

    def item(self, experiment: Experiment, configuration: Configuration, *, test: bool = False) -> int:  # noqa: ARG002
        return seeds.instance_seed(experiment.configuration, "a drawn experiment", experiment.instance)


class VirtualExecutor:
    """Simulated workers with a clock: items take given durations, and the caller its own CPU time.

    One item waits besides those that run, as in `ThreadExecutor`. A caller that thinks gives no items meanwhile, but
    workers go on with what they have. The function is not called: a result is drawn, by the item, with its duration.
    """

    def __init__(self, jobs: int, draw: Callable[[Any], tuple[float, Any]], *, thinking: Callable[[], float]) -> None:
        self.jobs = jobs
        self.now = self.busy = self.thought = 0.0  # [s]
        self.durations: list[float] = []  # of the items, by place
        self._draw, self._thinking = draw, thinking

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def stop(self) -> None:
        """Do nothing: all items that have begun are running."""

    def run(self, function: Callable[[T], R], items: Iterable[T | None]) -> Iterator[tuple[int, R | Failed]]:  # noqa: ARG002
        numbered = enumerate(items)
        free = [0.0] * self.jobs  # when each worker will have ended what it was given
        running: list[tuple[float, int, Any]] = []  # ends, places and results
        last = self._thinking()

        def think() -> None:
            nonlocal last
            now = self._thinking()
            self.now, self.thought, last = self.now + now - last, self.thought + now - last, now

        while True:
            while len(running) < self.jobs + 1:
                place, item = next(numbered, (0, None))
                think()
                if item is None:
                    break
                duration, result = self._draw(item)
                begin = max(self.now, heapq.heappop(free))
                heapq.heappush(free, begin + duration)
                heapq.heappush(running, (begin + duration, place, result))
                self.busy += duration
                self.durations.append(duration)
            if not running:
                return
            end, place, result = heapq.heappop(running)
            self.now = max(self.now, end)
            yield place, result
            think()
