"""irace's parameters.txt: a space is read from its lines, or written.

    file      := { parameter } { "[forbidden]" { expression } | "[global]" { "digits" "=" INTEGER } }
    parameter := NAME "switch" type "(" domain ")" [ "|" condition ]
    type      := c | o | i | r | i,log | r,log        categorical, ordered, integer, real

"#" starts a comment anywhere, even within quotes. Values and bounds may be in double quotes; single quotes are part of
a value, as in irace. `digits` holds for all real parameters. If irace would refuse something, there is a note.
"""

import re
from typing import Any, NoReturn

from mercator_design.errors import RaceError
from mercator_design.race.space.expressions import Expression
from mercator_design.race.space.parameter import DEFAULT_DIGITS, MAX_DIGITS, Kind, Parameter, bound_of
from mercator_design.race.space.r_operators import number_text
from mercator_design.race.space.relations import ValueIn
from mercator_design.race.space.space import Space

_KINDS: dict[str, Kind] = {"c": "categorical", "o": "ordered", "i": "integer", "r": "real"}
_NAME = re.compile(r"[._A-Za-z0-9]+")
_SWITCH = re.compile(r"""(?P<quote>["'])(?P<text>.*?)(?P=quote)""")
_TYPE = re.compile(r"(?P<kind>[coir])(?P<log>,log)?(?=[\s(]|$)")
_DIGITS = re.compile(r"digits\s*=\s*(?P<digits>\d+)$")
_BARE = re.compile(r"[-+._A-Za-z0-9]+")
"""Values that need no quotes."""


def parse_space(text: str, source: str = "parameters.txt") -> Space:
    """Read a space from the text of a parameters.txt; `source` names the file in messages.

    Raises:
        RaceError: with source, line and column, what was expected and what was found.
    """
    sections: dict[str, list[_ParameterLine]] = {"": [], "[forbidden]": [], "[global]": []}
    section = ""
    for number, whole in enumerate(text.splitlines(), start=1):
        line = _ParameterLine(whole.partition("#")[0].rstrip(), source, number)
        if line.text.lstrip().startswith("["):
            section = line.text.strip()
            if section not in sections:
                line.fail("[forbidden] or [global]", section)
        elif line.text.strip():
            sections[section].append(line)
    digits = DEFAULT_DIGITS
    for line in sections["[global]"]:
        digits = line.digits()
    if not sections[""]:
        raise RaceError(f"{source}: expected at least one parameter, before [forbidden] and [global], found none")
    parameters = [line.parameter(digits) for line in sections[""]]
    seen: dict[str, int] = {}
    for line, parameter in zip(sections[""], parameters, strict=True):
        if parameter.name in seen:
            line.position = 0
            line.fail(f"a new name, as line {seen[parameter.name]} has this one", f"'{parameter.name}'")
        seen[parameter.name] = line.number
    forbidden = [line.expression() for line in sections["[forbidden]"]]
    notes = [note for line in sections[""] for note in line.notes]
    conditions = [p.condition for p in parameters if isinstance(p.condition, Expression)]
    notes += _notes_on(conditions + forbidden, parameters)
    try:
        return Space(parameters, forbidden=forbidden, notes=notes)
    except RaceError as error:
        raise RaceError(f"{source}: {error}") from None


def parameters_text(space: Space) -> str:
    """The text of a parameters.txt, from which `parse_space` makes an equal space.

    Switches and values must not have double quotes or "#", which the format cannot express.

    Raises:
        RaceError: Its real parameters have different numbers of digits, which the file cannot say.
    """
    lines = []
    for one in space.parameters:
        line = f'{one.name} "{one.switch}" {one.kind[0]}{",log" if one.log else ""} ({", ".join(_domain_words(one))})'
        lines.append(line if one.condition is None else f"{line} | {condition_text(one, space)}")
    if space.forbidden:
        lines += ["", "[forbidden]", *(expression.text for expression in space.forbidden)]
    digits = sorted({one.digits for one in space.parameters if one.kind == "real"})
    if len(digits) > 1:
        raise RaceError(f"expected the same digits for all real parameters, found {', '.join(map(str, digits))}")
    if digits:
        lines += ["", "[global]", f"digits = {digits[0]}"]
    return "\n".join([*lines, ""])


def condition_text(parameter: Parameter, space: Space) -> str:
    """The condition of a parameter in irace's language; TRUE without one."""
    match parameter.condition:
        case None:
            return "TRUE"
        case ValueIn(name, range() as values) if values[-1] == space[name].high:  # as AutoMoDe's files write it
            number = name if space[name].condition is None else f"as.numeric({name})"
            return f"{number} > {values[0] - 1}"
        case ValueIn(name, values):
            return f"{name} %in% c({', '.join(_quoted(str(value)) for value in values)})"
        case expression:
            return expression.text


def _domain_words(parameter: Parameter) -> list[str]:
    if parameter.is_numeric:
        bounds = (parameter.low, parameter.high)
        return [number_text(one) if isinstance(one, int | float) else _quoted(one.text) for one in bounds]
    return [value if _BARE.fullmatch(value) else _quoted(value) for value in parameter.values]


def _quoted(text: str) -> str:
    return f'"{text}"'


def _notes_on(expressions: list[Expression], parameters: list[Parameter]) -> list[str]:
    """Notes on what irace refuses in expressions, and on numbers that R writes otherwise when it compares text."""
    of_text = {parameter.name for parameter in parameters if not parameter.is_numeric}
    notes = [note for expression in expressions for note in expression.double_operators]
    return notes + [note for one in expressions for name, note in one.ambiguous_numbers if name in of_text]


class _ParameterLine:
    """One line, the position in it, and notes on what irace refuses in it."""

    def __init__(self, text: str, source: str, number: int) -> None:
        self.text = text
        self.source = source
        self.number = number
        self.position = 0
        self.notes: list[str] = []

    def fail(self, expected: str, found: str | None = None) -> NoReturn:
        rest = self.text[self.position :].strip()
        found = found or (f"'{rest}'" if rest else "the end of the line")
        raise RaceError(f"{self._place()}: expected {expected}, found {found}")

    def _place(self) -> str:
        rest = self.text[self.position :]
        return f"{self.source}:{self.number}, column {self.position + len(rest) - len(rest.lstrip()) + 1}"

    def digits(self) -> int:
        match = _DIGITS.match(self.text.strip())
        if match is None or not 1 <= int(match["digits"]) <= MAX_DIGITS:
            self.fail(f"digits = 1 .. {MAX_DIGITS} (parameters belong before [forbidden] and [global])")
        return int(match["digits"])

    def expression(self) -> Expression:
        """The rest of the line."""
        self._skip_blanks()
        return Expression(self.text[self.position :], source=self.source, line=self.number, column=self.position + 1)

    def parameter(self, digits: int) -> Parameter:
        name = self._take(_NAME, "the name of a parameter").group()
        self._expect_blank("name")
        if self.text[self.position :].lstrip().startswith("'"):
            self.notes.append(f"{self._place()}: irace expects the switch in double quotes")
        switch = self._take(_SWITCH, 'a switch in quotes such as "--name "')["text"]
        self._expect_blank("switch")
        kind = self._take(_TYPE, "a type: c, o, i, r, i,log or r,log")
        self._expect_blank("type")
        words = self._domain()
        condition = self._condition()
        try:
            domain: dict[str, Any] = {"values": tuple(word for word, _ in words)}
            if kind["kind"] in "ir":
                if len(words) != 2:
                    self.position = words[0][1]
                    self.fail("two bounds", f"{len(words)}")
                low, high = (self._bound(*word) for word in words)
                domain = {"low": low, "high": high, "digits": digits if kind["kind"] == "r" else DEFAULT_DIGITS}
            is_log = kind["log"] is not None
            return Parameter(
                name=name, kind=_KINDS[kind["kind"]], switch=switch, log=is_log, condition=condition, **domain
            )
        except RaceError as error:
            message = str(error)
            if message.startswith(f"{self.source}:"):
                raise
            raise RaceError(f"{self.source}:{self.number}: {message}") from None

    def _expect_blank(self, what: str) -> None:
        following = self.text[self.position : self.position + 1]
        if following and not following.isspace():
            self.notes.append(f"{self._place()}: irace expects a blank after the {what}")

    def _skip_blanks(self) -> None:
        while self.text[self.position : self.position + 1].isspace():
            self.position += 1

    def _take(self, pattern: re.Pattern[str], expected: str) -> re.Match[str]:
        self._skip_blanks()
        match = pattern.match(self.text, self.position)
        if match is None:
            self.fail(expected)
        self.position = match.end()
        return match

    def _domain(self) -> list[tuple[str, int]]:
        """The words of the domain in parentheses, without quotes, each with its position."""
        self._skip_blanks()
        if self.text[self.position : self.position + 1] != "(":
            self.fail("a domain in parentheses")
        words, depth, quote, start = [], 0, "", self.position + 1
        for position in range(self.position, len(self.text)):
            character = self.text[position]
            if character == '"':
                quote = "" if quote else character
            if quote or character == '"':
                continue
            depth += (character == "(") - (character == ")")
            if depth == 0 or (character == "," and depth == 1):
                words.append(self._word(start, position))
                start = position + 1
            if depth == 0:
                self.position = position + 1
                return words
        return self.fail(f"the closing {quote or ')'} of the domain")

    def _word(self, start: int, end: int) -> tuple[str, int]:
        raw = self.text[start:end]
        start += len(raw) - len(raw.lstrip())
        word = raw.strip()
        if not word:
            self.position = start
            self.fail("a value")
        if word[0] == word[-1] == '"' and len(word) > 1:
            return word[1:-1], start + 1
        if word[0] == word[-1] == "'" and len(word) > 1:
            same = f"for a part of the value {word}, and so does this"
            self.notes.append(f"{self.source}:{self.number}: irace takes single quotes {same}: use double quotes")
        return word, start

    def _bound(self, word: str, position: int) -> float | Expression:
        return bound_of(Expression(word, source=self.source, line=self.number, column=position + 1, arithmetic=True))

    def _condition(self) -> Expression | None:
        self._skip_blanks()
        if self.position == len(self.text):
            return None
        if self.text[self.position] != "|":
            self.fail("'|' and a condition, or the end of the line")
        self.position += 1
        return self.expression()
