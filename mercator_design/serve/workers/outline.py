"""The pieces of a YAML text, which may be unfinished, with their places; for marks and completions in an editor."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import yaml

from mercator_design.config import spelling
from mercator_design.config.yaml_tree import LOADER, MAX_DEPTH, MAX_FILE_SIZE

Step: TypeAlias = str | int


class Mark(NamedTuple):
    """A place in a text: line and column, from 0; columns count characters."""

    line: int
    column: int


class Span(NamedTuple):
    """A range of a text; the end is exclusive."""

    start: Mark
    end: Mark


@dataclass(slots=True)
class Piece:
    """A scalar, a list or a mapping, which may be unfinished.

    content: Content; None for anything else, such as an alias.
    span: Range of the piece; of an unfinished list or mapping, only its beginning.
    key: Range of its key; None if it is no value of a key.
    """

    content: "str | list[Piece] | dict[str, Piece] | None"
    span: Span
    key: Span | None = None

    def child(self, step: Step) -> "Piece | None":
        """The piece at a key, in either spelling, or at an index."""
        if isinstance(self.content, dict) and isinstance(step, str):
            return self.content.get(spelling.find(step, self.content) or "")
        if isinstance(self.content, list) and isinstance(step, int) and step < len(self.content):
            return self.content[step]
        return None

    def parts(self) -> Iterator[tuple[Step, "Piece"]]:
        """The pieces in it, with their keys or indices."""
        if isinstance(self.content, dict):
            yield from self.content.items()
        elif isinstance(self.content, list):
            yield from enumerate(self.content)


@dataclass(slots=True)
class Outline:
    """The pieces of a text.

    root: None if there are none.
    error: The place where YAML's syntax is violated.
    """

    root: Piece | None = None
    error: Mark | None = None

    @classmethod
    def of(cls, text: str) -> "Outline":
        """Outline of a text; if that is too long or too deep, of its readable part."""
        outline = cls()
        events = yaml.parse(text[:MAX_FILE_SIZE], Loader=LOADER)
        try:
            for event in events:
                if isinstance(event, yaml.NodeEvent):
                    outline.root = _piece(event)
                    _fill(outline.root, events, MAX_DEPTH)
                elif isinstance(event, yaml.DocumentEndEvent):
                    break
        except yaml.MarkedYAMLError as error:
            outline.error = _place(error.problem_mark)
        except (yaml.YAMLError, UnicodeError):
            pass
        return outline


def _fill(piece: Piece, events: Iterator[Any], depth: int) -> None:
    """Read the parts of a list or mapping, recursively; a key without a value yet has an empty one."""
    if not isinstance(piece.content, (list, dict)):
        return
    if not depth:
        raise yaml.YAMLError("too deep")
    key: Piece | None = None
    for event in events:
        if isinstance(event, (yaml.SequenceEndEvent, yaml.MappingEndEvent)):
            piece.span = Span(piece.span.start, _place(event.end_mark))
            return
        part = _piece(event)
        if isinstance(piece.content, list):
            piece.content.append(part)
        elif key is None:
            key = part
            if isinstance(key.content, str):
                piece.content.setdefault(key.content, Piece(None, key.span, key.span))
        else:
            part.key = key.span
            if isinstance(key.content, str) and piece.content[key.content].key is part.key:  # of equal keys, the first
                piece.content[key.content] = part
            key = None
        _fill(part, events, depth - 1)


def _place(mark: Any) -> Mark:  # noqa: ANN401 - yaml's parsers have different ones
    return Mark(mark.line, mark.column) if mark else Mark(0, 0)


def _piece(event: Any) -> Piece:  # noqa: ANN401 - yaml's event classes share no typed fields
    span = Span(_place(event.start_mark), _place(event.end_mark))
    if isinstance(event, yaml.ScalarEvent):
        return Piece(str(event.value), span)
    if isinstance(event, yaml.SequenceStartEvent):
        return Piece([], span)
    return Piece({}, span) if isinstance(event, yaml.MappingStartEvent) else Piece(None, span)
