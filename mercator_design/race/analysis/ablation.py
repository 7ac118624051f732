"""Which changes make the difference between two configurations, one after the other.

Ablation analysis (Fawcett and Hoos 2016, Analysing differences between algorithm configurations through ablation,
Journal of Heuristics 22:431-458), as irace's `ablation()`: of all changes that are left, the one that costs least is
made, until none is left. Whatever can be changed in steps can be ablated; `Flips` goes from one configuration to
another by parameters.

That a change costs least on some instances flatters it there. So when the path is known, it is measured again on
others, and it is these costs that are given.
"""

import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from scipy.special import stdtr

from mercator_design.race.racing.statistics import holm
from mercator_design.race.space.parameter import Bounds, Configuration, Parameter, Value
from mercator_design.race.space.space import Space

C = TypeVar("C", bound=Hashable)
Costs = Sequence[float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Step(Generic[C]):
    """A step of a path.

    change: in words; empty for the start.
    there: where it leads.
    costs: there, on the instances of the second measurement.
    p_value: of no difference from the start (paired t-test on these, corrected over the steps by Holm); NaN for the
        start.
    """

    change: str
    there: C
    costs: tuple[float, ...]
    p_value: float


def ablate(
    start: C,
    changes: Callable[[C], Mapping[C, str]],
    measure: Callable[[Sequence[C], range], Sequence[Costs]],
    runs: int,
) -> list[Step[C]]:
    """The path from a start on which each change costs least.

    A path of k steps takes runs * k * (k + 3) / 2 measurements if each change leaves all others.

    Args:
        start: Where it begins.
        changes: What can be changed somewhere: where each change leads, and what it is in words. Must come to an end.
        measure: The costs of each of several, on instances of these numbers.
        runs: Instances that changes are chosen on, and as many others that the path is measured on.
    """
    path: list[tuple[str, C]] = [("", start)]
    while candidates := changes(path[-1][1]):
        there = list(candidates)
        means = [sum(costs) / runs for costs in measure(there, range(runs))] if len(there) > 1 else [0.0]
        chosen = there[int(np.argmin(means))]
        path.append((candidates[chosen], chosen))
    costs = measure([there for _, there in path], range(runs, 2 * runs))
    p_values = holm(np.array([_p_value(costs[0], own) for own in costs[1:]])).tolist()
    return [
        Step(change=change, there=there, costs=tuple(own), p_value=p)
        for (change, there), own, p in zip(path, costs, [math.nan, *p_values], strict=True)
    ]


def _p_value(costs: Costs, others: Costs) -> float:
    """Two-sided, of the paired t-test; 1 where all are equal."""
    differences = np.array(others) - np.array(costs)
    error = float(differences.std(ddof=1)) / math.sqrt(len(differences))
    if error == 0:
        return 0.0 if differences[0] else 1.0
    return float(2 * stdtr(len(differences) - 1, -abs(float(differences.mean())) / error))


class Flips:
    """From one configuration to another, a parameter at a time, with those that it makes active or inactive.

    Configurations are given and returned as keys of the space.
    """

    def __init__(self, space: Space, target: Configuration) -> None:
        self._space = space
        self._target = target

    def changes(self, key: tuple[Value | None, ...]) -> dict[tuple[Value | None, ...], str]:
        """As `ablate` wants them."""
        here = self.configuration(key)
        found: dict[tuple[Value | None, ...], str] = {}
        for parameter in self._space.parameters:
            old, new = here.get(parameter.name), self._target.get(parameter.name)
            if old is None or new is None or old == new:
                continue
            changed = self._space.build(self._choice({**self._target, **here, parameter.name: new}))
            if self._distance(changed) < self._distance(here) and not self._space.is_forbidden(changed):
                found.setdefault(self._space.key(changed), _words(parameter.name, here, changed))
        if not found and self._space.key(self._target) != key:  # what is left needs each other
            found[self._space.key(self._target)] = "all that is left"
        return found

    def configuration(self, key: tuple[Value | None, ...]) -> Configuration:
        """That of a key."""
        return {p.name: value for p, value in zip(self._space.parameters, key, strict=True) if value is not None}

    def _distance(self, configuration: Configuration) -> int:
        """How many of the target's values are still missing."""
        return sum(configuration.get(name) != value for name, value in self._target.items())

    def _choice(self, wanted: Configuration) -> Callable[[Parameter, Bounds], Value]:
        """The value that is wanted, or else the target's, or else the middle of the domain."""

        def choose(parameter: Parameter, bounds: Bounds) -> Value:
            for values in (wanted, self._target):
                value = values.get(parameter.name)
                if value is not None and parameter.is_valid(value, bounds):
                    return value
            return parameter.quantile(0.5, bounds)

        return choose


def _words(name: str, here: Configuration, there: Configuration) -> str:
    """A change of a parameter, and how many others change with it."""
    others = sum(here.get(other) != there.get(other) for other in here.keys() | there.keys()) - 1
    return f"{name} = {there[name]}" + (f", with {others} more" if others else "")
