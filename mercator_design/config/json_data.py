"""Reads JSON data of programs by the same annotations as YAML files; fast, because journals are long.

Types are strict: "1" is not a number, and 1 is not text. `reader` only checks whether data are valid;
config/building.py finds the mistakes, as in a YAML file.
"""

import dataclasses
import functools
import json
import math
import typing
from collections.abc import Callable, Mapping
from pathlib import Path
from types import NoneType
from typing import Any, Literal

from mercator_design.config import schema
from mercator_design.config.building import NodePath, build, message
from mercator_design.config.checked_lines import from_line
from mercator_design.config.schema import FieldError, Kind
from mercator_design.config.yaml_tree import MAX_DEPTH, MAX_INTEGER, Fault, is_text, tree_of
from mercator_design.errors import MercatorError
from mercator_design.system.files import contents_of

_MAX_SIZE = 16 * 1024 * 1024  # bytes of a file
WRONG: Any = object()
"""A reader returns this for data that are not of its kind."""


def from_json(
    data: object,
    kind: Kind,
    *,
    error: type[MercatorError],
    label: str = "",
    path: str = "",
) -> Any:  # noqa: ANN401 - what `kind` says
    """The value that JSON data describe, by a dataclass or another annotation of config/building.py, or `object`.

    Raises:
        error: with label, path of the key, what was expected and what was found.
    """
    value = reader(kind)(data)
    if value is not WRONG:
        return value
    path_to = NodePath(None, path) if path else None
    try:
        tree = tree_of(data, label)
        build(tree, kind, path_to)
    except Fault as fault:
        wrong = "; ".join(fault.args)
    else:
        wrong = message(tree, path_to, f"expected {schema.describe(kind)}, found something else")
    raise error(wrong)


def read_json(file: Path, kind: Kind, *, error: type[MercatorError], is_checked: bool = False) -> Any:  # noqa: ANN401 - what `kind` says
    """The value that a JSON file describes; one that `is_checked` is a line with a checksum.

    Raises:
        error: as `from_json`; or the file is missing, is too large, has no JSON, or another checksum.
    """
    contents = contents_of(file, _MAX_SIZE, error)
    try:
        data = from_line(contents) if is_checked else json.loads(contents)
    except (ValueError, RecursionError) as wrong:
        what = "it was damaged or changed after it was written" if is_checked else "expected JSON, found something else"
        raise error(f"{file}: {what}: {wrong}") from None
    return from_json(data, kind, error=error, label=str(file))


@functools.cache
def reader(kind: Kind) -> Callable[[Any], Any]:
    """A function from JSON data to a value of a kind, or `WRONG`; for the kinds of building.py, and `object`."""
    base, rules = schema.unwrapped(kind)
    read = _reader(base)
    for rule in rules:
        read = _checked(read, rule.allows)
    return read


def _checked(read: Callable[[Any], Any], allows: Callable[[Any], bool]) -> Callable[[Any], Any]:
    def checked(data: Any) -> Any:  # noqa: ANN401 - as all readers here
        value = read(data)
        return value if value is WRONG or value is None or allows(value) else WRONG

    return checked


def _reader(base: Kind) -> Callable[[Any], Any]:
    if base in _SCALARS:
        return _SCALARS[base]
    if schema.is_union(base):
        return _union(base)
    origin = schema.origin_of(base)
    if origin is Literal:
        words = {(type(word), word): word for word in typing.get_args(base)}
        return lambda data: words.get((type(data), data), WRONG) if not isinstance(data, list | dict) else WRONG
    if origin is tuple:
        return _tuple(base)
    if origin is Mapping:
        return _mapping(base)
    return _record(base)


def _union(base: Kind) -> Callable[[Any], Any]:
    readers = [reader(kind) for kind in typing.get_args(base)]

    def read(data: Any) -> Any:  # noqa: ANN401
        for one in readers:
            value = one(data)
            if value is not WRONG:
                return value
        return WRONG

    return read


def _tuple(base: Kind) -> Callable[[Any], Any]:
    kinds = typing.get_args(base)
    several = kinds[-1] is Ellipsis
    readers = [reader(kind) for kind in kinds if kind is not Ellipsis]
    first = readers[0]

    def read(data: Any) -> Any:  # noqa: ANN401
        if not isinstance(data, list) or not (several or len(data) == len(readers)):
            return WRONG
        if several:
            values = [first(item) for item in data]
        else:
            values = [one(item) for one, item in zip(readers, data, strict=True)]
        return WRONG if WRONG in values else tuple(values)

    return read


def _mapping(base: Kind) -> Callable[[Any], Any]:
    read_key, read_item = map(reader, typing.get_args(base))

    def read(data: Any) -> Any:  # noqa: ANN401
        if not isinstance(data, dict):
            return WRONG
        values = {}
        for key, item in data.items():
            value = read_item(item)
            if value is WRONG or read_key(key) is WRONG:
                return WRONG
            values[key] = value
        return values

    return read


def _record(kind: Kind) -> Callable[[Any], Any]:
    specification = schema.fields_of(kind)
    readers = {name: reader(annotation) for name, (annotation, _) in specification.items()}
    required = {name for name, (_, default) in specification.items() if default is dataclasses.MISSING}

    def read(data: Any) -> Any:  # noqa: ANN401
        if not isinstance(data, dict):
            return WRONG
        values = {}
        for name, item in data.items():
            one = readers.get(name)
            if one is None or (value := one(item)) is WRONG:
                return WRONG
            values[name] = value
        if not required <= values.keys():
            return WRONG
        try:
            return kind(**values)
        except FieldError:
            return WRONG

    return read


def _int(data: Any) -> Any:  # noqa: ANN401
    return data if type(data) is int and -MAX_INTEGER <= data <= MAX_INTEGER else WRONG


def _float(data: Any) -> Any:  # noqa: ANN401
    if type(data) is float:
        return data if math.isfinite(data) else WRONG
    return _int(data)  # a whole number stays an int


def _str(data: Any) -> Any:  # noqa: ANN401
    return data if type(data) is str and (data.isascii() or is_text(data)) else WRONG


def _anything(data: Any, depth: int = 0) -> Any:  # noqa: ANN401
    if isinstance(data, list | dict):
        items = [*data.values(), *data] if isinstance(data, dict) else data
        return data if depth < MAX_DEPTH and all(_anything(item, depth + 1) is not WRONG for item in items) else WRONG
    return data if data is None or isinstance(data, bool) or _float(data) is not WRONG else _str(data)


_SCALARS: dict[Kind, Callable[[Any], Any]] = {
    int: _int,
    float: _float,
    str: _str,
    bool: lambda data: data if isinstance(data, bool) else WRONG,
    NoneType: lambda data: data if data is None else WRONG,
    object: _anything,
}
