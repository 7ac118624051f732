"""Messages on a mission as findings with their places, for marks in an editor."""

import re
from collections.abc import Iterable
from dataclasses import dataclass

from mercator_design.config import shipped, spelling
from mercator_design.config.schema import fields_of
from mercator_design.config.yaml_tree import steps
from mercator_design.missions.mission import Mission
from mercator_design.serve.workers.outline import Outline, Piece, Span


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionFinding:
    """A mistake or a warning.

    message: Message without its place, if that is known.
    path: Path of the key, such as floor.zones[0].radius; empty if it is of none.
    line: From 1; None if it is of no line.
    column: From 1, in characters; None if it is not known. So are `end_line` and `end_column`, which are behind it.
    """

    message: str
    path: str = ""
    line: int | None = None
    column: int | None = None
    end_line: int | None = None
    end_column: int | None = None


def without_folders(message: str) -> str:
    """A message that names shipped files by their names alone."""
    for file in (*shipped.missions().values(), *shipped.robot_models().values()):
        message = message.replace(str(file), file.name)
    return message


def findings(messages: Iterable[str], label: str, text: str) -> list[MissionFinding]:
    """The findings of messages on a text, which they call by a label."""
    outline = Outline.of(text)
    return [_finding(without_folders(message), label, outline) for message in messages]


def _finding(message: str, label: str, outline: Outline) -> MissionFinding:
    found = re.fullmatch(rf"{re.escape(label)}(?::(\d+))?: (.*)", message, re.DOTALL)
    number, rest = (found[1], found[2]) if found else (None, message)
    path, _, after = rest.partition(": ")
    if after and _is_path(path, is_placed=found is not None):
        rest = after
    else:
        path = ""
    if number is None:
        return MissionFinding(message=rest, path=path)
    line = int(number)
    span = _span(outline, path, line - 1, is_on_key=rest.startswith("unknown key"))
    if span is None:
        return MissionFinding(message=rest, path=path, line=line)
    return MissionFinding(
        message=rest, path=path, line=line,
        column=span.start.column + 1, end_line=span.end.line + 1, end_column=span.end.column + 1,
    )  # fmt: skip


def _is_path(text: str, *, is_placed: bool) -> bool:
    """Whether a text at the start of a message is the path of a key."""
    way = steps(text)
    is_known = bool(way) and isinstance(way[0], str) and spelling.find(way[0], fields_of(Mission)) is not None
    return is_known or (is_placed and bool(way) and " " not in text)


def _span(outline: Outline, path: str, line: int, *, is_on_key: bool) -> Span | None:
    """Part of a line to mark for a message: the value there, else its key; None if unknown."""
    if not path:
        place = outline.error
        return None if place is None or place.line != line else Span(place, place)
    piece: Piece | None = outline.root
    for step in steps(path):
        child = piece.child(step) if piece else None
        if child is None:  # a key that is missing: on what it is missing in
            break
        piece = child
    if piece is None:
        return None
    is_value = isinstance(piece.content, str) and piece.content != "" and not is_on_key
    for span in (piece.span if is_value else None, piece.key, piece.span):
        if span is not None and span.start.line == line:
            return span if span.end.line == line else Span(span.start, span.start)
    return None
