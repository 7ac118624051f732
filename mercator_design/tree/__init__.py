"""The behaviour tree: inner nodes that choose, actions that behave, conditions that are tested.

    tree        nodes, validated; their tables
    control     one control cycle
    text        AutoMoDe's command line
    old_text    its form of 2018
    words/      trees in words
    space/      all trees of a flavour as a space of parameters, and steps from one tree to the next

Plain Python on the standard library, as it runs on the robot; the simulator compiles the same functions.
"""

from mercator_design.tree.text import parse, to_text
from mercator_design.tree.tree import Tree, TreeNode, action, condition

__all__ = ["Tree", "TreeNode", "action", "condition", "parse", "to_text"]
