"""Generations by successive halving: many new configurations run once, the better half goes on, until a few are left.

The noise of one experiment is large beside the differences between good designs, and instances explain little of it. So
it pays to look at many configurations with a single experiment each, and to repeat only those that look good, and more
often the fewer are left (Karnin et al. 2013, Almost optimal exploration in multi-armed bandits; Jamieson and Talwalkar
2016, Non-stochastic best arm identification). Configurations that have run on different instances are compared by their
expected costs (additive_model.py).
"""

import math
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from numbers import Integral
from typing import NamedTuple

import numpy as np

from mercator_design.errors import RaceError
from mercator_design.race.elimination.additive_model import expected, table
from mercator_design.race.elimination.history import RaceHistory
from mercator_design.race.elimination.race import ALL_REJECTED, Experiment
from mercator_design.race.elimination.stagnation import stagnates
from mercator_design.race.elimination.statistics import mid_ranks
from mercator_design.race.elimination.summary import IterationSummary
from mercator_design.race.methods.optimizer import Batches, Optimizer, Upcoming
from mercator_design.race.proposals.newcomers import Child, Newcomers
from mercator_design.race.space.parameter import Configuration, Value
from mercator_design.race.space.space import Space

MIN_BUDGET = 20
_MAX_FINALISTS = 8
_MAX_FIRST = 10_000
_MAX_LATER = 1000
"""Maximum numbers of newcomers in a generation, for any budget."""
_NO_BUDGET = "the budget left is too small for another generation"


@dataclass(frozen=True, kw_only=True, slots=True)
class HalvingOptions:
    """How a race by halving spends its budget.

    Args:
        first: Part of the budget for the first generation.
        simple: Part of the first generation that are simple configurations of the space's structure, if it has one; a
            Latin hypercube gives the others.
        surrogate: Part of later newcomers that a surrogate proposes; the others are neighbours of elites.
        structure: Whether to use the space's structure, if it has one: for simple configurations, for neighbours, and
            to bring newcomers into canonical form.
        elites: Number of configurations that a generation ends with.
        rung: Experiments in each rung of a generation, as a part of the newcomers of a later generation, rounded to
            whole instances: where there are few configurations, they run on several. 0 means one instance in each rung.
        confirmation: Part of the budget that is reserved for the confirmation of the winner.
        stop_when_stagnant: Whether the race ends when it stagnates (stagnation.py), after the confirmation.

    Raises:
        RaceError: An option is out of range.
    """

    first: float = 0.4
    simple: float = 0.7
    surrogate: float = 0.5
    structure: bool = True
    elites: int = 5
    rung: float = 0.75
    confirmation: float = 0.15
    stop_when_stagnant: bool = False

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            is_count = one.name == "elites"
            is_valid = value >= 2 and isinstance(value, Integral) if is_count else 0 <= value <= 1
            if not is_valid:
                expected = "a whole number, 2 or more" if is_count else "0 to 1"
                raise RaceError(f"race option {one.name}: expected {expected}, found {value}")
        if self.first + self.confirmation > 1:
            raise RaceError(
                f"race option first: expected at most {1 - self.confirmation:g}, so that the confirmation has its "
                f"part, found {self.first}"
            )


def by_expectation(history: RaceHistory, numbers: Sequence[int]) -> list[int]:
    """Sort configurations by expected mean cost, the best first; drop those that were rejected or have not run.

    With several objectives, they are sorted by the sum of their ranks by the expected cost of each.
    """
    accepted = [number for number in numbers if history.costs[number] and not history.is_rejected(number)]
    if not accepted:
        return []
    means = np.array([expected(table([own[number] for number in accepted])) for own in history.tables])
    order = np.argsort(mid_ranks(means)[0].sum(axis=0) if len(means) > 1 else means[0], kind="stable")
    return [accepted[k] for k in order]


def _in_likely_order(known: Mapping[Experiment, float], before: Sequence[int]) -> list[int]:
    """Sort configurations by what is known of a batch: in a hundredth of the time of `by_expectation`, and nearly so.

    A configuration counts by its mean difference from others on the same instances, and by its rank before.

    Args:
        known: Costs of some experiments.
        before: Configurations with earlier results, the best first; all of the batch, or none counts by its rank.
    """
    of_instance: dict[int, list[float]] = {}
    for one, cost in known.items():
        if cost != math.inf:
            of_instance.setdefault(one.instance, []).append(cost)
    means = {instance: sum(costs) / len(costs) for instance, costs in of_instance.items()}
    differences: dict[int, list[float]] = {}
    for one, cost in known.items():
        differences.setdefault(one.configuration, []).append(cost - means.get(one.instance, 0.0))
    values = {number: sum(own) / len(own) for number, own in differences.items() if math.inf not in own}
    ranked = sorted(values, key=values.__getitem__)
    place = {number: k for k, number in enumerate(before)}
    if not differences.keys() <= place.keys():
        return ranked
    return sorted(ranked, key={number: k + place[number] for k, number in enumerate(ranked)}.__getitem__)


class _Rung(NamedTuple):
    """A step of a generation: so many configurations run on new instances, and the worse half is dropped."""

    n: int
    n_instances: int


class Halving(Optimizer):
    """A race by halving over a space.

    In each generation, elites and newcomers run on a new instance, or few of them on several, and the worse half is
    dropped; the others run on the next ones, and so on. At the end, the best elites of all generations run on new
    instances to confirm the winner.

    Args:
        space, budget, seed: As `Optimizer`.
        options: How the budget is spent.
        initial: The first configurations.

    Attributes:
        parents: The elite that a configuration is a neighbour of, or the most similar elite if the surrogate proposed
            it; None in the first generation.

    Raises:
        RaceError: As all methods; or the budget is below 20, or an initial configuration is not valid.
    """

    SEVERAL_COSTS = True
    options: HalvingOptions

    def __init__(
        self,
        space: Space,
        *,
        budget: int,
        seed: int,
        options: HalvingOptions | None = None,
        initial: Sequence[Mapping[str, Value]] = (),
    ) -> None:
        super().__init__(space, budget=budget, seed=seed)
        self.options = options or HalvingOptions()
        if self.budget < MIN_BUDGET:
            raise RaceError(f"budget: expected at least {MIN_BUDGET} experiments, found {budget}")
        self._initial = self._checked(initial)
        self._newcomers = Newcomers(space, self.history, structure=self.options.structure)
        self._coming: list[_Rung] = []  # what comes after the current batch
        self._n_seen = 0  # instances

    @property
    def may_run_again(self) -> set[int]:
        return set(self.history.former_elites)

    def lookahead(self, n: int, known: Mapping[Experiment, float] | None = None) -> list[Experiment]:
        """On the next instances, those that would go on by the order of the costs so far.

        If costs of the current batch are given, they count. Then also those that have none yet, as some of them will go
        on, and what would come after that.
        """
        ranked = [number for number in self._alive if self.history.costs[number]]
        coming, open_yet = self._coming[:1], list[int]()
        if known is not None:
            batch = self._batch or []
            ranked, coming = _in_likely_order(known, ranked), self._coming
            has_cost = {one.configuration for one in known}
            open_yet = [one for one in dict.fromkeys(e.configuration for e in batch) if one not in has_cost]
        likely: list[Experiment] = []
        first = self._n_seen
        for rung in coming:
            instances = range(first, first + rung.n_instances)
            sure = math.ceil(rung.n * len(ranked) / max(len(ranked) + len(open_yet), 1))
            numbers = [*ranked[:sure], *open_yet, *ranked[sure : rung.n]]
            likely += [Experiment(number, instance) for number in numbers for instance in instances]
            first, open_yet = first + rung.n_instances, []
        return likely[: max(min(n, self.budget - self.used - len(self._batch or [])), 0)]

    def _run(self) -> Batches:
        reserved = int(self.options.confirmation * (self.budget - self.used))
        size, end = self._size, self.budget
        if not self.elites:
            children = yield from self._first_children(self.budget - reserved)
            left = self.budget - reserved - self._n_experiments(len(children))
            self._n_iterations = 1 + max(left // self._n_experiments(self.options.elites + size), 0)
            yield from self._generation([], self.history.add(children))
        while n := self._n_affordable(size, left := self.budget - self.used - reserved):
            elites = [elite.configuration for elite in self.elites]
            self.iteration += 1
            self._n_iterations = self.iteration + max(left // self._n_experiments(len(elites) + size) - 1, 0)
            children = yield from self._later_children(n, elites)
            n = self._n_affordable(len(children), left)  # fewer may take more experiments, as instances are whole
            if n == 0:
                self.iteration -= 1  # nothing has run in this one
                self.stop_reason = _NO_BUDGET if children else "no configuration was found that has not run"
                break
            children = children[:n]
            yield from self._generation(elites, self.history.add(children))
            if self.options.stop_when_stagnant and stagnates(self.iterations, self.budget):
                since = self.iteration - self.iterations[-1].stagnant
                self.stop_reason = f"no gain since iteration {since}"
                end = self.used + reserved
                break
        else:
            self.stop_reason = _NO_BUDGET
        self._n_iterations = self.iteration
        yield from self._confirm(end)

    def _first_children(self, max_experiments: int) -> Generator[Upcoming, object, list[Child]]:
        """The first configurations. The given and simple ones are upcoming before the others are sampled."""
        n = min(max(int(self.options.first * self.budget / 2), 2), _MAX_FIRST)
        n = self._n_first(n, max_experiments)
        if n < len(self._initial):
            self.notes.append(f"only {n} of {len(self._initial)} initial configurations fit in the first generation")
        self.iteration = 1
        simple = self._newcomers.simple(n, self._initial, self.options.simple, self._generator("simple"))
        if 0 < len(simple) < n:
            yield self._in_first_rung(dict(enumerate(child for child, _ in simple)), n)
        children = self._newcomers.first(n, simple, self._generator("sampling"))
        if len(children) < 2:
            raise RaceError("space: expected several different configurations to be allowed, found one")
        return children[: self._n_first(len(children), max_experiments)]

    def _later_children(self, n: int, elites: Sequence[int]) -> Generator[Upcoming, object, list[Child]]:
        """Up to n children of elites. Elites and neighbours are upcoming before the surrogate proposes the others."""
        n_proposed = round(self.options.surrogate * n)
        draws = self._generator("neighbours")
        neighbours = self._newcomers.neighbours(n - n_proposed, elites, draws)
        if n_proposed:
            known = {number: self.configurations[number] for number in elites}
            new = enumerate((child for child, _ in neighbours), start=len(self.configurations) + n_proposed)
            yield self._in_first_rung({**known, **dict(new)}, len(elites) + n)
        return self._newcomers.later(
            n,
            elites,
            neighbours,
            n_proposed=n_proposed,
            proposals=self._generator("proposals"),
            draws=draws,
        )

    def _in_first_rung(self, configurations: Mapping[int, Configuration], n: int) -> Upcoming:
        """Configurations in the first rung of a generation that begins with n."""
        instances = range(self._n_seen, self._n_seen + self._rungs(n)[0].n_instances)
        experiments = [Experiment(number, instance) for instance in instances for number in configurations]
        return Upcoming(experiments, configurations)

    def _generation(self, elites: Sequence[int], newcomers: Sequence[int]) -> Batches:
        """Run elites and newcomers on new instances; drop the worse half after each rung, until a few are left."""
        first, before = self._n_seen, self.used
        self._alive = [*elites, *newcomers]
        n = len(self._alive)
        rungs = self._rungs(n)
        for place, (rung, after) in enumerate(pairwise(rungs), start=1):
            self._coming = rungs[place:]
            yield self._on_new_instances(self._alive, rung.n_instances)
            ranked = by_expectation(self.history, self._alive) or self._all_ranked()
            self._alive = ranked[: after.n]
            self._best = self.history.statistics(ranked[0])
        survivors, self._alive, self._best, self._coming = self._alive, [], None, []
        summary = IterationSummary(
            iteration=self.iteration,
            budget=self._n_experiments(n),
            used=self.used - before,
            n_configurations=n,
            n_new=len(newcomers),
            n_instances=self._n_seen - first,
            n_alive=len(survivors),
            stop_reason=f"{len(survivors)} are left",
            survivors=tuple(survivors),
        )
        # Those that ran twice were selected by their first result: a test finds little, except that all cost the same.
        different = {cost for number in newcomers for cost in self.history.costs[number].values()}
        twice = [number for number in newcomers if len(self.history.costs[number]) > 1]
        self._end_iteration(summary, survivors, twice if len(different) == 1 else [])

    def _confirm(self, end: int) -> Batches:
        """Spend what is left, up to `end` experiments in all, on the best elites of all generations.

        A lucky one loses on new instances. All experiments of one halving are one batch.
        """
        order = by_expectation(self.history, self.history.former_elites)
        if len(order) < 2:  # of a space of two configurations, or if almost all elites were rejected
            order = self._all_ranked()
        n_finalists = n_alive = min(len(order), _MAX_FINALISTS, end - self.used)
        if n_finalists < 2:
            return
        self.iteration += 1
        first, before = self._n_seen, self.used
        while n_alive > 1 and (left := end - self.used) > 1:
            alive = order[: min(n_alive, left)]
            n_instances = max(left // (len(alive) * math.ceil(math.log2(len(alive)))), 1)
            n_next = math.ceil(len(alive) / 2)
            self._coming = [_Rung(n_next, math.ceil(n_instances * len(alive) / n_next))] if n_next > 1 else []
            yield self._on_new_instances(alive, n_instances)
            order = by_expectation(self.history, alive) + order[len(alive) :] or self._all_ranked()
            n_alive = min(math.ceil(len(alive) / 2), len(order))
        self._coming = []
        summary = IterationSummary(
            iteration=self.iteration,
            postselection=True,
            budget=end - before,
            used=self.used - before,
            n_configurations=n_finalists,
            n_instances=self._n_seen - first,
            n_alive=n_alive,
            stop_reason="one is left" if n_alive == 1 else "the whole budget is used",
            survivors=tuple(order[:n_alive]),
        )
        self._end_iteration(summary, order[: self.options.elites], [])

    def _on_new_instances(self, numbers: Sequence[int], n_instances: int) -> list[Experiment]:
        first, self._n_seen = self._n_seen, self._n_seen + n_instances
        return [Experiment(number, instance) for instance in range(first, self._n_seen) for number in numbers]

    def _all_ranked(self) -> list[int]:
        """All configurations that are accepted, the best first; for when those in question were rejected."""
        ranked = by_expectation(self.history, range(len(self.configurations)))
        if not ranked:
            raise RaceError(ALL_REJECTED)
        return ranked

    @property
    def _size(self) -> int:
        """Newcomers in a later generation."""
        return min(math.isqrt(self.budget), _MAX_LATER)

    def _rungs(self, n: int) -> list[_Rung]:
        """The rungs of a generation that begins with n configurations; then the first run of those that are left."""
        n_left = min(self.options.elites, math.ceil(n / 2))
        rungs = []
        while n > n_left:
            rungs.append(_Rung(n, max(round(self.options.rung * self._size / n), 1)))
            n = max(math.ceil(n / 2), n_left)
        return [*rungs, _Rung(n_left, 1)]

    def _n_experiments(self, n: int) -> int:
        """The experiments of a generation that begins with n configurations."""
        return sum(rung.n * rung.n_instances for rung in self._rungs(n)[:-1])

    def _n_first(self, size: int, left: int) -> int:
        """The largest number of configurations, up to a size, for the first generation with a budget; 2 at least."""
        return next((n for n in range(size, 2, -1) if self._n_experiments(n) <= left), 2)

    def _n_affordable(self, size: int, left: int) -> int:
        """The largest number of newcomers, up to a size, for a generation with a budget; 0 if it is too small."""
        minimum = min(size, self.options.elites)
        return next((n for n in range(size, minimum - 1, -1) if self._n_experiments(len(self.elites) + n) <= left), 0)
