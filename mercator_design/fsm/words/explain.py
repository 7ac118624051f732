"""A PFSM in plain sentences, state by state."""

from collections.abc import Iterator, Sequence

from mercator_design.fsm.pfsm import Pfsm
from mercator_design.modules.flavour import flavour_of
from mercator_design.modules.module import KnownSwarm
from mercator_design.modules.words import module_words, robots_words, with_parameters


def explanation(pfsm: Pfsm, names: Sequence[str], swarm: KnownSwarm) -> str:
    """A description of robots with a PFSM.

    Args:
        pfsm: The PFSM.
        names: The names of its states.
        swarm: The robots; their reference model gets the constants of the flavour.
    """
    swarm = swarm._replace(model=flavour_of(pfsm.flavour).reference_model(swarm.model))
    return "\n".join(_lines(pfsm, names, swarm))


def _lines(pfsm: Pfsm, names: Sequence[str], swarm: KnownSwarm) -> Iterator[str]:
    n, m = len(pfsm.states), sum(len(state.transitions) for state in pfsm.states)
    parts = f"{_count(n, 'state')} and {_count(m, 'transition')}"
    yield f"A PFSM of {pfsm.flavour} with {parts}. Robots begin in {names[0]}."
    if swarm.robots is not None:
        yield robots_words(swarm.robots)
    yield f"In each control cycle ({swarm.cycle:g} s) a robot does what its state says."
    if m:
        yield (
            "Then, but for the first cycle of a visit, it tests the transitions of the state in random order,\n"
            "and takes the first that fires."
        )
    for i, state in enumerate(pfsm.states):
        sources = [
            names[k] for k, other in enumerate(pfsm.states) if any(edge.target == i for edge in other.transitions)
        ]
        yield f"\n{names[i]}: {with_parameters(state.module, state.parameters)}"
        yield f"  The robot {module_words(state.module, state.parameters, swarm)}."
        if i and not sources:
            yield "  No transition leads to this state: robots never are in it."
        for target in dict.fromkeys(edge.target for edge in state.transitions):
            yield f"  It changes to {names[target]}"
            for edge in state.transitions:
                if edge.target == target:
                    yield f"    {module_words(edge.module, edge.parameters, swarm)}"
                    yield f"      [{with_parameters(edge.module, edge.parameters)}]"
        if not state.transitions and n > 1:
            yield "  No transition leads out of this state: the robot stays in it to the end."
    yield ""


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'s' * (number != 1)}"
