"""Counts the modules of a PFSM, and removes elements from it."""

from mercator_design.fsm.pfsm import Pfsm, Transition
from mercator_design.modules.flavour import flavour_of

Element = tuple[int, int | None]
"""A state, or a transition of it, by their numbers."""


def max_modules(flavour: str) -> dict[str, int]:
    """The modules of a flavour, each with its maximum number in a PFSM."""
    known = flavour_of(flavour)
    states, transitions = known.limit("states"), known.limit("transitions")
    return {module.name: states * (1 if module.kind == "behaviour" else transitions) for module in known.modules}


def module_counts(pfsm: Pfsm) -> dict[str, int]:
    """The number of each module of its flavour in the reachable states of a PFSM."""
    counts = dict.fromkeys(max_modules(pfsm.flavour), 0)
    for _, one in without(pfsm, frozenset()).nodes:
        counts[one.module.name] += 1
    return counts


def elements(pfsm: Pfsm) -> dict[Element, str]:
    """The removable elements of a PFSM, with descriptions: all states except the initial one, and transitions."""
    found: dict[Element, str] = {
        (i, None): f"state {i} ({state.behaviour})" for i, state in enumerate(pfsm.states) if i > 0
    }
    for i, state in enumerate(pfsm.states):
        for j, transition in enumerate(state.transitions):
            found[i, j] = f"transition {i} -> {transition.target} ({transition.condition})"
    return found


def removed(pfsm: Pfsm, out: frozenset[Element]) -> frozenset[Element]:
    """Add to removed elements of a PFSM those that cannot be reached without them."""
    reached = _reached(pfsm, out)
    kept = {(i, j) for i in reached for j, _ in _transitions(pfsm, i, out)}
    return frozenset(elements(pfsm)) - {(i, None) for i in reached} - kept


def without(pfsm: Pfsm, out: frozenset[Element]) -> Pfsm:
    """Remove elements from a PFSM, and those that cannot be reached without them."""
    reached = _reached(pfsm, out)
    places = {i: place for place, i in enumerate(reached)}
    states = [
        pfsm.states[i]._replace(
            transitions=tuple(t._replace(target=places[t.target]) for _, t in _transitions(pfsm, i, out))
        )
        for i in reached
    ]
    return Pfsm(tuple(states), pfsm.flavour, any_domain=pfsm.any_domain)


def one_less(pfsm: Pfsm, out: frozenset[Element]) -> dict[frozenset[Element], str]:
    """The sets of removed elements with one more, and all that cannot be reached without it; with descriptions."""
    found: dict[frozenset[Element], str] = {}
    for element, words in elements(pfsm).items():
        if element not in out:
            found.setdefault(removed(pfsm, out | {element}), f"without {words}")
    return found


def _reached(pfsm: Pfsm, out: frozenset[Element]) -> list[int]:
    """The states that can be reached from the initial one without some elements."""
    found, waiting = set(), {0}
    while waiting:
        i = waiting.pop()
        found.add(i)
        waiting |= {transition.target for _, transition in _transitions(pfsm, i, out)} - found
    return sorted(found)


def _transitions(pfsm: Pfsm, i: int, out: frozenset[Element]) -> list[tuple[int, Transition]]:
    """The remaining transitions of a state, with their numbers."""
    return [
        (j, transition)
        for j, transition in enumerate(pfsm.states[i].transitions)
        if (i, j) not in out and (transition.target, None) not in out
    ]
