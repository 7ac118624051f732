"""What each behaviour and condition does, in words, and the meaning and unit of its parameters.

A function for each module: its keyword-only parameters are the module's, with the comments that `mdesign schema fsm`
and error messages show; it returns the words for given values.
"""

import math
from collections.abc import Callable, Mapping
from typing import Literal, NamedTuple

from mercator_design.config.schema import unit_of
from mercator_design.modules.behaviours import BEHAVIOURS
from mercator_design.modules.conditions import COLOUR_LABELS, CONDITIONS, logistic
from mercator_design.modules.module import Module

Words = Callable[..., str]


class KnownSwarm(NamedTuple):
    """Known facts about the robots that run a PFSM."""

    cycle: float  # [s] control period
    robots: int | None = None  # how many; None if it is not known


def _exploration(
    swarm: KnownSwarm,
    *,
    tau: int,  # [cycles] a turn away from an obstacle takes fewer cycles than this; 0 means 1
) -> str:
    """Drive straight on; before an obstacle, turn away from it for a random time."""
    longest = max(1, tau - 1)
    time = f"1 to {longest} cycles" if longest > 1 else "1 cycle"
    return f"drives straight on; before an obstacle it turns away for {time} (at most {_seconds(longest, swarm)})"


def _stop(_: KnownSwarm) -> str:
    """Stand still."""
    return "stands still"


def _phototaxis(_: KnownSwarm) -> str:
    """Go to the light, away from obstacles."""
    return "goes to the light and keeps away from obstacles"


def _anti_phototaxis(_: KnownSwarm) -> str:
    """Go away from the light and from obstacles."""
    return "goes away from the light and from obstacles"


def _attraction(
    swarm: KnownSwarm,
    *,
    alpha: float,  # strength, from 1 (weak) to 5 (strong), against that of obstacles
) -> str:
    """Go to the neighbours, away from obstacles."""
    alone = f"; {_others(1)}" * (swarm.robots == 1)
    return f"goes to its neighbours (strength {alpha:g} of 1 to 5) and keeps away from obstacles{alone}"


def _repulsion(
    swarm: KnownSwarm,
    *,
    alpha: float,  # strength, from 1 (weak) to 5 (strong), against that of obstacles
) -> str:
    """Go away from the neighbours and from obstacles."""
    alone = f"; {_others(1)}" * (swarm.robots == 1)
    return f"goes away from its neighbours (strength {alpha:g} of 1 to 5) and from obstacles{alone}"


def _black_floor(
    swarm: KnownSwarm,
    *,
    beta: float,  # [per cycle] probability where the ground is black
) -> str:
    """The ground is black."""
    return _with_probability(beta, swarm, "where the ground is black")


def _gray_floor(
    swarm: KnownSwarm,
    *,
    beta: float,  # [per cycle] probability where the ground is gray
) -> str:
    """The ground is gray; green is as bright as gray."""
    return _with_probability(beta, swarm, "where the ground is as bright as gray (green is)")


def _white_floor(
    swarm: KnownSwarm,
    *,
    beta: float,  # [per cycle] probability where the ground is white
) -> str:
    """The ground is white; yellow is as bright as white."""
    return _with_probability(beta, swarm, "where the ground is as bright as white (yellow is)")


def _neighbours_count(
    swarm: KnownSwarm,
    *,
    xi: int,  # [robots] number of neighbours at which the probability is 1/2 a cycle
    eta: float,  # steepness: 0 is a probability of 1/2 for any number of neighbours, 20 nearly a threshold
) -> str:
    """The robot has many neighbours."""
    return f"the more neighbours the likelier: {_by_neighbours(xi, eta, swarm, +1)}"


def _inverted_neighbours_count(
    swarm: KnownSwarm,
    *,
    xi: int,  # [robots] number of neighbours at which the probability is 1/2 a cycle
    eta: float,  # steepness: 0 is a probability of 1/2 for any number of neighbours, 20 nearly a threshold
) -> str:
    """The robot has few neighbours."""
    return f"the fewer neighbours the likelier: {_by_neighbours(xi, eta, swarm, -1)}"


def _fixed_probability(
    swarm: KnownSwarm,
    *,
    beta: float,  # [per cycle] probability
) -> str:
    """By chance."""
    return _with_probability(beta, swarm, "")


def _floor_colour(
    swarm: KnownSwarm,
    *,
    beta: float,  # [per cycle] probability where the ground has the colour
    label: Literal["green", "blue", "red", "yellow"],  # the colour
) -> str:
    """The ground has a colour."""
    return _with_probability(beta, swarm, f"where the ground is {label}")


def _with_probability(beta: float, swarm: KnownSwarm, where: str) -> str:
    if beta <= 0.0:
        return "never"
    if beta >= 1.0:
        return f"at once {where}".rstrip()
    place = f" {where}" if where else ""
    time = f"after {_seconds(1.0 / beta, swarm)}{' there' * bool(where)}, on average"
    return f"with probability {beta:g} a cycle{place} ({time})"


def _by_neighbours(xi: int, eta: float, swarm: KnownSwarm, sign: int) -> str:
    """The probabilities with none and with about xi neighbours; no more than there are other robots."""
    numbers = {0, max(0, int(xi) - 1), int(xi), int(xi) + 1}
    only = ""
    if swarm.robots is not None and swarm.robots <= max(numbers):
        numbers = {min(n, swarm.robots - 1) for n in numbers}
        only = f"; {_others(swarm.robots)}"
    found = [f"{_percent(logistic(float(eta) * sign * (n - xi)))} with {n or 'none'}" for n in sorted(numbers)]
    return f"{' and '.join(filter(None, (', '.join(found[:-1]), found[-1])))}, in each cycle{only}"


def robots_words(robots: int) -> str:
    """How many robots there are, in a sentence."""
    if robots == 1:
        return "There is 1 robot: it has no others."
    return f"There are {robots} robots: each has {robots - 1} other{'s' * (robots > 2)}."


def _others(robots: int) -> str:
    """How many other robots a robot has."""
    n = robots - 1
    return f"there {'are' if n > 1 else 'is'} {f'only {n}' if n else 'no'} other robot{'s' * (n > 1)}"


def _percent(probability: float) -> str:
    percent = 100.0 * probability
    if percent < 0.05:
        return "nearly 0 %"
    if percent > 99.95:
        return "nearly 100 %"
    return f"{percent:.{0 if 1.0 <= percent <= 99.0 else 1}f} %"


def _seconds(cycles: float, swarm: KnownSwarm) -> str:
    return f"{cycles * swarm.cycle:.3g} s"


BEHAVIOUR_WORDS: Mapping[str, Words] = {
    "exploration": _exploration,
    "stop": _stop,
    "phototaxis": _phototaxis,
    "anti-phototaxis": _anti_phototaxis,
    "attraction": _attraction,
    "repulsion": _repulsion,
}
CONDITION_WORDS: Mapping[str, Words] = {
    "black floor": _black_floor,
    "gray floor": _gray_floor,
    "white floor": _white_floor,
    "neighbours count": _neighbours_count,
    "inverted neighbours count": _inverted_neighbours_count,
    "fixed probability": _fixed_probability,
    "floor colour": _floor_colour,
}
_WORDS = {**BEHAVIOUR_WORDS, **CONDITION_WORDS}
MODULES: Mapping[str, Module] = {module.name: module for module in (*BEHAVIOURS, *CONDITIONS)}
"""Behaviours and conditions by name."""


def value_of(name: str, value: float) -> int | float | str:
    """The value of a parameter as people write it: a label by its colour."""
    if name == "label" and value in range(len(COLOUR_LABELS)):
        return COLOUR_LABELS[int(value)]
    return int(value) if math.isfinite(value) and value == int(value) else float(value)


def number_of(name: str, value: float | str) -> float:
    """The number of a value; undoes `value_of`."""
    return float(COLOUR_LABELS.index(value) if name == "label" and isinstance(value, str) else value)


def named_values(module: str, values: tuple[float, ...]) -> dict[str, int | float | str]:
    """The parameters of a module by name, as people write them."""
    names = [parameter.name for parameter in MODULES[module].parameters]
    return {name: value_of(name, value) for name, value in zip(names, values, strict=True)}


def parameters_words(module: str, values: tuple[float, ...]) -> str:
    """The parameters of a module with their units: "beta 0.5 per cycle"; empty if it has none."""
    found = []
    for name, value in named_values(module, values).items():
        unit = unit_of(_WORDS[module], name)
        found.append(f"{name} {value}{f' {unit}' * bool(unit)}")
    return ", ".join(found)


def module_words(module: str, values: tuple[float, ...], swarm: KnownSwarm) -> str:
    """What a module with these parameters does: "stands still"; with which probability a condition holds."""
    return _WORDS[module](swarm, **named_values(module, values))


def with_parameters(module: str, values: tuple[float, ...]) -> str:
    """A module with its parameters in one line: "black floor (beta 0.5 per cycle)"."""
    parameters = parameters_words(module, values)
    return f"{module} ({parameters})" if parameters else module
