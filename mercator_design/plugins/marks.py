"""Checks of what a user gives to the marks of modules (`@behaviour`, `@condition`)."""

import inspect
import re
from collections.abc import Iterable
from typing import Any

from mercator_design.errors import excerpt

MAX_MEMORY = 64
"""Largest number of numbers that a module keeps."""
_TEXT = re.compile(r"[A-Za-z0-9][A-Za-z0-9 ._+-]{0,99}")


def check_functions(name: str, function: object, **others: object) -> None:
    """Refuse what is no plain function with parameters that are given by their places; others may be None.

    Raises:
        ValueError: naming the module and the argument.
    """
    for what, given in {"": function, **{f": {key}": one for key, one in others.items() if one is not None}}.items():
        if not inspect.isfunction(given) or inspect.iscoroutinefunction(given) or inspect.isgeneratorfunction(given):
            raise ValueError(f"{name}{what}: expected a function that returns, found {excerpt(repr(given))}")
        for each in inspect.signature(given).parameters.values():
            if each.kind in {each.KEYWORD_ONLY, each.VAR_KEYWORD}:
                raise ValueError(f"{name}{what}: parameter {each.name}: expected none behind a *")


def check_texts(**texts: object) -> None:
    """Refuse texts that could not be names in texts and files of any computer.

    Raises:
        ValueError: naming the argument.
    """
    for what, given in texts.items():
        if not isinstance(given, str) or not _TEXT.fullmatch(given):
            expected = "letters a to z and A to Z, digits, blanks and . _ + -, at most 100"
            raise ValueError(f"{what}: expected {expected}, found {excerpt(repr(given))}")


def check_memory(name: str, given: object, low: int) -> None:
    """Refuse what is no number of numbers that a module may keep.

    Raises:
        ValueError: naming the module.
    """
    if type(given) is not int or not low <= given <= MAX_MEMORY:
        expected = f"a whole number from {low} to {MAX_MEMORY}"
        raise ValueError(f"{name}: memory: expected {expected}, found {excerpt(repr(given))}")


def check_set(given: Any, place: str) -> Iterable[Any]:  # noqa: ANN401 - whatever a user gives
    """The items of a set or a list, which a text is not.

    Raises:
        ValueError: naming the place.
    """
    if isinstance(given, str) or not isinstance(given, Iterable):
        raise ValueError(f"{place}: expected a set of words, found {excerpt(repr(given))}")  # noqa: TRY004
    return given
