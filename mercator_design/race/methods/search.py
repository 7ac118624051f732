"""Plain search: configurations run on the same instances in the same order, and the best mean wins.

It is not a race in irace's sense: a configuration is compared only with the best one, and runs on all instances unless
it is pruned.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import NamedTuple, Protocol

import numpy as np

from mercator_design.errors import RaceError
from mercator_design.race.elimination.race import ALL_REJECTED, Experiment
from mercator_design.race.elimination.statistics import signed_rank_p_value
from mercator_design.race.elimination.summary import IterationSummary
from mercator_design.race.methods.optimizer import Batches, Optimizer
from mercator_design.race.space.parameter import Configuration, Value
from mercator_design.race.space.space import Space

_MAX_ELITES = 5
_MAX_KNOWN = 100
"""Stop after so many successive proposals that are not new."""
_MAX_EXCLUDED = 10_000
"""Stop after so many successive proposals that are not allowed: most of a space may be forbidden."""


class Proposal(NamedTuple):
    """A configuration that a sampler proposes."""

    configuration: Configuration
    finish: Callable[[float | None], object] = lambda _: None
    """Takes the mean cost of the configuration; None if it is not allowed."""


class Sampler(Protocol):
    """Proposes configurations."""

    def __call__(self, given: Configuration | None = None) -> Proposal:
        """The next proposal; the given configuration if there is one."""


class MakeSampler(Protocol):
    """Makes a sampler."""

    def __call__(self, space: Space, *, seed: int, generation: int) -> Sampler: ...


@dataclass(frozen=True, kw_only=True, slots=True)
class SearchOptions:
    """How a search spends its budget.

    Args:
        instances: Number of instances that each configuration runs on, unless it is pruned.
        generation: Configurations that are proposed together; they run before others are proposed. So proposals do
            not depend on the number of workers or on their speed.
        pruning: A configuration is pruned when it is worse than the best so far (p-value of Wilcoxon's signed-rank
            test below this) and its mean is higher than that of all results of the best. This is the rule of Optuna's
            WilcoxonPruner, whose default is 0.1. Below 50 instances our test is exact, also with ties, and takes 50 µs;
            scipy's takes up to 100 ms. None: no pruning.

    Raises:
        RaceError: An option is out of range.
    """

    instances: int
    generation: int
    pruning: float | None = None

    def __post_init__(self) -> None:
        for name in ("instances", "generation"):
            if (found := getattr(self, name)) < 1:
                raise RaceError(f"race option {name}: expected at least 1, found {found}")
        if self.pruning is not None and not 0 <= self.pruning <= 1:
            raise RaceError(f"race option pruning: expected 0 to 1, found {self.pruning}")


class Search(Optimizer):
    """A search with a sampler.

    Elites are sorted by number of instances, then by mean; the first is the winner. A pruned configuration has seen
    fewer instances than others, so it does not win. The best few use the rest of the budget, one instance after the
    other. An extended search runs new configurations on all instances seen so far.

    Args:
        space, budget, seed: As `Optimizer`.
        options: How the budget is spent.
        sampler: Proposes configurations.
        initial: The first configurations.

    Raises:
        RaceError: As all methods; or the budget is not enough for two configurations, or an initial configuration is
            not valid.
    """

    options: SearchOptions

    def __init__(
        self,
        space: Space,
        *,
        budget: int,
        seed: int,
        options: SearchOptions,
        sampler: MakeSampler,
        initial: Sequence[Mapping[str, Value]] = (),
    ) -> None:
        super().__init__(space, budget=budget, seed=seed)
        self.options = options
        if self.budget < 2 * options.instances:
            raise RaceError(
                f"budget: expected at least {2 * options.instances} experiments, for two configurations on "
                f"{options.instances} instances each, found {budget}"
            )
        self._sampler = sampler(space, seed=seed, generation=options.generation)
        self._initial = self._checked(initial)
        self._instances = range(0)  # after the current one
        self._n_tries = 0  # since the last new configuration
        self._means: dict[int, float] = {}  # of all that have run, as reported to the sampler

    def lookahead(self, n: int, known: Mapping[Experiment, float] | None = None) -> list[Experiment]:  # noqa: ARG002
        coming = (Experiment(number, instance) for instance in self._instances for number in self._alive)
        return list(islice(coming, n))

    def revise(self, costs: Mapping[Experiment, float]) -> None:
        super().revise(costs)
        self._rank([])

    @property
    def _n_instances(self) -> int:
        """Instances that a configuration of the next generation runs on: all that were seen."""
        return max(self.options.instances, self.elites[0].n_results if self.elites else 0)

    def _run(self) -> Batches:
        while (n := min(self.options.generation, (self.budget - self.used) // self._n_instances)) > 0:
            proposals = self._proposals(n)
            if not proposals:
                self.stop_reason = f"no configuration was found within {self._n_tries} draws that has not run"
                break
            self.iteration += 1
            # More, if some are pruned.
            left = (self.budget - self.used) / (self._n_instances * self.options.generation)
            self._n_iterations = self.iteration - 1 + math.ceil(left)
            yield from self._generation(proposals)
        else:
            self.stop_reason = "the budget left is too small for another configuration"
        self._n_iterations = self.iteration
        if self.used < self.budget:
            yield from self._confirm()

    def _proposals(self, n: int) -> dict[int, list[Proposal]]:
        """Up to n new configurations, by number; some are proposed more than once."""
        found: dict[int, list[Proposal]] = {}
        n_known = n_excluded = 0
        while len(found) < n and n_known < _MAX_KNOWN and n_excluded < _MAX_EXCLUDED:
            proposal = self._sampler(self._initial.pop(0) if self._initial else None)
            number = self.history.number(proposal.configuration)
            if self.history.is_excluded(proposal.configuration):
                proposal.finish(None)
                n_excluded += 1
            elif number is None:
                (number,) = self.history.add([(proposal.configuration, None)])
                found[number] = [proposal]
                n_known = n_excluded = 0
            else:
                n_known += 1
                if number in found:
                    found[number].append(proposal)
                else:
                    proposal.finish(self._means[number])
        self._n_tries = n_known + n_excluded
        if len(self.configurations) < 2:
            raise RaceError(
                "space: expected several different configurations to be allowed, "
                f"found {['none', 'one'][len(self.configurations)]} within {self._n_tries} draws"
            )
        return found

    def _generation(self, proposals: dict[int, list[Proposal]]) -> Batches:
        """Run new configurations, and report their means to the sampler."""
        before, n_instances, waiting = self.used, self._n_instances, list(proposals)
        while self.options.pruning is not None and waiting and not self.elites:  # the first best configuration
            yield from self._run_through(waiting[:1], n_instances)
            self._rank(waiting[:1])
            del waiting[0]
        yield from self._run_through(waiting, n_instances)
        for number, same in proposals.items():
            if not self.history.is_rejected(number):
                self._means[number] = self.history.statistics(number).mean
            for proposal in same:
                proposal.finish(self._means.get(number))
        self._rank(proposals)
        if not self.elites:
            raise RaceError(ALL_REJECTED)
        alive = [
            number for number in proposals if number in self._means and len(self.history.costs[number]) == n_instances
        ]
        self._conclude(list(proposals), alive, budget=len(proposals) * n_instances, used=self.used - before)

    def _run_through(self, numbers: Sequence[int], n_instances: int) -> Batches:
        """Run configurations on all instances, except those that are pruned or rejected."""
        self._alive = list(numbers)
        for instance in range(n_instances):
            if not self._alive:
                break
            self._instances = range(instance + 1, n_instances)
            costs = yield [Experiment(number, instance) for number in self._alive]
            self._alive = [
                number
                for number, cost in zip(self._alive, costs, strict=True)
                if not math.isinf(cost) and not self._is_worse(number)
            ]

    def _is_worse(self, number: int) -> bool:
        """Whether to prune a configuration, by its results on instances that the best has also seen."""
        if self.options.pruning is None or not self.elites:
            return False
        own, others = self.history.costs[number], self.history.costs[self.best.configuration]
        if sum(own.values()) / len(own) <= self.best.mean:
            return False
        differences = np.array([cost - others[instance] for instance, cost in own.items() if instance in others])
        return signed_rank_p_value(differences) < self.options.pruning

    def _confirm(self) -> Batches:
        """Spend the rest of the budget on the elites, one new instance after the other."""
        self.iteration += 1
        before, first = self.used, self.elites[0].n_results
        raced = [elite.configuration for elite in self.elites if elite.n_results == first]
        while (left := self.budget - self.used) > 0:
            new = self.elites[0].n_results  # the first instance that the best has not seen
            self._alive = [elite.configuration for elite in self.elites if elite.n_results == new][:left]
            self._instances = range(new + 1, new + left // len(self._alive))
            yield [Experiment(number, new) for number in self._alive]
            self._rank([])
            if not self.elites:
                raise RaceError(ALL_REJECTED)
        alive = [number for number in raced if not self.history.is_rejected(number)]
        self._conclude(raced, alive, budget=self.budget - before, used=self.used - before, postselection=True)

    def _rank(self, newcomers: Iterable[int]) -> None:
        """Select the elites from the former ones and newcomers; from all configurations if these are rejected."""
        former = [elite.configuration for elite in self.elites]
        accepted = [number for number in dict.fromkeys([*former, *newcomers]) if not self.history.is_rejected(number)]
        if not accepted:
            accepted = [number for number in self._means if not self.history.is_rejected(number)]
        ranked = sorted(map(self.history.statistics, accepted), key=lambda one: (-one.n_results, one.mean))
        self.history.elites = ranked[:_MAX_ELITES]

    def _conclude(
        self, raced: list[int], alive: list[int], *, budget: int, used: int, postselection: bool = False
    ) -> None:
        """Record the summary of an iteration."""
        self._alive, self._instances = [], range(0)
        newcomers = [] if postselection else raced
        summary = IterationSummary(
            iteration=self.iteration,
            postselection=postselection,
            budget=budget,
            used=used,
            n_configurations=len(raced),
            n_new=len(newcomers),
            n_instances=min((len(self.history.costs[number]) for number in alive), default=0),
            n_alive=len(alive),
            stop_reason="all instances were seen" if alive else "all were pruned or rejected",
            survivors=tuple(alive),
        )
        self.history.conclude(summary, newcomers, self.budget)
