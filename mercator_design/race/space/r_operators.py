"""The operators of the expression language, as closures over the values of parameters.

As in R, the result of an operation on NA, here None, is NA, except for `FALSE & NA`, `TRUE | NA`, `%in%` and `is.na`.
An operation on vectors, here tuples, works member by member; a vector of one member is that member. A Python int is an
integer of R, a float is a double.
"""

import math
import operator
import re
from collections.abc import Callable
from decimal import Decimal
from typing import Any

Values = tuple[Any, ...]
Closure = Callable[[Values], Any]
Operation = Callable[[Any, Any], Any]

CONSTANTS = {"TRUE": True, "FALSE": False, "NA": None, "NULL": None, "Inf": math.inf}
COMPARISONS = {
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
MAX_INTEGER = 2**31 - 1
"""R's largest integer."""
MAX_MEMBERS = 100_000
"""Maximum length of a vector."""
_MAX_WHOLE = 2**63 - 1
_SIGNIFICANT_DIGITS = 15
_WHOLE = re.compile(r"[+-]?[0-9]+")
_NUMBER = re.compile(
    r"[+-]?(?:(?P<hex>0x(?:[0-9a-f]+\.?[0-9a-f]*|\.[0-9a-f]+)(?:p[+-]?[0-9]+)?)"
    r"|(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:e[+-]?[0-9]+)?|inf|infinity|nan)",
    re.IGNORECASE,
)


def is_true(value: Any) -> bool:  # noqa: ANN401 - the value of any expression
    """Whether a condition holds; NA does not hold."""
    if value is True or value is False or value is None:  # nearly always
        return value is True
    return logical(value)


def number_text(value: float) -> str:
    """A number as irace writes it on a command line: up to 15 significant digits, no exponent, and no sign of zero."""
    text = str(value) if isinstance(value, int) else f"{value + 0.0:.{_SIGNIFICANT_DIGITS}g}"
    return format(Decimal(text), "f") if "e" in text else text


def value_text(value: Any) -> str:  # noqa: ANN401
    """A value as text, as R's as.character: a double is 1e+05, not 100000."""
    if isinstance(value, str):
        return value
    if isinstance(value, bool):
        return str(value).upper()
    if isinstance(value, int):
        return str(value)
    if not math.isfinite(value):
        return "NaN" if math.isnan(value) else "Inf" if value > 0 else "-Inf"
    mantissa, _, exponent = f"{value + 0.0:.{_SIGNIFICANT_DIGITS - 1}e}".partition("e")
    mantissa = mantissa.rstrip("0").rstrip(".")
    scientific = f"{mantissa}e{exponent}"
    fixed = format(Decimal(scientific), "f")
    return fixed if len(fixed) <= len(scientific) else scientific


def number(text: str) -> float:
    """Read a number, decimal or hexadecimal, as R does.

    Raises:
        ValueError: The text is not a number.
    """
    text = text.strip()
    if _WHOLE.fullmatch(text):
        try:
            return _as_r_number(int(text))
        except (ValueError, OverflowError):  # Python limits the number of digits
            return float(text)
    match = _NUMBER.fullmatch(text)
    if match is None:
        raise ValueError(text)
    if match["hex"] is None:
        return float(text)
    return _hexadecimal(text)


def _hexadecimal(text: str) -> float:
    try:
        value = float.fromhex(text)
    except OverflowError:
        return -math.inf if text.startswith("-") else math.inf
    return int(value) if value.is_integer() and abs(value) <= _MAX_WHOLE else value


def constant(value: Any) -> Closure:  # noqa: ANN401 - any literal
    return lambda _: value


def vector(members: tuple[Any, ...]) -> Any:  # noqa: ANN401
    """The value of some members: one member is no tuple."""
    return members[0] if len(members) == 1 else members


def members_of(value: Any) -> tuple[Any, ...]:  # noqa: ANN401
    return value if isinstance(value, tuple) else (value,)


def each(operation: Callable[..., Any], arguments: list[Any]) -> Any:  # noqa: ANN401
    """The result of an operation on values, member by member if some are vectors; shorter ones are repeated."""
    lengths = [len(a) for a in arguments if isinstance(a, tuple)]
    if not lengths:
        return operation(*arguments)
    longest = 0 if 0 in lengths else max(lengths)
    rows = [members_of(a) for a in arguments]
    return tuple(operation(*(row[k % len(row)] for row in rows)) for k in range(longest))


def strict(operation: Callable[..., Any], *operands: Closure) -> Closure:
    """An operation whose result is NA if an operand is NA."""

    def one(*arguments: Any) -> Any:  # noqa: ANN401
        if any(a is None for a in arguments):
            return None
        result = operation(*arguments)
        return None if isinstance(result, float) and math.isnan(result) else result

    return lift(one, *operands)


def lift(operation: Callable[..., Any], *operands: Closure) -> Closure:
    """An operation on values as one on closures; it has to take NA."""
    return lambda values: each(operation, [operand(values) for operand in operands])


def numeric(operation: Callable[..., Any], *operands: Closure) -> Closure:
    """A strict operation on numbers."""
    return strict(lambda *arguments: _as_r_number(operation(*map(number_of, arguments))), *operands)


def some(*values: Any) -> bool | None:  # noqa: ANN401
    """`a | b | ...`: whether one of the values is true; NA if that depends on missing values."""
    found = [_truth(value) for value in values]
    return True if True in found else None if None in found else False


def every(*values: Any) -> bool | None:  # noqa: ANN401
    """`a & b & ...`: whether all values are true; NA if that depends on missing values."""
    found = [_truth(value) for value in values]
    return False if False in found else None if None in found else True


def member(left: Closure, right: Closure) -> Closure:
    """`x %in% c(...)`, which is never NA."""

    def apply(values: Values) -> Any:  # noqa: ANN401
        members = members_of(right(values))
        return each(lambda a: any(_matches(a, m) for m in members), [left(values)])

    return apply


def _matches(a: Any, b: Any) -> bool:  # noqa: ANN401
    if a is None or b is None:
        return a is b
    one, other = comparable(a, b)
    return bool(one == other)


def combine(*values: Any) -> Any:  # noqa: ANN401
    """`c(...)`: one vector of all members. If one is text, all become text; else if one is a number, all do."""
    members = tuple(m for value in values for m in members_of(value))
    if any(isinstance(m, str) for m in members):
        members = tuple(m if m is None else value_text(m) for m in members)
    elif any(isinstance(m, float) for m in members):
        members = tuple(m if m is None else float(m) for m in members)
    elif any(isinstance(m, int) and not isinstance(m, bool) for m in members):
        members = tuple(m if m is None else int(m) for m in members)
    return vector(members)


def span(low: Closure, high: Closure) -> Closure:
    """`low:high`."""
    return lambda values: between(low(values), high(values))


def between(low: Any, high: Any) -> Any:  # noqa: ANN401
    """The numbers from one to another in steps of 1, up or down; integers if the first is whole."""
    first, last = (_end(end) for end in (low, high))
    n = int(abs(last - first) + 1e-10) + 1
    check_length(n)
    step = 1 if first <= last else -1
    start = int(first) if first.is_integer() else first
    return vector(tuple(start + k * step for k in range(n)))


def _end(value: Any) -> float:  # noqa: ANN401
    first = members_of(value)[0] if value != () else None
    if first is None or isinstance(first, str) or not math.isfinite(first):
        raise TypeError(f"expected a number on each side of ':', found {value!r}")
    return float(first)


def check_length(n: float) -> None:
    if n > MAX_MEMBERS:
        raise TypeError(f"expected at most {MAX_MEMBERS} members of a vector, found {n:.0f}")


def comparable(a: Any, b: Any) -> tuple[Any, Any]:  # noqa: ANN401
    """Convert two values for a comparison: to text if one of them is text."""
    if isinstance(a, str) or isinstance(b, str):
        return value_text(a), value_text(b)
    return a, b


def _truth(value: Any) -> bool | None:  # noqa: ANN401
    return None if value is None else logical(value)


def logical(value: Any) -> bool:  # noqa: ANN401
    return bool(number_of(value, "TRUE or FALSE"))


def number_of(value: Any, expected: str = "a number") -> float:  # noqa: ANN401
    if isinstance(value, (str, tuple)):
        raise TypeError(f"expected {expected}, found {value!r}")
    return value  # type: ignore[no-any-return]  # an int stays an int


def _as_r_number(value: float) -> float:
    """Convert a whole number that is too large for 64 bits to a float."""
    return float(value) if abs(value) > _MAX_WHOLE else value


def divide(a: float, b: float) -> float:
    if b == 0:
        return math.nan if a == 0 else math.copysign(math.inf, a)
    return a / b


def modulo(a: float, b: float) -> float:
    return math.nan if b == 0 else a % b


def whole_quotient(a: float, b: float) -> float:
    quotient = divide(a, b)
    return math.floor(quotient) if math.isfinite(quotient) else quotient


def power(a: float, b: float) -> float:
    try:
        return math.pow(a, b)
    except ValueError:
        return math.nan if a else math.inf
    except OverflowError:
        return -math.inf if a < 0 and b % 2 else math.inf
