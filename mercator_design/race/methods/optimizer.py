"""What all methods of a race are: they ask for experiments, are told their costs, and end with elites.

What is asked depends on the space, the budget, the seed and the costs alone. Costs are minimised; one that is infinite
rejects its configuration for good. The budget is never exceeded, not even by an experiment.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from mercator_design import seeds
from mercator_design.errors import RaceError
from mercator_design.race.racing.history import RaceHistory
from mercator_design.race.racing.race import Experiment, check_costs
from mercator_design.race.racing.summary import Elite, IterationSummary, Progress
from mercator_design.race.space.parameter import Configuration, Value
from mercator_design.race.space.space import Space

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Batches = Generator[list[Experiment], Sequence[float], None]


class Optimizer(ABC):
    """A method at work on a space.

    Args:
        space: What to configure.
        budget: How many experiments to make at most.
        seed: Of everything that is random here.

    Attributes:
        options: What else makes the method what it is.
        history: What was tried, what it cost, and what came of it.
        notes: What differs from what a user may expect.
        stop_reason: Why there are no more iterations, None as long as there may be.

    Raises:
        RaceError: The budget or seed is not a whole number, or the space leaves nothing to choose.
    """

    options: "DataclassInstance"

    def __init__(self, space: Space, *, budget: int, seed: int) -> None:
        self.space = space
        self.budget = _whole("budget", budget, 1)
        self.seed = _whole("seed", seed, 0)
        if space.n_variable == 0:
            raise RaceError("space: expected at least one parameter with more than one value, found none")
        self.history = RaceHistory(space)
        self.notes: list[str] = []
        self.stop_reason: str | None = None

        self._iteration = 0
        self._batches = self._run()
        self._batch: list[Experiment] | None = None
        self._error: RaceError | None = None

    @property
    @abstractmethod
    def progress(self) -> Progress:
        """Where the race stands."""

    @abstractmethod
    def lookahead(self, n: int) -> list[Experiment]:
        """At most n experiments that `ask` will probably give next, after those it has given."""

    @property
    def returning(self) -> set[int]:
        """The configurations of iterations that have ended that may run again."""
        return set(self.history.elite_configurations)

    def beside(self, instance: int) -> list[int]:
        """The configurations that compete with those that are asked for, and that have been on an instance before."""
        return [number for number in self.history.elite_configurations if instance in self.history.costs[number]]

    def revise(self, costs: Mapping[Experiment, float]) -> None:
        """Replace costs that were told; one that is infinite rejects its configuration.

        Raises:
            RaceError: All configurations of the race have been rejected.
        """
        self.history.revise(costs)

    @abstractmethod
    def _run(self) -> Batches:
        """The whole algorithm, up to the end of the budget; each batch it yields is sent its costs."""

    @property
    def configurations(self) -> list[Configuration]:
        """All that were ever proposed; an experiment names one by its place in this list."""
        return self.history.configurations

    @property
    def parents(self) -> list[int | None]:
        """The configuration that each of these comes from, None if from no other."""
        return self.history.parents

    @property
    def elites(self) -> list[Elite]:
        """The best of the last iteration that has ended, best first."""
        return self.history.elites

    @property
    def iterations(self) -> list[IterationSummary]:
        """Summaries of the iterations that have ended."""
        return self.history.iterations

    @property
    def used(self) -> int:
        """Experiments told."""
        return self.history.n_told

    @property
    def iteration(self) -> int:
        """The present iteration, from 1; 0 before the first `ask`."""
        return self._iteration

    @property
    def best(self) -> Elite:
        """The best of the elites.

        Raises:
            RaceError: No iteration has ended yet.
        """
        if not self.elites:
            raise RaceError("race: expected an iteration to have ended before its best is asked for, found none")
        return self.elites[0]

    def costs(self, configuration: int) -> dict[int, float]:
        """The costs of a configuration so far, by instance."""
        return dict(self.history.costs[configuration])

    def statistics(self, configuration: int) -> Elite:
        """The costs of a configuration in short; it must have some."""
        return self.history.statistics(configuration)

    def ask(self) -> list[Experiment]:
        """The next experiments, the same until their costs are told; none at the end.

        Raises:
            RaceError: The options leave the first iteration too small a budget, or too little is allowed.
        """
        if self._batch is None:
            self._advance(lambda: next(self._batches))
        return list(self._batch or [])

    def tell(self, costs: Sequence[float]) -> None:
        """The costs of the experiments that `ask` gave, in their order.

        Raises:
            RaceError: There is not one number for each experiment (then nothing has changed), or all
                configurations of the race have been rejected.
        """
        if not self._batch:
            raise RaceError("tell: expected costs only after `ask` gave experiments, found none asked for")
        check_costs(self._batch, costs)
        self.history.record(self._batch, costs)
        values = [float(cost) for cost in costs]
        self._advance(lambda: self._batches.send(values))

    def extend(self, budget: int) -> None:
        """Go on with a larger budget after the end.

        Raises:
            RaceError: The race has not ended yet, or the budget is no larger.
        """
        if self.ask():
            raise RaceError("extend: expected the race to have ended, found experiments that are asked for")
        self.budget = _whole("budget", budget, self.budget + 1)
        self.stop_reason = None
        self._batches = self._run()
        self._batch = None

    def _advance(self, step: Callable[[], list[Experiment]]) -> None:
        """Find what to ask for next; that a race cannot go on is raised again whenever it is asked."""
        if self._error is not None:
            raise self._error
        try:
            self._batch = step()
        except StopIteration:
            self._batch = []
        except RaceError as error:
            self._batch, self._error = None, error
            raise

    def _checked(self, initial: Sequence[Mapping[str, Value]]) -> list[Configuration]:
        """Configurations to begin with.

        Raises:
            RaceError: One is not valid, or there twice.
        """
        found: dict[tuple[Value | None, ...], Configuration] = {}
        for number, given in enumerate(initial, start=1):
            configuration = dict(given)
            try:
                self.space.check(configuration)
            except RaceError as error:
                raise RaceError(f"initial configuration {number}: {error}") from None
            if self.space.key(configuration) in found:
                raise RaceError(f"initial configuration {number}: expected a new one, found it twice")
            found[self.space.key(configuration)] = configuration
        return list(found.values())

    def _generator(self, purpose: str) -> np.random.Generator:
        return seeds.generator(self.seed, f"race, iteration {self._iteration}, {purpose}")


def _whole(name: str, value: int, least: int) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
        raise RaceError(f"{name}: expected a whole number, {least} or more, found {value!r}")
    return int(value)
