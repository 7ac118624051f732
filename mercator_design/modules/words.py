"""Modules in words: what each does with its parameters, and these with their units."""

import math
from typing import TYPE_CHECKING

from mercator_design.errors import FsmError, described
from mercator_design.plugins.places import first_line, line_of
from mercator_design.plugins.registries import is_ours

if TYPE_CHECKING:
    from mercator_design.modules.module import KnownSwarm, Module, ModuleParameter


def probability_words(beta: float, swarm: "KnownSwarm", where: str) -> str:
    """A probability a cycle at a place, with the mean time that it means."""
    if beta <= 0.0:
        return "never"
    if beta >= 1.0:
        return f"at once {where}".rstrip()
    place = f" {where}" if where else ""
    time = f"after {seconds_words(1.0 / beta, swarm)}{' there' * bool(where)}, on average"
    return f"with probability {beta:g} a cycle{place} ({time})"


def robots_words(robots: int) -> str:
    """The number of robots, in a sentence."""
    if robots == 1:
        return "There is 1 robot: it has no others."
    return f"There are {robots} robots: each has {robots - 1} other{'s' * (robots > 2)}."


def others_words(robots: int) -> str:
    """The number of other robots that a robot has."""
    n = robots - 1
    return f"there {'are' if n > 1 else 'is'} {f'only {n}' if n else 'no'} other robot{'s' * (n > 1)}"


def percent_words(probability: float) -> str:
    """A probability in per cent."""
    percent = 100.0 * probability
    if percent < 0.05:
        return "nearly 0 %"
    if percent > 99.95:
        return "nearly 100 %"
    return f"{percent:.{0 if 1.0 <= percent <= 99.0 else 1}f} %"


def seconds_words(cycles: float, swarm: "KnownSwarm") -> str:
    """The duration of control cycles."""
    return f"{cycles * swarm.cycle:.3g} s"


def value_of(parameter: "ModuleParameter", value: float) -> int | float | str:
    """The value of a parameter as people write it: a number of a label by that label."""
    if value in range(len(parameter.labels)):
        return parameter.labels[int(value)]
    return int(value) if math.isfinite(value) and value == int(value) else float(value)


def number_of(parameter: "ModuleParameter", value: float | str) -> float:
    """The number of a value; undoes `value_of`."""
    return float(parameter.labels.index(value) if isinstance(value, str) else value)


def named_values(module: "Module", values: tuple[float, ...]) -> dict[str, int | float | str]:
    """The parameters of a module by name, as people write them."""
    return {one.name: value_of(one, value) for one, value in zip(module.parameters, values, strict=True)}


def parameters_words(module: "Module", values: tuple[float, ...]) -> str:
    """The parameters of a module with their units: "beta 0.5 per cycle"; empty if it has none."""
    found = []
    for name, value in named_values(module, values).items():
        unit = module.unit(name)
        found.append(f"{name} {value}{f' {unit}' * bool(unit)}")
    return ", ".join(found)


def module_words(module: "Module", values: tuple[float, ...], swarm: "KnownSwarm") -> str:
    """A module with these parameters in words: "stands still"; of a condition the probability that it holds."""
    if module.words is not None:
        try:
            return module.words(swarm, *values)
        except Exception as error:
            if is_ours(module.function):
                raise
            place = line_of(error) or first_line(module.function)
            raise FsmError(f"{place}words of {module.name}: {described(error)}") from None
    if module.kind == "behaviour":
        does = f"runs {module.name}"
    elif module.has_beta:
        does = probability_words(values[0], swarm, f"where {module.name} holds")
    else:
        does = f"with the probability of {module.name}"
    return f"{does}: {module.sentence}" if module.sentence else does


def with_parameters(module: "Module", values: tuple[float, ...]) -> str:
    """A module with its parameters in one line: "black floor (beta 0.5 per cycle)"."""
    parameters = parameters_words(module, values)
    return f"{module.name} ({parameters})" if parameters else module.name
