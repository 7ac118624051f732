"""AutoMoDe's command lines: flags and their values in turn, whatever control software they describe."""

import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence

from mercator_design.errors import FsmError
from mercator_design.modules.architecture import Warn
from mercator_design.modules.flavour import Flavour
from mercator_design.modules.module import Module, ModuleParameter

_MAX_WARNING = 200
NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_INTEGER = re.compile(r"[+-]?[0-9]+")
_NOT_DECIMAL = re.compile(r"[+-]?(?:inf|nan|0x)", re.IGNORECASE)


def tokens_of(line: str, lead: str = "", *, longest: int = 40) -> list[str]:
    """The tokens of a command line, without a leading option such as --fsm-config.

    Raises:
        FsmError: One of them is too long to be a flag or a number, or has other characters.
    """
    tokens = line.split()
    if tokens[:1] == [lead]:
        del tokens[0]
    for token in tokens:
        if len(token) > longest or not token.isprintable():
            raise FsmError(f"expected a flag or a number, found {token[:longest]!r}")
    return tokens


def flags_of(modules: Iterable[Module]) -> set[str]:
    """The letters of all parameters of modules."""
    return {parameter.flag for module in modules for parameter in module.parameters}


def number_text(value: float) -> str:
    """A number as command lines and genomes have it, so that it is read back as the same."""
    return f"{value:.0f}" if value == int(value) and abs(value) < 1e15 else repr(float(value))


def values_text(module: Module, values: Sequence[float], index: str) -> list[str]:
    """The parameters of a module at a place, flag by flag."""
    pairs = zip(module.parameters, values, strict=True)
    return [f"--{parameter.flag}{index} {number_text(value)}" for parameter, value in pairs]


class FlagReader:
    """Reads well-formed tokens, one flag with its value after the other.

    Args:
        tokens: The tokens.
        known: A pattern of all flags.
        example: Flags to show where one is not known.
        flavour: Whose modules these are.
        any_domain: Whether parameters may be outside their domains.

    Raises:
        FsmError: A flag is not known or given twice, or has no value.
    """

    def __init__(
        self, tokens: Sequence[str], known: re.Pattern[str], example: str, flavour: Flavour, *, any_domain: bool
    ) -> None:
        self.flavour = flavour
        self.any_domain = any_domain
        self._pairs: list[tuple[str, str]] = []
        seen: set[str] = set()
        for flag, value in zip(tokens[::2], [*tokens[1::2], ""], strict=False):
            if not known.fullmatch(flag):
                raise FsmError(f"expected a flag such as {example}, found {flag!r}")
            if flag in seen:
                raise FsmError(f"{flag} is given twice")
            if not value or value.startswith("--"):
                raise FsmError(f"{flag}: expected a value, found {value or 'the end of the text'!r}")
            seen.add(flag)
            self._pairs.append((flag, value))
        self._next = 0

    def peek(self) -> str | None:
        """The next flag, if there is one."""
        return self._pairs[self._next][0] if self._next < len(self._pairs) else None

    def gather(self, flags: Collection[str]) -> dict[str, str]:
        """The values of the next flags, as long as they are among these."""
        start = self._next
        while self.peek() in flags:
            self._next += 1
        return dict(self._pairs[start : self._next])

    def value(self, flag: str, what: str) -> str:
        """The value of the next flag, which must be this one."""
        if self.peek() != flag:
            found = self.peek() or "the end of the text"
            raise FsmError(f"expected {flag}, {what}; found {found}")
        self._next += 1
        return self._pairs[self._next - 1][1]

    def integer(self, flag: str, what: str, low: int, high: int, none: str = "") -> int:
        """The next value, a whole number within bounds; `none` says what is expected if there is no such number."""
        value = self.value(flag, what)
        if not _INTEGER.fullmatch(value) or not low <= int(value) <= high:
            expected = f"a whole number from {low} to {high}" if high > low else str(low)
            raise FsmError(f"{flag}, {what}: expected {none if high < low else expected}, found {value}")
        return int(value)

    def known(self, flag: str, value: str, what: str, known: Mapping[int, Module]) -> Module:
        """The module of a number."""
        if not _INTEGER.fullmatch(value) or int(value) not in known:
            names = ", ".join(f"{number} {module.name}" for number, module in known.items())
            raise FsmError(f"{flag}, {what}: expected one of {names} ({self.flavour.name}); found {value}")
        return known[int(value)]

    def number(self, place: str, flag: str, text: str | None, of: str, parameter: ModuleParameter) -> float:
        """The number that a text of a parameter `of` a module stands for; None is a missing one."""
        if text is None:
            raise FsmError(f"{place}: {flag}, the {parameter.name} of {of}, is missing")
        if not (_INTEGER if parameter.integer else NUMBER).fullmatch(text):
            raise FsmError(f"{place}: {flag}: expected {parameter.domain}, found {text!r}")
        if not (self.any_domain or parameter.contains(float(text))):
            raise FsmError(f"{place}: {flag}, the {parameter.name} of {of}: expected {parameter.domain}, found {text}")
        return float(text)

    def values(self, place: str, module: Module, given: dict[str, str], index: str) -> tuple[float, ...]:
        """The parameters of a module, of the flags that are given for it."""
        values = []
        for parameter in module.parameters:
            flag = f"--{parameter.flag}{index}"
            values.append(self.number(place, flag, given.pop(flag, None), module.name, parameter))
        for flag in given:
            raise FsmError(f"{place}: {module.name} has no parameter {flag}")
        return tuple(values)


class OriginalReader:
    """Finds flags as AutoMoDe's builders do, and reads numbers as C's atoi and strtod do.

    The first of several flags counts, and what is not searched for is ignored. What makes the original crash is left in
    place in `clean`, for a strict reader to refuse.
    """

    def __init__(self, tokens: Sequence[str], warn: Warn) -> None:
        self.tokens = tokens
        self.clean: list[str] = []
        self._warn = warn
        self._used: set[int] = set()

    def find(self, flag: str, start: int, end: int) -> int:
        """The place of a flag; `end` if it is not there."""
        return next((k for k in range(start, end) if self.tokens[k] == flag), end)

    def take(
        self, flag: str, start: int, end: int, *, integer: bool = False, cut: bool = False, byte: bool = False
    ) -> str | None:
        """Use a flag's value: as atoi reads it if `integer`, else as strtod does.

        It is cut to a whole number if `cut`, which is one of 0 to 255 if `byte`.
        """
        at = self.find(flag, start, end)
        if at + 1 >= end:
            return None
        self._used.update((at, at + 1))
        text = self.tokens[at + 1]
        match = (_INTEGER if integer else NUMBER).match(text)
        value = match.group() if match else "0"
        if not integer and _NOT_DECIMAL.match(text):
            value = text  # strtod makes a number of it that no controller means; the strict reader refuses it
        elif cut and math.isfinite(float(value)):
            value = str(int(float(value)) % 256 if byte else int(float(value)))
        if value != text:
            self._warn(f"{flag} {text} was read as {value}")
        self.clean.extend((flag, value))
        return value

    def end(self) -> list[str]:
        """The tokens that the original makes use of; a warning names the others."""
        ignored = " ".join(token for k, token in enumerate(self.tokens) if k not in self._used)
        if ignored:
            self._warn(f"ignored: {ignored if len(ignored) <= _MAX_WARNING else ignored[:_MAX_WARNING] + ' ...'}")
        return self.clean
