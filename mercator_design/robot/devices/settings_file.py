"""Change values in a robot.yaml in place: everything else stays as it was written, with its comments."""

import dataclasses
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from mercator_design.config import spelling
from mercator_design.config.writing import plain
from mercator_design.config.yaml_tree import text_of
from mercator_design.errors import SettingsError
from mercator_design.robot.devices.settings import parse_settings, read_settings
from mercator_design.system.files import write_text

_WIDE = 10**6  # columns, so that a value is written in one line


def change(path: Path, **values: object) -> None:
    """Change settings in their file, atomically; entries of a mapping that are not given stay.

    Raises:
        SettingsError: if the file is not valid before or after the change; then it stays as it is.
        OSError: if it cannot be written; then it stays as it is.
    """
    write_text(path, _changed(path, values))


def check_changeable(path: Path, **values: object) -> None:
    """Check that a file can be changed, before a user measures the values.

    Raises:
        SettingsError: if it cannot.
    """
    _changed(path, values)
    if not os.access(path.resolve().parent, os.W_OK):
        raise SettingsError(f"{path}: cannot be written: nothing can be written to its folder")


def _changed(path: Path, values: Mapping[str, object]) -> str:
    """The text of a file with changed values; errors are those of `change`."""
    old, text = read_settings(path), text_of(path, error=SettingsError)
    wanted: dict[str, Any] = {}
    changes: dict[tuple[str, ...], object]
    for key, value in values.items():
        if isinstance(value, Mapping):
            wanted[key] = {**(getattr(old, key) or {}), **value}
            changes = {(key, name): each for name, each in value.items()}
        else:
            wanted[key], changes = value, {(key,): value}
        for way, each in changes.items():
            try:
                text = put(text, way, plain(each))
            except (yaml.YAMLError, ValueError):
                raise _unchangeable(path, values) from None
    new = parse_settings(text, f"{path}, changed", path.parent)
    if new != dataclasses.replace(old, **wanted):
        raise _unchangeable(path, values)
    return text


def _unchangeable(path: Path, values: Iterable[str]) -> SettingsError:
    return SettingsError(f"{path} is written in a way that cannot be changed; put {', '.join(values)} there yourself")


def put(text: str, keys: tuple[str, ...], value: object) -> str:
    """A YAML text with another value at the end of a way of keys, which begins at the top.

    Comments within the old value are lost, unless it is a mapping in which the way goes on.
    """
    node: Any = yaml.compose(text, Loader=yaml.SafeLoader)
    if node is None:  # nothing but comments
        return _with_entry(text, None, keys, value)
    for depth, name in enumerate(keys):
        known = {key.value: (key, child) for key, child in node.value}
        written = spelling.find(name, known)
        if written is None:
            return _with_entry(text, node, keys[depth:], value)
        key, child = known[written]
        if depth == len(keys) - 1 or not isinstance(child, yaml.MappingNode) or not child.value:
            break
        node = child
    colon = text.index(":", key.end_mark.index) + 1
    between = text[colon : child.start_mark.index].rstrip()  # comments, if the value began in a later line
    return f"{text[:colon]} {_flow(keys[depth + 1 :], value)}{between}{text[_end(child) :]}"


def _with_entry(text: str, mapping: Any, keys: tuple[str, ...], value: object) -> str:  # noqa: ANN401 - yaml has no types
    """A text with one entry more in a mapping; None: its first."""
    name, *rest = keys
    entry = f"{name}: {_flow(tuple(rest), value)}"
    if mapping and mapping.flow_style:
        end = _end(mapping.value[-1][1]) if mapping.value else mapping.start_mark.index + 1
        return text[:end] + (", " if mapping.value else "") + entry + text[end:]
    indent = " " * mapping.value[0][0].start_mark.column if mapping else ""
    if rest:
        entry = f"{name}:\n{indent}  {rest[0]}: {_flow(tuple(rest[1:]), value)}"
    end = len(text[: _end(mapping) if mapping else None].rstrip())
    line_end = text.find("\n", end) if "\n" in text[end:] else len(text)
    before = f"{text[:line_end]}\n" if end else ""
    rest_of_text = text[line_end:] or "\n"
    return f"{before}{indent}{entry}{rest_of_text}"


def _flow(keys: tuple[str, ...], value: object) -> str:
    for key in reversed(keys):
        value = {key: value}
    return yaml.safe_dump(value, default_flow_style=True, width=_WIDE).removesuffix("...\n").strip()


def _end(node: Any) -> int:  # noqa: ANN401
    """The position where a value ends: a block's own mark is behind the comments that follow it."""
    if isinstance(node, yaml.ScalarNode) or node.flow_style or not node.value:
        return int(node.end_mark.index)
    last = node.value[-1]
    return _end(last[1] if isinstance(node, yaml.MappingNode) else last)
