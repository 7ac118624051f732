"""Reads a YAML file to a frozen dataclass, with its base, overrides and defaults.

The schema is the dataclass: its annotations say what is expected. Supported are float (finite), int, bool, str,
Literal, tuple, Mapping[str, X], dataclasses, NamedTuples, unions (dataclasses are distinguished by a field that is a
one-word Literal), and the rules of schema.py in Annotated. yaml_tree.py refuses unsafe texts; building.py makes values.
"""

import dataclasses
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TypeAlias, TypeVar

import yaml

from mercator_design.config import schema
from mercator_design.config.annotations import check_annotation
from mercator_design.config.building import NodePath, build, message
from mercator_design.config.schema import Kind
from mercator_design.config.writing import Dumper, plain
from mercator_design.config.yaml_tree import (
    MAX_MISTAKES,
    Fault,
    FromFile,
    Node,
    clashes,
    compose,
    compose_all,
    merge,
    override,
    text_of,
)
from mercator_design.errors import MercatorError, excerpt

T = TypeVar("T")

FindBase: TypeAlias = Callable[[str, Path], Path]


def read(
    path: str | Path,
    kind: type[T],
    *,
    error: type[MercatorError],
    overrides: Sequence[str] = (),
    defaults: Mapping[str, str] = types.MappingProxyType({}),
    find_base: FindBase | None = None,
) -> T:
    """The dataclass `kind` that a YAML file describes.

    Args:
        path: The file; relative paths in it start from its folder.
        kind: A dataclass.
        error: The class of errors to raise.
        overrides: Assignments such as `floor.zones[0].radius=0.3`, applied before anything is built.
        defaults: Values of top-level keys that the file may omit.
        find_base: Returns the base's file, given the value of the key `base` and the file's folder. Keys that a
            file with a base does not have are taken from the base.

    Raises:
        error: with file, line, path of the key, what was expected and what was found, for each mistake.
    """
    return parse(
        text_of(Path(path), error=error),
        kind,
        error=error,
        label=str(path),
        folder=Path(path).parent,
        overrides=overrides,
        defaults=defaults,
        find_base=find_base,
    )


def parse(
    text: str,
    kind: type[T],
    *,
    error: type[MercatorError],
    label: str = "text",
    folder: Path | None = None,
    files: bool = True,
    overrides: Sequence[str] = (),
    defaults: Mapping[str, str] = types.MappingProxyType({}),
    find_base: FindBase | None = None,
    lines: bool = True,
) -> T:
    """As `read`, of a text; `label` names it in errors, and relative paths in it start from `folder`.

    Without `files`, the text may not name files. Without `lines`, errors do not name the line.
    """
    mistakes: list[str] = []
    try:
        tree, mistakes = compose_all(text, label, (folder or Path.cwd()) if files else None, lines=lines)
        if find_base is not None:
            tree = _on_base(tree, find_base, [str(Path(label).resolve())])
        mistakes += clashes(overrides)
        for assignment in overrides:
            try:
                override(tree, assignment)
            except Fault as fault:
                mistakes += fault.args
        if isinstance(tree.content, dict):
            given = {key: dataclasses.replace(tree, content=text) for key, text in defaults.items()}
            tree.content = given | tree.content
        value: object = build(tree, kind)
    except Fault as fault:
        raise error(*_in_order([*mistakes, *fault.args], label)) from None
    if mistakes:
        raise error(*_in_order(mistakes, label))
    if isinstance(value, FromFile):
        object.__setattr__(value, "tree", tree)
    return typing.cast("T", value)


def _in_order(mistakes: Sequence[str], label: str) -> list[str]:
    """The mistakes in the order of their lines, at most MAX_MISTAKES; those of other places come last."""

    def line(mistake: str) -> float:
        before, _, _ = mistake.removeprefix(f"{label}:").partition(":")
        return int(before) if before.isdecimal() and mistake.startswith(f"{label}:") else float("inf")

    found = sorted(mistakes[:MAX_MISTAKES], key=line)
    return found + [f"{label}: its reading ended with {MAX_MISTAKES} mistakes"] * (len(mistakes) >= MAX_MISTAKES)


def _on_base(tree: Node, find_base: FindBase, labels: list[str]) -> Node:
    """A tree merged with its base, and with the base of the base; `labels` are the files before it."""
    if not isinstance(tree.content, dict) or "base" not in tree.content:
        return tree
    base = tree.content.pop("base")
    path_to = NodePath(None, "base")
    name = build(base, str, path_to)
    try:
        path = find_base(name, tree.folder or Path())
    except MercatorError as error:
        raise Fault(*(message(base, path_to, each) for each in error.messages)) from None
    file = str(path.resolve())
    if file in labels:
        raise Fault(message(base, path_to, f"{path} is based on itself"))
    below = _on_base(compose(text_of(path), str(path), path.parent), find_base, [*labels, file])
    if isinstance(below.content, dict):
        for key in ("name", "description"):  # are the base's own
            below.content.pop(key, None)
    return merge(below, tree)


def check_parameter(kind: Kind, default: object = dataclasses.MISSING) -> None:
    """Check that a file can have a value of a kind, and the default.

    Raises:
        TypeError: with the mistake.
    """
    check_annotation(kind)
    if default is dataclasses.MISSING:
        return
    try:
        text = yaml.dump([plain(default)], Dumper=Dumper)
        build(compose(text, "", Path()), tuple[kind])
    except (Fault, yaml.YAMLError):
        raise TypeError(
            f"its default {excerpt(repr(default))} cannot be written in YAML as {schema.describe(kind)}"
        ) from None
