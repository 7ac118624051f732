"""Completions at a place of a mission's text: keys, words and names, with their descriptions.

The text may be unfinished. The keys and their types come from the annotations by which missions are read.
"""

import dataclasses
import re
import types
import typing
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

from mercator_design.config import schema, shipped, spelling
from mercator_design.config.json_schema import meaning, summary_of
from mercator_design.config.schema import FilePath, KeywordsOf, Kind, Specification
from mercator_design.config.writing import plain
from mercator_design.config.yaml_tree import MAX_FILE_SIZE
from mercator_design.missions.mission import Mission
from mercator_design.missions.plugins import ZoneReference
from mercator_design.serve.workers.outline import Outline, Piece, Step

_CURSOR = "cursor0cursor"
"""Placeholder in the text for the unfinished word."""
_BEFORE = re.compile(r"(?P<what>^[ ]*(?:-[ ]+)*|[{\[,][ ]*|:[ ]+)(?P<word>[^{}\[\],:#'\"]*)$")
_AFTER = re.compile(r"[^{}\[\],:#'\"]*")


@dataclass(frozen=True, slots=True)
class _TagMeaning:
    """Description of a dataclass, for the word of its tag."""

    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Completion:
    """A possible completion.

    label: A key, a word or a name.
    kind: Kind of the label.
    insert: Text to insert; further lines get the indentation of the first one.
    detail: Type and default of a key.
    info: Its description.
    is_required: Whether it is a key without which the mission is not valid.
    """

    label: str
    kind: Literal["key", "word", "name", "value"]
    insert: str
    detail: str = ""
    info: str = ""
    is_required: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Completions:
    """All completions at a place; `column` is the start of the word to replace, from 1."""

    column: int
    options: tuple[Completion, ...]


def completions(text: str, line: int, column: int) -> Completions:
    """Completions at a place of a mission's text.

    Args:
        text: The text; it may be unfinished.
        line: The line, from 1.
        column: The column in characters, from 1.
    """
    nothing = Completions(column=column, options=())
    lines = text[:MAX_FILE_SIZE].split("\n")
    if line > len(lines) or column - 1 > len(lines[line - 1]):
        return nothing
    before, after = lines[line - 1][: column - 1], lines[line - 1][column - 1 :]
    found = _BEFORE.search(before)
    if found is None or re.search(r"(^|\s)#", before):
        return nothing
    start, rest = found.start("word"), _AFTER.sub("", after, count=1)
    at_start = found["what"].strip() == ""
    for colon in (": ", "") if at_start and not rest.startswith(":") else ("",):
        lines[line - 1] = f"{before[:start]}{_CURSOR}{colon}{rest}"
        root = Outline.of("\n".join(lines)).root
        if root is not None and (path := _path_to_cursor(root)) is not None:
            options: dict[str, Completion] = {}
            for each in _options(root, path):
                options.setdefault(each.label, each)
            return Completions(column=start + 1, options=tuple(options.values()))
    return nothing


def _path_to_cursor(piece: Piece) -> list[Step] | None:
    """The steps to the cursor: a key, or a value."""
    if piece.content == _CURSOR:
        return []
    for step, part in piece.parts():
        if step == _CURSOR:
            return [step]
        if (path := _path_to_cursor(part)) is not None:
            return [step, *path]
    return None


def _options(root: Piece, path: list[Step]) -> Iterator[Completion]:
    """Completions at the end of a path."""
    is_key = bool(path) and path[-1] == _CURSOR
    kinds: list[Kind] = [Mission]
    piece: Piece | None = root
    for step in path[:-1] if is_key else path:
        kinds = [inner for kind in kinds for inner in _kinds_inside(kind, piece, step)]
        piece = piece.child(step) if piece else None
    zones = _zone_names(root)
    for kind in kinds:
        if is_key:
            yield from _keys(kind, piece, zones)
        else:
            yield from _values(kind, zones)
            if path and isinstance(path[-1], int):
                yield from _keys(kind, None, zones)


def _kinds_inside(kind: Kind, piece: Piece | None, step: Step) -> Iterator[Kind]:
    """Possible kinds of a part of a piece."""
    base, _ = schema.unwrapped(kind)
    for record in _records(kind, piece):
        if isinstance(step, str):
            fields = _fields(record, piece)
            key = spelling.find(step, fields)
            if key is not None:
                inner, _ = fields[key]
                yield (
                    typing.Annotated[inner, _TagMeaning(summary_of(record))] if len(schema.words(inner)) == 1 else inner
                )
    for each in typing.get_args(base) if schema.is_union(base) else (base,):
        arguments = typing.get_args(each)
        if schema.origin_of(each) is tuple and isinstance(step, int):
            if arguments[-1] is Ellipsis or step < len(arguments):
                yield arguments[0 if arguments[-1] is Ellipsis else step]
        elif schema.origin_of(each) is Mapping and isinstance(step, str):
            yield arguments[1]
        elif schema.origin_of(each) is typing.Annotated:
            yield from _kinds_inside(each, piece, step)


def _records(kind: Kind, piece: Piece | None) -> list[Kind]:
    """Dataclasses of a kind; only that of the tag in a piece, if there is one."""
    base, _ = schema.unwrapped(kind)
    found = [each for each in (typing.get_args(base) if schema.is_union(base) else (base,)) if schema.is_record(each)]
    if len(found) > 1:
        key, tagged = schema.tags(found)
        tag = piece.child(key) if piece else None
        word = spelling.find(tag.content, tagged) if tag is not None and isinstance(tag.content, str) else None
        found = [tagged[word]] if word else found
    return found


def _function(record: Kind, piece: Piece | None) -> Kind | None:
    """Function named in a piece whose parameters are keys of the dataclass; None if there is none."""
    keywords = schema.keywords_of(record)
    named = piece.child(keywords[1].key) if keywords and piece else None
    if keywords is None or named is None or not isinstance(named.content, str):
        return None
    return keywords[1].functions.get(spelling.find(named.content, keywords[1].functions) or "")


def _fields(record: Kind, piece: Piece | None) -> Specification:
    """The keys of a dataclass with their kinds and defaults."""
    fields, keywords = schema.fields_of(record), schema.keywords_of(record)
    if keywords is None:
        return fields
    field, rule = keywords
    fields = {name: entry for name, entry in fields.items() if name != field}
    fields[rule.key] = (typing.Annotated[str, rule], dataclasses.MISSING)
    function = _function(record, piece)
    return fields | (schema.parameters_of(function) if function else {})


def _keys(kind: Kind, piece: Piece | None, zones: list[str]) -> Iterator[Completion]:
    """Completions of the missing keys of a mapping."""
    there = {spelling.folded(str(step)) for step, _ in piece.parts()} if piece else set()
    records = _records(kind, piece)
    if len(records) > 1:  # which of them it is, is not said yet
        tag, tagged = schema.tags(records)
        detail = f"{schema.one_of([*tagged])}; required"
        yield Completion(label=tag, kind="key", insert=f"{tag}: ", detail=detail, is_required=True)
    for record in records:
        function = _function(record, piece)
        comments = schema.comments_of(record) | (schema.comments_of(function) if function else {})
        fields = _fields(record, piece)
        for name, (inner, default) in sorted(fields.items(), key=lambda item: item[1][1] is not dataclasses.MISSING):
            if spelling.folded(name) not in there:
                is_given = record is Mission and name == "name"  # by the name of the file
                is_required = len(records) == 1 and default is dataclasses.MISSING and not is_given
                about = comments.get(name) or meaning(inner, summary_of(record))
                yield Completion(
                    label=name, kind="key", insert=f"{name}:{_after_key(inner)}",
                    detail=_type(inner, default, is_required=is_required), info=about, is_required=is_required,
                )  # fmt: skip
    base, _ = schema.unwrapped(kind)
    if schema.origin_of(base) is Mapping:
        for each in _values(typing.get_args(base)[0], zones):
            if spelling.folded(each.label) not in there:
                yield dataclasses.replace(each, insert=f"{each.insert}: ")
    elif schema.origin_of(base) is tuple and piece is not None and len(there) == 1:  # a list that begins
        item = typing.get_args(base)[0]
        for each in (*_values(item, zones), *_keys(item, None, zones)):
            yield dataclasses.replace(each, insert=f"- {each.insert}".replace("\n", "\n  "))


def _after_key(kind: Kind) -> str:
    """Text after a key: a space, or a new line for a list or mapping."""
    base, _ = schema.unwrapped(kind)
    parts = typing.get_args(base) if schema.is_union(base) else (base,)
    if any(schema.is_record(part) for part in parts):
        return "\n  "
    arguments = typing.get_args(base)
    if schema.origin_of(base) is tuple and arguments[-1] is Ellipsis and _records(arguments[0], None):
        return "\n  - "
    return " "


def _type(kind: Kind, default: object, *, is_required: bool) -> str:
    """The type of a key in words, and its default."""
    words = schema.describe(kind)
    if is_required:
        return f"{words}; required"
    value = None if default is dataclasses.MISSING else plain(default)
    return f"{words}; default {value}" if isinstance(value, (str, int, float)) and value != "" else words


def _values(kind: Kind, zones: list[str]) -> Iterator[Completion]:
    """Completions of the value of a scalar, or of a list of fixed length."""
    base, _ = schema.unwrapped(kind)
    extras = getattr(kind, "__metadata__", ())
    for extra in extras:
        if isinstance(extra, ZoneReference):
            for name in zones:
                yield Completion(label=name, kind="name", insert=name, info="A zone of this floor.")
        elif isinstance(extra, KeywordsOf):
            for name, function in extra.functions.items():
                yield Completion(label=name, kind="name", insert=name, info=summary_of(function))
        elif isinstance(extra, FilePath) and extra.unless_name:
            for name in shipped.robot_models():
                yield Completion(label=name, kind="name", insert=name, info="A shipped robot model.")
    if schema.is_union(base):
        for each in typing.get_args(base):
            yield from _values(each, zones)
    elif schema.origin_of(base) is Literal:
        info = next((extra.text for extra in extras if isinstance(extra, _TagMeaning)), "")
        for word in typing.get_args(base):
            yield Completion(label=str(word), kind="word", insert=str(word), info=info)
    elif base is bool:
        for word in ("true", "false"):
            yield Completion(label=word, kind="word", insert=word)
    elif base is types.NoneType:
        yield Completion(label="null", kind="word", insert="null")
    elif schema.origin_of(base) is tuple:
        arguments = typing.get_args(base)
        if arguments[-1] is not Ellipsis:
            sample = f"[{', '.join('0' for _ in arguments)}]"
            yield Completion(label=sample, kind="value", insert=sample, detail=schema.describe(kind))
        elif not _records(arguments[0], None):
            for each in _values(arguments[0], zones):
                yield dataclasses.replace(each, label=f"[{each.label}]", insert=f"[{each.insert}]")


def _zone_names(root: Piece) -> list[str]:
    """The names of the zones in a text."""
    floor = root.child("floor")
    zones = floor.child("zones") if floor else None
    names = [zone.child("name") for _, zone in zones.parts()] if zones else []
    found = [name.content for name in names if name is not None and isinstance(name.content, str)]
    return [name for name in dict.fromkeys(found) if name and name != _CURSOR]
