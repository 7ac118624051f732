"""Ablation analysis: which changes from one configuration to another matter.

As irace's `ablation()`, after Fawcett and Hoos 2016 (Analysing differences between algorithm configurations through
ablation, Journal of Heuristics 22:431-458): each step makes the change with the lowest mean cost, until no change is
left. `Flips` changes one configuration into another, a parameter in each step; other kinds of changes are possible.

A change that was selected on some instances looks better on these instances than it is. So the path is measured again
on other instances, and the results have these costs.
"""

import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from mercator_design.race.analysis.pairs import paired_p_value
from mercator_design.race.elimination.statistics import holm
from mercator_design.race.space.parameter import Bounds, Configuration, Key, Parameter, Value, key_of
from mercator_design.race.space.space import Space

C = TypeVar("C", bound=Hashable)
Costs = Sequence[float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Step(Generic[C]):
    """A step of a path.

    change: A description of the change; empty for the start.
    variant: The variant after the change.
    costs: The costs of the variant on the instances of the second measurement.
    p_value: The p-value of no difference from the start (paired t-test on these costs, with Holm's correction for all
        steps); NaN for the start.
    """

    change: str
    variant: C
    costs: tuple[float, ...]
    p_value: float


def ablate(
    start: C,
    changes: Callable[[C], Mapping[C, str]],
    measure: Callable[[Sequence[C], range], Sequence[Costs]],
    runs: int,
) -> list[Step[C]]:
    """Find the path from a start on which each change has the lowest mean cost.

    A path of k steps takes runs * k * (k + 3) / 2 measurements if each change leaves all others possible.

    Args:
        start: The first variant.
        changes: Returns the variants that one change can make from a variant, with descriptions of the changes; after
            some changes there must be none.
        measure: Returns the costs of each of several variants, on instances of these numbers.
        runs: Number of instances on which changes are chosen, and of other instances on which the path is measured.
    """
    path: list[tuple[str, C]] = [("", start)]
    while candidates := changes(path[-1][1]):
        variants = list(candidates)
        means = [sum(costs) / runs for costs in measure(variants, range(runs))] if len(variants) > 1 else [0.0]
        chosen = variants[int(np.argmin(means))]
        path.append((candidates[chosen], chosen))
    costs = measure([variant for _, variant in path], range(runs, 2 * runs))
    p_values = holm(np.array([paired_p_value(np.subtract(own, costs[0])) for own in costs[1:]])).tolist()
    return [
        Step(change=change, variant=variant, costs=tuple(own), p_value=p)
        for (change, variant), own, p in zip(path, costs, [math.nan, *p_values], strict=True)
    ]


class Flips:
    """Changes one configuration into another by parameters, with those that become active or inactive.

    The variants are keys of configurations (`key_of`).
    """

    def __init__(self, space: Space, target: Configuration) -> None:
        self._space = space
        self._target = target

    def changes(self, key: Key) -> dict[Key, str]:
        """The variants after one more change, for `ablate`."""
        here = self.configuration(key)
        found: dict[Key, str] = {}
        for parameter in self._space.parameters:
            old, new = here.get(parameter.name), self._target.get(parameter.name)
            if old is None or new is None or old == new:
                continue
            changed = self._space.build(self._choice({**self._target, **here, parameter.name: new}))
            if self._distance(changed) < self._distance(here) and not self._space.is_forbidden(changed):
                found.setdefault(key_of(changed), _description(parameter.name, here, changed))
        if not found and key_of(self._target) != key:  # no single change is possible
            found[key_of(self._target)] = "all that is left"
        return found

    def configuration(self, key: Key) -> Configuration:
        """The configuration of a key."""
        n = len(key) // 2
        values = {str(name): value for name, value in zip(key[:n], key[n:], strict=True)}
        return {p.name: values[p.name] for p in self._space.parameters if p.name in values}

    def _distance(self, configuration: Configuration) -> int:
        """The number of the target's values that a configuration does not have."""
        return sum(configuration.get(name) != value for name, value in self._target.items())

    def _choice(self, wanted: Configuration) -> Callable[[Parameter, Bounds], Value]:
        """Returns a function that chooses the wanted value, or else the target's, or else the middle of the domain."""

        def choose(parameter: Parameter, bounds: Bounds) -> Value:
            for values in (wanted, self._target):
                value = values.get(parameter.name)
                if value is not None and parameter.is_valid(value, bounds):
                    return value
            return parameter.quantile(0.5, bounds)

        return choose


def _description(name: str, before: Configuration, after: Configuration) -> str:
    """The description of a change of a parameter, with the number of others that change with it."""
    others = sum(before.get(other) != after.get(other) for other in before.keys() | after.keys()) - 1
    return f"{name} = {after[name]}" + (f", with {others} more" if others else "")
