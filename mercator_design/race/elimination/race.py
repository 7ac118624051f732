"""The race of one iteration: which configurations run on which instance next, and which of them are eliminated.

This is irace's elitist race (race.R, elitist_race) as ask and tell; it runs nothing itself. Elites keep their
results. A later race begins with new instances, then revisits the old ones, on which only the newcomers have
to run. An elite can be eliminated only when the newcomers have run on all instances that it has seen. Before
that, neither the budget nor the number of survivors ends the race: otherwise the elites would have an advantage.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mercator_design.arrays import Floats
from mercator_design.errors import RaceError
from mercator_design.race.elimination.statistics import TestName, eliminate, overall_ranks

ALL_REJECTED = "race: expected some configurations to be accepted, but all were rejected by infinite costs"


class Experiment(NamedTuple):
    """One configuration on one instance, both counted from 0."""

    configuration: int
    instance: int


Cost = float | tuple[float, ...]
"""The cost of an experiment; by several objectives a cost by each, all finite."""


@dataclass(frozen=True, kw_only=True, slots=True)
class RaceRules:
    """When a race tests and when it ends.

    test: which test eliminates.
    confidence: of the test.
    first_test: instances before the first test, a multiple of each_test.
    each_test: instances between tests.
    elitist_limit: tests without elimination that end the race; 0 for no limit.
    """

    test: TestName = "friedman"
    confidence: float = 0.95
    first_test: int = 5
    each_test: int = 1
    elitist_limit: int = 2


def check_costs(experiments: Sequence[Experiment], costs: Sequence[Cost]) -> None:
    """Raise a RaceError unless there is a cost for each experiment, in their order."""
    if len(costs) != len(experiments):
        raise RaceError(f"costs: expected {len(experiments)}, one for each experiment asked for, found {len(costs)}")
    for experiment, cost in zip(experiments, costs, strict=True):
        if any(not isinstance(one, Real) or math.isnan(one) for one in (cost if isinstance(cost, tuple) else (cost,))):
            raise RaceError(
                f"cost of configuration {experiment.configuration} on instance {experiment.instance}: "
                f"expected a number, found {cost!r}"
            )


class EliminationRace:
    """A race over configurations, in batches of one instance each.

    Args:
        configurations: Their numbers, elites first.
        earlier: Earlier results of elites: configuration -> instance -> cost.
        further: The same by each further objective, if there are several.
        instances: The known instances in their order; new ones follow in order of their numbers.
        next_instance: Number of the first instance after these.
        rules: When to test and to end.
        survivors: How many alive configurations end the race.
        planned_budget: Experiments to plan with. A race that has begun with old instances finishes them.
        max_experiments: More than these are never run.
        max_instances: The race ends after so many instances; None: no limit.

    Attributes:
        used: Experiments whose costs are known.
        rejected: Configurations that were rejected by an infinite cost.
        stop_reason: Why the race has ended, None before.

    Raises:
        RaceError: There are no configurations.
    """

    def __init__(
        self,
        configurations: Sequence[int],
        *,
        earlier: Mapping[int, Mapping[int, float]],
        instances: Sequence[int],
        next_instance: int,
        rules: RaceRules,
        survivors: int,
        planned_budget: int,
        max_experiments: int,
        max_instances: int | None = None,
        further: Sequence[Mapping[int, Mapping[int, float]]] = (),
    ) -> None:
        if len(configurations) == 0:
            raise RaceError("race: expected configurations, found none")
        self.configurations = tuple(configurations)
        self.used = 0
        self.rejected: list[int] = []
        self.stop_reason: str | None = None
        self._rules = rules
        self._survivors = survivors
        self._planned_budget = planned_budget
        self._max_experiments = max_experiments
        self._max_instances = math.inf if max_instances is None else max_instances
        self._known = tuple(instances)
        self._next_instance = next_instance
        self._row = 0  # place of the current instance in the order of this race
        self._costs = self._table(earlier)
        self._further = [self._table(one) for one in further]  # costs by each further objective
        self._alive = np.ones(len(self.configurations), dtype=bool)
        # Earlier results of each elite on instances that this race has not reached yet protect it from elimination.
        self._n_results_ahead = (~np.isnan(self._costs)).sum(axis=0)
        self._tests_without_elimination = 0
        self._columns: NDArray[np.intp] | None = None  # columns of the batch that has no costs yet

    @property
    def alive(self) -> list[int]:
        """The configurations that are still in the race."""
        return [self.configurations[column] for column in np.flatnonzero(self._alive)]

    @property
    def n_instances(self) -> int:
        """Number of instances that have been raced on."""
        return self._row

    def ask(self) -> list[Experiment]:
        """The next experiments, all on one instance; none when the race has ended, which `stop_reason` then says."""
        while self._columns is None and self.stop_reason is None:
            if self._row == self._max_instances:
                self.stop_reason = "all instances were used"
                break
            columns = np.flatnonzero(self._alive & np.isnan(self._costs[self._row]))
            if len(columns) == 0:  # only elites are alive, and they have results here
                self._n_results_ahead -= self._n_results_ahead > 0  # one less where there are any
                self._advance()
                continue
            self.stop_reason = self._reason_to_stop(len(columns))
            if self.stop_reason is None:
                self._columns = columns
        if self._columns is None:
            return []
        instance = self._instance(self._row)
        return [Experiment(self.configurations[column], instance) for column in self._columns]

    def _table(self, earlier: Mapping[int, Mapping[int, float]]) -> Floats:
        """Costs of shape (instances, configurations), with room for more instances; NaN where there is none."""
        table = np.full((max(2 * len(self._known), 16), len(self.configurations)), math.nan)
        for column, configuration in enumerate(self.configurations):
            results = earlier.get(configuration, {})
            for row, instance in enumerate(self._known):
                table[row, column] = results.get(instance, math.nan)
        return table

    def tell(self, costs: Sequence[float], further: Sequence[Sequence[float]] = ()) -> None:
        """Take the costs of the experiments that `ask` gave, in their order.

        An infinite cost rejects its configuration.

        Args:
            costs: The costs.
            further: The costs by each further objective, if there are several.

        Raises:
            RaceError: A cost is not a number, or all configurations have been rejected.
        """
        check_costs(self.ask(), costs)
        if further and not self._further:
            self._further = [np.full_like(self._costs, math.nan) for _ in further]
        columns, self._columns = self._columns, None
        if columns is None:
            return
        self._costs[self._row, columns] = costs
        for table, own in zip(self._further, further, strict=True):
            table[self._row, columns] = own
        self.used += len(columns)
        seen_again = self._n_results_ahead > 0
        seen_again[columns] = False
        self._n_results_ahead -= seen_again
        self._reject(columns[np.isinf(self._costs[self._row, columns])])
        self._advance()
        self._test()

    def revise(self, costs: Mapping[Experiment, float]) -> None:
        """Replace costs of alive configurations; an infinite cost rejects its configuration.

        Raises:
            RaceError: All configurations have been rejected.
        """
        rejected = []
        for (configuration, instance), cost in costs.items():
            column = self.configurations.index(configuration)
            self._costs[self._row_of(instance), column] = cost
            if math.isinf(cost):
                rejected.append(column)
        self._reject(np.array(rejected, dtype=np.intp))

    def lookahead(self, n: int) -> list[Experiment]:
        """At most n experiments that come after the current batch, if no configuration is eliminated."""
        found: list[Experiment] = []
        row = self._row + 1
        asked = 0 if self._columns is None else len(self._columns)
        n = max(min(n, self._planned_budget - self.used - asked), 0)
        while len(found) < n and row < self._max_instances:
            known = row < len(self._known)
            if not known and self._alive.sum() <= self._survivors:
                break
            new = self._alive & np.isnan(self._costs[row]) if known else self._alive
            found += [Experiment(self.configurations[column], self._instance(row)) for column in np.flatnonzero(new)]
            row += 1
        return found[:n]

    def ranked(self) -> list[int]:
        """The alive configurations, best first: sorted by number of results, then by the ranks of the test."""
        ranks = self.ranks()
        return sorted(ranks, key=ranks.__getitem__)

    def ranks(self) -> dict[int, float]:
        """The ranks that `ranked` sorts by."""
        columns = np.flatnonzero(self._alive)
        ranks = overall_ranks(self._blocks(max(self._row, len(self._known)), columns), self._rules.test)
        return {self.configurations[column]: float(rank) for column, rank in zip(columns, ranks, strict=True)}

    def _blocks(self, n_rows: int, columns: NDArray[np.intp]) -> Floats:
        """The costs that are ranked, in blocks: an instance each, or each pair of an instance and an objective."""
        tables = [table[:n_rows, columns] for table in (self._costs, *self._further)]
        return tables[0] if len(tables) == 1 else np.vstack(tables)

    def _instance(self, row: int) -> int:
        return self._known[row] if row < len(self._known) else self._next_instance + row - len(self._known)

    def _row_of(self, instance: int) -> int:
        if instance in self._known:
            return self._known.index(instance)
        return len(self._known) + instance - self._next_instance

    def _advance(self) -> None:
        self._row += 1
        if self._row == len(self._costs):
            room = np.full_like(self._costs, math.nan)
            self._costs = np.vstack((self._costs, room))
            self._further = [np.vstack((table, room)) for table in self._further]

    def _reject(self, columns: NDArray[np.intp]) -> None:
        self._alive[columns] = False
        self._n_results_ahead[columns] = 0
        self.rejected += [self.configurations[column] for column in columns]
        if not self._alive.any():
            raise RaceError(ALL_REJECTED)

    def _reason_to_stop(self, n_next: int) -> str | None:
        rules = self._rules
        if self.used + n_next > self._max_experiments:
            return "the whole budget is used"
        if not self._may_stop_fairly():
            return None
        n_alive = int(self._alive.sum())
        if n_alive <= self._survivors:
            return f"{n_alive} are alive, and {self._survivors} or fewer end the race"
        is_test_due = self._row >= rules.first_test and self._row % rules.each_test == 0
        if is_test_due and self.used + n_next * rules.each_test > self._planned_budget:
            return "the budget of the iteration is used"
        if rules.elitist_limit and self._tests_without_elimination >= rules.elitist_limit:
            return f"{self._tests_without_elimination} tests without elimination"
        return None

    def _may_stop_fairly(self) -> bool:
        """Whether all known instances are covered, and all results of alive configurations have been tested."""
        is_known = ~np.isnan(self._costs[self._row : max(self._row, len(self._known)), self._alive])
        counts = self._row + is_known.sum(axis=0)
        return bool(is_known.any(axis=1).all() and (counts % self._rules.each_test == 0).all())

    def _test(self) -> None:
        rules = self._rules
        if self._row < rules.first_test or self._row % rules.each_test:
            return
        dropped = False
        columns = np.flatnonzero(self._alive)
        if len(columns) > 1:
            blocks, several = self._blocks(self._row, columns), bool(self._further)
            verdict = eliminate(blocks, rules.test, rules.confidence, several=several)
            losers = columns[~verdict.survivors & (self._n_results_ahead[columns] == 0)]
            self._alive[losers] = False
            dropped = len(losers) > 0
        # As long as elites are protected, a test that eliminates nothing says nothing about the newcomers.
        if self._row > rules.first_test and not self._n_results_ahead.any():
            self._tests_without_elimination = 0 if dropped else self._tests_without_elimination + 1
