"""Checks that values of an annotation can be written in a file, and suggests another annotation if not."""

import collections.abc
import enum
import inspect
import numbers
import os
import typing
from collections.abc import Mapping
from typing import Literal

from mercator_design.config import schema
from mercator_design.config.schema import Kind

_LISTS = (list, set, frozenset, collections.abc.Iterable)
_NUMBERS = ((numbers.Integral, "int"), (numbers.Real, "float"), (numbers.Complex, "tuple[float, float]"))
_ARRAYS = {"ndarray": "tuple[float, ...], and numpy.array(...) in the function", "bool": "bool", "bool_": "bool"}
"""Suggestions for types of numpy, by their names: robots do not have numpy, so it is not imported here."""


def check_annotation(kind: Kind, within: tuple[Kind, ...] = ()) -> None:
    """Make sure that config/loading.py understands an annotation; `within` are the records that it is part of.

    Raises:
        TypeError: naming the part that it does not understand, and the supported ones.
    """
    base, _ = schema.unwrapped(kind)
    parts = typing.get_args(base)
    if schema.is_union(base):
        records = [each for each in parts if schema.is_record(each)]
        if len(records) > 1:
            schema.tags(records)
    elif schema.is_record(base):
        parts = () if base in within else tuple(annotation for annotation, _ in schema.fields_of(base).values())
        within = (*within, base)
    elif schema.origin_of(base) is Literal:
        parts = ()
    elif not (schema.origin_of(base) in {tuple, Mapping} and parts) and not any(base is each for each in schema.NOUNS):
        raise TypeError(
            f"{inspect.formatannotation(base)} cannot be written in YAML; {_instead_of(base)}supported are float, int, "
            "bool, str, None, Literal[...], tuple[...], Mapping[..., ...] of these, dataclasses, NamedTuples, and | "
            "between them"
        )
    for part in parts:
        if part is not Ellipsis:
            check_annotation(part, within)


def _instead_of(base: Kind) -> str:
    """Suggestion of another annotation, which ends in a semicolon; empty if none is similar."""
    kind, parts = schema.origin_of(base) or base, [inspect.formatannotation(part) for part in typing.get_args(base)]
    if base is typing.Any:
        return "use object; "
    if not isinstance(kind, type):
        return ""
    if issubclass(kind, enum.Enum):
        words = ", ".join(repr(str(one.value)) for one in kind)
        return f"use Literal[{words}]; "
    if issubclass(kind, os.PathLike):
        return "use Annotated[str, FilePath()] of mercator_design.config.schema; "
    if kind.__module__ == "numpy" and kind.__name__ in _ARRAYS:
        return f"use {_ARRAYS[kind.__name__]}; "
    for number, instead in _NUMBERS:
        if issubclass(kind, number):
            return f"use {instead}; "
    if issubclass(kind, collections.abc.Mapping):
        return f"use Mapping[{', '.join(parts) if len(parts) == 2 else 'str, float'}] of collections.abc; "
    if kind is tuple or (issubclass(kind, _LISTS) and kind is not str and not issubclass(kind, bytes)):
        item = parts[0] if parts else "float"
        return f"use tuple[{item}, ...]; "
    return ""
