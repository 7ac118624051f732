"""A PFSM as AutoMoDe's command line.

    --nstates 2 --s0 0 --rwm0 20 --n0 1 --n0x0 0 --c0x0 0 --p0x0 0.5 --s1 1

A state's behaviour, its parameters, the number of its transitions; for each transition the target, the condition and
its parameters. The target is relative: the number among the *other* states. `parse` is strict: all that the original
program crashes on or silently reads as something else is refused, with the token, the state and the transition.
A caller who passes `tolerate` hears of each such thing instead, and gets what the original would have run.
"""

import contextlib
import math
import re
from collections.abc import Callable, Iterable, Mapping

from mercator_design.errors import FsmError
from mercator_design.fsm.pfsm import Pfsm, State, Transition, absolute_target, relative_target
from mercator_design.modules.flavour import DEFAULT_FLAVOUR, Flavour, flavour_names, flavour_of
from mercator_design.modules.module import Module

Warn = Callable[[str], None]

_MAX_WARNING = 200
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_INTEGER = re.compile(r"[+-]?[0-9]+")
_NOT_DECIMAL = re.compile(r"[+-]?(?:inf|nan|0x)", re.IGNORECASE)
_MAX_TOKEN = 40


def _flags(table: Iterable[Module]) -> set[str]:
    """The letters of all parameters of modules."""
    return {parameter.flag for module in table for parameter in module.parameters}


def _known_flags(flavour: Flavour) -> re.Pattern[str]:
    """All flags of a flavour's texts."""
    of_states = "|".join(sorted({"s", "n"} | _flags(flavour.numbered("behaviour").values())))
    of_transitions = "|".join(sorted({"n", "c"} | _flags(flavour.numbered("condition").values())))
    return re.compile(rf"--(?:nstates|(?:{of_states})[0-9]+|(?:{of_transitions})[0-9]+x[0-9]+)")


def parse(line: str, flavour: str = DEFAULT_FLAVOUR, *, tolerate: Warn | None = None) -> Pfsm:
    """The PFSM that a command line describes.

    Args:
        line: The text, with or without a leading `--fsm-config`.
        flavour: Whose module numbers these are.
        tolerate: If given, what the original AutoMoDe tolerates is accepted, and this is called with a sentence on
            each such thing; if not, it is refused.

    Raises:
        FsmError: naming token, state and transition.
    """
    known = flavour_of(flavour)
    tokens = line.split()
    if tokens[:1] == ["--fsm-config"]:
        del tokens[0]
    for token in tokens:
        if len(token) > _MAX_TOKEN or not token.isprintable():
            raise FsmError(f"expected a flag or a number, found {token[:_MAX_TOKEN]!r}")
    given = tokens
    if tolerate:
        tokens = _as_original(tokens, known, tolerate)
    try:
        pfsm = _TokenReader(tokens, known, any_domain=tolerate is not None).pfsm()
    except FsmError as error:
        lenient = tolerate is not None
        hint = other_flavour(flavour, lambda other: _TokenReader(given, flavour_of(other), any_domain=lenient).pfsm())
        raise FsmError(f"{error}{hint}") from None
    if tolerate:
        out_of_domain(pfsm, tolerate)
    return pfsm


def other_flavour(flavour: str | None, read: Callable[[str], object]) -> str:
    """What to say of a PFSM that cannot be read in its flavour, but in another; empty if it fits none."""
    for other in flavour_names("pfsm"):
        if other != flavour:
            with contextlib.suppress(FsmError):
                read(other)
                return f"; it fits the flavour {other}: give that flavour"
    return ""


def out_of_domain(pfsm: Pfsm, warn: Warn) -> None:
    """Warn of each parameter that is outside its domain."""
    for place, one in pfsm.nodes:
        for parameter, value in zip(one.module.parameters, one.parameters, strict=True):
            if not parameter.contains(value):
                warn(f"{place}: {parameter.name} of {one.module.name} is {value:g}, not {parameter.domain}")


def to_text(pfsm: Pfsm) -> str:
    """The canonical command line of a PFSM; `parse` reads it back to an equal one."""
    words = [f"--nstates {len(pfsm.states)}"]
    behaviours, conditions = (flavour_of(pfsm.flavour).numbers_of(kind) for kind in ("behaviour", "condition"))
    for i, state in enumerate(pfsm.states):
        words.append(f"--s{i} {behaviours[state.behaviour]}")
        words += _values(state.module, state.parameters, f"{i}")
        if state.transitions:
            words.append(f"--n{i} {len(state.transitions)}")
        for j, transition in enumerate(state.transitions):
            relative = relative_target(i, transition.target)
            words.append(f"--n{i}x{j} {relative} --c{i}x{j} {conditions[transition.condition]}")
            words += _values(transition.module, transition.parameters, f"{i}x{j}")
    return " ".join(words)


def _values(module: Module, values: tuple[float, ...], index: str) -> list[str]:
    return [
        f"--{parameter.flag}{index} {int(value) if value == int(value) and abs(value) < 1e15 else value!r}"
        for parameter, value in zip(module.parameters, values, strict=True)
    ]


class _TokenReader:
    """Reads well-formed tokens, one flag with its value after the other."""

    def __init__(self, tokens: list[str], flavour: Flavour, *, any_domain: bool) -> None:
        self._flavour = flavour
        self._any_domain = any_domain
        self._behaviours = flavour.numbered("behaviour")
        self._conditions = flavour.numbered("condition")
        known = _known_flags(flavour)
        self._pairs: list[tuple[str, str]] = []
        seen: set[str] = set()
        for flag, value in zip(tokens[::2], [*tokens[1::2], ""], strict=False):
            if not known.fullmatch(flag):
                raise FsmError(f"expected a flag such as --s0 or --p0x1, found {flag!r}")
            if flag in seen:
                raise FsmError(f"{flag} is given twice")
            if not value or value.startswith("--"):
                raise FsmError(f"{flag}: expected a value, found {value or 'the end of the text'!r}")
            seen.add(flag)
            self._pairs.append((flag, value))
        self._next = 0

    def pfsm(self) -> Pfsm:
        n = self._integer("--nstates", "the number of states", 1, self._flavour.limit("states"))
        states = tuple(self._state(i, n) for i in range(n))
        if self._next < len(self._pairs):
            flag = self._pairs[self._next][0]
            raise FsmError(f"{flag} is not expected here: --nstates {n} ends with state {n - 1}")
        return Pfsm(states, self._flavour.name, any_domain=self._any_domain)

    def _state(self, i: int, n: int) -> State:
        place = f"state {i}"
        what = f"the behaviour of {place}"
        module = self._known(f"--s{i}", self._value(f"--s{i}", what), what, self._behaviours)
        flags = {f"--{flag}{i}" for flag in _flags(self._behaviours.values())}
        parameters = self._values(place, module, self._gather(flags), f"{i}")
        transitions: tuple[Transition, ...] = ()
        if self._peek() == f"--n{i}":
            max_transitions = self._flavour.limit("transitions") if n > 1 else 0
            m = self._integer(f"--n{i}", f"the number of transitions of {place} (of {n})", 0, max_transitions)
            transitions = tuple(self._transition(i, j, n) for j in range(m))
        return State(module.name, parameters, transitions)

    def _transition(self, i: int, j: int, n: int) -> Transition:
        place = f"state {i}, transition {j}"
        relative = self._integer(f"--n{i}x{j}", f"the target of {place}, counted among the other states", 0, n - 2)
        flags = {f"--{flag}{i}x{j}" for flag in _flags(self._conditions.values())}
        condition = f"--c{i}x{j}"
        given = self._gather({condition, *flags})
        if condition not in given:
            raise FsmError(f"{place}: {condition}, its condition, is missing")
        module = self._known(condition, given.pop(condition), f"the condition of {place}", self._conditions)
        parameters = self._values(place, module, given, f"{i}x{j}")
        return Transition(module.name, parameters, absolute_target(i, relative))

    def _peek(self) -> str | None:
        return self._pairs[self._next][0] if self._next < len(self._pairs) else None

    def _gather(self, flags: set[str]) -> dict[str, str]:
        """The values of the next flags, as long as they are among these."""
        start = self._next
        while self._peek() in flags:
            self._next += 1
        return dict(self._pairs[start : self._next])

    def _value(self, flag: str, what: str) -> str:
        if self._peek() != flag:
            found = self._peek() or "the end of the text"
            raise FsmError(f"expected {flag}, {what}; found {found}")
        self._next += 1
        return self._pairs[self._next - 1][1]

    def _integer(self, flag: str, what: str, low: int, high: int) -> int:
        value = self._value(flag, what)
        if not _INTEGER.fullmatch(value) or not low <= int(value) <= high:
            expected = f"a whole number from {low} to {high}" if high > low else str(low)
            if high < low:
                expected = "no transition, as there is no other state"
            raise FsmError(f"{flag}, {what}: expected {expected}, found {value}")
        return int(value)

    def _known(self, flag: str, value: str, what: str, known: Mapping[int, Module]) -> Module:
        if not _INTEGER.fullmatch(value) or int(value) not in known:
            names = ", ".join(f"{number} {module.name}" for number, module in known.items())
            raise FsmError(f"{flag}, {what}: expected one of {names} ({self._flavour.name}); found {value}")
        return known[int(value)]

    def _values(self, place: str, module: Module, given: dict[str, str], index: str) -> tuple[float, ...]:
        values = []
        for parameter in module.parameters:
            flag = f"--{parameter.flag}{index}"
            text = given.pop(flag, None)
            if text is None:
                raise FsmError(f"{place}: {flag}, the {parameter.name} of {module.name}, is missing")
            if not (_INTEGER if parameter.integer else _NUMBER).fullmatch(text):
                raise FsmError(f"{place}: {flag}: expected {parameter.domain}, found {text!r}")
            if not (self._any_domain or parameter.contains(float(text))):
                raise FsmError(
                    f"{place}: {flag}, the {parameter.name} of {module.name}: expected {parameter.domain}, found {text}"
                )
            values.append(float(text))
        for flag in given:
            raise FsmError(f"{place}: {module.name} has no parameter {flag}")
        return tuple(values)


def _as_original(tokens: list[str], flavour: Flavour, warn: Warn) -> list[str]:
    """The tokens that the original builder makes use of, with numbers as C's atoi and strtod read them.

    AutoMoDeFsmBuilder searches slices of the text for flags: the first of each counts, what it does not search for is
    ignored. What makes it crash is left in place, for the strict reader to refuse.
    """
    used: set[int] = set()
    clean: list[str] = []

    def find(flag: str, start: int, end: int) -> int:
        return next((k for k in range(start, end) if tokens[k] == flag), end)

    def take(flag: str, start: int, end: int, *, integer: bool = False, cut: bool = False) -> str | None:
        """Use a flag's value: as atoi reads it if `integer`, else as strtod does, cut to a whole number if `cut`."""
        at = find(flag, start, end)
        if at + 1 >= end:
            return None
        used.update((at, at + 1))
        text = tokens[at + 1]
        match = (_INTEGER if integer else _NUMBER).match(text)
        value = match.group() if match else "0"
        if not integer and _NOT_DECIMAL.match(text):
            value = text  # strtod makes a number of it that no controller means; the strict reader refuses it
        elif cut and math.isfinite(float(value)):
            value = str(int(float(value)))
        if value != text:
            warn(f"{flag} {text} was read as {value}")
        clean.extend((flag, value))
        return value

    def take_parameters(table: Mapping[int, Module], number: str | None, index: str, start: int, end: int) -> None:
        module = table.get(int(number)) if number is not None else None
        for parameter in module.parameters if module else ():
            take(f"--{parameter.flag}{index}", start, end, cut=parameter.integer)

    begin = find("--nstates", 0, len(tokens))
    n = min(int(take("--nstates", begin, len(tokens), integer=True) or 0), flavour.limit("states") + 1)
    for i in range(n):
        start = find(f"--s{i}", 0, len(tokens))
        end = find(f"--s{i + 1}", 0, len(tokens)) if i < n - 1 else len(tokens)
        behaviour = take(f"--s{i}", start, end, integer=True)
        take_parameters(flavour.numbered("behaviour"), behaviour, f"{i}", start, end)
        m = min(int(take(f"--n{i}", start, end, integer=True) or 0), flavour.limit("transitions") + 1)
        for j in range(m):
            first = find(f"--n{i}x{j}", start, end)
            last = find(f"--n{i}x{j + 1}", start, end) if j < m - 1 else end
            take(f"--n{i}x{j}", first, last, integer=True)
            condition = take(f"--c{i}x{j}", first, last, integer=True)
            take_parameters(flavour.numbered("condition"), condition, f"{i}x{j}", first, last)
    ignored = " ".join(token for k, token in enumerate(tokens) if k not in used)
    if ignored:
        warn(f"ignored: {ignored if len(ignored) <= _MAX_WARNING else ignored[:_MAX_WARNING] + ' ...'}")
    return clean
