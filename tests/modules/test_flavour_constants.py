"""Constants of the reference model in flavours."""

import pytest

from mercator_design.errors import FsmError
from mercator_design.modules.flavour import flavour_from


@pytest.mark.parametrize("name", ["neighbour_memory", "neighbour_count_memory", "ground_vote_cycles"])
def test_what_robots_remember_is_not_of_a_flavour(name):
    """The simulator makes room for it by the robot model."""
    with pytest.raises(FsmError, match=rf"constants\.{name}: expected this constant in the robot model"):
        flavour_from(f"schema: 1\nbehaviours: {{stop: 0}}\nconstants: {{{name}: 3}}\n", "own.yaml")
