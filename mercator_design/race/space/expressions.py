"""irace's expression language: conditions, dependent bounds and forbidden combinations over parameter names.

It is a small part of R. A parser turns an expression into closures; it is never run as code. As in R, the result of an
operation on a missing value is missing (NA; here None, the value of an inactive parameter), but `FALSE & NA` is FALSE
and `TRUE | NA` is TRUE. Text and a number are compared as text: `"1" == 1` is TRUE, but `"100000" == 100000` is FALSE,
because R writes that number as 1e+05. Unlike in R, the order of texts is that of code points, not that of a locale.

    or         := and { ("|" | "||") and }                 operators by R's precedence, lowest first
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
from functools import lru_cache, partial
from typing import Any, NamedTuple, NoReturn

from mercator_design.errors import RaceError, excerpt
from mercator_design.race.space.r_functions import ARITHMETIC_FUNCTIONS, FUNCTIONS
from mercator_design.race.space.r_operators import (
    COMPARISONS,
    CONSTANTS,
    Closure,
    Operation,
    comparable,
    constant,
    divide,
    every,
    is_true,
    lift,
    logical,
    member,
    modulo,
    number,
    numeric,
    power,
    some,
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
_CACHE_SIZE = 4096
"""Results that are cached for each expression: most depend on one or two parameters with few values."""
_MAX_DEPTH = 40
"""Maximum depth of parentheses, functions and signs: a level takes a dozen calls, of which Python allows a thousand."""
_FAILURES = (TypeError, OverflowError, RecursionError)


class Expression:
    """An expression over parameter names.

    Args:
        text: In irace's language, see the module.
        source, line, column: The place of the text, for error messages.
        arithmetic: Whether only numbers and arithmetic are allowed, as in the bounds of a domain.

    Attributes:
        names: The parameters that it depends on, in order of appearance.
        double_operators: Notes on `&&` and `||`, which irace refuses in conditions.
        ambiguous_numbers: The parameters that are compared with numbers that R writes in another form, each with a note
            for the case that its values are text.

    Raises:
        RaceError: The text does not follow the grammar. When called: an operand has the wrong type, a number is too
            large, or there are too many operators in a row.
    """

    __slots__ = ("_cached", "ambiguous_numbers", "arithmetic", "double_operators", "names", "text")

    def __init__(
        self, text: str, *, source: str = "", line: int = 1, column: int = 1, arithmetic: bool = False
    ) -> None:
        parser = _Parser(text, source, line, column, arithmetic=arithmetic)
        self.text = text.strip()
        self.arithmetic = arithmetic
        closure = parser.parse()
        self.names: tuple[str, ...] = tuple(parser.names)
        self.double_operators: tuple[str, ...] = tuple(parser.double_operators)
        self.ambiguous_numbers: tuple[tuple[str, str], ...] = tuple(parser.ambiguous_numbers)
        self._cached = lru_cache(_CACHE_SIZE, typed=True)(lambda *values: closure(values))

    def __call__(self, configuration: Mapping[str, Any]) -> Any:  # noqa: ANN401 - number, text, bool, None
        """The value for a configuration; None stands for NA."""
        try:
            return self._cached(*map(configuration.get, self.names))
        except _FAILURES as error:
            raise self._failed(error, configuration) from None

    def holds(self, configuration: Mapping[str, Any]) -> bool:
        """Whether it is true for a configuration; NA is not."""
        try:
            return is_true(self._cached(*map(configuration.get, self.names)))
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
        return partial(Expression, arithmetic=self.arithmetic), (self.text,)


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
        self.double_operators: list[str] = []
        self.ambiguous_numbers: list[tuple[str, str]] = []
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
        """The character of an escape of R."""
        escape = _Token("", match.group(), token.position + 1 + match.start())
        digits = match["octal"] or match["byte"] or match["braced"] or match["point"]
        if digits is None:
            if match["letter"] not in _ESCAPED:
                self._fail("an escape of R such as \\n or \\\\", escape)
            return _ESCAPED[match["letter"]]
        code = int(digits, 8 if match["octal"] else 16)
        if code == 0 or 0xD800 <= code <= 0xDFFF:
            self._fail("a character", escape)
        return chr(code) if code <= sys.maxunicode else "\ufffd"

    def _logic(self) -> _Token:
        """Take an operator with a logical result, which bounds may not have."""
        if self._arithmetic:
            self._fail("arithmetic", self._next)
        if self._at("&&", "||"):
            twice = self._next.text
            self.double_operators.append(f"{self._where(self._next)}: irace refuses '{twice}' here: write '{twice[0]}'")
        return self._take()

    def _nested(self, part: Callable[[], Closure]) -> Closure:
        """Parse a part that is nested in another, and check the depth."""
        self._depth += 1
        if self._depth > _MAX_DEPTH:
            self._fail(f"at most {_MAX_DEPTH} nested parentheses, functions and signs", self._next)
        found = part()
        self._depth -= 1
        return found

    def _joined(
        self, part: Callable[[], Closure], operators: tuple[str, ...], operation: Callable[..., Any]
    ) -> Closure:
        operands = [part()]
        while self._at(*operators):
            self._logic()
            operands.append(part())
        return lift(operation, *operands) if len(operands) > 1 else operands[0]

    def _or(self) -> Closure:
        return self._joined(self._and, ("|", "||"), some)

    def _and(self) -> Closure:
        return self._joined(self._not, ("&", "&&"), every)

    def _not(self) -> Closure:
        if self._at("!"):
            self._logic()
            return strict(lambda a: not logical(a), self._nested(self._not))
        return self._comparison()

    def _comparison(self) -> Closure:
        start = self._index
        left = self._sum()
        if self._at(*COMPARISONS):
            middle = self._index
            compare = COMPARISONS[self._logic().text]
            right = self._sum()
            self._note_ambiguous_numbers(self._tokens[start:middle], self._tokens[middle + 1 : self._index])
            return strict(lambda a, b: compare(*comparable(a, b)), left, right)
        return left

    def _note_ambiguous_numbers(self, left: list[_Token], right: list[_Token]) -> None:
        """Note the numbers that a parameter is compared with, if R writes them in another form."""
        for one, others in ((left, right), (right, left)):
            if len(one) == 1 and one[0].kind in {"name", "quoted"}:
                for token in others:
                    if token.kind == "number" and not token.text.endswith("L"):
                        text = value_text(float(number(token.text)))
                        if text != token.text:
                            what = f"R compares text with '{text}' where a condition has the number {token.text}"
                            note = f"{self._where(token)}: {what}: put it in quotes"
                            self.ambiguous_numbers.append((one[0].text.strip("`"), note))

    def _arithmetic_of(self, part: Callable[[], Closure], operations: Mapping[str, Operation]) -> Closure:
        left = part()
        while self._at(*operations):
            left = numeric(operations[self._take().text], left, part())
        return left

    def _sum(self) -> Closure:
        return self._arithmetic_of(self._product, {"+": operator.add, "-": operator.sub})

    def _product(self) -> Closure:
        return self._arithmetic_of(self._special, {"*": operator.mul, "/": divide})

    def _special(self) -> Closure:
        start = self._index
        left = self._range()
        while self._at("%in%", "%%", "%/%"):
            if self._next.text == "%in%":
                middle = self._index
                self._logic()
                left = member(left, self._range())
                self._note_ambiguous_numbers(self._tokens[start:middle], self._tokens[middle + 1 : self._index])
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
            return numeric(lambda a: sign * a, self._nested(self._sign))
        return self._power()

    def _power(self) -> Closure:
        base = self._primary()
        if self._at("^"):
            self._take()
            return numeric(power, base, self._nested(self._sign))
        return base

    def _primary(self) -> Closure:
        token = self._next
        if self._at("("):
            self._take()
            inside = self._nested(self._or)
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
        """The value of a number: without an L it is a float, as in R; but bounds may be integers without an L."""
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
        return name, self._nested(self._or)
