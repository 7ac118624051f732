from dataclasses import replace
from typing import Annotated

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mercator_design.config.schema import FieldError, Range
from mercator_design.errors import FsmError
from mercator_design.modules.flavour import define_flavour, flavour_of
from mercator_design.modules.module import condition as in_conditions
from mercator_design.tree.old_text import parse_old
from mercator_design.tree.space.grammar import branches_of, from_tree, parameters_of, shape_of, to_tree, tree_of
from mercator_design.tree.space.structure import TreeStructure, canonical
from mercator_design.tree.text import parse, to_text
from mercator_design.tree.tree import Tree, TreeNode, action, condition
from tests.tree.maple import DATA
from tests.tree.strategies import designed_trees, trees

STRUCTURE = TreeStructure("maple")
STOP = action("stop")
BLACK, GRAY, NEVER = condition("black floor", 0.5), condition("gray floor", 0.5), condition("fixed probability", 0.0)


def tree(*branches):
    return Tree(TreeNode("sequence*", tuple(TreeNode("selector", branch) for branch in branches)))


def test_the_published_space_has_41_parameters_and_with_two_conditions_69(own_flavour):
    assert len([*parameters_of("maple")]) == 41
    own_flavour("two-conditions", limits={"branches": 4, "conditions": 2})
    assert len([*parameters_of("two-conditions")]) == 69


def test_parameters_are_those_that_were_published():
    found = {one.name: one for one in parameters_of("maple")}
    assert (found["NumBranches"].low, found["NumBranches"].high) == (1, 4)
    assert found["C3x0"].values == found["A3"].values == tuple("012345")
    assert found["C3x0"].condition == ("NumBranches", range(4, 5))
    assert (found["P0x0"].low, found["P0x0"].high, found["P0x0"].digits) == (0, 1, 2)
    assert found["P0x0"].condition == ("C0x0", ("0", "1", "2", "5"))
    assert (found["B0x0"].low, found["B0x0"].high, found["B0x0"].digits) == (1, 10, 0)
    assert (found["WI0x0"].low, found["WI0x0"].high, found["WI0x0"].condition) == (0, 20, ("C0x0", ("4",)))
    assert (found["RWM0"].low, found["RWM0"].high, found["RWM0"].digits) == (1, 100, 0)
    assert (found["ATT0"].low, found["REP0"].high, found["REP0"].condition) == (1, 5, ("A0", ("5",)))


@pytest.mark.parametrize("published", DATA["published"], ids=lambda published: published["robot"])
def test_published_trees_are_configurations(published, own_flavour):
    own_flavour("two-conditions", limits={"branches": 4, "conditions": 2})
    found = parse(published["text"], "two-conditions")
    assert to_tree(from_tree(found), "two-conditions") == found


@given(designed_trees())
def test_configurations_both_ways(found):
    configuration = from_tree(found)
    assert to_tree(configuration, "maple") == found
    active = {one.name for one in parameters_of("maple") if one.condition is None or is_active(one, configuration)}
    assert configuration.keys() == active


def is_active(parameter, configuration):
    name, values = parameter.condition
    return configuration.get(name) in values


LIMITS = [(4, 1), (4, 2), (1, 1), (1, 3), (2, 2)]


@pytest.mark.parametrize(("branches", "conditions"), LIMITS)
def test_switches_and_values_are_a_text_of_2018(branches, conditions, own_flavour):
    flavour = f"limits-{branches}-{conditions}"
    own_flavour(flavour, limits={"branches": branches, "conditions": conditions})
    structure = TreeStructure(flavour)
    draws = np.random.default_rng(1)
    configuration = structure.simple(draws)[0]
    for _ in range(200):
        configuration = structure.neighbour(configuration, draws)
        written = [
            f"{one.switch}{configuration[one.name]}" for one in parameters_of(flavour) if one.name in configuration
        ]
        assert parse_old(" ".join(written), flavour) == to_tree(configuration, flavour)
        assert len(configuration) >= len(written) > 0


@pytest.mark.parametrize(
    ("found", "message"),
    [
        (
            Tree(TreeNode("sequence", (TreeNode("selector", (BLACK, STOP)),))),
            "the root: maple designs a sequence. of branches",
        ),
        (tree((BLACK, action("stop", p=0.5))), "the root: maple designs .* p = 0; this tree has another shape"),
        (tree((STOP, BLACK)), "the root: maple designs"),
        (tree((STOP,)), "the root: maple designs"),
        (tree(*[(BLACK, STOP)] * 5), "the root: maple designs 1 to 4 branches, found 5"),
        (tree((BLACK, STOP), (BLACK, GRAY, STOP)), "node 1: maple designs 1 to 1 conditions, found 2"),
        (tree((condition("light", 0.5), STOP)), "node 00: maple does not design with light"),
        (tree((BLACK, action("curve", 1.0))), "node 01: maple does not design with curve"),
    ],
)
def test_trees_of_another_shape_are_no_configurations(found, message):
    with pytest.raises(FsmError, match=f"^{message}"):
        from_tree(found)


def test_simple_trees_have_each_behaviour_alone_and_each_condition_with_each_other_behaviour():
    found = [to_tree(one, "maple") for one in STRUCTURE.simple(np.random.default_rng(3))]
    alone = [branches_of(one)[0] for one in found if len(branches_of(one)) == 1]
    assert {branch.action.name for branch in alone} == {
        "exploration", "stop", "phototaxis", "anti-phototaxis", "attraction", "repulsion",
    }  # fmt: skip
    assert {branch.conditions for branch in alone} == {(NEVER,)}
    pairs = [branches_of(one) for one in found if len(branches_of(one)) == 2]
    assert len(found) == 6 + 6 * 5 == len({*found})
    assert {(first.conditions[0].name, second.action.name) for first, second in pairs} == {
        (module, behaviour)
        for module in ("black floor", "gray floor", "white floor", "neighbours count", "inverted neighbours count",
                       "fixed probability")
        for behaviour in ("stop", "phototaxis", "anti-phototaxis", "attraction", "repulsion")
    }  # fmt: skip
    assert all(first.action.name == "exploration" for first, _ in pairs)


def test_simple_trees_have_what_is_of_use_on_a_mission():
    structure = TreeStructure("maple", usable=lambda module, _: "light" not in module.reads and module.name != "stop")
    found = [to_text(to_tree(one, "maple")) for one in structure.simple(np.random.default_rng(3))]
    assert not any(action in text for text in found for action in ("--a01 1", "--a01 2", "--a11 2", "--a11 3"))


class TestCanonicalForm:
    def test_conditions_of_a_branch_are_sorted(self):
        assert canonical(tree((GRAY, BLACK, STOP))) == canonical(tree((BLACK, GRAY, STOP)))

    @pytest.mark.usefixtures("registries")
    def test_conditions_with_a_memory_keep_their_order(self):
        @in_conditions(memory=1)
        def later(model, readings, memory, beta: Annotated[float, Range(0, 1)]):
            memory[0] += 1.0
            return beta if memory[0] > 9.0 else 0.0

        text = "schema: 1\narchitecture: tree\nbehaviours: {stop: 0}\nconditions: {later: 0, black floor: 1}\n"
        define_flavour(text, "remembering")
        for tested in ((condition("later", 0.5), BLACK), (BLACK, condition("later", 0.5))):
            found = Tree(TreeNode("sequence*", (TreeNode("selector", (*tested, STOP)),)), "remembering")
            assert canonical(found) == found

    def test_a_condition_that_never_holds_is_dropped(self):
        assert canonical(tree((NEVER, BLACK, STOP))) == tree((BLACK, STOP))

    def test_nothing_is_reached_behind_a_branch_that_never_ends(self):
        never_black = condition("black floor", 0.0)
        found = canonical(tree((BLACK, STOP), (never_black, STOP), (GRAY, STOP)))
        assert found == tree((BLACK, STOP), (NEVER, STOP))

    def test_the_order_of_branches_stays_as_robots_begin_with_the_first(self):
        found = tree((GRAY, STOP), (BLACK, action("exploration", 3.0)))
        assert canonical(found) == found

    def test_conditions_that_cannot_fire_on_a_mission(self):
        structure = TreeStructure("maple", can_fire=lambda module, _: module.name != "black floor")
        found = structure.canonical(from_tree(tree((GRAY, STOP), (BLACK, STOP), (GRAY, STOP))))
        assert to_tree(found, "maple") == tree((GRAY, STOP), (NEVER, STOP))
        draws = np.random.default_rng(2)
        for _ in range(300):
            found = structure.neighbour(found, draws)
            assert "black floor" not in {node.name for _, node in to_tree(found, "maple").nodes}

    @given(trees())
    def test_other_trees_are_as_they_are(self, found):
        assert canonical(found) == (found if shape_of(found) is None else canonical(canonical(found)))

    @given(designed_trees())
    def test_it_is_its_own(self, found):
        assert canonical(canonical(found)) == canonical(found)


@given(designed_trees(), st.integers(0, 2**32))
def test_neighbours_are_other_canonical_trees_of_the_grammar(found, seed):
    draws = np.random.default_rng(seed)
    grid = replace(found, root=on_grid(found.root))
    moved = STRUCTURE.neighbour(from_tree(grid), draws)
    assert STRUCTURE.canonical(moved) == moved
    assert from_tree(parse(to_text(to_tree(moved, "maple")))) == moved


def on_grid(node):
    """A node whose parameters are within the sampled domain."""
    if not node.is_leaf:
        return node._replace(children=tuple(map(on_grid, node.children)))
    bounds = [one.sampled for one in node.module.parameters]
    values = tuple(max(low, value) for (low, _), value in zip(bounds, node.parameters, strict=True))
    return node._replace(parameters=values)


def test_moves_reach_every_number_of_branches_and_every_module():
    draws = np.random.default_rng(5)
    configuration = STRUCTURE.simple(draws)[0]
    sizes, names = set(), set()
    for _ in range(1500):
        configuration = STRUCTURE.neighbour(configuration, draws)
        found = to_tree(configuration, "maple")
        sizes.add(len(branches_of(found)))
        names |= {node.name for _, node in found.nodes}
    assert sizes == {1, 2, 3, 4}
    assert len(names) == 12


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"conditions": {}, "not_designed": ()}, "conditions: expected one condition at least that trees are designed"),
        ({"not_designed": ("stop", "jump")}, r"not_designed\[1\]: expected a behaviour or a condition .* found 'jump'"),
        ({"not_designed": tuple(flavour_of("maple").behaviours)}, "not_designed: expected one behaviour at least"),
        ({"architecture": "pfsm", "limits": {}}, "not_designed: expected none: only trees"),
        ({"behaviours": None}, r"not_designed\[0\]: expected a behaviour or a condition of this flavour"),
        ({"limits": {"states": 4}}, "limits.states: expected one of branches, conditions"),
    ],
)
def test_flavours_that_nothing_can_be_designed_with_are_refused(own_flavour, changes, message):
    with pytest.raises(FieldError, match=message):
        own_flavour("wrong", **changes)


def test_tree_of_branches():
    found = tree((BLACK, STOP), (GRAY, STOP))
    assert tree_of(branches_of(found), "maple") == found
