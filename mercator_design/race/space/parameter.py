"""A parameter: its kind, its domain, its condition, and the mapping of its values to the unit interval.

`quantile` maps u in [0, 1] to a value; `position` maps a value back to the middle of its part of the interval. The
first configurations and the sampling model use this scale.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

from mercator_design.errors import RaceError
from mercator_design.race.space.expressions import Expression
from mercator_design.race.space.r_operators import MAX_INTEGER, number, number_text
from mercator_design.race.space.relations import ValueIn, ValuePlus

Value = str | int | float
Configuration = dict[str, Value]
Key = tuple[Value, ...]
"""Equal configurations have equal keys."""
Kind = Literal["categorical", "ordered", "integer", "real"]
Bounds = tuple[float, float]
Bound = float | Expression | ValuePlus
Condition = Expression | ValueIn

DEFAULT_DIGITS = 4
"""Decimal places of a real value (irace)."""
MAX_DIGITS = 15
"""With more decimal places a value would be rounded by its floating-point format (irace)."""


def key_of(configuration: Mapping[str, Value]) -> Key:
    """The key of a configuration: the names of its parameters in alphabetical order, then their values."""
    names = sorted(configuration)
    return (*names, *map(configuration.__getitem__, names))


@dataclass(frozen=True, kw_only=True, slots=True)
class Parameter:
    """A parameter of a space; `categorical`, `ordered`, `integer` and `real` make one.

    Args:
        name: Letters, digits, dots and underscores.
        kind: The kind of its values.
        switch: The text before the value on a command line, including the blank or "=".
        values: The values of a categorical or ordered parameter, as text.
        low, high: The inclusive bounds of an integer or real parameter: numbers, or functions of other numeric
            parameters.
        log: Whether it is sampled on a logarithmic scale.
        digits: Decimal places of a real value.
        condition: The parameter is active where this is true; None: always.

    Raises:
        RaceError: The domain is not valid.
    """

    name: str
    kind: Kind
    switch: str = ""
    values: tuple[str, ...] = ()
    low: Bound = 0
    high: Bound = 0
    log: bool = False
    digits: int = DEFAULT_DIGITS
    condition: Condition | None = None

    def __post_init__(self) -> None:
        if self.is_numeric:
            self._check_bounds()
        else:
            self._check_values()

    @property
    def is_numeric(self) -> bool:
        return self.kind in {"integer", "real"}

    @property
    def is_fixed(self) -> bool:
        """Whether there is only one value."""
        return len(self.values) == 1

    @property
    def is_dependent(self) -> bool:
        """Whether the bounds depend on other parameters."""
        return not isinstance(self.low, int | float) or not isinstance(self.high, int | float)

    @property
    def bound_names(self) -> tuple[str, ...]:
        """The names of the parameters that the bounds depend on."""
        return tuple(n for bound in (self.low, self.high) if not isinstance(bound, int | float) for n in bound.names)

    @property
    def depends_on(self) -> tuple[str, ...]:
        """The names of the parameters that the bounds and the condition depend on."""
        return (*self.bound_names, *(self.condition.names if self.condition is not None else ()))

    @property
    def domain(self) -> str:
        """The domain as parameters.txt writes it, for messages."""
        if not self.is_numeric:
            return f"({', '.join(self.values)})"
        return f"({_bound_text(self.low)}, {_bound_text(self.high)})"

    def bounds(self, configuration: Mapping[str, Value]) -> Bounds | None:
        """Inclusive bounds for a configuration, or None if they are NA; 1 .. number of values if not numeric.

        Raises:
            RaceError: The lower bound exceeds the upper one, or one is not finite.
        """
        if not self.is_numeric:
            return 1, len(self.values)
        low = self.low if isinstance(self.low, int | float) else self.low(configuration)
        high = self.high if isinstance(self.high, int | float) else self.high(configuration)
        if low is None or high is None:
            return None
        if self.kind == "integer" and math.isfinite(low) and math.isfinite(high):
            low, high = int(low), int(high)
        if low > high or not self._is_representable(low, high):
            given = ", ".join(f"{n} = {configuration.get(n)}" for n in dict.fromkeys(self.bound_names))
            raise RaceError(
                f"parameter '{self.name}', domain {self.domain}: expected finite lower <= upper, "
                f"found ({low}, {high}) with {given}; a condition must exclude this case"
            )
        return low, high

    def quantile(self, u: float, bounds: Bounds) -> Value:
        """The value at u in [0, 1], as irace's param_quantile."""
        low, high = bounds
        if self.kind == "real":
            value = (
                math.exp(_interpolated(u, math.log(low), math.log(high))) if self.log else _interpolated(u, low, high)
            )
            return min(max(self.rounded(value), low), high)
        if self.log:
            value = min(max(math.exp(_interpolated(u, math.log(low), math.log(high + 1))), low), high + 1)
        else:
            value = _interpolated(u, low, high + 1)
        whole = int(min(high, math.floor(value)))
        return whole if self.kind == "integer" else self.values[whole - 1]

    def rounded(self, value: float) -> float:
        """Round a real value to `digits` decimal places; -0.0 becomes 0.0."""
        return round(value, self.digits) + 0.0

    def position(self, value: Value, bounds: Bounds) -> float:
        """The place of a value in the unit interval; inverse of `quantile`, for integers the middle of their part."""
        low, high = bounds
        if self.kind == "real":
            number = float(value)
        else:
            number = (self.values.index(str(value)) + 1 if self.values else float(value)) + 0.5
            high += 1
        if low == high:
            return 0.5
        if self.log:
            return (math.log(number) - math.log(low)) / (math.log(high) - math.log(low))
        return (number - low) / (high - low)

    def is_valid(self, value: Value, bounds: Bounds) -> bool:
        """Whether a value is of this parameter's kind and within the bounds."""
        if not self.is_numeric:
            return value in self.values
        kinds = (int,) if self.kind == "integer" else (int, float)
        return isinstance(value, kinds) and not isinstance(value, bool) and bounds[0] <= value <= bounds[1]

    def check(self, value: Value, bounds: Bounds) -> None:
        """Raise a RaceError unless a value is of this parameter's kind and within the bounds."""
        if not self.is_valid(value, bounds):
            if self.is_numeric:
                expected = f"{self.kind} within ({number_text(bounds[0])}, {number_text(bounds[1])})"
            else:
                expected = "one of " + ", ".join(f'"{v}"' for v in self.values)
            raise RaceError(f"parameter '{self.name}': expected {expected}, found {value!r}")

    def _check_values(self) -> None:
        if not self.values:
            raise RaceError(f"parameter '{self.name}': expected at least one value, found none")
        repeated = [v for v in dict.fromkeys(self.values) if self.values.count(v) > 1]
        if repeated:
            raise RaceError(f"parameter '{self.name}': expected different values, found '{repeated[0]}' twice")
        if self.log:
            raise RaceError(f"parameter '{self.name}': only integer and real parameters may be log, found {self.kind}")
        if self.kind == "ordered":
            try:
                numbers = [number(v) for v in self.values]
            except ValueError:
                return
            if any(b <= a for a, b in pairwise(numbers)):
                raise RaceError(f"parameter '{self.name}': expected increasing numbers, found {self.domain}")

    def _is_representable(self, low: float, high: float) -> bool:
        """Whether R's integers, or floats, can represent all values between two bounds, and their difference."""
        if self.kind == "integer":
            return max(abs(low), abs(high)) <= MAX_INTEGER
        return math.isfinite(high - low)

    def _check_bounds(self) -> None:
        place = f"parameter '{self.name}', domain {self.domain}"
        if not 1 <= self.digits <= MAX_DIGITS:
            raise RaceError(f"{place}: expected 1 to {MAX_DIGITS} digits, found {self.digits}")
        if self.log and self.is_dependent:
            raise RaceError(f"{place}: expected numbers as bounds of a log parameter, found a dependent domain")
        for bound in (self.low, self.high):
            if not isinstance(bound, int | float):
                continue
            if not math.isfinite(bound):
                raise RaceError(f"{place}: expected finite bounds, found {bound}")
            if self.kind == "integer" and bound != int(bound):
                raise RaceError(f"{place}: expected whole numbers, found {number_text(bound)}")
            if self.kind == "real" and round(bound, self.digits) != bound:
                raise RaceError(f"{place}: expected bounds of at most {self.digits} digits, found {number_text(bound)}")
        if not isinstance(self.low, int | float) or not isinstance(self.high, int | float):
            return
        if not self._is_representable(self.low, self.high):
            expected = f"integers up to {MAX_INTEGER}" if self.kind == "integer" else "a finite difference"
            raise RaceError(f"{place}: expected {expected}, found too large bounds")
        if self.low >= self.high:
            raise RaceError(f"{place}: expected lower < upper; a single value is written as a categorical parameter")
        if self.log and self.low <= 0:
            raise RaceError(f"{place}: expected a lower bound above 0 for a log parameter")


def categorical(
    name: str, values: Iterable[object], *, switch: str = "", condition: str | Condition | None = None
) -> Parameter:
    """A parameter with unordered values, which become text."""
    return _parameter(name, "categorical", switch, condition, values=tuple(map(str, values)))


def ordered(
    name: str, values: Iterable[object], *, switch: str = "", condition: str | Condition | None = None
) -> Parameter:
    """A parameter with ordered values, which become text."""
    return _parameter(name, "ordered", switch, condition, values=tuple(map(str, values)))


def integer(
    name: str,
    low: str | Bound,
    high: str | Bound,
    *,
    log: bool = False,
    switch: str = "",
    condition: str | Condition | None = None,
) -> Parameter:
    """A whole number within inclusive bounds, which may be expressions of other parameters."""
    return _parameter(name, "integer", switch, condition, low=_bound(low), high=_bound(high), log=log)


def real(
    name: str,
    low: str | Bound,
    high: str | Bound,
    *,
    log: bool = False,
    digits: int = DEFAULT_DIGITS,
    switch: str = "",
    condition: str | Condition | None = None,
) -> Parameter:
    """A real number within inclusive bounds, rounded to `digits` decimal places."""
    return _parameter(name, "real", switch, condition, low=_bound(low), high=_bound(high), log=log, digits=digits)


def _parameter(name: str, kind: Kind, switch: str, condition: str | Condition | None, **domain: Any) -> Parameter:  # noqa: ANN401
    active = Expression(condition) if isinstance(condition, str) else condition
    return Parameter(name=name, kind=kind, switch=switch, condition=active, **domain)


def _interpolated(u: float, low: float, high: float) -> float:
    return low + u * (high - low)


def _bound(bound: str | Bound) -> Bound:
    return bound_of(Expression(bound, arithmetic=True)) if isinstance(bound, str) else bound


def bound_of(expression: Expression) -> float | Expression:
    """The value of an expression without parameters, or else the expression."""
    if expression.names:
        return expression
    value = expression({})
    return math.nan if value is None else float(value) if isinstance(value, float) else int(value)


def _bound_text(bound: Bound) -> str:
    return number_text(bound) if isinstance(bound, int | float) else bound.text
