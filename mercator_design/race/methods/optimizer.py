"""The base class of all methods: `ask` gives experiments, `tell` takes their costs, `elites` are the best.

What `ask` gives depends only on the space, the budget, the seed and the costs. Costs are minimised; an infinite cost
rejects its configuration for the whole race. The budget is never exceeded.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from mercator_design import seeds
from mercator_design.errors import RaceError, described
from mercator_design.race.elimination.history import RaceHistory
from mercator_design.race.elimination.race import Cost, Experiment, check_costs
from mercator_design.race.elimination.summary import Elite, IterationSummary, Progress
from mercator_design.race.space.parameter import Configuration, Key, Value, key_of
from mercator_design.race.space.space import Space

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


class Upcoming(NamedTuple):
    """What the next batch will most probably have, known before its other configurations, which take time to propose.

    experiments: In their order.
    configurations: Of these experiments, by numbers that new ones will most probably have.
    """

    experiments: list[Experiment]
    configurations: Mapping[int, Configuration]


Batches = Generator[list[Experiment] | Upcoming, Sequence[float], None]


class Optimizer(ABC):
    """A method that optimizes over a space.

    Args:
        space: What to configure.
        budget: Maximum number of experiments.
        seed: Seed of all random draws.

    Attributes:
        options: The method's options.
        history: Configurations, costs and elites.
        notes: Notes for the user, for example on a reduced plan.
        iteration: The current one, from 1; 0 before the first `ask` or `upcoming`.
        stop_reason: Why there are no more iterations; None while there may be.

    Raises:
        RaceError: The budget or seed is not a whole number, or the space leaves nothing to choose.
    """

    SEVERAL_COSTS: ClassVar = False
    """Whether it ranks configurations by several costs of an experiment, without summing them."""
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
        self.iteration = 0
        self._n_iterations = 0
        self._alive: list[int] = []  # of the current iteration, while it runs
        self._best: Elite | None = None  # of the current iteration, where it is known
        self._upcoming: Upcoming | None = None
        self._batches = self._run()
        self._batch: list[Experiment] | None = None
        self._error: RaceError | None = None

    @property
    def progress(self) -> Progress:
        """The progress of the race."""
        return Progress(
            iteration=self.iteration,
            iterations=self._n_iterations,
            alive=len(self._alive) or len(self.elites),
            used=self.used,
            budget=self.budget,
            best=self._best or (self.elites[0] if self.elites else None),
        )

    @abstractmethod
    def lookahead(self, n: int, known: Mapping[Experiment, float] | None = None) -> list[Experiment]:
        """At most n experiments that `ask` will probably give after the current batch.

        Args:
            n: Maximum number.
            known: Costs of experiments of the current batch that have run; a method may do without.
        """

    @property
    def may_run_again(self) -> set[int]:
        """The configurations of ended iterations that may run again."""
        return set(self.history.elite_configurations)

    def competitors(self, instance: int) -> list[int]:
        """The configurations that compete with the current batch and already have a result on an instance."""
        return [number for number in self.history.elite_configurations if instance in self.history.costs[number]]

    def revise(self, costs: Mapping[Experiment, float]) -> None:
        """Replace known costs; an infinite cost rejects its configuration.

        Raises:
            RaceError: All configurations of the race have been rejected.
        """
        self.history.revise(costs)

    @abstractmethod
    def _run(self) -> Batches:
        """The algorithm, to the end of the budget: a generator that yields batches and is sent their costs.

        Before it proposes configurations, it may yield what is upcoming.
        """

    @property
    def configurations(self) -> list[Configuration]:
        """All proposed configurations; an experiment refers to one by its index in this list."""
        return self.history.configurations

    @property
    def parents(self) -> list[int | None]:
        """The number of each configuration's parent; None if it has none."""
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
        """Experiments whose costs are known."""
        return self.history.n_told

    @property
    def best(self) -> Elite:
        """The best of the elites.

        Raises:
            RaceError: No iteration has ended yet.
        """
        if not self.elites:
            raise RaceError("race: best: expected an iteration that has ended, found none")
        return self.elites[0]

    def costs(self, configuration: int) -> dict[int, float]:
        """The costs of a configuration so far, by instance."""
        return dict(self.history.costs[configuration])

    @property
    def upcoming(self) -> Upcoming | None:
        """What `ask` will most probably give, if it has to propose other configurations first; else None.

        To know it, the race advances to this point.

        Raises:
            RaceError: As `ask`.
        """
        if self._batch is None and self._upcoming is None:
            self._advance(lambda: next(self._batches))
        return self._upcoming

    def ask(self) -> list[Experiment]:
        """The next experiments; the same until `tell` has their costs; none at the end.

        Raises:
            RaceError: The budget is too small for a first iteration, or too few configurations are allowed.
        """
        while self._batch is None:
            self._advance(lambda: next(self._batches))
        return list(self._batch)

    def tell(self, costs: Sequence[Cost]) -> None:
        """Take the costs of the experiments that `ask` gave, in their order.

        Methods with SEVERAL_COSTS also take tuples, of a cost by each objective, and an infinite cost for a failure.

        Raises:
            RaceError: There is not one cost for each experiment (then nothing changes), or all configurations of the
                race have been rejected.
        """
        if not self._batch:
            raise RaceError("tell: expected `ask` to be called before, found no experiments")
        check_costs(self._batch, costs)
        self.history.record(self._batch, costs)
        values = [float(cost[0] if isinstance(cost, tuple) else cost) for cost in costs]
        self._advance(lambda: self._batches.send(values))

    def extend(self, budget: int) -> None:
        """Continue with a larger budget after the end.

        Raises:
            RaceError: The race has not ended yet, or the budget is no larger.
        """
        if self.ask():
            raise RaceError("extend: expected the race to have ended, found experiments without costs")
        self.budget = _whole("budget", budget, self.budget + 1)
        self.stop_reason = None
        self._batches = self._run()
        self._batch = None

    def _advance(self, step: Callable[[], list[Experiment] | Upcoming]) -> None:
        """Compute the next batch, or what is upcoming. After an error, or Ctrl-C, later calls raise a RaceError."""
        if self._error is not None:
            raise self._error
        try:
            found = step()
            self._batch, self._upcoming = (None, found) if isinstance(found, Upcoming) else (found, None)
        except StopIteration:
            self._batch, self._upcoming = [], None
        except BaseException as error:
            self._batch = self._upcoming = None
            self._error = (
                error
                if isinstance(error, RaceError)
                else RaceError(
                    f"race: cannot continue after {described(error)}; run it again, or resume it from its journal"
                )
            )
            raise

    def _end_iteration(self, summary: IterationSummary, elites: Sequence[int], newcomers: Sequence[int]) -> None:
        """Make configurations the elites, and keep the summary."""
        self.history.elites = [self.history.statistics(number) for number in elites]
        self.history.conclude(summary, newcomers, self.budget)

    def _checked(self, initial: Sequence[Mapping[str, Value]]) -> list[Configuration]:
        """The initial configurations.

        Raises:
            RaceError: One is not valid, or given twice.
        """
        found: dict[Key, Configuration] = {}
        for number, given in enumerate(initial, start=1):
            configuration = dict(given)
            try:
                self.space.check(configuration)
            except RaceError as error:
                raise RaceError(f"initial configuration {number}: {error}") from None
            if key_of(configuration) in found:
                raise RaceError(f"initial configuration {number}: expected a new one, found it twice")
            found[key_of(configuration)] = configuration
        return list(found.values())

    def _generator(self, purpose: str) -> np.random.Generator:
        return seeds.generator(self.seed, f"race, iteration {self.iteration}, {purpose}")


def _whole(name: str, value: int, minimum: int) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < minimum:
        raise RaceError(f"{name}: expected a whole number, {minimum} or more, found {value!r}")
    return int(value)
