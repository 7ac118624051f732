"""The functions of the expression language, as in R.

A function makes a closure from the closures of its arguments, in the order of their names. A function with any number
of arguments has only names that must be written, such as `na.rm = TRUE`.
"""

import math
import re
import warnings
from collections.abc import Callable, Mapping
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from mercator_design.race.space.r_operators import (
    MAX_INTEGER,
    Closure,
    Values,
    between,
    check_length,
    combine,
    each,
    every,
    lift,
    logical,
    members_of,
    number,
    number_of,
    numeric,
    some,
    strict,
    value_text,
    vector,
)

_LOGICAL = dict.fromkeys(("TRUE", "true", "T", "True"), True)
_LOGICAL |= dict.fromkeys(("FALSE", "false", "F", "False"), False)
_MAX_DIGITS = 400
"""More digits than a number has on either side of its point; Python computes ten to the power of what it is given."""
_POSIX_CLASSES = {
    "[:alnum:]": "0-9A-Za-z",
    "[:alpha:]": "A-Za-z",
    "[:blank:]": r" \t",
    "[:digit:]": "0-9",
    "[:lower:]": "a-z",
    "[:punct:]": r"!-/:-@\[-`{-~",
    "[:space:]": r"\s",
    "[:upper:]": "A-Z",
    "[:xdigit:]": "0-9A-Fa-f",
}


class Function(NamedTuple):
    """A function of the language."""

    make: Callable[..., Closure]
    names: tuple[str, ...] = ("x",)  # of the arguments
    min_arguments: int = 1
    is_variadic: bool = False  # whether it takes any number of arguments

    def arguments(self, given: list[tuple[str, Closure]]) -> tuple[list[Closure], dict[str, Closure]]:
        """The arguments in the order of their names; for a variadic function, named ones separately.

        Raises:
            TypeError: A name is unknown or given twice, or there are too many or too few arguments.
        """
        named: dict[str, Closure] = {}
        for name, closure in given:
            if name:
                full = self._full(name)
                if full in named:
                    raise TypeError(f"one argument '{full}'")
                named[full] = closure
        free = [closure for name, closure in given if not name]
        wanted = [name for name in self.names if name not in named]
        n = len(free) + (0 if self.is_variadic else len(named))
        if n < self.min_arguments or (not self.is_variadic and len(free) > len(wanted)):
            if self.is_variadic:
                raise TypeError(f"{self.min_arguments} or more arguments")
            raise TypeError(
                "1 argument" if len(self.names) == 1 else f"{self.min_arguments} to {len(self.names)} arguments"
            )
        if self.is_variadic:
            return free, named
        named |= dict(zip(wanted, free, strict=False))
        places = [place for place, name in enumerate(self.names) if name in named]
        return [named.get(name, _absent) for name in self.names[: max(places) + 1]], {}

    def _full(self, name: str) -> str:
        """The full name of an argument; a unique beginning is enough."""
        found = [name] if name in self.names else [one for one in self.names if one.startswith(name)]
        if len(found) != 1:
            raise TypeError(f"arguments {', '.join(self.names)}" if self.names else "arguments without names")
        return found[0]


def _absent(_: Values) -> None:
    """The closure of an omitted argument."""


def _of_numbers(operation: Callable[..., Any], *names: str) -> Function:
    return Function(lambda *operands: numeric(operation, *operands), names or ("x",))


def _rounded(operation: Callable[[float], float]) -> Callable[[float], float]:
    return lambda a: operation(a) if math.isfinite(a) else a


def _double(operation: Callable[[float], float]) -> Callable[[float], float]:
    """An operation whose result for a double is a double."""
    return lambda a: float(operation(a)) if isinstance(a, float) else operation(a)


def _round(a: float, digits: float = 0) -> float:
    digits = min(max(digits, -_MAX_DIGITS), _MAX_DIGITS)
    return round(a, int(digits)) if math.isfinite(a) else a


def _quietly(operation: Callable[..., Any]) -> Callable[..., float]:
    """A function of numpy without its warnings; its infinities and NaN are those of R."""

    def apply(*arguments: float) -> float:
        with np.errstate(all="ignore"):
            return float(operation(*(np.float64(a) for a in arguments)))

    return apply


def _log(a: float, base: float | None = None) -> float:
    if base is None:
        return float(np.log(a))
    exact = {2.0: np.log2, 10.0: np.log10}.get(float(base))
    return float(exact(a) if exact else np.log(a) / np.log(base))


def _over_all(operation: Callable[..., Any], *, of_logical: bool = False) -> Callable[..., Closure]:
    """A function of all members of all arguments; with na.rm, missing members are left out."""

    def make(*operands: Closure, **options: Closure) -> Closure:
        remove = options.get("na.rm")

        def apply(values: Values) -> Any:  # noqa: ANN401
            members = [m for operand in operands for m in members_of(operand(values))]
            if remove is not None and remove(values) is True:
                members = [m for m in members if m is not None]
            if of_logical:
                return operation(*members)
            if any(m is None for m in members):
                return None
            return operation([number_of(m) + 0 for m in members])

        return apply

    return make


def _combined(*operands: Closure) -> Closure:
    return lambda values: combine(*(operand(values) for operand in operands))


def _as_logical(value: Any) -> bool | None:  # noqa: ANN401
    return _LOGICAL.get(value) if isinstance(value, str) else logical(value)


def _as_number(value: Any) -> float | None:  # noqa: ANN401
    if not isinstance(value, str):
        return float(number_of(value))
    try:
        return float(number(value))
    except ValueError:
        return None


def _as_integer(value: Any) -> int | None:  # noqa: ANN401
    found = _as_number(value)
    return None if found is None or not abs(found) <= MAX_INTEGER else int(found)


def _if_else(test: Closure, yes: Closure, no: Closure) -> Closure:
    def apply(values: Values) -> Any:  # noqa: ANN401
        def choose(number: int, chosen: Any) -> Any:  # noqa: ANN401
            truth = None if chosen is None else _as_logical(chosen)
            if truth is None:
                return None
            members = members_of((yes if truth else no)(values))
            return members[number % len(members)] if members else None

        return vector(tuple(choose(number, one) for number, one in enumerate(members_of(test(values)))))

    return apply


def _sequence(*given: Closure) -> Closure:
    """`seq(from, to, by, length.out)`; with one argument the numbers from 1 to this, or to the length of this."""

    def apply(values: Values) -> Any:  # noqa: ANN401
        found: list[Any] = [operand(values) for operand in given]
        if len(found) == 1:
            return between(1, len(found[0]) if isinstance(found[0], tuple) else found[0])
        for one, operand in zip(found, given, strict=True):
            if isinstance(one, (str, tuple)) or (one is None and operand is not _absent):
                raise TypeError(f"expected numbers in seq(), found {one!r}")
        first, last, by, length = found + [None] * (4 - len(found))
        if length is not None:
            return _of_length(first, last, by, length)
        first = 1.0 if first is None else first
        last = 1.0 if last is None else last
        if by is None:
            return between(first, last)
        if first == last:
            return first
        steps = (last - first) / by if by else -1.0
        if not 0 <= steps < math.inf:
            raise TypeError(f"expected steps that lead from {first:g} to {last:g}, found {by:g}")
        check_length(steps)
        return vector(tuple(first + k * by for k in range(int(steps + 1e-10) + 1)))

    return apply


def _of_length(first: float | None, last: float | None, by: float | None, length: float) -> Any:  # noqa: ANN401
    check_length(length)
    n = max(math.ceil(length), 0)
    if first is not None and last is not None and by is not None:
        raise TypeError("expected three of from, to, by and length.out in seq(), found all four")
    if by is None:
        if first is not None and last is not None:
            by = (last - first) / (n - 1) if n > 1 else 0.0
            inner = [first + k * by for k in range(1, n - 1)]
            return vector((first, *inner, last)[:n])
        by = 1
    if first is None:
        first = 1 if last is None else last - (n - 1) * by
    return vector(tuple(first + k * by for k in range(n)))


def _matcher(*given: Closure) -> Closure:
    """`grepl(pattern, x, ignore.case, perl, fixed)`."""
    pattern, x = given[:2]

    def apply(values: Values) -> Any:  # noqa: ANN401
        ignore_case, _, fixed = (operand(values) is True for operand in (*given[2:], *[_absent] * (5 - len(given))))
        wanted = pattern(values)
        if wanted is None:
            return None
        search = _pattern(value_text(wanted), ignore_case, fixed).search
        return each(lambda a: a is not None and search(value_text(a)) is not None, [x(values)])

    return apply


@lru_cache(maxsize=256)
def _pattern(text: str, ignore_case: bool, fixed: bool) -> re.Pattern[str]:
    wanted = re.escape(text) if fixed else text
    for name, members in _POSIX_CLASSES.items():
        wanted = wanted if fixed else wanted.replace(name, members)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # on syntax that future versions of Python may change
            return re.compile(wanted, re.IGNORECASE if ignore_case else 0)
    except (re.error, OverflowError) as error:
        raise TypeError(f"expected a regular expression, found {text!r}: {error}") from None


Functions = Mapping[str, Function]

ARITHMETIC_FUNCTIONS: Functions = {
    "min": Function(_over_all(partial(min, default=math.inf)), ("na.rm",), is_variadic=True),
    "max": Function(_over_all(partial(max, default=-math.inf)), ("na.rm",), is_variadic=True),
    "round": _of_numbers(_round, "x", "digits"),
    "floor": _of_numbers(_rounded(math.floor)),
    "ceiling": _of_numbers(_rounded(math.ceil)),
    "trunc": _of_numbers(_rounded(math.trunc)),
}
"""The functions that a bound of a domain may use."""
FUNCTIONS: Functions = {
    **ARITHMETIC_FUNCTIONS,
    "floor": _of_numbers(_double(_rounded(math.floor))),
    "ceiling": _of_numbers(_double(_rounded(math.ceil))),
    "trunc": _of_numbers(_double(_rounded(math.trunc))),
    "abs": _of_numbers(abs),
    "sqrt": _of_numbers(_quietly(np.sqrt)),
    "exp": _of_numbers(_quietly(np.exp)),
    "log": _of_numbers(_quietly(_log), "x", "base"),
    "log2": _of_numbers(_quietly(np.log2)),
    "log10": _of_numbers(_quietly(np.log10)),
    "sum": Function(_over_all(sum), ("na.rm",), 0, is_variadic=True),
    "any": Function(_over_all(some, of_logical=True), ("na.rm",), 0, is_variadic=True),
    "all": Function(_over_all(every, of_logical=True), ("na.rm",), 0, is_variadic=True),
    "c": Function(_combined, (), is_variadic=True),
    "seq": Function(_sequence, ("from", "to", "by", "length.out")),
    "is.na": Function(lambda operand: lift(lambda a: a is None, operand)),
    "as.numeric": Function(lambda operand: strict(_as_number, operand)),
    "as.integer": Function(lambda operand: strict(_as_integer, operand)),
    "as.logical": Function(lambda operand: strict(_as_logical, operand)),
    "as.character": Function(lambda operand: strict(value_text, operand)),
    "nchar": Function(lambda operand: strict(lambda a: len(value_text(a)), operand)),
    "grepl": Function(_matcher, ("pattern", "x", "ignore.case", "perl", "fixed"), 2),
    "ifelse": Function(_if_else, ("test", "yes", "no"), 3),
    "xor": Function(lambda a, b: strict(lambda x, y: logical(x) != logical(y), a, b), ("x", "y"), 2),
}
