"""EvoStick's evolutionary algorithm: the best of a population are copied, and mutated copies of them are added.

A generation runs on instances of its own, the same for all. After the last one, there is one more reproduction, and all
of this population run on further instances, which decide. Source: demiurge-project's ARGoS3-NEAT with its parameters
for EvoStick; there, all parameters are weights from -5 to 5.
"""

import math
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from mercator_design.errors import RaceError
from mercator_design.race.elimination.race import ALL_REJECTED, Experiment
from mercator_design.race.elimination.summary import IterationSummary
from mercator_design.race.methods.optimizer import Batches, Optimizer, Upcoming
from mercator_design.race.space.parameter import Bounds, Configuration, Parameter, Value
from mercator_design.race.space.space import Space

Ranking = Generator[list[Experiment] | Upcoming, Sequence[float], list[int]]
"""Yields batches, is sent their costs, and returns configurations, the best first."""

MIN_BUDGET = 20
_MAX_DRAWS = 1000
"""Stop after so many successive draws of configurations that are forbidden, rejected or in the population."""
_MIN_POPULATION = 5
_STEP = 0.1
"""Largest change of a value, as a part of its domain."""
_END = 0.8
"""The parameters behind this part of all are mutated more (NEAT, from ten parameters on)."""


@dataclass(frozen=True, kw_only=True, slots=True)
class EvoStickOptions:
    """How the algorithm spends its budget.

    Args:
        population: Configurations of a generation.
        instances: Number of instances that they run on.
        elites: Part of the population that is copied, and has children.
        final: Part of the budget for the last population.
        generations: So many of this size need to fit, or population and instances are reduced.

    Raises:
        RaceError: An option is out of range.
    """

    population: int = 100
    instances: int = 10
    elites: float = 0.2
    final: float = 0.1
    generations: int = 9

    def __post_init__(self) -> None:
        for name, low in (("population", _MIN_POPULATION), ("instances", 1), ("generations", 1)):
            if (found := getattr(self, name)) < low:
                raise RaceError(f"race option {name}: expected at least {low}, found {found}")
        for name in ("elites", "final"):
            if not 0 <= (found := getattr(self, name)) < 1:
                raise RaceError(f"race option {name}: expected 0 to below 1, found {found}")

    def reduced(self, budget: int) -> tuple[int, int]:
        """Population and instances for a budget."""
        share = (1.0 - self.final) * budget / (self.generations * self.population * self.instances)
        if share >= 1.0:
            return self.population, self.instances
        instances = max(round(self.instances * math.sqrt(share)), 1)
        return max(int(share * self.population * self.instances / instances), _MIN_POPULATION), instances


class EvoStick(Optimizer):
    """The evolutionary algorithm over a space.

    A real parameter whose bounds are symmetric about 0 is a weight: it begins near 0. Others begin anywhere.

    Args:
        space, budget, seed: As `Optimizer`.
        options: How the budget is spent.
        initial: The first configurations.

    Raises:
        RaceError: As all methods; or the budget is below 20, or an initial configuration is not valid.
    """

    options: EvoStickOptions

    def __init__(
        self,
        space: Space,
        *,
        budget: int,
        seed: int,
        options: EvoStickOptions | None = None,
        initial: Sequence[Mapping[str, Value]] = (),
    ) -> None:
        super().__init__(space, budget=budget, seed=seed)
        self.options = options or EvoStickOptions()
        if self.budget < MIN_BUDGET:
            raise RaceError(f"budget: expected at least {MIN_BUDGET} experiments, found {budget}")
        self._initial = self._checked(initial)
        self._size, self._n_instances = self.options.reduced(self.budget)
        if (self._size, self._n_instances) != (self.options.population, self.options.instances):
            self.notes.append(
                f"a budget of {budget} is small for this method: the population is {self._size}, on "
                f"{self._n_instances} instance{'s' * (self._n_instances != 1)} in each generation, instead of "
                f"{self.options.population} on {self.options.instances}"
            )
        if len(self._initial) > self._size:
            self.notes.append(f"only {self._size} of {len(self._initial)} initial configurations fit in the population")
        self._ranked: list[int] = []  # the last population, the best first
        self._coming: list[Experiment] = []
        self._n_seen = 0  # instances

    def lookahead(self, n: int, known: Mapping[Experiment, float] | None = None) -> list[Experiment]:  # noqa: ARG002
        alive = {*self._alive}
        return list(islice((one for one in self._coming if one.configuration in alive), n))

    @property
    def may_run_again(self) -> set[int]:
        return {*super().may_run_again, *self._ranked}

    def _run(self) -> Batches:
        reserved = int(self.options.final * (self.budget - self.used))
        cost = self._size * self._n_instances
        while (n_left := (self.budget - self.used - reserved) // cost) > 0:
            self.iteration += 1
            self._n_iterations = self.iteration + n_left
            population, new = self._reproduced() if self._ranked else self._first()
            before = self.used
            self._ranked = yield from self._evaluated(population, self._n_instances)
            self._conclude(population, new, self._n_instances, before)
        self.iteration += 1
        self._n_iterations = self.iteration
        yield from self._last_population()
        self.stop_reason = "the budget left is too small for another generation"

    def _last_population(self) -> Batches:
        """Spend the rest of the budget on one more population; what is left then goes to the best of it."""
        before, n_left = self.used, self.budget - self.used
        if n_left == 0:
            self.iteration -= 1
            return
        population, new = self._reproduced() if n_left >= self._size else (self._parents[:n_left], [])
        n_instances, n_more = divmod(n_left, len(population))
        self._ranked = yield from self._evaluated(population, n_instances)
        if best := [number for number in self._ranked[:n_more] if number in population]:
            costs = {number: self._recent_costs(number, n_instances) for number in best}
            yield from self._evaluated(best, 1)
            best = [number for number in best if not self.history.is_rejected(number)]
            best.sort(key=lambda number: sum(costs[number]) + self._recent_costs(number, 1)[0])
            self._ranked = [*best, *(one for one in self._ranked if one not in costs)] or self._accepted()
        self._conclude(population, new, n_instances, before, postselection=True)

    def _evaluated(self, population: Sequence[int], n_instances: int) -> Ranking:
        """Run a population on new instances; return it by mean cost, the best first, without those rejected."""
        self._alive = list(population)
        instances = range(self._n_seen, self._n_seen + n_instances)
        self._n_seen += n_instances
        for instance in instances:
            later = range(instance + 1, instances.stop)
            self._coming = [Experiment(number, one) for one in later for number in self._alive]
            yield [Experiment(number, instance) for number in self._alive]
            self._alive = [number for number in self._alive if not self.history.is_rejected(number)]
            if not self._alive:
                break
        ranked = sorted(self._alive, key=lambda number: sum(self._recent_costs(number, n_instances)))
        self._alive, self._coming = [], []
        return ranked or self._accepted()

    def _recent_costs(self, number: int, n_instances: int) -> list[float]:
        """The costs of a configuration on the latest instances."""
        costs = self.history.costs[number]
        return [costs[instance] for instance in range(self._n_seen - n_instances, self._n_seen)]

    def _accepted(self) -> list[int]:
        """All configurations that were not rejected, by mean cost."""
        numbers = range(len(self.configurations))
        accepted = [one for one in numbers if self.history.costs[one] and not self.history.is_rejected(one)]
        if not accepted:
            raise RaceError(ALL_REJECTED)
        return sorted(accepted, key=lambda number: self.history.statistics(number).mean)

    def _conclude(
        self,
        population: Sequence[int],
        new: Sequence[int],
        n_instances: int,
        before: int,
        *,
        postselection: bool = False,
    ) -> None:
        used = self.used - before
        summary = IterationSummary(
            iteration=self.iteration,
            postselection=postselection,
            budget=used,
            used=used,
            n_configurations=len(population),
            n_new=len(new),
            n_instances=n_instances,
            n_alive=len(self._ranked),
            stop_reason="the whole budget is used" if postselection else "all instances were seen",
            survivors=tuple(self._ranked),
        )
        accepted = [number for number in new if not self.history.is_rejected(number)]
        self._end_iteration(summary, self._parents, accepted)

    @property
    def _parents(self) -> list[int]:
        """The elites of the last population."""
        n = max(round(self.options.elites * self._size), 1)
        return [number for number in self._ranked if not self.history.is_rejected(number)][:n] or self._accepted()[:n]

    def _first(self) -> tuple[list[int], list[int]]:
        """The first population, all of which are new."""
        draws = self._generator("start")
        given = iter(self._initial)

        def drawn() -> tuple[Configuration, None]:
            configuration = next(given, None)
            return (configuration or self.space.build(lambda one, bounds: _begun(one, bounds, draws))), None

        population = self._completed([], drawn)
        if len(population) < 2:
            raise RaceError(
                "space: expected several different configurations to be allowed, "
                f"found {['none', 'one'][len(population)]} within {_MAX_DRAWS} draws"
            )
        return population, population

    def _reproduced(self) -> tuple[list[int], list[int]]:
        """The elites and their children, and those that are new."""
        draws = self._generator("reproduction")
        parents = self._parents
        n_known = len(self.configurations)

        def drawn() -> tuple[Configuration, int]:
            parent = parents[int(draws.integers(len(parents)))]
            return self._mutated(self.configurations[parent], draws), parent

        population = self._completed(parents, drawn)
        return population, [number for number in population if number >= n_known]

    def _completed(self, members: Sequence[int], drawn: Callable[[], tuple[Configuration, int | None]]) -> list[int]:
        """A population of these members and others that are drawn, each with its parent; no two are equal."""
        population = dict.fromkeys(members)
        n_draws = 0
        while len(population) < self._size and n_draws < _MAX_DRAWS:
            configuration, parent = drawn()
            n_draws += 1
            if self.history.is_excluded(configuration):
                continue
            number = self.history.number(configuration)
            if number is None:
                (number,) = self.history.add([(configuration, parent)])
            if number not in population:
                population[number] = None
                n_draws = 0
        return list(population)

    def _mutated(self, parent: Configuration, draws: np.random.Generator) -> Configuration:
        """A mutated copy of a configuration; parameters that become active are drawn."""
        is_severe = draws.random() < 0.5
        order = {parameter.name: k for k, parameter in enumerate(self.space.variable)}
        n = len(order)

        def mutated(parameter: Parameter, bounds: Bounds) -> Value:
            value = parent.get(parameter.name)
            if value is None:
                return _begun(parameter, bounds, draws)
            is_at_end = n >= 10 and order[parameter.name] > _END * n
            change, replacement = (0.7, 0.9) if is_severe else (0.5, 0.7) if is_at_end else (1.0, 1.0)
            u = draws.random()
            if u < change:
                return _changed(parameter, bounds, value, draws)
            return _begun(parameter, bounds, draws) if u < replacement else _within(parameter, bounds, value)

        return self.space.build(mutated)


def _is_weight(parameter: Parameter, bounds: Bounds) -> bool:
    low, high = bounds
    return parameter.kind == "real" and low == -high


def _begun(parameter: Parameter, bounds: Bounds, draws: np.random.Generator) -> Value:
    """A value to begin with: of a weight a small one, of others any."""
    if parameter.kind == "categorical":
        return parameter.values[int(draws.integers(len(parameter.values)))]
    u = draws.random()
    return parameter.quantile(0.5 + 2.0 * _STEP * (u - 0.5) if _is_weight(parameter, bounds) else u, bounds)


def _changed(parameter: Parameter, bounds: Bounds, value: Value, draws: np.random.Generator) -> Value:
    """A value that differs by a tenth of its domain at most, or is the next one; a category is seldom another one."""
    step = 2.0 * draws.random() - 1.0
    if parameter.kind == "categorical":
        return _begun(parameter, bounds, draws) if abs(step) < _STEP else value
    low, high = bounds
    n = math.inf if parameter.kind == "real" else high - low + 1
    place = parameter.position(_within(parameter, bounds, value), bounds) + max(_STEP, 1.0 / n) * step
    return parameter.quantile(min(max(place, 0.0), 1.0), bounds)


def _within(parameter: Parameter, bounds: Bounds, value: Value) -> Value:
    """A value of a parent, within bounds that may have changed."""
    return min(max(value, bounds[0]), bounds[1]) if parameter.is_numeric else value
