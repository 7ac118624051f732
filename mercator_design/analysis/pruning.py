"""What a PFSM consists of: how often each module is in it, and what is left when something is taken out."""

from dataclasses import replace

from mercator_design.fsm.behaviours import BEHAVIOURS
from mercator_design.fsm.conditions import CONDITIONS
from mercator_design.fsm.modules import numbered
from mercator_design.fsm.pfsm import MAX_TRANSITIONS, MOST_STATES, Pfsm, Transition

Element = tuple[int, int | None]
"""A state, or a transition of it, by their numbers."""


def max_modules(flavour: str) -> dict[str, int]:
    """The modules of a flavour, each with how often a PFSM may have it."""
    behaviours, conditions = numbered(BEHAVIOURS, flavour).values(), numbered(CONDITIONS, flavour).values()
    return {
        **{module.name: MOST_STATES for module in behaviours},
        **{module.name: MOST_STATES * MAX_TRANSITIONS for module in conditions},
    }


def module_counts(pfsm: Pfsm) -> dict[str, int]:
    """How often each module of its flavour is in a PFSM, in states that can be reached."""
    counts = dict.fromkeys(max_modules(pfsm.flavour), 0)
    for _, module in without(pfsm, frozenset()).modules:
        counts[module.name] += 1
    return counts


def elements(pfsm: Pfsm) -> dict[Element, str]:
    """What can be taken out of a PFSM, in words: all states but the initial one, and transitions."""
    found: dict[Element, str] = {
        (i, None): f"state {i} ({state.behaviour})" for i, state in enumerate(pfsm.states) if i > 0
    }
    for i, state in enumerate(pfsm.states):
        for j, transition in enumerate(state.transitions):
            found[i, j] = f"transition {i} -> {transition.target} ({transition.condition})"
    return found


def removed(pfsm: Pfsm, out: frozenset[Element]) -> frozenset[Element]:
    """All that goes with some elements of a PFSM: these, and what cannot be reached without them."""
    reached = _reached(pfsm, out)
    kept = {(i, j) for i in reached for j, _ in _transitions(pfsm, i, out)}
    return frozenset(elements(pfsm)) - {(i, None) for i in reached} - kept


def without(pfsm: Pfsm, out: frozenset[Element]) -> Pfsm:
    """What is left of a PFSM when some elements are taken out, and with them what cannot be reached."""
    reached = _reached(pfsm, out)
    places = {i: place for place, i in enumerate(reached)}
    states = [
        replace(
            pfsm.states[i],
            transitions=tuple(replace(t, target=places[t.target]) for _, t in _transitions(pfsm, i, out)),
        )
        for i in reached
    ]
    return Pfsm(tuple(states), pfsm.flavour, any_domain=pfsm.any_domain)


def _reached(pfsm: Pfsm, out: frozenset[Element]) -> list[int]:
    """The states that the initial one leads to without some elements."""
    found, ahead = set(), {0}
    while ahead:
        i = ahead.pop()
        found.add(i)
        ahead |= {transition.target for _, transition in _transitions(pfsm, i, out)} - found
    return sorted(found)


def _transitions(pfsm: Pfsm, i: int, out: frozenset[Element]) -> list[tuple[int, Transition]]:
    """Those of a state that are left, with their numbers."""
    return [
        (j, transition)
        for j, transition in enumerate(pfsm.states[i].transitions)
        if (i, j) not in out and (transition.target, None) not in out
    ]
