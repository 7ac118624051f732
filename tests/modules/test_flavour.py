"""Rules of flavours: constants, limits, and parameters that texts and races tell apart."""

from typing import Annotated

import pytest

from mercator_design.config.schema import Range
from mercator_design.errors import FsmError
from mercator_design.modules.flavour import flavour_from
from mercator_design.modules.module import behaviour
from mercator_design.modules.reference import drive


@pytest.mark.parametrize("name", ["neighbour_memory", "neighbour_count_memory", "ground_vote_cycles"])
def test_what_robots_remember_is_not_of_a_flavour(name):
    """The simulator makes room for it by the robot model."""
    with pytest.raises(FsmError, match=rf"constants\.{name}: expected this constant in the robot model"):
        flavour_from(f"schema: 1\nbehaviours: {{stop: 0}}\nconstants: {{{name}: 3}}\n", "own.yaml")


@pytest.mark.parametrize(("limit", "highest"), [("branches", 10), ("conditions", 9)])
def test_a_designed_tree_fits_into_a_text(limit, highest):
    text = "schema: 1\narchitecture: tree\nbehaviours: {stop: 0}\nconditions: {black floor: 0}\n"
    assert flavour_from(f"{text}limits: {{{limit}: {highest}}}\n", "own.yaml").limit(limit) == highest
    with pytest.raises(FsmError, match=rf"own.yaml:5: limits\.{limit}: expected an integer from 1 to {highest}, found"):
        flavour_from(f"{text}limits: {{{limit}: {highest + 1}}}\n", "own.yaml")


class TestParameters:
    """Names of parameters in texts and in races."""

    @pytest.fixture(autouse=True)
    def own_behaviours(self, registries):
        @behaviour()
        def wait(model, readings, memory, u, n: Annotated[float, Range(0, 1)]):
            return drive(n, n)

        @behaviour(name="go up")
        def apart(model, readings, memory, u, t: Annotated[float, Range(0, 1)]):
            return drive(1.0, t)

        @behaviour(name="goup")
        def together(model, readings, memory, u, t: Annotated[float, Range(0, 2)]):
            return drive(1.0, 0.5 * t)

        @behaviour()
        def turn2(model, readings, memory, u, t: Annotated[float, Range(0, 1)]):
            return drive(1.0, t)

        @behaviour()
        def turn3(model, readings, memory, u, t: Annotated[float, Range(0, 2)]):
            return drive(1.0, 0.5 * t)

    @pytest.mark.parametrize("architecture", ["pfsm", "tree"])
    def test_letters_that_texts_have_for_something_else(self, architecture):
        text = f"schema: 1\narchitecture: {architecture}\nbehaviours: {{wait: 0}}\nconditions: {{black floor: 0}}\n"
        expected = rf"own.yaml:3: behaviours\.wait: parameter n: texts of a {architecture} have --n for something"
        with pytest.raises(FsmError, match=expected):
            flavour_from(text, "own.yaml")

    def test_names_that_races_cannot_tell_apart(self):
        expected = r"behaviours\.goup: parameter t: the parameter t of go up is called GOUPT in races, too; call"
        with pytest.raises(FsmError, match=expected):
            flavour_from("schema: 1\nbehaviours: {go up: 0, goup: 1}\n", "own.yaml")

    def test_digits_tell_modules_apart(self):
        flavour_from("schema: 1\nbehaviours: {turn2: 0, turn3: 1}\n", "own.yaml")
