"""What is compared when recorded vectors are replayed, and what agrees: numbers to their last recorded digits."""

import math
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mercator_design.errors import MercatorError

DIGITS = 1e-13
"""Relative difference of numbers that agree; they are recorded with 15 digits."""


class Check(NamedTuple):
    """One comparison.

    kind: Row of the table.
    case: Which one it is, for people.
    difference: What disagrees; empty if nothing does.
    is_tie: It disagrees, but in the order of means alone that differ by rounding.
    """

    kind: str
    case: str
    difference: str
    is_tie: bool = False


def attempt(kind: str, case: str, checks: Iterable[Check]) -> Iterator[Check]:
    """The checks of a case, which is replayed as they are taken; one that disagrees if it cannot be."""
    try:
        yield from checks
    except (MercatorError, LookupError, TypeError, ValueError, ArithmeticError, AttributeError) as error:
        yield Check(kind, case, f"cannot be replayed: {type(error).__name__}: {error}")


def each(kind: str, cases: Iterable[Any], replay: Callable[[str, Any], Iterable[Check]]) -> Iterator[Check]:
    """The checks of all cases, which are given their names."""
    for number, case in enumerate(cases, start=1):
        name = f"case {case.get('id', number) if isinstance(case, dict) else number}"
        yield from attempt(kind, name, replay(name, case))


def difference(expected: Any, found: Any, place: str = "", digits: float = DIGITS) -> str:
    """The first place where JSON values differ, with what is there; empty if nothing does. NaN is null or "NaN"."""
    if isinstance(expected, dict) and isinstance(found, dict) and expected.keys() == found.keys():
        parts = [(f"{place}.{key}" if place else str(key), expected[key], found[key]) for key in expected]
    elif isinstance(expected, list) and isinstance(found, list) and len(expected) == len(found):
        parts = [(f"{place}[{n}]", *pair) for n, pair in enumerate(zip(expected, found, strict=True), start=1)]
    else:
        same = _is_same(expected, found, digits)
        return "" if same else f"{place}: expected {expected!r:.200}, found {found!r:.200}".removeprefix(": ")
    return next(filter(None, (difference(e, f, name, digits) for name, e, f in parts)), "")


def table(rows: Iterable[Iterable[float | None]], missing: float = math.nan) -> NDArray[np.float64]:
    """Costs, shape (instances, configurations), with a number in place of null."""
    return np.array([[missing if cost is None else float(cost) for cost in row] for row in rows])


def _is_same(expected: object, found: object, digits: float) -> bool:
    if isinstance(found, float) and math.isnan(found):
        return expected is None or expected == "NaN" or (isinstance(expected, float) and math.isnan(expected))
    if isinstance(expected, (int, float)) and isinstance(found, (int, float)):
        return math.isclose(expected, found, rel_tol=digits)
    return bool(expected == found)
