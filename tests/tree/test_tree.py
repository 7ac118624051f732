import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mercator_design.errors import FsmError
from mercator_design.jit import compiled
from mercator_design.modules.perception import new_row
from mercator_design.modules.reference import ACTIONS, ReferenceModel
from mercator_design.tree.control import tree_cycle
from mercator_design.tree.text import parse, to_text
from mercator_design.tree.tree import MAX_DEPTH, Tree, TreeNode, action, condition
from tests.fsm.strategies import DRAW, READINGS
from tests.tree.strategies import trees
from tests.tree.test_vectors import arrays, fast_cycle

STOP = action("stop")


def chain(depth):
    """A leaf that many levels below the root."""
    node = STOP
    for _ in range(depth):
        node = TreeNode("selector", (node,))
    return node


@pytest.mark.parametrize(
    ("root", "message"),
    [
        (STOP, "the root: expected one of selector, .*, negation, found 'action'"),
        (TreeNode("parallel", (STOP,)), "the root: expected one of selector, .*, found 'parallel'"),
        (TreeNode("selector"), "the root: a selector has 1 to 10 children, found 0"),
        (TreeNode("sequence", (STOP,) * 11), "the root: a sequence has 1 to 10 children, found 11"),
        (TreeNode("selector", (STOP, TreeNode("negation", (STOP, STOP)))), "node 1: a negation has one child, found 2"),
        (
            TreeNode("selector", (TreeNode("selector", (action("jump"),)),)),
            "node 00: maple has no behaviour 'jump'; it has",
        ),
        (TreeNode("selector", (condition("stop"),)), "node 0: maple has no condition 'stop'; it has black floor"),
        (
            TreeNode("selector", (STOP._replace(children=(STOP,)),)),
            "node 0: expected no children of action stop, found 1",
        ),
        (TreeNode("selector", (action("exploration"),)), "node 0: exploration takes 1 parameters, found 0"),
        (TreeNode("selector", (action("stop", 1.0),)), "node 0: stop takes 0 parameters, found 1"),
        (
            TreeNode("selector", (action("attraction", 9.0),)),
            "node 0: parameter alpha of attraction must be a number from 1",
        ),
        (TreeNode("selector", (action("attraction", float("nan")),)), "node 0: parameter alpha .* found nan"),
        (TreeNode("selector", (action("stop", p=1.5),)), "node 0: parameter p of stop must be a number from 0 to 1"),
        (TreeNode("selector", (condition("black floor", 0.5)._replace(p=0.5),)), "node 0: only an action has a probab"),
        (TreeNode("selector", (STOP,), "stop"), "the root: a selector has no behaviour, condition or parameters"),
        (chain(MAX_DEPTH + 1), "node 000000: expected at most 5 levels below the root"),
        (chain(5000), "node 000000: expected at most 5 levels below the root"),
    ],
)
def test_invalid_trees_are_refused(root, message):
    with pytest.raises(FsmError, match=f"^{message}"):
        Tree(root)


def test_the_deepest_and_widest_trees_are_valid():
    assert len(to_text(Tree(chain(MAX_DEPTH))).split("--n00000 ")) == 2
    assert Tree(TreeNode("selector", (STOP,) * 10)).draws == 12


@given(trees())
def test_trees_are_values(tree):
    assert parse(to_text(tree)) == tree
    assert pickle.loads(pickle.dumps(tree)) == tree  # noqa: S301 - our own
    assert {tree: 1}[Tree(tree.root)] == 1
    assert repr(tree) == f"<Tree: {tree.summary}>"


def test_summary():
    tree = Tree(TreeNode("selector", (condition("black floor", 0.5), STOP, action("exploration", 5.0))))
    assert tree.summary == "maple, 4 nodes (actions: stop, exploration), 1 condition"


def test_nodes_are_the_modules_with_their_places():
    tree = Tree(TreeNode("selector", (condition("black floor", 0.5), TreeNode("negation", (STOP,)))))
    assert [(place, node.module.name) for place, node in tree.nodes] == [("node 0", "black floor"), ("node 10", "stop")]


MODELS = st.sampled_from(
    [ReferenceModel(), ReferenceModel(count_wraps=1.0, starred_selector_succeeds=1.0, slowest_wheel=-0.5)]
)


@pytest.mark.together("parity")
@settings(max_examples=60, deadline=None)
@given(trees(), st.lists(READINGS, min_size=1, max_size=5), MODELS, st.data())
def test_plain_and_compiled_are_the_same(tree, cycles, model, data):
    program = tree.program()
    plain_memory, plain_actions = new_row(program.memory), new_row(ACTIONS)
    memory, actions = np.zeros(program.memory), np.zeros(ACTIONS)
    for readings in cycles:
        draws = data.draw(st.lists(DRAW, min_size=tree.draws, max_size=tree.draws))
        tree_cycle(model, program, readings, plain_memory, draws, plain_actions)
        compiled(fast_cycle)(model, arrays(program), readings, memory, np.array(draws), actions)
        assert memory.tolist() == list(plain_memory)
        assert actions.tolist() == list(plain_actions)
        assert all(-1.0 <= wheel <= 1.0 for wheel in plain_actions[:2])
