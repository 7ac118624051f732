"""The history of a race: configurations, costs and elites."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain

import numpy as np

from mercator_design.race.elimination.race import Cost, Experiment
from mercator_design.race.elimination.stagnation import judged
from mercator_design.race.elimination.summary import Elite, IterationSummary
from mercator_design.race.space.parameter import Configuration, Key, key_of
from mercator_design.race.space.space import Space


@dataclass(slots=True, eq=False)
class RaceHistory:
    """The history of a race; a method reads it to decide what comes next.

    space: Of the configurations.
    configurations: All proposed configurations; an experiment refers to one by its index in this list.
    parents: The number of each configuration's parent; None if it has none.
    costs: Of each configuration, by instance; by the first objective, if there are several.
    further: The same by each further objective.
    elites: The best of the last iteration that has ended, best first.
    iterations: Summaries of the iterations that have ended.
    n_told: Experiments whose costs are known.
    """

    space: Space
    configurations: list[Configuration] = field(default_factory=list)
    parents: list[int | None] = field(default_factory=list)
    costs: list[dict[int, float]] = field(default_factory=list)
    further: list[list[dict[int, float]]] = field(default_factory=list)
    elites: list[Elite] = field(default_factory=list)
    iterations: list[IterationSummary] = field(default_factory=list)
    n_told: int = 0
    _rejected: set[Key] = field(default_factory=set)
    _numbers: dict[int, int] = field(default_factory=dict)  # the first of equal configurations, by `_place`

    def add(self, children: Sequence[tuple[Configuration, int | None]]) -> list[int]:
        """Number new configurations, each with its parent."""
        first = len(self.configurations)
        for number, (configuration, parent) in enumerate(children, start=first):
            self.configurations.append(configuration)
            self._numbers.setdefault(self._place(configuration), number)
            self.parents.append(parent)
            for table in self.tables:
                table.append({})
        return list(range(first, len(self.configurations)))

    def number(self, configuration: Configuration) -> int | None:
        """The number of a configuration; None if it is new."""
        return self._numbers.get(self._place(configuration))

    def _place(self, configuration: Configuration) -> int:
        """The hash of a configuration, or the next place if another one has it: keys take 400 bytes each."""
        place = hash(key_of(configuration))
        while (known := self._numbers.get(place)) is not None and self.configurations[known] != configuration:
            place += 1
        return place

    @property
    def tables(self) -> list[list[dict[int, float]]]:
        """The costs by each objective."""
        return [self.costs, *self.further]

    def record(self, experiments: Sequence[Experiment], costs: Sequence[Cost]) -> None:
        """Record the costs of experiments."""
        self.n_told += len(costs)
        self._set(zip(experiments, costs, strict=True))

    def revise(self, costs: Mapping[Experiment, float]) -> None:
        """Replace costs; remove elites that this rejects, unless it rejects all of them."""
        self._set((experiment, float(cost)) for experiment, cost in costs.items())
        accepted = [elite.configuration for elite in self.elites if not self.is_rejected(elite.configuration)]
        self.elites = [self.statistics(number) for number in accepted] or self.elites

    def statistics(self, number: int) -> Elite:
        """Mean, standard deviation and number of the costs of a configuration; it must have some."""
        costs = np.array(list(self.costs[number].values()))
        sd = float(costs.std(ddof=1)) if len(costs) > 1 else math.nan
        return Elite(configuration=number, mean=float(costs.mean()), sd=sd, n_results=len(costs))

    def is_rejected(self, number: int) -> bool:
        """Whether a configuration, or an equal one, has had an infinite cost."""
        return bool(self._rejected) and key_of(self.configurations[number]) in self._rejected

    def is_excluded(self, configuration: Configuration) -> bool:
        """Whether a configuration may not run, because it is forbidden or was rejected."""
        return self.space.is_forbidden(configuration) or (
            bool(self._rejected) and key_of(configuration) in self._rejected
        )

    @property
    def elite_configurations(self) -> dict[int, Configuration]:
        """The elites' configurations by their numbers."""
        return {elite.configuration: self.configurations[elite.configuration] for elite in self.elites}

    @property
    def former_elites(self) -> list[int]:
        """The elites of all iterations, those of the latest first."""
        former = chain.from_iterable(summary.elites for summary in reversed(self.iterations))
        return list(dict.fromkeys(elite.configuration for elite in former))

    def different(self, numbers: Sequence[int]) -> list[int]:
        """The first of each set of equal configurations."""
        found: dict[Key, int] = {}
        for number in numbers:
            found.setdefault(key_of(self.configurations[number]), number)
        return list(found.values())

    def conclude(self, summary: IterationSummary, newcomers: Sequence[int], budget: int) -> None:
        """Add an iteration that has ended with the present elites, compared with the iterations before it."""
        summary = replace(summary, elites=tuple(self.elites))
        if not summary.postselection and not self.further:  # whether a race stagnates is judged by one cost
            earlier = [iteration for iteration in self.iterations if not iteration.postselection]
            summary = judged(summary, earlier, self.costs.__getitem__, newcomers, budget)
        self.iterations.append(summary)

    def _set(self, costs: Iterable[tuple[Experiment, Cost]]) -> None:
        for experiment, cost in costs:
            if isinstance(cost, tuple) and not self.further:  # experiments before have failed
                self.further = [[dict(own) for own in self.costs] for _ in cost[1:]]
            first = cost[0] if isinstance(cost, tuple) else cost
            self.costs[experiment.configuration][experiment.instance] = first
            for k, table in enumerate(self.further, start=1):
                table[experiment.configuration][experiment.instance] = cost[k] if isinstance(cost, tuple) else cost
            if math.isinf(first):
                self._rejected.add(key_of(self.configurations[experiment.configuration]))
