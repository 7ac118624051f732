"""Behaviour trees do what the original classes do, cycle by cycle, in plain Python and compiled."""

import numpy as np
import pytest

from mercator_design.jit import compiled
from mercator_design.modules.flavour import flavour_of
from mercator_design.modules.perception import new_row
from mercator_design.modules.reference import ACTIONS, Readings, ReferenceModel
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.tree.control import ACTING, FAILURE, RUNNING, STATUSES, SUCCESS, tree_cycle
from mercator_design.tree.old_text import parse_old
from mercator_design.tree.text import parse, to_text
from mercator_design.tree.tree import TreeProgram
from tests.tree.maple import DATA

STATUS_NAMES = {RUNNING: "running", SUCCESS: "success", FAILURE: "failure"}
ROBOTS = {"maple-epuck": "epuck", "maple-mercator": "mercator-chocolate"}


def model_of(name):
    """The reference model of a vector: the robot's, with the constants of the flavour."""
    flavour = name.removesuffix("-intended")
    model = flavour_of(flavour).reference_model(load_robot_model(ROBOTS[flavour]).reference_model)
    return flavour, model._replace(count_wraps=0.0) if name.endswith("-intended") else model


def run(vector, cycle, row, program_form):
    """Whether status, ticked nodes, acting node and wheels are those of a vector, in each of its cycles."""
    flavour, model = model_of(vector["model"])
    tree = parse(vector["tree"], flavour)
    program, identifiers = program_form(tree.program()), [identifier for identifier, _ in tree.preorder]
    memory, actions = row(tree.program().memory), row(ACTIONS)
    for step in vector["steps"]:
        readings = Readings(*map(float, step["readings"]))
        cycle(model, program, readings, memory, np.array(step["draws"]), actions)
        assert [actions[0], actions[1]] == pytest.approx(step["wheels"], abs=1e-9)
        assert STATUS_NAMES[memory[STATUSES]] == step["status"]
        statuses = memory[STATUSES : STATUSES + len(identifiers)]
        visited = [each or "root" for each, status in zip(identifiers, statuses, strict=True) if status]
        assert visited == step["visited"]
        assert (identifiers[int(memory[ACTING])] or None) == step["acted"]


@pytest.mark.parametrize("vector", DATA["vectors"], ids=lambda vector: vector["model"])
def test_plain(vector):
    run(vector, tree_cycle, new_row, lambda program: program)


def fast_cycle(model, program, readings, memory, draws, actions):
    """An entry to the kernel, compiled as the engine is."""
    tree_cycle(model, program, readings, memory, draws, actions)


def arrays(program):
    kinds = {"parameters": np.float64}
    return TreeProgram(*(np.array(row, kinds.get(name, np.int64)) for name, row in program._asdict().items()))


@pytest.mark.together("parity")
def test_compiled():
    for vector in DATA["vectors"]:
        run(vector, compiled(fast_cycle), np.zeros, arrays)


@pytest.mark.parametrize("published", DATA["published"], ids=lambda published: published["robot"])
def test_published_trees_are_read_and_written_without_loss(published):
    tree = parse(published["text"])

    def pairs(text):
        tokens = text.split()
        return {flag: float(value) for flag, value in zip(tokens[::2], tokens[1::2], strict=True)}

    assert pairs(to_text(tree)) == pairs(published["text"])
    assert parse(to_text(tree)) == tree
    if "original_text" in published:
        assert parse_old(published["original_text"]) == tree


def test_the_constants_of_published_flavours_are_those_of_the_original():
    _, epuck = model_of("maple-epuck")
    _, mercator = model_of("maple-mercator")
    own = ReferenceModel()
    assert (epuck.obstacle_threshold, epuck.slowest_wheel, epuck.repulsion_power) == (0.5, -0.5, 1.0)
    assert (mercator.obstacle_threshold, mercator.slowest_wheel, mercator.repulsion_power) == (0.1, -1.0, 2.0)
    for model in (epuck, mercator):
        assert (model.strength_step, model.attraction_gain, model.attraction_obstacle_gain) == (1.0, 1.0, 6.0)
        assert (model.count_wraps, model.starred_selector_succeeds) == (1.0, 1.0)
    assert flavour_of("maple").reference_model(own) == own
