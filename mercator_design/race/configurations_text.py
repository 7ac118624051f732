"""irace's file of configurations: a table in columns, whose first line names the parameters; NA where one is inactive.

`#` begins a comment. A value with blanks is in quotes. Parameters of only one value may be left out.
"""

import shlex
from collections.abc import Sequence
from pathlib import Path

from mercator_design.errors import RaceError, excerpt
from mercator_design.files import Unreadable, read_small
from mercator_design.race.operations import number, number_text
from mercator_design.race.parameter import Configuration, Parameter, Value
from mercator_design.race.space import Space

_LARGEST = 16 * 1024 * 1024  # bytes
_MISSING = {"NA", "<NA>"}


def read_lines(path: Path) -> list[tuple[int, str]]:
    """The lines of a text file that have more than a comment, numbered, without blanks around them.

    Raises:
        RaceError: It cannot be read.
    """
    try:
        text = read_small(path, _LARGEST).decode("utf-8-sig")
    except Unreadable as error:
        raise RaceError(f"{path}: {error}") from None
    except UnicodeDecodeError as error:
        raise RaceError(f"{path}: expected UTF-8 text, found the byte 0x{error.object[error.start]:02x}") from None
    lines = enumerate((line.partition("#")[0].strip() for line in text.splitlines()), start=1)
    return [(number, line) for number, line in lines if line]


def read_configurations(path: Path, space: Space) -> tuple[list[Configuration], list[str]]:
    """The configurations of a file, and notes on those that are forbidden and so left out.

    Raises:
        RaceError: with file and line, what was expected and what was found.
    """
    lines = read_lines(path)
    if not lines:
        raise RaceError(f"{path}: expected a line with the names of parameters, found none")
    number, line = lines[0]
    names = _words(path, number, line)
    for name in names:
        if name not in {parameter.name for parameter in space.parameters}:
            raise RaceError(f"{path}:{number}: expected names of parameters, found '{excerpt(name)}'")
    found: dict[tuple[Value | None, ...], tuple[int, Configuration]] = {}
    notes = []
    for number, line in lines[1:]:
        words = _words(path, number, line)
        if len(words) != len(names):
            raise RaceError(f"{path}:{number}: expected {len(names)} values, found {len(words)}")
        given = {name: word for name, word in zip(names, words, strict=True) if word not in _MISSING}
        try:
            configuration = _configuration(space, given)
        except RaceError as error:
            raise RaceError(f"{path}:{number}: {error}") from None
        key = space.key(configuration)
        if key in found:
            raise RaceError(f"{path}:{number}: expected another configuration, found that of line {found[key][0]}")
        if space.is_forbidden(configuration):
            notes.append(f"{path}:{number}: is forbidden, and left out")
        else:
            found[key] = number, configuration
    return [configuration for _, configuration in found.values()], notes


def to_text(space: Space, configurations: Sequence[Configuration], comments: Sequence[str] = ()) -> str:
    """Configurations as such a file, below comments."""
    names = [parameter.name for parameter in space.parameters]
    rows = [names, *([_word(one.get(name)) for name in names] for one in configurations)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
    return "\n".join([*(f"# {comment}" for comment in comments), *lines]) + "\n"


def _configuration(space: Space, given: dict[str, str]) -> Configuration:
    fixed = {p.name: p.values[0] for p in space.parameters if p.is_fixed and p.name not in given}
    values = {name: _value(space[name], text) for name, text in given.items()}
    active = space.build(lambda parameter, bounds: values.get(parameter.name, parameter.quantile(0.5, bounds)))
    values |= {name: value for name, value in fixed.items() if name in active}
    configuration = {
        name: values[name] for name in (parameter.name for parameter in space.parameters) if name in values
    }
    if not space.is_forbidden(configuration):
        space.check(configuration)
    return configuration


def _value(parameter: Parameter, text: str) -> Value:
    if not parameter.is_numeric:
        return text
    try:
        value = number(text)
        if parameter.kind == "real":
            return float(value)
        if value == int(value):
            return int(value)
    except (ValueError, OverflowError):
        pass
    kind = "a whole number" if parameter.kind == "integer" else "a number"
    raise RaceError(f"parameter '{parameter.name}': expected {kind}, found '{excerpt(text)}'")


def _words(path: Path, number: int, line: str) -> list[str]:
    try:
        return shlex.split(line)
    except ValueError as error:
        raise RaceError(f"{path}:{number}: expected values, in quotes if they have blanks, found {error}") from None


def _word(value: Value | None) -> str:
    if value is None:
        return "NA"
    text = value if isinstance(value, str) else number_text(value)
    return text if text and not set(text) & set(" \t\"'#\\") and text not in _MISSING else f'"{text}"'
