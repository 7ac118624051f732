"""What the operators and functions of the expression language do: closures over the values of parameters.

As in R: NA, here None, spreads through an operation, but for `FALSE & NA`, `TRUE | NA`, `%in%` and `is.na`.
"""

import math
import operator
from collections.abc import Callable
from decimal import Decimal
from typing import Any

import numpy as np

Values = tuple[Any, ...]
Closure = Callable[[Values], Any]


CONSTANTS = {"TRUE": True, "FALSE": False, "NA": None, "NULL": None, "Inf": math.inf}
_LOGICAL = dict.fromkeys(("TRUE", "true", "T", "True"), True)
_LOGICAL |= dict.fromkeys(("FALSE", "false", "F", "False"), False)
_LARGEST_WHOLE = 2**63 - 1
COMPARISONS = {
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


def is_true(value: Any) -> bool:  # noqa: ANN401 - whatever an expression may give
    """Whether a condition holds: NA does not."""
    if value is True or value is False or value is None:  # nearly always
        return value is True
    return logical(value)


def number_text(value: float) -> str:
    """A number as irace writes it on a command line: up to 15 significant digits, never with an exponent."""
    text = str(value) if isinstance(value, int) else f"{value:.15g}"
    return format(Decimal(text), "f") if "e" in text else text


def constant(value: Any) -> Closure:  # noqa: ANN401 - any literal
    return lambda _: value


def strict(operation: Callable[..., Any], *operands: Closure) -> Closure:
    """An operation that is NA as soon as one operand is."""

    def apply(values: Values) -> Any:  # noqa: ANN401
        arguments = [operand(values) for operand in operands]
        if any(a is None for a in arguments):
            return None
        result = operation(*arguments)
        return None if isinstance(result, float) and math.isnan(result) else result

    return apply


def numeric(operation: Callable[..., Any], *operands: Closure) -> Closure:
    """A strict operation on numbers."""
    return strict(lambda *arguments: _as_r_has_it(operation(*map(_number_of, arguments))), *operands)


def any_of(*operands: Closure) -> Closure:
    """`a | b | ...`."""

    def apply(values: Values) -> bool | None:
        found = [_truth(operand(values)) for operand in operands]
        return True if True in found else None if None in found else False

    return apply


def all_of(*operands: Closure) -> Closure:
    """`a & b & ...`."""

    def apply(values: Values) -> bool | None:
        found = [_truth(operand(values)) for operand in operands]
        return False if False in found else None if None in found else True

    return apply


def member(left: Closure, right: Closure) -> Closure:
    """`x %in% c(...)`, which is never NA."""

    def apply(values: Values) -> bool:
        a, b = left(values), right(values)
        members = b if isinstance(b, tuple) else (b,)
        return any(a is m or (a is not None and m is not None and operator.eq(*comparable(a, m))) for m in members)

    return apply


def comparable(a: Any, b: Any) -> tuple[Any, Any]:  # noqa: ANN401
    if isinstance(a, tuple) or isinstance(b, tuple):
        raise TypeError("expected single values, found c(...)")
    if isinstance(a, str) or isinstance(b, str):
        return _text_of(a), _text_of(b)
    return a, b


def _text_of(value: Any) -> str:  # noqa: ANN401
    if isinstance(value, str):
        return value
    return str(value).upper() if isinstance(value, bool) else number_text(value)


def _truth(value: Any) -> bool | None:  # noqa: ANN401
    return None if value is None else logical(value)


def logical(value: Any) -> bool:  # noqa: ANN401
    return bool(_number_of(value, "TRUE or FALSE"))


def _number_of(value: Any, expected: str = "a number") -> float:  # noqa: ANN401
    if isinstance(value, (str, tuple)):
        raise TypeError(f"expected {expected}, found {value!r}")
    return value  # type: ignore[no-any-return]  # an int stays an int


def _as_logical(value: Any) -> bool | None:  # noqa: ANN401
    return _LOGICAL.get(value) if isinstance(value, str) else logical(value)


def _as_number(value: Any) -> float | None:  # noqa: ANN401
    if not isinstance(value, str):
        return _number_of(value) + 0
    try:
        return number(value)
    except ValueError:
        return None


def number(text: str) -> float:
    """The number that a text is.

    Raises:
        ValueError: It is none.
    """
    if "_" in text:  # which Python takes, and nobody else
        raise ValueError(text)
    try:
        return _as_r_has_it(int(text))
    except (ValueError, OverflowError):
        return float(text)


def _as_r_has_it(value: float) -> float:
    """A whole number that is too large for 64 bits as the nearest float."""
    return float(value) if abs(value) > _LARGEST_WHOLE else value


def divide(a: float, b: float) -> float:
    if b == 0:
        return math.nan if a == 0 else math.copysign(math.inf, a)
    return a / b


def modulo(a: float, b: float) -> float:
    return math.nan if b == 0 else a % b


def whole_quotient(a: float, b: float) -> float:
    return _whole(math.floor)(divide(a, b))


def power(a: float, b: float) -> float:
    try:
        return math.pow(a, b)
    except ValueError:
        return math.nan if a else math.inf
    except OverflowError:
        return -math.inf if a < 0 and b % 2 else math.inf


def _log(a: float, base: float = math.e) -> float:
    with np.errstate(all="ignore"):
        return float(np.log(a) / np.log(base))


def _whole(operation: Callable[[float], float]) -> Callable[[float], float]:
    return lambda a: operation(a) if math.isfinite(a) else a


def _is_missing(operand: Closure) -> Closure:
    return lambda values: operand(values) is None


def _list(*operands: Closure) -> Closure:
    return lambda values: tuple(operand(values) for operand in operands)


def _on_numbers(operation: Callable[..., Any]) -> Callable[..., Closure]:
    return lambda *operands: numeric(operation, *operands)


Functions = dict[str, tuple[int, int, Callable[..., Closure]]]

ARITHMETIC_FUNCTIONS: Functions = {
    # name: fewest and most arguments, closure of the arguments' closures
    "min": (1, 99, _on_numbers(lambda *a: min(a))),
    "max": (1, 99, _on_numbers(lambda *a: max(a))),
    "round": (1, 2, _on_numbers(lambda a, digits=0: round(a, int(digits)) if math.isfinite(a) else a)),
    "floor": (1, 1, _on_numbers(_whole(math.floor))),
    "ceiling": (1, 1, _on_numbers(_whole(math.ceil))),
    "trunc": (1, 1, _on_numbers(_whole(math.trunc))),
}
FUNCTIONS: Functions = {
    **ARITHMETIC_FUNCTIONS,
    "c": (1, 999, _list),
    "is.na": (1, 1, _is_missing),
    "as.numeric": (1, 1, lambda operand: strict(_as_number, operand)),
    "as.logical": (1, 1, lambda operand: strict(_as_logical, operand)),
    "log": (1, 2, _on_numbers(_log)),
}
