from dataclasses import replace

import pytest
from hypothesis import given

from mercator_design.modules.module import KnownSwarm
from mercator_design.tree.space.grammar import Branch, tree_of
from mercator_design.tree.text import parse
from mercator_design.tree.tree import Tree, TreeNode, action, condition
from mercator_design.tree.words.difference import difference
from mercator_design.tree.words.explain import explanation
from tests.tree.maple import DATA
from tests.tree.strategies import trees

SWARM = KnownSwarm(cycle=0.1, robots=20)
RING = parse(
    "--nroot 3 --nchildroot 2 --n0 0 --nchild0 2 --n00 6 --c00 0 --p00 0.5 --n01 5 --a01 0 --rwm01 5 --p01 0 "
    "--n1 0 --nchild1 2 --n10 6 --c10 3 --p10 3 --w10 2.5 --n11 5 --a11 4 --att11 2 --p11 0"
)


def test_a_designed_tree_is_a_ring_of_branches():
    assert explanation(RING, SWARM) == (
        """\
A behaviour tree of maple of 7 nodes: 2 actions and 2 conditions among them.
There are 20 robots: each has 19 others.
In each control cycle (0.1 s) the root is ticked, and ticks its children in turn.
At most one action acts; where the root succeeds or fails, the robot stands still.
The tree is a ring of branches; a robot begins with branch 0.
It stays in a branch until a condition of it succeeds. These are tested before it acts.

Branch 0: exploration (tau 5 cycles)
  The robot drives straight on; before an obstacle it turns away for 1 to 4 cycles (at most 0.4 s).
  It goes on to branch 1 in the same cycle
    with probability 0.5 a cycle where the ground is black (after 0.2 s there, on average)
      [black floor (beta 0.5 per cycle)]

Branch 1: attraction (alpha 2)
  The robot goes to its neighbours (strength 2 of 1 to 5) and keeps away from obstacles.
  It stands still for a cycle, and begins again with branch 0,
    the more neighbours the likelier: 0.1 % with none, 8 % with 2, 50 % with 3 and 92 % with 4, in each cycle
      [neighbours count (xi 3 robots, eta 2.5)]
"""
    )


def test_a_branch_whose_action_may_fail():
    words = explanation(tree_of([Branch((condition("black floor", 0.5),), action("straight"))], "maple"), SWARM)
    assert "fails before an obstacle.\n  Where that fails, it stands still for a cycle, and begins again with" in words


def test_another_tree_is_explained_node_by_node():
    tree = Tree(TreeNode("selector*", (TreeNode("negation", (condition("light", 1.0),)), action("straight", p=0.25))))
    words = explanation(tree, KnownSwarm(cycle=0.1))
    assert words.splitlines()[3:] == [
        "",
        "root: selector*",
        "  It ticks its children from the one that was running last, until one does not fail; fails if all fail.",
        "",
        "  0: negation",
        "    It fails where its child succeeds, and succeeds where it fails.",
        "",
        "    00: condition light (beta 1 per cycle)",
        "      It succeeds at once where it perceives a light; otherwise it fails.",
        "",
        "  1: action straight, p 0.25",
        "    The robot drives straight on; in a tree it fails before an obstacle. It succeeds instead with probability "
        "0.25 a cycle.",
    ]


def test_words_know_the_slips_of_published_flavours():
    published = replace(RING, flavour="maple-mercator")
    assert "but never with more than 3: 0.1 % with none, 8 % with 2, 50 % with 3 and nearly 0 % with 4" in (
        explanation(published, SWARM)
    )
    failing = TreeNode("selector*", (condition("light", 1.0), condition("light", 1.0)))
    assert "fails if all fail" in explanation(Tree(failing), SWARM)
    assert "succeeds if all fail" in explanation(Tree(failing, "maple-epuck"), SWARM)


@pytest.mark.parametrize("published", DATA["published"], ids=lambda published: published["robot"])
def test_published_trees_are_explained(published):
    tree = parse(published["text"], f"maple-{published['robot']}")
    words = explanation(tree, SWARM)
    assert words.count("Branch ") == len(tree.root.children)
    assert all(node.name in words for _, node in tree.nodes)


STOP, BLACK = action("stop"), condition("black floor", 0.5)


@pytest.mark.parametrize(
    ("old", "new", "kind", "changes"),
    [
        ((BLACK, STOP), (BLACK, STOP), "same", []),
        (
            (BLACK, STOP),
            (condition("black floor", 0.25), STOP),
            "different",
            ["node 00, black floor: beta 0.5 -> 0.25"],
        ),
        ((BLACK, STOP), (BLACK, action("stop", p=0.5)), "different", ["node 01, stop: p 0 -> 0.5"]),
        (
            (BLACK, STOP),
            (BLACK, action("attraction", 2.0)),
            "different",
            ["node 01: action attraction (alpha 2) instead of action stop"],
        ),
        (
            (BLACK, STOP),
            (STOP,),
            "different",
            ["node 00 is gone: condition black floor (beta 0.5 per cycle)"],
        ),
        (
            (BLACK, STOP),
            (BLACK, TreeNode("negation", (BLACK,)), STOP),
            "different",
            ["node 0: new child 1: negation of (condition black floor (beta 0.5 per cycle))"],
        ),
        (
            (BLACK, condition("gray floor", 1.0), STOP),
            (condition("gray floor", 1.0), BLACK, STOP),
            "equivalent",
            [
                "node 0: new child 0: condition gray floor (beta 1 per cycle)",
                "node 01 is gone: condition gray floor (beta 1 per cycle)",
            ],
        ),
    ],
)
def test_difference(old, new, kind, changes):
    one, other = (Tree(TreeNode("sequence*", (TreeNode("selector", children),))) for children in (old, new))
    found = difference(one, other)
    assert (found.kind, [*found.changes]) == (kind, changes)


def test_difference_of_flavours_and_kinds():
    found = difference(RING, replace(RING, root=RING.root._replace(kind="sequence"), flavour="maple-epuck"))
    assert found.changes == (
        "the flavour is maple-epuck, was maple",
        "the root: sequence instead of sequence*",
    )


@given(trees(), trees())
def test_trees_differ_from_all_others(one, other):
    assert difference(one, one).kind == "same"
    found = difference(one, other)
    assert (found.kind == "same") == (one == other) == (not found.changes)
