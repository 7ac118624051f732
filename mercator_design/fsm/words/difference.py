"""How two PFSMs differ, in words: states and transitions are matched so that there are fewest changes."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from mercator_design.fsm.pfsm import Pfsm, State, Transition
from mercator_design.fsm.space.structure import canonical
from mercator_design.modules.architecture import Difference
from mercator_design.modules.flavour import same_constants
from mercator_design.modules.words import named_values, with_parameters

_OTHER_MODULE = 4.0
_OTHER_TARGET = 2.0
_ONE_LESS = 6.0
"""What a change counts when states and transitions are matched; a parameter counts 0.5 to 1.5."""


def difference(one: Pfsm, other: Pfsm, names: Sequence[str], other_names: Sequence[str]) -> Difference:
    """How a PFSM, with its names of states, differs from one other.

    They are equivalent if they are the same but for states that cannot be reached.
    """
    match = _match(one, other)
    changes = tuple(_changes(one, other, names, other_names, match))
    if (one.flavour, one.states) == (other.flavour, other.states):
        return Difference("same", ())
    if not changes:
        return Difference("renumbered", ())
    alike = same_constants(one.flavour, other.flavour) and (
        canonical(one) == canonical(replace(other, flavour=one.flavour))
    )
    return Difference("equivalent" if alike else "different", changes)


_Match = tuple[tuple[int | None, int | None], ...]
"""Pairs of states; None where one of the two PFSMs has no such state."""


def _match(one: Pfsm, other: Pfsm) -> _Match:
    """The assignment of states with fewest changes; of equals the first, so the result does not depend on chance."""
    n = max(len(one.states), len(other.states))
    numbers = [i if i < len(one.states) else None for i in range(n)]
    orders = itertools.permutations([i if i < len(other.states) else None for i in range(n)])
    return min(
        (tuple(zip(numbers, order, strict=True)) for order in orders), key=lambda match: _cost(one, other, match)
    )


def _cost(one: Pfsm, other: Pfsm, match: _Match) -> float:
    places = dict(match)
    total = _OTHER_TARGET * (places[0] != 0)
    for i, k in match:
        if i is None or k is None:
            total += _ONE_LESS
        else:
            old, new = one.states[i], other.states[k]
            total += _module_cost(old, new)
            for before, after in _pairs(old, new, match):
                total += _edge_cost(before, after, match) if before and after else _OTHER_MODULE
    return total


def _module_cost(old: State | Transition, new: State | Transition) -> float:
    if old.module is not new.module:
        return _OTHER_MODULE
    changed = zip(old.module.parameters, old.parameters, new.parameters, strict=True)
    return sum(0.5 + min(1.0, abs(a - b) / (p.high - p.low)) for p, a, b in changed if a != b)


def _edge_cost(old: Transition, new: Transition, match: _Match) -> float:
    return _module_cost(old, new) + _OTHER_TARGET * (dict(match)[old.target] != new.target)


def _pairs(old: State, new: State, match: _Match) -> list[tuple[Transition | None, Transition | None]]:
    """The transitions of two states in pairs with fewest changes; None where there is one less."""
    pairs: list[tuple[Transition | None, Transition | None]] = []
    table = sorted(
        (_edge_cost(a, b, match), i, k) for i, a in enumerate(old.transitions) for k, b in enumerate(new.transitions)
    )
    taken: dict[int, int] = {}
    for cost, i, k in table:  # greedy: at most 4 of each
        if cost < _OTHER_MODULE + _OTHER_TARGET and i not in taken and k not in taken.values():
            taken[i] = k
    for i, edge in enumerate(old.transitions):
        pairs.append((edge, new.transitions[taken[i]] if i in taken else None))
    left = [edge for k, edge in enumerate(new.transitions) if k not in taken.values()]
    return [*pairs, *((None, edge) for edge in left)]


def _changes(one: Pfsm, other: Pfsm, names: Sequence[str], other_names: Sequence[str], match: _Match) -> Iterator[str]:
    """The changes; states of both are called by their names in the first PFSM."""
    places = dict(match)
    called = {k: f"'{names[i]}'" if i is not None else f"the new '{other_names[k]}'" for i, k in match if k is not None}
    if one.flavour != other.flavour:
        yield f"the flavour is {other.flavour}, was {one.flavour}"
    if places[0] != 0:
        yield f"robots begin in {called[0]}, before in '{names[0]}'"
    for i, k in match:
        if i is not None and k is not None:
            renamed = f" (now '{other_names[k]}')" * (names[i] != other_names[k])
            for words in _state_changes(one.states[i], other.states[k], match, called):
                yield f"state '{names[i]}'{renamed}: {words}"
        elif i is not None:
            yield f"no state '{names[i]}' any more: {_described(one.states[i])}"
        elif k is not None:
            state = other.states[k]
            edges = "".join(f"; {_edge_words(edge, called[edge.target])}" for edge in state.transitions)
            yield f"new state '{other_names[k]}': {_described(state)}{edges}"


def _state_changes(old: State, new: State, match: _Match, called: Mapping[int, str]) -> Iterator[str]:
    yield from _module_changes(old, new)
    places = dict(match)
    for before, after in _pairs(old, new, match):
        if after is not None and before is None:
            yield f"new transition {_edge_words(after, called[after.target])}"
        elif before is not None:
            target = places[before.target]
            there = called[target] if target is not None else "a state that is gone"
            if after is None:
                yield f"no transition {_edge_words(before, there)} any more"
                continue
            edge = f"transition to {there} by {before.condition}"
            if target != after.target:
                yield f"{edge}: now to {called[after.target]}"
            yield from (f"{edge}: {words}" for words in _module_changes(before, after))


def _module_changes(old: State | Transition, new: State | Transition) -> Iterator[str]:
    if old.module is not new.module:
        yield f"{_described(new)} instead of {_described(old)}"
        return
    before, after = (named_values(each.module, each.parameters) for each in (old, new))
    yield from (f"{name} {before[name]} -> {value}" for name, value in after.items() if before[name] != value)


def _described(one: State | Transition) -> str:
    return with_parameters(one.module, one.parameters)


def _edge_words(edge: Transition, target: str) -> str:
    return f"to {target} by {_described(edge)}"
