"""Iterated F-race: race, learn where the survivors lie, sample around them, race again (irace.R, irace_run).

The surrogate, too, learns between races only. Unlike irace's, the budget is never exceeded, not even by an
experiment: a race that would do so ends.
"""

import math
from collections.abc import Mapping, Sequence
from itertools import chain
from typing import TypeVar

import numpy as np

from mercator_design.errors import RaceError
from mercator_design.race.methods.additive_model import Floats, expected, table
from mercator_design.race.methods.model import SamplingModel
from mercator_design.race.methods.optimizer import Batches, Optimizer
from mercator_design.race.methods.proposals import Proposer
from mercator_design.race.methods.sampling import similar, sobol_sample
from mercator_design.race.racing import budget as arithmetic
from mercator_design.race.racing.options import RaceOptions
from mercator_design.race.racing.postselection import select_candidates
from mercator_design.race.racing.race import ALL_REJECTED, Experiment, Race
from mercator_design.race.racing.statistics import concordance
from mercator_design.race.racing.summary import IterationSummary, Progress
from mercator_design.race.space.parameter import Configuration, Value
from mercator_design.race.space.space import Space

Parent = TypeVar("Parent", int, None)

_LEARNT_FROM = 3.0
"""Configurations a parameter before the surrogate has its whole share."""
_MOST_FINALISTS = 8
"""Of the confirmation."""


class IteratedRace(Optimizer):
    """An iterated race over a space.

    Args:
        space: What to configure.
        budget: How many experiments to make at most.
        seed: Of everything that is random here.
        options: Ours unless given; `RaceOptions.irace()` is irace's algorithm.
        initial: Configurations to begin with; the first iteration samples the others.

    Attributes:
        parents: The elite that a configuration was sampled from, or is most like if the surrogate proposed it; None in
            the first iteration.
        elites: The survivors of the last race that has ended, best first.

    Raises:
        RaceError: As all methods; or the budget is not enough for one iteration, or an initial configuration is not
            valid.
    """

    options: RaceOptions

    def __init__(
        self,
        space: Space,
        *,
        budget: int,
        seed: int,
        options: RaceOptions | None = None,
        initial: Sequence[Mapping[str, Value]] = (),
    ) -> None:
        super().__init__(space, budget=budget, seed=seed)
        self.options = options or RaceOptions()
        plan = self._plan()
        if plan.note is not None:
            self.notes.append(plan.note)
        self._survivors = plan.survivors  # that end a race
        self._most_configurations = None if self.options.n_configurations else plan.configurations
        self._n_iterations = plan.iterations
        wanted = self.options.n_configurations
        if wanted is not None and wanted <= plan.survivors:
            raise RaceError(
                f"race option n_configurations: expected more than the {plan.survivors} survivors that end a race, "
                f"found {wanted}"
            )
        self._initial = self._checked(initial)
        self._before = 0  # iterations, that came before the budget was extended and are not counted
        self._n_seen = 0  # instances
        self._n_new_instances = self.options.new_instances
        self._model = SamplingModel(
            space,
            elitist=self.options.elitist,
            ordered_as_integers=self.options.ordered_as_integers,
            means_scale=self.options.means_scale,
        )
        self._proposer: Proposer | None = None
        self._is_exhausted = False
        self._race: Race | None = None

    @property
    def _confirms(self) -> bool:
        """Whether the winner is confirmed, for which there must be instances that nobody has seen."""
        return self.options.confirmation > 0 and self.options.instances is None

    @property
    def _remaining(self) -> int:
        """Of the budget, for iterations."""
        return self.budget - self._kept - self._used

    @property
    def progress(self) -> Progress:
        best = self.elites[0] if self.elites else None
        if self._race is not None:
            leader = self._race.ranked()[0]
            best = self.statistics(leader) if self._costs[leader] else best
        return Progress(
            iteration=self._iteration,
            iterations=self._n_iterations,
            alive=len(self.elites) if self._race is None else len(self._race.alive),
            used=self._used,
            budget=self.budget,
            best=best,
        )

    @property
    def returning(self) -> set[int]:
        if self._confirms:
            return set(self._former_elites())
        if self.options.elitist and self.options.postselection:
            return set(range(len(self.configurations)))
        return super().returning

    def beside(self, instance: int) -> list[int]:
        if self._race is None:
            return super().beside(instance)
        return [number for number in self._race.alive if instance in self._costs[number]]

    def revise(self, costs: Mapping[Experiment, float]) -> None:
        super().revise(costs)
        if self._race is not None:
            self._race.revise(costs)

    def foresee(self, n: int) -> list[Experiment]:
        return [] if self._race is None else self._race.foresee(n)

    def extend(self, budget: int) -> None:
        """Go on with a larger budget after the end.

        What is added is planned as the budget of a race of its own is: as many iterations, or fewer until it suffices.
        The first of them takes the place of a second one: it begins with the elites that the race has ended with, their
        distributions as wide as after a first iteration.

        Raises:
            RaceError: The race has not ended yet, or the budget is no larger.
        """
        super().extend(budget)
        self._before = self._iteration - 1
        try:
            plan = self._plan()
        except RaceError:  # not enough for an iteration by itself; perhaps for one that has elites
            self._n_iterations = self._iteration + 1
        else:
            self._n_iterations = self._iteration + plan.iterations
            self._most_configurations = None if self.options.n_configurations else plan.configurations
        self._n_new_instances = self.options.new_instances
        self._model.initialise(self._elite_configurations())

    def _plan(self) -> arithmetic.Plan:
        """Plan what is left of the budget, some of which is kept for the confirmation if an iteration fits beside."""
        left, self._kept = self.budget - self._used, 0
        plan = arithmetic.plan(
            left,
            n_variable=self.space.n_variable,
            mu=self.options.planned_mu,
            each_test=self.options.instances_each_test,
            n_new=self.options.new_instances,
            elitist=self.options.elitist,
            iterations=self.options.iterations,
            survivors=self.options.survivors,
        )
        if self._confirms:
            self._kept = min(int(self.options.confirmation * left), left - plan.least)
        return plan

    def _run(self) -> Batches:
        while not isinstance(planned := self._plan_iteration(self._iteration + 1), str):
            self._iteration, budget, n = planned
            self._n_iterations = max(self._n_iterations, self._iteration)
            yield from self._later_race(budget, n) if self.elites else self._first_race(budget, n)
        if not self.iterations:
            raise RaceError(f"race: expected a budget for a first iteration, but {planned}")
        self.stop_reason = planned
        self._n_iterations = self._iteration
        if self._confirms:
            yield from self._confirm()
        elif self.options.elitist and self.options.postselection:
            yield from self._postselect()

    def _plan_iteration(self, iteration: int) -> tuple[int, int, int] | str:
        """Number, budget and number of configurations of an iteration, or why there is none."""
        remaining = self._remaining
        if remaining <= 0:
            return "the whole budget is used"
        if self._is_exhausted:
            return "no configuration was found that has not run"
        if iteration > self._n_iterations and self.options.iterations is not None:
            return f"all {self._n_iterations} iterations are done"
        share = arithmetic.iteration_budget(remaining, iteration, max(iteration, self._n_iterations))
        budget = min(self.options.experiments_per_iteration or share, remaining)
        n = self._n_configurations(budget, iteration - self._before)
        wanted = self.options.n_configurations
        if wanted is not None and n < wanted:
            if budget == share < remaining:
                return self._plan_iteration(iteration + 1)
            return f"the budget left is too small to race {wanted} configurations"
        n = n if wanted is None else wanted
        n_elites = len(self.elites)
        if n <= self._survivors:
            return f"the budget left is too small to race more than {self._survivors} configurations"
        if n <= n_elites:
            return "the budget left is too small to sample configurations"
        mu = self.options.planned_mu
        needed = n * mu
        if self.options.elitist:
            needed = (n - n_elites) * mu + n_elites * min(self._n_new, mu)
        return "the budget left is too small to test configurations" if needed > budget else (iteration, budget, n)

    def _n_configurations(self, budget: int, iteration: int) -> int:
        """As many as the budget allows, if need be without new instances, and then with few instances at all."""
        keeping = self.options.elitist and bool(self.elites)
        n_elites, n_old = (len(self.elites), self._n_seen) if keeping else (0, 0)

        def fitting(growth: int, mu: int) -> int:
            n_new = self._n_new if keeping else 0
            each_test = self.options.instances_each_test
            return arithmetic.n_configurations(
                budget, growth, mu=mu, each_test=each_test, n_elites=n_elites, n_old=n_old, n_new=n_new
            )

        n = fitting(iteration, self.options.planned_mu)
        if n <= self._survivors:
            self._n_new_instances = 0  # from now on
            n = fitting(iteration, self.options.planned_mu)
        if n <= self._survivors:
            n = fitting(1, 1)
        return n if self._most_configurations is None else min(n, self._most_configurations)

    def _first_race(self, budget: int, n: int) -> Batches:
        initial = self._initial[:n]
        if len(initial) < len(self._initial):
            self.notes.append(f"only {n} of {len(self._initial)} initial configurations fit in the first iteration")
        present = {self.space.key(configuration) for configuration in initial}
        sampled: list[Configuration] = []
        if len(initial) < n:
            sampled = sobol_sample(
                self.space,
                n - len(initial),
                self._generator("sampling"),
                lambda c: self._is_excluded(c) or self.space.key(c) in present,
            )
        sampled = [child for child, _ in self._canonical([(configuration, None) for configuration in sampled])]
        self._allow_for_few(len(initial + sampled))
        numbers = self._add([(configuration, None) for configuration in initial + sampled])
        race = self._new_race(numbers, budget, elites=[])
        yield from self._hold(race, budget, n_new=len(numbers), soft_restart=False)
        self._model.initialise(self._elite_configurations())

    def _allow_for_few(self, n: int) -> None:
        """A race ends when few are alive, but in a small space it would not even begin."""
        if n == 1:
            raise RaceError("space: expected several different configurations to be allowed, found one")
        if n <= self._survivors:
            self._survivors = n - 1
            self.notes.append(f"only {n} different configurations were found, so races end with {n - 1}")

    def _later_race(self, budget: int, n: int) -> Batches:
        elites = [elite.configuration for elite in self.elites]
        n_new = n - len(elites)
        self._model.update(
            self._elite_configurations(),
            {elite: parent for elite in elites if (parent := self.parents[elite]) is not None},
            n_new=n_new,
            iteration=self._iteration - self._before,
            iterations=self._n_iterations - self._before,
        )
        generator = self._generator("sampling")
        known = len(self.configurations) / (_LEARNT_FROM * self.space.n_variable)
        n_drawn = n_new - round(self.options.surrogate * min(known, 1.0) * n_new)
        children = self._model.sample(n_drawn, elites, generator, self._is_excluded)
        to_restart = self._too_narrow(children) if self.options.soft_restart else []
        if to_restart:
            self._model.restart(to_restart, n_new)
            children = self._model.sample(n_drawn, elites, generator, self._is_excluded)
        children = self._canonical(children)
        if not self.options.repeated:
            children = self._different(children)
        if self.options.surrogate > 0:
            children += self._proposed(n_new - len(children), elites, children)
        if not children:
            self._is_exhausted = True
            self._iteration -= 1
            return
        numbers = elites + self._add(children)
        race = self._new_race(numbers, budget, elites=elites)
        yield from self._hold(race, budget, n_new=n_new, soft_restart=bool(to_restart))

    def _canonical(self, children: Sequence[tuple[Configuration, Parent]]) -> list[tuple[Configuration, Parent]]:
        """Children as the space's structure writes them, each once, if it has one that is made use of."""
        structure = self.space.structure
        if structure is None or not self.options.structure:
            return list(children)
        canonical = ((structure.canonical(child), parent) for child, parent in children)
        return list({self.space.key(child): (child, parent) for child, parent in canonical}.values())

    def _different(self, children: Sequence[tuple[Configuration, int]]) -> list[tuple[Configuration, int]]:
        """Those that have not run, each once."""
        found: dict[tuple[Value | None, ...], tuple[Configuration, int]] = {}
        for child in children:
            found.setdefault(self.space.key(child[0]), child)
        return [child for key, child in found.items() if key not in self._numbers]

    def _proposed(
        self, n: int, elites: Sequence[int], others: Sequence[tuple[Configuration, int]]
    ) -> list[tuple[Configuration, int]]:
        present = self._numbers.keys() | {self.space.key(configuration) for configuration, _ in others}
        if self._proposer is None:  # looking for BLAS, and the features of a space, take their time
            self._proposer = Proposer(self.space, structure=self.options.structure)
        return self._proposer.propose(
            n,
            elites,
            configurations=self.configurations,
            costs=self._costs,
            model=self._model,
            generator=self._generator("proposals"),
            excluded=lambda c: self._is_excluded(c) or self.space.key(c) in present,
        )

    def _too_narrow(self, children: Sequence[tuple[Configuration, int]]) -> list[int]:
        """The elites whose distributions have come to give the same configurations again."""
        together = self._elite_configurations()
        parents = {number: number for number in together}
        for number, (configuration, parent) in enumerate(children, start=len(self.configurations)):
            together[number] = configuration
            parents[number] = parent
        alike = similar(self.space, together, self.options.soft_restart_threshold)
        return list(dict.fromkeys(parents[number] for number in alike))

    def _new_race(self, numbers: Sequence[int], budget: int, *, elites: Sequence[int]) -> Race:
        new: list[int] = []
        old: list[int] = []
        if self.options.elitist and elites:
            new = list(range(self._n_seen, self._n_seen + self._n_new))
            old = self._old_instances()
        return Race(
            numbers,
            earlier={elite: self._costs[elite] for elite in elites} if self.options.elitist else {},
            instances=new + old,
            next_instance=self._n_seen + len(new),
            rules=self.options.rules(),
            survivors=self._survivors,
            budget=budget,
            limit=self._remaining,
            most_instances=self.options.instances,
        )

    @property
    def _n_new(self) -> int:
        """Instances that a later elitist race begins with."""
        total = self.options.instances
        return self._n_new_instances if total is None else min(self._n_new_instances, total - self._n_seen)

    def _old_instances(self) -> list[int]:
        """Those seen, if they are to be sampled in random order of their blocks."""
        if not self.options.sample_instances:
            return list(range(self._n_seen))
        size = self.options.block_size
        blocks = self._generator("instances").permutation(math.ceil(self._n_seen / size)).tolist()
        in_order = (block * size + place for block in blocks for place in range(size))
        return [instance for instance in in_order if instance < self._n_seen]

    def _postselect(self) -> Batches:
        """A race among the best of all iterations with what is left of the budget."""
        remaining = self.budget - self._used
        if remaining // max(self.options.block_size, self.options.each_test) <= 1 or not self.elites:
            return
        ordered = dict.fromkeys([*self._former_elites(), *range(len(self.configurations))])
        accepted = [c for c in ordered if not self._is_rejected(c)]
        needs = {c: self._n_seen - len(self._costs[c]) for c in accepted}
        each_test = None if self._n_seen == self.options.instances else self.options.instances_each_test
        candidates = sorted(select_candidates(needs, remaining, each_test))
        if not candidates:
            return
        self._iteration += 1
        race = Race(
            candidates,
            earlier={c: self._costs[c] for c in candidates},
            instances=self._old_instances(),
            next_instance=self._n_seen,
            rules=self.options.rules(first_test=self._n_seen, elitist_limit=0),
            survivors=1,
            budget=remaining,
            limit=remaining,
            most_instances=self.options.instances,
        )
        yield from self._hold(race, remaining, n_new=0, soft_restart=False, postselection=True)

    def _confirm(self) -> Batches:
        """Halve the best few on new instances until one is left, with all that is left of the budget.

        Who was merely lucky in a race loses here. All experiments of a halving are asked for at once.
        """
        budget, n_seen, order = self.budget - self._used, self._n_seen, self._by_expectation(self._former_elites())
        size = self.options.block_size
        n_finalists = n_alive = min(len(order), _MOST_FINALISTS, budget // size)
        if n_alive < 2:
            return
        self._iteration += 1
        while n_alive > 1 and (n_fitting := (self.budget - self._used) // size) > 1:
            alive = order[: min(n_alive, n_fitting)]
            n_blocks = max(n_fitting // (len(alive) * math.ceil(math.log2(len(alive)))), 1)
            new = range(self._n_seen, self._n_seen + n_blocks * size)
            yield [Experiment(configuration, instance) for instance in new for configuration in alive]
            self._n_seen = new.stop
            order = self._by_expectation(alive) + order[len(alive) :]
            if not order:  # no elite is accepted any more
                order = self._by_expectation(range(len(self.configurations)))
            if not order:
                raise RaceError(ALL_REJECTED)
            n_alive = min(math.ceil(len(alive) / 2), len(order))
        self.elites = [self.statistics(number) for number in order[: self._survivors]]
        accepted = [number for number in alive if not self._is_rejected(number)]
        summary = IterationSummary(
            iteration=self._iteration,
            postselection=True,
            budget=budget,
            used=budget - self.budget + self._used,
            n_configurations=n_finalists,
            n_new=0,
            n_instances=self._n_seen - n_seen,
            n_alive=n_alive,
            elites=tuple(self.elites),
            soft_restart=False,
            stop_reason="one is left" if n_alive == 1 else "the whole budget is used",
            survivors=tuple(order[:n_alive]),
            concordance=concordance(self._table(accepted)[:, new.start :].T),
        )
        self._conclude(summary, newcomers=[])

    def _by_expectation(self, numbers: Sequence[int]) -> list[int]:
        """The best first; those that were rejected, or have not run, are left out."""
        accepted = [number for number in numbers if self._costs[number] and not self._is_rejected(number)]
        if not accepted:
            return []
        costs = self._table(accepted)
        order = np.argsort(expected(costs[:, ~np.isnan(costs).all(axis=0)]), kind="stable")
        return [accepted[k] for k in order]

    def _table(self, numbers: Sequence[int]) -> Floats:
        """Costs of some configurations, shape (configurations, instances), NaN where there is none."""
        return table([self._costs[number] for number in numbers])

    def _former_elites(self) -> list[int]:
        """Those of all races, the latest first."""
        former = chain.from_iterable(summary.elites for summary in reversed(self.iterations))
        return list(dict.fromkeys(elite.configuration for elite in former))

    def _hold(self, race: Race, budget: int, *, n_new: int, soft_restart: bool, postselection: bool = False) -> Batches:
        """Run a race to its end and let its best be the elites."""
        newcomers = sorted(set(race.configurations) - {elite.configuration for elite in self.elites})
        self._race = race
        while batch := race.ask():
            costs = yield batch
            race.tell(costs)
            self._n_seen = max(self._n_seen, batch[0].instance + 1)
        different: dict[tuple[Value | None, ...], int] = {}
        survivors = race.ranked()
        for number in survivors:
            different.setdefault(self.space.key(self.configurations[number]), number)
        self.elites = [self.statistics(number) for number in list(different.values())[: self._survivors]]
        self._race = None
        summary = IterationSummary(
            iteration=self._iteration,
            postselection=postselection,
            budget=budget,
            used=race.used,
            n_configurations=len(race.configurations),
            n_new=n_new,
            n_instances=race.n_instances,
            n_alive=len(race.alive),
            elites=tuple(self.elites),
            soft_restart=soft_restart,
            stop_reason=race.stop_reason or "",
            survivors=tuple(survivors),
            concordance=race.concordance(),
        )
        self._conclude(summary, newcomers)

    def _elite_configurations(self) -> dict[int, Configuration]:
        return {elite.configuration: self.configurations[elite.configuration] for elite in self.elites}
