"""The names of states."""

import re
from collections import Counter

from mercator_design.fsm.pfsm import Pfsm

STATE_NAME = r"\w([\w .+-]{0,38}\w)?"
"""What a name of a state may be, as a regular expression; it has no comma."""


def is_state_name(text: str) -> bool:
    return re.fullmatch(STATE_NAME, text) is not None


def state_names(pfsm: Pfsm) -> tuple[str, ...]:
    """A name for each state: its behaviour, with a number if several states have it."""
    behaviours = [state.behaviour for state in pfsm.states]
    several = Counter(behaviours)
    return tuple(
        f"{name} {behaviours[: i + 1].count(name)}" if several[name] > 1 else name for i, name in enumerate(behaviours)
    )
