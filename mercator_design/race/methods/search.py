"""Plain search: configurations run on the same instances in the same order, and the best mean wins.

No race in the sense of irace: configurations are compared with the best alone, and those that are not pruned run on as
many instances as all others.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Protocol

import numpy as np

from mercator_design.errors import RaceError
from mercator_design.race.methods.optimizer import Batches, Optimizer
from mercator_design.race.racing.race import ALL_REJECTED, Experiment
from mercator_design.race.racing.statistics import concordance, signed_rank_p_value
from mercator_design.race.racing.summary import IterationSummary, Progress
from mercator_design.race.space.parameter import Configuration, Value
from mercator_design.race.space.space import Space

_MAX_ELITES = 5
_MAX_TRIES = 100
"""Proposals that are not new or not allowed, one after another, before none is expected any more."""


class Proposal:
    """A configuration that a sampler proposes, and what the sampler is told of it: nothing, here."""

    def __init__(self, configuration: Configuration) -> None:
        self.configuration = configuration

    def finish(self, cost: float | None) -> None:
        """Take in what the configuration costs in the mean, None if it is not allowed."""


class Sampler(Protocol):
    """Where proposals come from."""

    def __call__(self, given: Configuration | None = None) -> Proposal:
        """The next, which is the given configuration if there is one."""
        ...


class MakeSampler(Protocol):
    """Makes a sampler."""

    def __call__(self, space: Space, *, seed: int, generation: int) -> Sampler: ...


@dataclass(frozen=True, kw_only=True, slots=True)
class SearchOptions:
    """How a search spends its budget.

    Args:
        instances: On which each configuration runs, unless it is pruned.
        generation: Configurations that are proposed together, and then run, before any other is proposed. What is
            proposed does so not depend on how many can be run at once, or on how long that takes.
        pruning: A configuration is dropped when Wilcoxon's signed-rank test gives that it is worse than the best so far
            with a p-value below this, and its mean is higher, too, than that of all the best's results. That is the
            rule of Optuna's WilcoxonPruner, whose own value is 0.1; but the test is exact, with ties or not, and takes
            50 µs where scipy's takes up to 100 ms. None prunes nothing.
    """

    instances: int
    generation: int
    pruning: float | None = None


class Search(Optimizer):
    """A search with a sampler.

    The winner, and the order of the elites: more instances before fewer, and among equals the least mean. A pruned
    configuration has seen fewer instances than others, so it does not win. What the generations leave of the budget
    goes to the best few, an instance at a time. An extended search runs new configurations on all instances seen until
    then.

    Args:
        space: What to configure.
        budget: How many experiments to make at most.
        seed: Of everything that is random here.
        options: How it is spent.
        sampler: Proposes configurations.
        initial: Configurations to begin with.

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
        self._alive: list[int] = []  # of the present generation, while it runs
        self._instances = range(0)  # that come after the one asked for
        self._n_iterations = 0
        self._means: dict[int, float] = {}  # of all that have run, as the sampler was told

    @property
    def progress(self) -> Progress:
        return Progress(
            iteration=self._iteration,
            iterations=self._n_iterations,
            alive=len(self._alive) or len(self.elites),
            used=self.used,
            budget=self.budget,
            best=self.elites[0] if self.elites else None,
        )

    def lookahead(self, n: int) -> list[Experiment]:
        coming = (Experiment(number, instance) for instance in self._instances for number in self._alive)
        return list(islice(coming, n))

    @property
    def _n_instances(self) -> int:
        """That a configuration of the next generation has to run on: all that were seen."""
        return max(self.options.instances, self.elites[0].n_results if self.elites else 0)

    def _run(self) -> Batches:
        while (n := min(self.options.generation, (self.budget - self.used) // self._n_instances)) > 0:
            proposals = self._proposals(n)
            if not proposals:
                self.stop_reason = "no configuration was found that has not run"
                break
            self._iteration += 1
            # More, if some are pruned.
            left = (self.budget - self.used) / (self._n_instances * self.options.generation)
            self._n_iterations = self._iteration - 1 + math.ceil(left)
            yield from self._generation(proposals)
        else:
            self.stop_reason = "the budget left is too small for another configuration"
        self._n_iterations = self._iteration
        if self.used < self.budget:
            yield from self._confirm()

    def _proposals(self, n: int) -> dict[int, list[Proposal]]:
        """Up to n new configurations, by number; some are proposed more than once."""
        found: dict[int, list[Proposal]] = {}
        tries = 0
        while len(found) < n and tries < _MAX_TRIES:
            proposal = self._sampler(self._initial.pop(0) if self._initial else None)
            number = self.history.number(proposal.configuration)
            tries += 1
            if self.history.is_excluded(proposal.configuration):
                proposal.finish(None)
            elif number is None:
                (number,) = self.history.add([(proposal.configuration, None)])
                found[number] = [proposal]
                tries = 0
            elif number in found:
                found[number].append(proposal)
            else:
                proposal.finish(self._means[number])
        if len(self.configurations) < 2:
            raise RaceError(
                "space: expected several different configurations to be allowed, "
                f"found {['none', 'one'][len(self.configurations)]}"
            )
        return found

    def _generation(self, proposals: dict[int, list[Proposal]]) -> Batches:
        """Run new configurations, and let the sampler know."""
        before, n_instances, waiting = self.used, self._n_instances, list(proposals)
        while self.options.pruning is not None and waiting and not self.elites:  # the first that others compare with
            yield from self._run_through(waiting[:1], n_instances)
            self._rank(waiting[:1])
            del waiting[0]
        yield from self._run_through(waiting, n_instances)
        for number, same in proposals.items():
            if not self.history.is_rejected(number):
                self._means[number] = self.statistics(number).mean
            for proposal in same:
                proposal.finish(self._means.get(number))
        self._rank(proposals)
        if not self.elites:
            raise RaceError(ALL_REJECTED)
        alive = [
            number for number in proposals if number in self._means and len(self.history.costs[number]) == n_instances
        ]
        self._end_iteration(list(proposals), alive, budget=len(proposals) * n_instances, used=self.used - before)

    def _run_through(self, numbers: Sequence[int], n_instances: int) -> Batches:
        """Run configurations on all instances, but for those that are pruned or rejected."""
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
        """Whether to prune a configuration, from its results on instances that the best has seen, too."""
        if self.options.pruning is None or not self.elites:
            return False
        own, others = self.history.costs[number], self.history.costs[self.best.configuration]
        if sum(own.values()) / len(own) <= self.best.mean:
            return False
        differences = np.array([cost - others[instance] for instance, cost in own.items() if instance in others])
        return signed_rank_p_value(differences) < self.options.pruning

    def _confirm(self) -> Batches:
        """Spend what is left on the best, an instance that they have not seen at a time."""
        self._iteration += 1
        before, first = self.used, self.elites[0].n_results
        raced = [elite.configuration for elite in self.elites if elite.n_results == first]
        while (left := self.budget - self.used) > 0:
            most = self.elites[0].n_results
            self._alive = [elite.configuration for elite in self.elites if elite.n_results == most][:left]
            self._instances = range(most + 1, most + left // len(self._alive))
            yield [Experiment(number, most) for number in self._alive]
            self._rank([])
            if not self.elites:
                raise RaceError(ALL_REJECTED)
        alive = [number for number in raced if not self.history.is_rejected(number)]
        self._end_iteration(raced, alive, budget=self.budget - before, used=self.used - before, postselection=True)

    def _rank(self, newcomers: Iterable[int]) -> None:
        """Choose the elites from those there were and newcomers; from all, if these have been rejected."""
        former = [elite.configuration for elite in self.elites]
        accepted = [number for number in dict.fromkeys([*former, *newcomers]) if not self.history.is_rejected(number)]
        if not accepted:
            accepted = [number for number in self._means if not self.history.is_rejected(number)]
        ranked = sorted(map(self.statistics, accepted), key=lambda one: (-one.n_results, one.mean))
        self.history.elites = ranked[:_MAX_ELITES]

    def _end_iteration(
        self, raced: list[int], alive: list[int], *, budget: int, used: int, postselection: bool = False
    ) -> None:
        """Note what an iteration was."""
        self._alive, self._instances = [], range(0)
        n_instances = min((len(self.history.costs[number]) for number in alive), default=0)
        costs = np.array([list(self.history.costs[number].values())[:n_instances] for number in alive])
        newcomers = [] if postselection else raced
        summary = IterationSummary(
            iteration=self._iteration,
            postselection=postselection,
            budget=budget,
            used=used,
            n_configurations=len(raced),
            n_new=len(newcomers),
            n_instances=n_instances,
            n_alive=len(alive),
            elites=tuple(self.elites),
            soft_restart=False,
            stop_reason="all instances were seen" if alive else "all were pruned or rejected",
            survivors=tuple(alive),
            concordance=concordance(costs.T.reshape(n_instances, len(alive))),
        )
        self.history.conclude(summary, newcomers, self.budget)
