"""irace's file of configurations: a table whose first line names the parameters; NA where a parameter is inactive.

It is read as R's read.table reads it. `#` begins a comment. A value with blanks is in quotes, and a quote within has a
backslash before it. Rows may begin with their names, as irace prints tables: then the first line has one word less.
Parameters of only one value may be left out. Reals are rounded to the digits of their parameters.

R cannot read a quoted value that ends in one backslash. It is written with two, and read by the parameter's domain.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from mercator_design.errors import RaceError, excerpt
from mercator_design.race.irace.scenario_text import read_text
from mercator_design.race.space.parameter import Configuration, Key, Parameter, Value, key_of
from mercator_design.race.space.r_operators import number, number_text
from mercator_design.race.space.space import Space

_MISSING = {"NA", "<NA>"}
_WORD = re.compile(
    r"""\s*(?:(?P<quote>["'])(?P<quoted>(?:\\.|(?!(?P=quote)).)*+)(?P=quote)(?=[\s#]|$)
         | (?P<bare>[^\s#"'][^\s#]*) | (?P<end>\#.*|$))""",
    re.VERBOSE | re.DOTALL,
)


class _Word(NamedTuple):
    text: str
    written: str  # with its quotes

    @property
    def is_quoted(self) -> bool:
        return self.text != self.written


def read_configurations(path: Path, space: Space) -> tuple[list[Configuration], list[str]]:
    """Read the configurations of a file; also return notes, for example on forbidden ones, which are left out.

    Raises:
        RaceError: with file and line, what was expected and what was found.
    """
    lines = read_text(path).splitlines()
    rows = [(number, words) for number, line in enumerate(lines, start=1) if (words := _words(path, number, line))]
    if not rows:
        raise RaceError(f"{path}: expected a line with the names of parameters, found none")
    number, header = rows.pop(0)
    names = [word.text for word in header]
    for name in names:
        if name not in {parameter.name for parameter in space.parameters}:
            raise RaceError(f"{path}:{number}: expected names of parameters, found '{excerpt(name)}'")
        if names.count(name) > 1:
            raise RaceError(f"{path}:{number}: expected each parameter once, found '{excerpt(name)}' twice")
    found: dict[Key, tuple[int, Configuration]] = {}
    notes = [
        f"{path}:{number}: irace expects a column for parameter '{parameter.name}'"
        for parameter in space.variable
        if parameter.name not in names
    ]
    n_row_names = int(bool(rows) and len(rows[0][1]) == len(names) + 1)
    for number, words in rows:
        if len(words) != n_row_names + len(names):
            raise RaceError(f"{path}:{number}: expected {n_row_names + len(names)} values, found {len(words)}")
        try:
            configuration = _configuration(space, dict(zip(names, words[n_row_names:], strict=True)))
        except RaceError as error:
            raise RaceError(f"{path}:{number}: {error}") from None
        key = key_of(configuration)
        if key in found:
            raise RaceError(f"{path}:{number}: expected another configuration, found that of line {found[key][0]}")
        if space.is_forbidden(configuration):
            notes.append(f"{path}:{number}: is forbidden, and left out")
        else:
            found[key] = number, configuration
    return [configuration for _, configuration in found.values()], notes


def to_text(space: Space, configurations: Sequence[Configuration], comments: Sequence[str] = ()) -> str:
    """The contents of such a file, with comments first.

    Raises:
        RaceError: A value needs quotes, and with another backslash at its end it is another value.
    """
    rows = [[parameter.name for parameter in space.parameters]]
    rows += [[_word(parameter, one.get(parameter.name)) for parameter in space.parameters] for one in configurations]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
    return "\n".join([*(f"# {comment}" for comment in comments), *lines]) + "\n"


def _configuration(space: Space, words: dict[str, _Word]) -> Configuration:
    values = {name: value for name, word in words.items() if (value := _value(space[name], word)) is not None}
    active = space.build(lambda parameter, bounds: values.get(parameter.name, parameter.quantile(0.5, bounds)))
    values |= {p.name: p.values[0] for p in space.parameters if p.is_fixed and p.name in active.keys() - values.keys()}
    configuration = {p.name: values[p.name] for p in space.parameters if p.name in values}
    if space.is_forbidden(configuration):
        return configuration
    space.check(configuration)
    rounded = {
        name: space[name].rounded(value) if isinstance(value, float) else value for name, value in configuration.items()
    }
    try:
        space.check(rounded)  # conditions and bounds may differ for rounded values
    except RaceError as error:
        raise RaceError(f"rounded to the digits of its parameters: {error}") from None
    return rounded


def _value(parameter: Parameter, word: _Word) -> Value | None:
    """The value of a parameter that a word stands for; None if it is missing."""
    if word.text in _MISSING and not (word.is_quoted and word.text in parameter.values):
        return None
    if not parameter.is_numeric:
        shorter = word.text.removesuffix("\\") if word.is_quoted else word.text
        # irace prints values that have quotes as they are.
        return next((text for text in (word.written, word.text, shorter) if text in parameter.values), word.text)
    try:
        value = number(word.text)
        if parameter.kind == "real":
            return float(value)
        if value == int(value):
            return int(value)
    except (ValueError, OverflowError):
        pass
    kind = "a whole number" if parameter.kind == "integer" else "a number"
    raise RaceError(f"parameter '{parameter.name}': expected {kind}, found '{excerpt(word.text)}'")


def _words(path: Path, number: int, line: str) -> list[_Word]:
    words: list[_Word] = []
    position = 0
    while True:
        match = _WORD.match(line, position)
        if match is None:
            rest = excerpt(line[position:].strip())
            raise RaceError(f"{path}:{number}: expected values, in quotes if they have blanks, found {rest}")
        if match["end"] is not None:
            return words
        words.append(_read(match))
        position = match.end()


def _read(match: re.Match[str]) -> _Word:
    quote = match["quote"]
    text = match["bare"] if quote is None else match["quoted"].replace(f"\\{quote}", quote)
    return _Word(text, match[0].strip())


def _word(parameter: Parameter, value: Value | None) -> str:
    """The word for a value; in quotes only if it would be read as another value without them."""
    if not isinstance(value, str):
        return "NA" if value is None else number_text(value)
    quoted = [f"{quote}{value.replace(quote, chr(92) + quote)}{end}{quote}" for end in ("", "\\") for quote in "\"'"]
    for written in (value, *quoted):
        match = _WORD.fullmatch(written)
        if match is not None and match["end"] is None and _value(parameter, _read(match)) == value:
            return written
    expected = "a value that can be written in a table"
    raise RaceError(f"parameter '{parameter.name}': expected {expected}, found {excerpt(repr(value))}")
