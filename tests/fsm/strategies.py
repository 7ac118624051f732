"""Random PFSMs, readings and draws for property tests."""

import re

from hypothesis import strategies as st

from mercator_design.fsm.pfsm import Pfsm, State, Transition
from mercator_design.modules.flavour import flavour_of
from mercator_design.modules.module import Module
from mercator_design.modules.reference import Readings

FLAVOURS = ("watermelon", "chocolate")
MAX_STATES = MAX_TRANSITIONS = 4
DRAWS = 1 + 2 * MAX_TRANSITIONS

CHANNEL = st.one_of(st.integers(0, 255).map(float), st.floats(0, 255))
READINGS = st.builds(
    Readings,
    proximity_x=st.floats(-1, 1),
    proximity_y=st.floats(-1, 1),
    neighbours=st.integers(0, 1000).map(float),
    neighbours_x=st.floats(-1000, 1000),
    neighbours_y=st.floats(-1000, 1000),
    ground_red=CHANNEL,
    ground_green=CHANNEL,
    ground_blue=CHANNEL,
    light_x=st.floats(-1, 1),
    light_y=st.floats(-1, 1),
)
DRAW = st.floats(0, 1, exclude_max=True)
WORD = st.sampled_from("aZ9_") | st.sampled_from(re.findall(r"\w", "".join(map(chr, range(0x3100)))))
"""A character of a word; `from_regex` would look through all of Unicode first, which takes seconds."""
OF_NAME = WORD | st.sampled_from(" .+-")


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
    behaviours = list(flavour_of(flavour).numbered("behaviour").values())
    conditions = list(flavour_of(flavour).numbered("condition").values())
    n = draw(st.integers(1, MAX_STATES))
    states = []
    for i in range(n):
        transitions = []
        for _ in range(draw(st.integers(0, MAX_TRANSITIONS)) if n > 1 else 0):
            condition = draw(st.sampled_from(conditions))
            target = draw(st.integers(0, n - 1).filter(lambda t, i=i: t != i))
            transitions.append(Transition(condition.name, draw(values(condition)), target))
        behaviour = draw(st.sampled_from(behaviours))
        states.append(State(behaviour.name, draw(values(behaviour)), tuple(transitions)))
    return Pfsm(tuple(states), flavour)
