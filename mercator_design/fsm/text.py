"""A PFSM as AutoMoDe's command line.

    --nstates 2 --s0 0 --rwm0 20 --n0 1 --n0x0 0 --c0x0 0 --p0x0 0.5 --s1 1

A state's behaviour, its parameters, the number of its transitions; for each transition the target, the condition and
its parameters. The target is relative: the number among the *other* states. `parse` is strict: all that the original
program crashes on or silently reads as something else is refused, with the token, the state and the transition.
A caller who passes `tolerate` hears of each such thing instead, and gets what the original would have run.
"""

import re
from collections.abc import Mapping, Sequence

from mercator_design.errors import FsmError
from mercator_design.fsm.pfsm import Pfsm, State, Transition, absolute_target, relative_target
from mercator_design.modules.architecture import Warn, out_of_domain
from mercator_design.modules.flavour import DEFAULT_FLAVOUR, Flavour, flavour_of, other_flavour
from mercator_design.modules.module import Module
from mercator_design.modules.tokens import FlagReader, OriginalReader, flags_of, tokens_of, values_text


def _known_flags(flavour: Flavour) -> re.Pattern[str]:
    """All flags of a flavour's texts."""
    of_states, of_transitions = (
        "|".join(sorted(flavour.reserved_flags(kind) | flags_of(flavour.numbered(kind).values())))
        for kind in ("behaviour", "condition")
    )
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
    known = flavour_of(flavour, "pfsm")
    given = tokens = tokens_of(line, "--fsm-config")
    if tolerate:
        tokens = _as_original(tokens, known, tolerate)
    try:
        pfsm = _TokenReader(tokens, known, any_domain=tolerate is not None).pfsm()
    except FsmError as error:

        def read(other: str) -> Pfsm:
            return _TokenReader(given, flavour_of(other), any_domain=tolerate is not None).pfsm()

        raise FsmError(f"{error}{other_flavour(flavour, 'pfsm', read)}") from None
    if tolerate:
        out_of_domain(pfsm, tolerate)
    return pfsm


def to_text(pfsm: Pfsm) -> str:
    """The canonical command line of a PFSM; `parse` reads it back to an equal one."""
    words = [f"--nstates {len(pfsm.states)}"]
    behaviours, conditions = (flavour_of(pfsm.flavour).numbers_of(kind) for kind in ("behaviour", "condition"))
    for i, state in enumerate(pfsm.states):
        words.append(f"--s{i} {behaviours[state.behaviour]}")
        words += values_text(state.module, state.parameters, f"{i}")
        if state.transitions:
            words.append(f"--n{i} {len(state.transitions)}")
        for j, transition in enumerate(state.transitions):
            relative = relative_target(i, transition.target)
            words.append(f"--n{i}x{j} {relative} --c{i}x{j} {conditions[transition.condition]}")
            words += values_text(transition.module, transition.parameters, f"{i}x{j}")
    return " ".join(words)


class _TokenReader(FlagReader):
    """Reads well-formed tokens."""

    def __init__(self, tokens: Sequence[str], flavour: Flavour, *, any_domain: bool) -> None:
        super().__init__(tokens, _known_flags(flavour), "--s0 or --p0x1", flavour, any_domain=any_domain)
        self._behaviours = flavour.numbered("behaviour")
        self._conditions = flavour.numbered("condition")

    def pfsm(self) -> Pfsm:
        n = self.integer("--nstates", "the number of states", 1, self.flavour.limit("states"))
        states = tuple(self._state(i, n) for i in range(n))
        if flag := self.peek():
            raise FsmError(f"{flag} is not expected here: --nstates {n} ends with state {n - 1}")
        return Pfsm(states, self.flavour.name, any_domain=self.any_domain)

    def _state(self, i: int, n: int) -> State:
        place = f"state {i}"
        what = f"the behaviour of {place}"
        module = self.known(f"--s{i}", self.value(f"--s{i}", what), what, self._behaviours)
        flags = {f"--{flag}{i}" for flag in flags_of(self._behaviours.values())}
        parameters = self.values(place, module, self.gather(flags), f"{i}")
        transitions: tuple[Transition, ...] = ()
        if self.peek() == f"--n{i}":
            max_transitions = self.flavour.limit("transitions") if n > 1 else 0
            m = self.integer(f"--n{i}", f"the number of transitions of {place} (of {n})", 0, max_transitions)
            transitions = tuple(self._transition(i, j, n) for j in range(m))
        return State(module.name, parameters, transitions)

    def _transition(self, i: int, j: int, n: int) -> Transition:
        place = f"state {i}, transition {j}"
        what = f"the target of {place}, counted among the other states"
        relative = self.integer(f"--n{i}x{j}", what, 0, n - 2, none="no transition, as there is no other state")
        flags = {f"--{flag}{i}x{j}" for flag in flags_of(self._conditions.values())}
        condition = f"--c{i}x{j}"
        given = self.gather({condition, *flags})
        if condition not in given:
            raise FsmError(f"{place}: {condition}, its condition, is missing")
        module = self.known(condition, given.pop(condition), f"the condition of {place}", self._conditions)
        parameters = self.values(place, module, given, f"{i}x{j}")
        return Transition(module.name, parameters, absolute_target(i, relative))


def _as_original(tokens: list[str], flavour: Flavour, warn: Warn) -> list[str]:
    """The tokens that the original builder makes use of, with numbers as C's atoi and strtod read them.

    AutoMoDeFsmBuilder searches slices of the text for flags: the first of each counts, what it does not search for is
    ignored. What makes it crash is left in place, for the strict reader to refuse.
    """
    original = OriginalReader(tokens, warn)
    find, take = original.find, original.take

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
    return original.end()
