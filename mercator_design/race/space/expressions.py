"""irace's expression language: conditions, dependent bounds and forbidden combinations over parameter names.

A small part of R, read by a parser of our own and turned into closures, never into Python code. As in R, a
missing value (NA, here None: the value of an inactive parameter) spreads through whatever uses it, `FALSE &
NA` is FALSE and `TRUE | NA` is TRUE, and comparing text with a number compares text: `"1" == 1` is TRUE, and
`"100000" == 100000` is FALSE, as R writes that number as 1e+05. One choice of our own: text is ordered by code
point, not by locale.

    or         := and { ("|" | "||") and }                 operators by R's precedence, loosest first
    and        := not { ("&" | "&&") not }
    not        := "!" not | comparison
    comparison := sum [ ("==" | "!=" | "<" | "<=" | ">" | ">=") sum ]
    sum        := product { ("+" | "-") product }
    product    := special { ("*" | "/") special }
    special    := range { ("%in%" | "%%" | "%/%") range }
    range      := sign { ":" sign }
    sign       := ("-" | "+") sign | power
    power      := primary [ "^" sign ]
    primary    := NUMBER | "text" | TRUE | FALSE | NA | name | `name` | function "(" arguments ")" | "(" or ")"
    arguments  := [ [ name "=" ] or { "," [ name "=" ] or } ]           functions: race/space/r_functions.py
"""

import operator
import re
import sys
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any, NamedTuple, NoReturn

from mercator_design.errors import RaceError, excerpt
from mercator_design.race.space.r_functions import ARITHMETIC_FUNCTIONS, FUNCTIONS
from mercator_design.race.space.r_operators import (
    COMPARISONS,
    CONSTANTS,
    Closure,
    all_of,
    any_of,
    comparable,
    constant,
    divide,
    is_true,
    logical,
    member,
    modulo,
    number,
    numeric,
    power,
    span,
    strict,
    value_text,
    whole_quotient,
)

_TOKEN = re.compile(
    r"""\s*(?:
        (?P<number>(?:0[xX][0-9A-Fa-f]+|(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)L?)
      | (?P<name>[A-Za-z.][A-Za-z0-9._]*)
      | (?P<quoted>`[^`\n]+`)
      | (?P<text>"(?:[^"\\]|\\.)*"|'(?:[^'\\]|\\.)*')
      | (?P<operator>%in%|%%|%/%|==|!=|<=|>=|&&|\|\||[-+*/^<>!&|(),:=])
      | (?P<end>$)
    )""",
    re.VERBOSE | re.DOTALL,
)
_ESCAPE = re.compile(
    r"\\(?:(?P<octal>[0-7]{1,3})|x(?P<byte>[0-9A-Fa-f]{1,2})"
    r"|[uU](?:\{(?P<braced>[0-9A-Fa-f]{1,6})\}|(?P<point>[0-9A-Fa-f]{1,4}))|(?P<letter>.))",
    re.DOTALL,
)
_ESCAPED = {"n": "\n", "t": "\t", "r": "\r", "a": "\a", "b": "\b", "f": "\f", "v": "\v"} | {c: c for c in "\\\"'` \n"}
_REMEMBERED = 4096
"""Results kept for each expression: most depend on one or two parameters with a handful of values."""
_DEEPEST = 40
"""Parentheses, functions and signs within one another: each takes a dozen calls to read, of Python's thousand."""
_FAILURES = (TypeError, OverflowError, RecursionError)


class Expression:
    """An expression over parameter names.

    Args:
        text: in irace's language, see the module.
        source, line, column: where the text stands, for error messages.
        arithmetic: only numbers and arithmetic, as in the bounds of a domain.

    Attributes:
        names: of the parameters that it depends on, in order of appearance.
        doubled: places of `&&` and `||`, which irace refuses in conditions.
        odd_numbers: numbers that a parameter is compared with, and that R writes otherwise: the name of the parameter,
            and what to tell if its values are text.

    Raises:
        RaceError: the text does not follow the grammar; when called, an operand of the wrong type, too large a number,
            or too many operators in a row.
    """

    __slots__ = ("_remembered", "arithmetic", "doubled", "names", "odd_numbers", "text")

    def __init__(
        self, text: str, *, source: str = "", line: int = 1, column: int = 1, arithmetic: bool = False
    ) -> None:
        parser = _Parser(text, source, line, column, arithmetic=arithmetic)
        self.text = text.strip()
        self.arithmetic = arithmetic
        closure = parser.parse()
        self.names: tuple[str, ...] = tuple(parser.names)
        self.doubled: tuple[str, ...] = tuple(parser.doubled)
        self.odd_numbers: tuple[tuple[str, str], ...] = tuple(parser.odd_numbers)
        self._remembered = lru_cache(_REMEMBERED)(lambda *values: closure(values))

    def __call__(self, configuration: Mapping[str, Any]) -> Any:  # noqa: ANN401 - number, text, bool, None
        """The value for a configuration; None stands for NA."""
        try:
            return self._remembered(*map(configuration.get, self.names))
        except _FAILURES as error:
            raise self._failed(error, configuration) from None

    def holds(self, configuration: Mapping[str, Any]) -> bool:
        """Whether it is true for a configuration; NA is not."""
        try:
            return is_true(self._remembered(*map(configuration.get, self.names)))
        except _FAILURES as error:
            raise self._failed(error, configuration) from None

    def _failed(self, error: Exception, configuration: Mapping[str, Any]) -> RaceError:
        what = "expected fewer operators in a row" if isinstance(error, RecursionError) else str(error)
        given = ", ".join(f"{name} = {configuration.get(name)!r}" for name in self.names)
        return RaceError(f"{excerpt(self.text)}: {what}{f' (with {excerpt(given)})' if given else ''}")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Expression) and other.text == self.text

    def __hash__(self) -> int:
        return hash(self.text)

    def __repr__(self) -> str:
        return f"Expression({self.text!r})"

    def __reduce__(self) -> tuple[Any, ...]:
        return _again, (self.text, self.arithmetic)


def _again(text: str, arithmetic: bool) -> Expression:
    return Expression(text, arithmetic=arithmetic)


class _Token(NamedTuple):
    kind: str
    text: str
    position: int

    def __str__(self) -> str:
        return "the end" if self.kind == "end" else f"'{self.text}'"


class _Parser:
    """Recursive descent over the tokens of one expression."""

    def __init__(self, text: str, source: str, line: int, column: int, *, arithmetic: bool) -> None:
        self.names: dict[str, None] = {}  # in order of appearance
        self.doubled: list[str] = []
        self.odd_numbers: list[tuple[str, str]] = []
        self._text = text
        self._place = (source, line, column)
        self._arithmetic = arithmetic
        self._tokens = self._tokenise(text)
        self._index = 0
        self._depth = 0

    def parse(self) -> Closure:
        closure = self._or()
        if self._next.kind != "end":
            self._fail("an operator or the end", self._next)
        return closure

    @property
    def _next(self) -> _Token:
        return self._tokens[self._index]

    def _take(self) -> _Token:
        self._index += 1
        return self._tokens[self._index - 1]

    def _at(self, *operators: str) -> bool:
        return self._next.kind == "operator" and self._next.text in operators

    def _expect(self, text: str) -> None:
        if not self._at(text):
            self._fail(f"'{text}'", self._next)
        self._take()

    def _fail(self, expected: str, found: _Token) -> NoReturn:
        raise RaceError(f"{self._where(found)}: expected {expected}, found {found}")

    def _where(self, token: _Token) -> str:
        source, line, column = self._place
        before = self._text[: token.position]
        line += before.count("\n")
        column = token.position - before.rfind("\n") if "\n" in before else column + token.position
        return f"{source}:{line}, column {column}" if source else f"line {line}, column {column}"

    def _tokenise(self, text: str) -> list[_Token]:
        tokens, position = [], 0
        while True:
            match = _TOKEN.match(text, position)
            if match is None or match.lastgroup is None:
                rest = text[position:]
                start = position + len(rest) - len(rest.lstrip())
                self._fail("a number, a name, text or an operator", _Token("", text[start], start))
            tokens.append(_Token(match.lastgroup, match[match.lastgroup], match.start(match.lastgroup)))
            if match.lastgroup == "end":
                return tokens
            position = match.end()

    def _unescaped(self, match: re.Match[str], token: _Token) -> str:
        """What an escape of R's stands for."""
        digits = match["octal"] or match["byte"] or match["braced"] or match["point"]
        if digits is None:
            if match["letter"] not in _ESCAPED:
                self._fail(
                    "an escape of R such as \\n or \\\\", _Token("", match.group(), token.position + 1 + match.start())
                )
            return _ESCAPED[match["letter"]]
        code = int(digits, 8 if match["octal"] else 16)
        if code == 0 or 0xD800 <= code <= 0xDFFF:
            self._fail("a character", _Token("", match.group(), token.position + 1 + match.start()))
        return chr(code) if code <= sys.maxunicode else "\ufffd"

    def _logic(self) -> _Token:
        """Take an operator that gives a truth value, which bounds may not have."""
        if self._arithmetic:
            self._fail("arithmetic", self._next)
        if self._at("&&", "||"):
            twice = self._next.text
            self.doubled.append(f"{self._where(self._next)}: irace refuses '{twice}' here: write '{twice[0]}'")
        return self._take()

    def _within(self, part: Callable[[], Closure]) -> Closure:
        """A part that is inside of another."""
        self._depth += 1
        if self._depth > _DEEPEST:
            self._fail(f"at most {_DEEPEST} parentheses, functions and signs within one another", self._next)
        found = part()
        self._depth -= 1
        return found

    def _joined(self, part: Callable[[], Closure], operators: tuple[str, ...], join: Callable[..., Closure]) -> Closure:
        operands = [part()]
        while self._at(*operators):
            self._logic()
            operands.append(part())
        return join(*operands) if len(operands) > 1 else operands[0]

    def _or(self) -> Closure:
        return self._joined(self._and, ("|", "||"), any_of)

    def _and(self) -> Closure:
        return self._joined(self._not, ("&", "&&"), all_of)

    def _not(self) -> Closure:
        if self._at("!"):
            self._logic()
            return strict(lambda a: not logical(a), self._within(self._not))
        return self._comparison()

    def _comparison(self) -> Closure:
        start = self._index
        left = self._sum()
        if self._at(*COMPARISONS):
            middle = self._index
            compare = COMPARISONS[self._logic().text]
            right = self._sum()
            self._note_odd_numbers(self._tokens[start:middle], self._tokens[middle + 1 : self._index])
            return strict(lambda a, b: compare(*comparable(a, b)), left, right)
        return left

    def _note_odd_numbers(self, left: list[_Token], right: list[_Token]) -> None:
        """Note the numbers that a parameter is compared with, if as text they are not what is written."""
        for one, others in ((left, right), (right, left)):
            if len(one) == 1 and one[0].kind in {"name", "quoted"}:
                for token in others:
                    if token.kind == "number" and not token.text.endswith("L"):
                        text = value_text(float(number(token.text)))
                        if text != token.text:
                            what = f"R compares text with '{text}' where a condition has the number {token.text}"
                            note = f"{self._where(token)}: {what}: put it in quotes"
                            self.odd_numbers.append((one[0].text.strip("`"), note))

    def _sum(self) -> Closure:
        left = self._product()
        while self._at("+", "-"):
            operation = operator.add if self._take().text == "+" else operator.sub
            left = numeric(operation, left, self._product())
        return left

    def _product(self) -> Closure:
        left = self._special()
        while self._at("*", "/"):
            operation = operator.mul if self._take().text == "*" else divide
            left = numeric(operation, left, self._special())
        return left

    def _special(self) -> Closure:
        start = self._index
        left = self._range()
        while self._at("%in%", "%%", "%/%"):
            if self._next.text == "%in%":
                middle = self._index
                self._logic()
                left = member(left, self._range())
                self._note_odd_numbers(self._tokens[start:middle], self._tokens[middle + 1 : self._index])
            else:
                operation = modulo if self._take().text == "%%" else whole_quotient
                left = numeric(operation, left, self._range())
        return left

    def _range(self) -> Closure:
        left = self._sign()
        while self._at(":"):
            self._logic()
            left = span(left, self._sign())
        return left

    def _sign(self) -> Closure:
        if self._at("-", "+"):
            sign = -1 if self._take().text == "-" else 1
            return numeric(lambda a: sign * a, self._within(self._sign))
        return self._power()

    def _power(self) -> Closure:
        base = self._primary()
        if self._at("^"):
            self._take()
            return numeric(power, base, self._within(self._sign))
        return base

    def _primary(self) -> Closure:
        token = self._next
        if self._at("("):
            self._take()
            inside = self._within(self._or)
            self._expect(")")
            return inside
        if token.kind not in {"number", "text", "name", "quoted"} or (token.kind == "text" and self._arithmetic):
            self._fail("a number or a parameter" if self._arithmetic else "a value, a parameter or '('", token)
        self._take()
        if token.kind == "number":
            return constant(self._number(token))
        if token.kind == "text":
            return constant(_ESCAPE.sub(lambda match: self._unescaped(match, token), token.text[1:-1]))
        if self._at("(") and token.kind == "name":
            return self._call(token)
        if token.text in CONSTANTS:
            return constant(CONSTANTS[token.text])
        name = token.text.strip("`")
        self.names.setdefault(name)
        index = list(self.names).index(name)
        return lambda values: values[index]

    def _number(self, token: _Token) -> float:
        """A number, which in R is no integer unless it has an L; a bound of integers has integers all the same."""
        value = number(token.text.rstrip("L"))
        return value if self._arithmetic or token.text.endswith("L") else float(value)

    def _call(self, function: _Token) -> Closure:
        known = ARITHMETIC_FUNCTIONS if self._arithmetic else FUNCTIONS
        if function.text not in known:
            self._fail(f"one of {', '.join(known)}", function)
        self._take()
        given = [] if self._at(")") else [self._argument()]
        while self._at(","):
            self._take()
            given.append(self._argument())
        self._expect(")")
        try:
            operands, options = known[function.text].arguments(given)
        except TypeError as error:
            self._fail(f"{error} of {function.text}", _Token("", f"{len(given)}", function.position))
        return known[function.text].make(*operands, **options)

    def _argument(self) -> tuple[str, Closure]:
        """An argument of a function, and its name if that is written."""
        name = ""
        following = self._tokens[min(self._index + 1, len(self._tokens) - 1)]
        if self._next.kind == "name" and following.kind == "operator" and following.text == "=":
            name = self._take().text
            self._take()
        return name, self._within(self._or)
