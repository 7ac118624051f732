"""Parses YAML text to a tree of nodes with their lines, and refuses unsafe texts.

Files are untrusted: nothing in a file may hang, use up memory or run code. Accepted are regular files of at most 256
KiB, plain data (no anchors, aliases, tags or second document), text keys without duplicates, and 32 levels of nesting.
The tree is built from the parser's events, so an attack is refused at the first event that shows it.
"""

import json
import operator
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, TypeAlias

import yaml

from mercator_design.config import spelling
from mercator_design.errors import excerpt
from mercator_design.system.files import small_text

MAX_FILE_SIZE = 256 * 1024
MAX_DEPTH = 32
TOO_DEEP = f"nested more than {MAX_DEPTH} levels deep"
MAX_INTEGER = 2**63 - 1  # that numpy holds
MAX_MISTAKES = 20
"""Maximum number of reported mistakes in one text; reading ends with the last of them."""

_Event: TypeAlias = Any  # yaml's event classes share no typed fields
LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class Fault(Exception):  # noqa: N818 - becomes the error class that the caller of config/loading.py names
    """The mistakes in a text: messages with places. Empty if all have been reported."""


@dataclass(slots=True, kw_only=True)
class Node:
    """A piece of a text: a scalar, a list, or a mapping, whose values have the place of their keys.

    A node that could not be read has no content. A scalar without quotes is plain; of JSON data, a plain
    scalar is no text.
    """

    content: "str | list[Node] | dict[str, Node] | None"
    where: str
    folder: Path | None
    plain: bool = True
    is_json: bool = False

    @property
    def found(self) -> str:
        """A description for error messages."""
        if isinstance(self.content, dict):
            return "a mapping of keys"
        if isinstance(self.content, list):
            return f"a list of {len(self.content)}"
        text = self.content or ""
        if self.plain and (self.is_json or not text):
            return excerpt(text) or "nothing"
        return json.dumps(excerpt(text), ensure_ascii=False)

    def child(self, step: str | int) -> "Node | None":
        """The node at a key or an index, if there is one."""
        if isinstance(self.content, dict) and isinstance(step, str):
            return self.content.get(self.key(step))
        if isinstance(self.content, list) and isinstance(step, int) and step < len(self.content):
            return self.content[step]
        return None

    def key(self, word: str) -> str:
        """A key as this mapping spells it; as given if it has none."""
        return (spelling.find(word, self.content) if isinstance(self.content, dict) else None) or word

    def nearest(self, way: "list[str | int]") -> "Node":
        """The last node that exists on a way from here."""
        node = self
        for step in way:
            child = node.child(step)
            if child is None:
                break
            node = child
        return node


def text_of(path: Path, *, error: type[Exception] = Fault) -> str:
    """The text of a regular, small, UTF-8 file.

    Raises:
        error: with the path and what is wrong with the file.
    """
    return small_text(path, MAX_FILE_SIZE, error)


def is_text(text: str) -> bool:
    """Whether a text can be encoded: it has no unpaired surrogate, as JSON may have."""
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def tree_of(data: object, where: str = "", depth: int = 0) -> Node:
    """The tree of JSON data.

    Raises:
        Fault: They are nested too deep.
    """
    if depth > MAX_DEPTH:
        raise Fault(f"{where}: {TOO_DEEP}")
    content: str | list[Node] | dict[str, Node]
    if isinstance(data, dict):
        content = {key: tree_of(item, where, depth + 1) for key, item in data.items()}
    elif isinstance(data, list):
        content = [tree_of(item, where, depth + 1) for item in data]
    else:
        content = data if isinstance(data, str) else json.dumps(data)
    return Node(content=content, where=where, folder=Path(), plain=not isinstance(data, str), is_json=True)


def compose(text: str, label: str, folder: Path | None, *, lines: bool = True) -> Node:
    """The tree of the one document in a text.

    Raises:
        Fault: with label, and with the line if there are `lines`.
    """
    tree, mistakes = compose_all(text, label, folder, lines=lines)
    if mistakes:
        raise Fault(*mistakes)
    return tree


def compose_all(text: str, label: str, folder: Path | None, *, lines: bool = True) -> tuple[Node, list[str]]:
    """As `compose`, with the mistakes after which reading continued.

    Raises:
        Fault: if it could not continue.
    """
    composer = _Composer(text, label, folder, lines=lines)
    try:
        return composer.document(), composer.mistakes
    except Fault as fault:
        raise Fault(*composer.mistakes, *fault.args) from None


class _Composer:
    """Makes nodes from the parser's events; `mistakes` are those after which it continued."""

    def __init__(self, text: str, label: str, folder: Path | None, *, lines: bool) -> None:
        self.label, self.folder, self.lines = label, folder, lines
        self.events: Iterator[_Event] = self._events(text)
        self.mistakes: list[str] = []

    def _events(self, text: str) -> Iterator[_Event]:
        if len(text.encode(errors="surrogatepass")) > MAX_FILE_SIZE:
            raise Fault(f"{self.label}: expected at most {MAX_FILE_SIZE // 1024} KiB of YAML")
        try:
            yield from yaml.parse(text, Loader=LOADER)
        except yaml.MarkedYAMLError as error:
            # The parser of PyYAML 6.0.4 reads ahead, and so may meet its own limit of 1000 levels first.
            is_deep = error.problem == "exceeded maximum nesting depth"
            problem = TOO_DEEP if is_deep else f"not valid YAML: {error.problem}"
            raise Fault(f"{self._place(error.problem_mark)}: {problem}") from None
        except (yaml.YAMLError, UnicodeError) as error:
            reason = getattr(error, "reason", "unreadable characters")
            raise Fault(f"{self.label}: not valid YAML: {reason}") from None

    def _place(self, mark: yaml.Mark | None) -> str:
        return f"{self.label}:{mark.line + 1}" if self.lines and mark else self.label

    def _mistake(self, place: str, message: str) -> None:
        """Record a mistake at a place; reading ends when there are MAX_MISTAKES."""
        self.mistakes.append(f"{place}: {message}")
        if len(self.mistakes) >= MAX_MISTAKES:
            raise Fault

    def document(self) -> Node:
        next(self.events)
        if isinstance(next(self.events), yaml.StreamEndEvent):
            raise Fault(f"{self.label}: expected keys and values, found an empty text")
        root = self._node(next(self.events), 0)
        next(self.events)
        event = next(self.events)
        if not isinstance(event, yaml.StreamEndEvent):
            self._mistake(self._place(event.start_mark), "expected one document, found a second")
        return root

    def _node(self, event: _Event, depth: int) -> Node:
        place = self._place(event.start_mark)
        if depth > MAX_DEPTH:
            raise Fault(f"{place}: {TOO_DEEP}")
        is_alias = isinstance(event, yaml.AliasEvent)
        if is_alias or event.anchor is not None:
            self._mistake(place, "anchors and aliases (&, *) are not understood; write the value out")
        if is_alias:
            return Node(content=None, where=place, folder=self.folder)
        if event.tag is not None:
            self._mistake(place, f"tags are not understood, found {excerpt(event.tag)}; write the value without it")
        plain = not isinstance(event, yaml.ScalarEvent) or not event.style  # None or "", by parser
        return Node(content=self._content(event, depth), where=place, folder=self.folder, plain=plain)

    def _content(self, event: _Event, depth: int) -> "str | list[Node] | dict[str, Node]":
        if isinstance(event, yaml.ScalarEvent):
            return str(event.value)
        if isinstance(event, yaml.SequenceStartEvent):
            items: list[Node] = []
            while not isinstance(event := next(self.events), yaml.SequenceEndEvent):
                items.append(self._node(event, depth + 1))
            return items
        mapping: dict[str, Node] = {}
        while not isinstance(event := next(self.events), yaml.MappingEndEvent):
            key = self._node(event, depth + 1)
            value = self._node(next(self.events), depth + 1)
            value.where = key.where
            if not isinstance(key.content, str):
                if key.content is not None:
                    self._mistake(key.where, f"expected text as a key, found {key.found}")
            elif key.content in mapping:
                first = mapping[key.content].where
                self._mistake(key.where, f"duplicate key '{excerpt(key.content)}'; the first is at {first}")
            else:
                mapping[key.content] = value
        return mapping


def steps(path: str) -> list[str | int]:
    """The keys and indices of a path: `zones[1].name` -> zones, 1, name; empty if it is none."""
    if not re.fullmatch(r"[^.\[\]]+(\[[0-9]{1,9}\])*(\.[^.\[\]]+(\[[0-9]{1,9}\])*)*", path):
        return []
    return [int(index) if index else key for index, key in re.findall(r"\[([0-9]+)\]|([^.\[\]]+)", path)]


def clashes(assignments: Sequence[str]) -> list[str]:
    """The conflicts between values given on the command line: two set the same key, or one sets a part of the other."""
    given: dict[tuple[str | int, ...], str] = {}
    mistakes = []
    for assignment in assignments:
        path, _, _ = assignment.partition("=")
        way = tuple(spelling.folded(step) if isinstance(step, str) else step for step in steps(path.strip()))
        set_by = [earlier for other, earlier in given.items() if all(map(operator.eq, way, other))]
        if way and set_by:
            first = f"--set {excerpt(set_by[0])}"
            mistakes.append(f"--set {excerpt(assignment)}: sets what {first} sets, too; give one of them")
        elif way:
            given[way] = assignment
    return mistakes


def override(tree: Node, assignment: str) -> None:
    """Put a value given on the command line (`--set path=value`) into a tree; errors name this option as their place.

    Raises:
        Fault: if the option is not of that form, or its path leads nowhere.
    """
    label, folder = f"--set {excerpt(assignment)}", tree.folder and Path.cwd()
    path, equals, text = assignment.partition("=")
    way = steps(path.strip())
    if not equals or not way:
        raise Fault(f"{label}: expected path=value, as in robots=20 or floor.zones[0].radius=0.3")
    nothing = Node(content="", where=label, folder=folder)
    value = compose(text, label, folder, lines=False) if text.strip() else nothing
    node = tree
    while len(way) > 1 and (child := node.child(way[0])) is not None:
        node = child
        way = way[1:]
    for step in reversed(way[1:]):  # in mappings that are not there yet
        mapping = Node(content={}, where=label, folder=folder)
        _put(mapping, step, value, label)
        value = mapping
    _put(node, way[0], value, label)


_TAGS = ("shape", "device", "distribution")
"""Keys that name the kind of a mapping. A mapping of another kind replaces the base's completely."""


def merge(base: Node, changes: Node) -> Node:
    """The base with the values of another tree, key by key; a list replaces the base's list completely."""
    old, new = base.content, changes.content
    if not isinstance(old, dict) or not isinstance(new, dict):
        return changes
    for tag in _TAGS:
        if tag in old and tag in new and old[tag].content != new[tag].content:
            return changes
    merged = dict(old)
    for word, value in new.items():
        key = base.key(word)
        merged[key] = merge(old[key], value) if key in old else value
    return Node(content=merged, where=changes.where, folder=changes.folder)


def _put(node: Node, step: str | int, value: Node, label: str) -> None:
    content = node.content
    if isinstance(content, dict) and isinstance(step, str):
        content[node.key(step)] = value
        return
    if isinstance(content, list) and isinstance(step, int) and step < len(content):
        content[step] = value
        return
    wanted = f"a list with an item [{step}]" if isinstance(step, int) else f"a mapping for the key '{step}'"
    raise Fault(f"{label}: expected {wanted}, found {node.found} ({node.where})")


@dataclass(frozen=True, slots=True, kw_only=True)
class FromFile:
    """A record that may have been read from a file, to name the place of a mistake that is found later.

    KIND: What the record is called in messages if it was not read from a file, before its name if it has one.
    """

    KIND: ClassVar[str]
    tree: Node | None = field(default=None, repr=False, compare=False)

    def where(self, path: str) -> str:
        """Place and path of a key: "my.yaml:3: arena.walls"; without a file, "mission foraging: arena.walls"."""
        if self.tree is None:
            where = f"{self.KIND} {getattr(self, 'name', '')}".rstrip()
        else:
            where = self.tree.nearest(steps(path)).where
        return f"{where}: {path}" if path else where
