"""Iterated F-race: race, learn where the survivors lie, sample around them, race again (irace.R, irace_run).

Unlike in irace, the budget is never exceeded: an elimination race that would exceed it ends.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from mercator_design.errors import RaceError
from mercator_design.race.elimination.options import RaceOptions
from mercator_design.race.elimination.planning import IterationPlan, Planner
from mercator_design.race.elimination.postselection import select_candidates
from mercator_design.race.elimination.race import EliminationRace, Experiment
from mercator_design.race.elimination.summary import IterationSummary, Progress
from mercator_design.race.methods.optimizer import Batches, Optimizer
from mercator_design.race.proposals.model import SamplingModel
from mercator_design.race.proposals.sampling import even_sample, similar, sobol_sequence
from mercator_design.race.space.parameter import Configuration, Value, key_of
from mercator_design.race.space.space import Space


class IteratedRace(Optimizer):
    """An iterated race over a space.

    Args:
        space, budget, seed: As `Optimizer`.
        options: irace's options; by default with irace's defaults.
        initial: The first configurations; the first iteration samples the others.

    Attributes:
        parents: The elite that a configuration was sampled from; None in the first iteration.
        elites: The survivors of the last race that has ended, best first.

    Raises:
        RaceError: As all methods; or the budget is not enough for one iteration, or an initial configuration is not
            valid.
    """

    SEVERAL_COSTS = True
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
        self._planner = Planner(self.options, space.n_variable, self._left_to_iterate)
        if self._planner.note is not None:
            self.notes.append(self._planner.note)
        self._initial = self._checked(initial)
        self._n_seen = 0  # instances
        self._model = SamplingModel(space, self.options)
        self._race: EliminationRace | None = None
        if isinstance(planned := self._next(), str):
            raise RaceError(f"race: expected a budget for a first iteration, but {planned}")

    @property
    def _left(self) -> int:
        """The remaining budget."""
        return self.budget - self.used

    @property
    def _left_to_iterate(self) -> int:
        """The remaining budget, without what is kept for the race among the best."""
        return self._left - self.options.kept(self.budget)

    @property
    def progress(self) -> Progress:
        found = replace(super().progress, iterations=self._planner.n_iterations)
        if self._race is None or not self._race.alive:
            return found
        leader = self._race.ranked()[0]
        best = self.history.statistics(leader) if self.history.costs[leader] else found.best
        return replace(found, alive=len(self._race.alive), best=best)

    @property
    def may_run_again(self) -> set[int]:
        if self.options.elitist and self.options.postselection:
            return set(range(len(self.configurations)))
        return super().may_run_again

    def competitors(self, instance: int) -> list[int]:
        if self._race is None:
            return super().competitors(instance)
        return [number for number in self._race.alive if instance in self.history.costs[number]]

    def revise(self, costs: Mapping[Experiment, float]) -> None:
        super().revise(costs)
        if self._race is not None:
            self._race.revise(costs)

    def lookahead(self, n: int, known: Mapping[Experiment, float] | None = None) -> list[Experiment]:  # noqa: ARG002
        return [] if self._race is None else self._race.lookahead(n)

    def extend(self, budget: int) -> None:
        """Continue with a larger budget after the end.

        The added budget is planned like that of a new race. Its first iteration counts as a second one: it begins with
        the elites at the end of the race, with distributions as wide as after a first iteration.

        Raises:
            RaceError: The race has not ended yet, or the budget is no larger.
        """
        super().extend(budget)
        self._planner.extend(self._left_to_iterate, self.iteration)
        self._model.initialise(self.history.elite_configurations)

    def _run(self) -> Batches:
        while self.stop_reason is None:
            if isinstance(planned := self._next(), str):
                self.stop_reason = planned
                break
            self.iteration = planned.number
            self._planner.n_iterations = max(self._planner.n_iterations, self.iteration)
            run = self._later_race if self.elites else self._first_race
            yield from run(planned.budget, planned.n_configurations)
        self._planner.n_iterations = self.iteration
        if self.options.elitist and self.options.postselection:
            yield from self._postselect()

    def _next(self) -> IterationPlan | str:
        """Plan the next iteration, or return why there is none."""
        left, n_elites = self._left_to_iterate, len(self.elites)
        return self._planner.next(self.iteration + 1, left=left, n_elites=n_elites, n_seen=self._n_seen)

    def _first_race(self, budget: int, n: int) -> Batches:
        initial = self._initial[:n]
        if len(initial) < len(self._initial):
            self.notes.append(f"only {n} of {len(self._initial)} initial configurations fit in the first iteration")
        present = {key_of(configuration) for configuration in initial}
        sampled: list[Configuration] = []
        if len(initial) < n:
            sampled = even_sample(
                self.space,
                n - len(initial),
                self._generator("sampling"),
                lambda c: self.history.is_excluded(c) or key_of(c) in present,
                sobol_sequence,
            )
        self._limit_survivors(len(initial + sampled))
        numbers = self.history.add([(configuration, None) for configuration in initial + sampled])
        race = self._new_race(numbers, budget, elites=[])
        yield from self._run_race(race, budget, n_new=len(numbers))
        self._model.initialise(self.history.elite_configurations)

    def _limit_survivors(self, n: int) -> None:
        """Reduce the number of survivors if it is not below the number of configurations, so that a race can begin."""
        if n == 1:
            raise RaceError("space: expected several different configurations to be allowed, found one")
        if n <= self._planner.survivors:
            self._planner.survivors = n - 1
            self.notes.append(f"only {n} different configurations were found, so races end with {n - 1}")

    def _later_race(self, budget: int, n: int) -> Batches:
        elites = [elite.configuration for elite in self.elites]
        n_new = n - len(elites)
        self._model.update(
            self.history.elite_configurations,
            {elite: parent for elite in elites if (parent := self.parents[elite]) is not None},
            n_new=n_new,
            iteration=self._planner.age(self.iteration),
            iterations=self._planner.age(self._planner.n_iterations),
        )
        generator = self._generator("sampling")
        children = self._model.sample(n_new, elites, generator, self.history.is_excluded)
        to_restart = self._too_narrow(children) if self.options.soft_restart else []
        if to_restart:
            self._model.restart(to_restart, n_new)
            children = self._model.sample(n_new, elites, generator, self.history.is_excluded)
        if len(elites) + len(children) <= self._planner.survivors:
            self.iteration = self.iterations[-1].iteration  # nothing has run in this one
            self.stop_reason = "too few configurations were found that are neither forbidden nor rejected"
            return
        numbers = elites + self.history.add(children)
        race = self._new_race(numbers, budget, elites=elites)
        yield from self._run_race(race, budget, n_new=len(children), soft_restart=bool(to_restart))

    def _too_narrow(self, children: Sequence[tuple[Configuration, int]]) -> list[int]:
        """The elites whose distributions have become so narrow that they give the same configurations again."""
        together = self.history.elite_configurations
        parents = {number: number for number in together}
        for number, (configuration, parent) in enumerate(children, start=len(self.configurations)):
            together[number] = configuration
            parents[number] = parent
        alike = similar(self.space, together, self.options.soft_restart_threshold)
        return list(dict.fromkeys(parents[number] for number in alike))

    def _new_race(self, numbers: Sequence[int], budget: int, *, elites: Sequence[int]) -> EliminationRace:
        new: list[int] = []
        old: list[int] = []
        if self.options.elitist and elites:
            new = list(range(self._n_seen, self._n_seen + self._planner.n_new(self._n_seen)))
            old = self._old_instances()
        return EliminationRace(
            numbers,
            earlier={elite: self.history.costs[elite] for elite in elites} if self.options.elitist else {},
            instances=new + old,
            next_instance=self._n_seen + len(new),
            rules=self.options.rules(),
            survivors=self._planner.survivors,
            planned_budget=budget,
            max_experiments=self._left_to_iterate,
            max_instances=self.options.instances,
            further=self._further(elites) if self.options.elitist else [],
        )

    def _further(self, numbers: Sequence[int]) -> list[dict[int, dict[int, float]]]:
        """The costs of configurations by each further objective."""
        return [{number: table[number] for number in numbers} for table in self.history.further]

    def _old_instances(self) -> list[int]:
        """The instances seen, with their blocks in random order (see `sample_instances`)."""
        if not self.options.sample_instances:
            return list(range(self._n_seen))
        size = self.options.block_size
        blocks = self._generator("instances").permutation(math.ceil(self._n_seen / size)).tolist()
        in_order = (block * size + place for block in blocks for place in range(size))
        return [instance for instance in in_order if instance < self._n_seen]

    def _postselect(self) -> Batches:
        """Race the best of all iterations with the rest of the budget."""
        remaining = self._left
        if remaining // max(self.options.block_size, self.options.each_test) <= 1 or not self.elites:
            return
        ordered = dict.fromkeys([*self.history.former_elites, *range(len(self.configurations))])
        accepted = [c for c in ordered if not self.history.is_rejected(c)]
        needs = {c: self._n_seen - len(self.history.costs[c]) for c in accepted}
        each_test = None if self._n_seen == self.options.instances else self.options.instances_each_test
        candidates = sorted(select_candidates(needs, remaining, each_test))
        if not candidates:
            return
        self.iteration += 1
        race = EliminationRace(
            candidates,
            earlier={c: self.history.costs[c] for c in candidates},
            instances=self._old_instances(),
            next_instance=self._n_seen,
            rules=replace(self.options.rules(), first_test=self._n_seen, elitist_limit=0),
            survivors=1,
            planned_budget=remaining,
            max_experiments=remaining,
            max_instances=self.options.instances,
            further=self._further(candidates),
        )
        yield from self._run_race(race, remaining, postselection=True)

    def _run_race(
        self,
        race: EliminationRace,
        budget: int,
        *,
        n_new: int = 0,
        soft_restart: bool = False,
        postselection: bool = False,
    ) -> Batches:
        """Run a race to its end; its best are the new elites."""
        newcomers = sorted(set(race.configurations) - {elite.configuration for elite in self.elites})
        self._race = race
        while batch := race.ask():
            costs = yield batch
            race.tell(costs, [[table[c][instance] for c, instance in batch] for table in self.history.further])
            self._n_seen = max(self._n_seen, batch[0].instance + 1)
        survivors = race.ranked()
        self._race = None
        summary = IterationSummary(
            iteration=self.iteration,
            postselection=postselection,
            budget=budget,
            used=race.used,
            n_configurations=len(race.configurations),
            n_new=n_new,
            n_instances=race.n_instances,
            n_alive=len(race.alive),
            soft_restart=soft_restart,
            stop_reason=race.stop_reason or "",
            survivors=tuple(survivors),
        )
        elites = self.history.different(survivors)[: self._planner.survivors]
        self._end_iteration(summary, elites, newcomers)
