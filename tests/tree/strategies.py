"""Random trees for property tests."""

from hypothesis import strategies as st

from mercator_design.modules.flavour import flavour_of
from mercator_design.tree.space.grammar import Branch, limits_of, modules_of, tree_of
from mercator_design.tree.tree import Tree, TreeNode
from tests.fsm.strategies import values

INNER = ["selector", "selector*", "sequence", "sequence*"]


@st.composite
def leaves(draw, flavour="maple"):
    kind = draw(st.sampled_from(["behaviour", "condition"]))
    module = draw(st.sampled_from([*flavour_of(flavour).numbered(kind).values()]))
    parameters = tuple(map(float, draw(values(module))))
    if kind == "condition":
        return TreeNode("condition", (), module.name, parameters)
    return TreeNode("action", (), module.name, parameters, draw(st.sampled_from([0.0, 1.0]) | st.floats(0, 1)))


@st.composite
def nodes(draw, depth=3):
    if depth == 0 or draw(st.booleans()):
        return draw(leaves())
    return draw(inner_nodes(depth))


@st.composite
def inner_nodes(draw, depth=3):
    kind = draw(st.sampled_from([*INNER, "negation"]))
    n = 1 if kind == "negation" else draw(st.integers(1, 3))
    return TreeNode(kind, tuple(draw(nodes(depth - 1)) for _ in range(n)))


def trees():
    """Trees of any shape."""
    return inner_nodes().map(Tree)


@st.composite
def designed_trees(draw, flavour="maple"):
    """Trees of the shape of those that are designed."""
    behaviours, conditions = modules_of(flavour)
    max_branches, max_conditions = limits_of(flavour)

    def leaf(kind, modules):
        module = draw(st.sampled_from([*modules.values()]))
        return TreeNode(kind, (), module.name, tuple(map(float, draw(values(module)))))

    branches = []
    for _ in range(draw(st.integers(1, max_branches))):
        tested = tuple(leaf("condition", conditions) for _ in range(draw(st.integers(1, max_conditions))))
        branches.append(Branch(tested, leaf("action", behaviours)))
    return tree_of(branches, flavour)
