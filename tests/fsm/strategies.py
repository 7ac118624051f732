"""Random PFSMs for property tests."""

from hypothesis import strategies as st

from mercator_design.fsm.behaviours import BEHAVIOURS
from mercator_design.fsm.conditions import CONDITIONS
from mercator_design.fsm.modules import Module, numbered
from mercator_design.fsm.pfsm import FLAVOURS, MOST_STATES, MOST_TRANSITIONS, Pfsm, State, Transition


def values(module: Module) -> st.SearchStrategy[tuple[float, ...]]:
    """Parameters of a module, from their whole domains."""
    return st.tuples(
        *(
            st.integers(int(p.low), int(p.high)) if p.integer else st.floats(p.low, p.high, allow_subnormal=False)
            for p in module.parameters
        )
    )


@st.composite
def pfsms(draw, flavours=FLAVOURS):
    flavour = draw(st.sampled_from(flavours))
    behaviours = list(numbered(BEHAVIOURS, flavour).values())
    conditions = list(numbered(CONDITIONS, flavour).values())
    n = draw(st.integers(1, MOST_STATES))
    states = []
    for i in range(n):
        transitions = []
        for _ in range(draw(st.integers(0, MOST_TRANSITIONS)) if n > 1 else 0):
            condition = draw(st.sampled_from(conditions))
            target = draw(st.integers(0, n - 1).filter(lambda t, i=i: t != i))
            transitions.append(Transition(condition.name, draw(values(condition)), target))
        behaviour = draw(st.sampled_from(behaviours))
        states.append(State(behaviour.name, draw(values(behaviour)), tuple(transitions)))
    return Pfsm(tuple(states), flavour)
