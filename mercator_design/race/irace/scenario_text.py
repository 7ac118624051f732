r"""The text of irace's scenario.txt: assignments of R, which a parser reads; they are never run as code.

    file      := { statement }
    statement := NAME ( "=" | "<-" ) value    until ";" or the line's end, unless a bracket or an operator is open
    value     := an expression of race/space/expressions.py, with the variables that were assigned before

`#` starts a comment, except within text. Text is in double or single quotes, with R's escapes (`\n`, `\x41`,
`\u00e9`). A name that begins with a dot is a variable that only the file uses.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mercator_design.errors import RaceError, excerpt
from mercator_design.race.space.expressions import Expression
from mercator_design.race.space.r_operators import number_text
from mercator_design.system.files import small_text

Setting = str | bool | float | tuple[Any, ...] | None
"""The value of an option; None is R's NULL and NA."""
_MAX_SIZE = 16 * 1024 * 1024  # bytes of a file
_ASSIGNMENT = re.compile(r"\s*(?P<name>[A-Za-z.][A-Za-z0-9._]*)\s*(?:=(?!=)|<-)\s*")
_FUNCTION = re.compile(r"(?:function\b|\\\()")
_PIECE = re.compile(
    r"""(?P<text>"(?:[^"\\]|\\.)*"|'(?:[^'\\]|\\.)*')
      | (?P<comment>\#[^\n]*)
      | (?P<open>[(\[{])
      | (?P<close>[)\]}])
      | (?P<end>[\n;])
      | (?P<unclosed>["'].*)
      | [^"'\#(\[{)\]}\n;]+""",
    re.VERBOSE | re.DOTALL,
)
_OPEN = re.compile(r"(?:[-=+*/,&|<>!]|%%|%in%)\s*$")


@dataclass(frozen=True, slots=True)
class Assignment:
    """An option with its value, and where it is set: "FILE:LINE", or the command line."""

    name: str
    value: Setting
    place: str


def read_text(path: Path, option: str = "") -> str:
    """The text of a file; `option` is the place and name of the option that names it, for errors.

    Raises:
        RaceError: It cannot be read.
    """
    return small_text(path, _MAX_SIZE, RaceError, f"{option}: {path}" if option else "")


def read_assignments(text: str, source: str) -> list[Assignment]:
    """The assignments of a scenario's text in their order, without those of the file's own variables.

    Raises:
        RaceError: with source, line and column, what was expected and what was found.
    """
    known: dict[str, Any] = {"T": True, "F": False}
    found = []
    for line, statement in _statements(text, source):
        match = _ASSIGNMENT.match(statement)
        if match is None:
            raise RaceError(f"{source}:{line}: expected NAME = VALUE, found '{excerpt(statement.strip())}'")
        name, rest = match["name"], statement[match.end() :]
        at = line + statement.count("\n", 0, match.end())
        column = match.end() - statement.rfind("\n", 0, match.end())
        if _FUNCTION.match(rest):
            raise RaceError(f"{source}:{at}: {name}: expected a value, found a function of R, which cannot be run here")
        expression = Expression(rest, source=source, line=at, column=column)
        unknown = [one for one in expression.names if one not in known]
        if unknown:
            expected = "text in quotes, a number, TRUE or FALSE"
            raise RaceError(f"{source}:{at}: {name}: expected {expected}, found the name '{unknown[0]}'")
        try:
            known[name] = expression(known)
        except RaceError as error:
            raise RaceError(f"{source}:{at}: {name}: {error}") from None
        if not name.startswith("."):
            found.append(Assignment(name, known[name], f"{source}:{at}"))
    return found


def to_text(settings: Mapping[str, Setting]) -> str:
    """The text of a scenario with these settings, for `read_assignments` and for R."""
    return "".join(f"{name} = {_literal(value)}\n" for name, value in settings.items())


def _literal(value: Setting) -> str:
    match value:
        case None:
            return "NA"
        case bool():
            return str(int(value))
        case str():
            return f'"{value.translate(_ESCAPES)}"'
        case tuple():
            return f"c({', '.join(map(_literal, value))})"
        case float() if not value.is_integer():
            return repr(value)  # with all digits: a race that is resumed needs the same value
        case _:
            return number_text(value)


_ESCAPES = str.maketrans({"\\": r"\\", '"': r"\"", "\n": r"\n", "\r": r"\r", "\t": r"\t"})


def _statements(text: str, source: str) -> Iterator[tuple[int, str]]:
    """The statements without comments, each with the number of its first line."""
    line, begun, depth = 1, 1, 0
    pieces: list[str] = []
    for piece in _PIECE.finditer(f"{text}\n"):
        kind, found = piece.lastgroup, piece.group()
        if kind == "unclosed":
            raise RaceError(f"{source}:{line}: expected the closing {found[0]} of {excerpt(found.splitlines()[0])}")
        if kind == "comment":
            continue
        depth += (kind == "open") - (kind == "close")
        statement = "".join(pieces) if kind == "end" and depth <= 0 else ""
        if kind == "end" and depth <= 0 and not _OPEN.search(statement):
            if statement:
                yield begun, statement
            pieces, depth = [], 0
        elif pieces or not found.isspace():
            begun = begun if pieces else line
            pieces.append(found)
        line += found.count("\n")
    if pieces:
        raise RaceError(
            f"{source}:{begun}: expected the end of '{excerpt(''.join(pieces).strip())}', found the end of the file"
        )
