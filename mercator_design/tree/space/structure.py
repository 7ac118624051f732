"""Moves in the structure of a designed tree, and the one tree that stands for all that are the same."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from mercator_design.modules.drawing import (
    Draws,
    Usable,
    always,
    any_of,
    drawn_values,
    firing,
    label_of,
    make_moves,
    near,
)
from mercator_design.modules.grammar import Value
from mercator_design.modules.module import Module
from mercator_design.tree.space.grammar import (
    Branch,
    from_branches,
    limits_of,
    modules_of,
    never_of,
    shape_of,
    to_branches,
    tree_of,
)
from mercator_design.tree.space.simple import simple_trees
from mercator_design.tree.tree import Tree, TreeNode, action, condition


class TreeStructure:
    """The structure of a flavour's trees, in terms of configurations of the grammar; arguments as of PfsmStructure."""

    def __init__(self, flavour: str, usable: Usable = always, can_fire: Usable = always) -> None:
        self._flavour = flavour
        self._usable = usable
        self._conditions, self._dead = firing(modules_of(flavour)[1].values(), can_fire)

    def simple(self, draws: Draws) -> list[dict[str, Value]]:
        """The configurations of simple trees, in random order."""
        return [self._configuration(one) for one in simple_trees(self._flavour, self._usable, draws)]

    def canonical(self, configuration: Mapping[str, Value]) -> dict[str, Value]:
        """The configuration that stands for all whose trees are the same but for order and what cannot fire."""
        return self._configuration(to_branches(configuration, self._flavour))

    def neighbour(self, configuration: Mapping[str, Value], draws: Draws) -> dict[str, Value]:
        """A configuration whose tree is one move or a few away, in canonical form."""
        branches = _Branches(to_branches(configuration, self._flavour), self._flavour, self._conditions, draws)
        return self._configuration(branches.moved())

    def _configuration(self, branches: Sequence[Branch]) -> dict[str, Value]:
        return from_branches(_canonical(branches, self._flavour, self._dead), self._flavour)


def canonical(tree: Tree, can_fire: Usable = always) -> Tree:
    """The same tree in a form of its own, if it has the shape of those that are designed; else the tree.

    Args:
        tree: The tree.
        can_fire: Whether a condition can fire at all, as of TreeStructure.
    """
    branches = shape_of(tree)
    if branches is None:
        return tree
    _, dead = firing(modules_of(tree.flavour)[1].values(), can_fire)
    return replace(tree, root=tree_of(_canonical(branches, tree.flavour, dead), tree.flavour).root)


def _canonical(branches: Sequence[Branch], flavour: str, dead: Collection[tuple[str, float]]) -> list[Branch]:
    """The branches with their conditions sorted, unless one has a memory, and without those that never hold.

    Their order matters to a memory: a condition behind one that holds is not tested, and so remembers nothing.
    A branch that never ends has the one condition that stands for all such, and is the last: none behind it is reached.
    """
    found = []
    for branch in branches:
        holding = [
            node
            for node in branch.conditions
            if _may_hold(node) and (node.name, label_of(node.module, node.parameters)) not in dead
        ]
        if not holding:
            found.append(Branch((never_of(flavour) or min(branch.conditions),), branch.action))
            break
        has_memory = any(node.module.memory for node in holding)
        found.append(Branch(tuple(holding if has_memory else sorted(holding)), branch.action))
    return found


class _Branches:
    """Branches of a tree that are being changed. A move returns whether it was possible.

    Args:
        branches: Of the tree.
        flavour: Of its behaviours.
        conditions: What new conditions are drawn from.
        draws: Makes all random draws.
    """

    def __init__(self, branches: Sequence[Branch], flavour: str, conditions: Sequence[Module], draws: Draws) -> None:
        self.branches = [*branches]
        self._draws = draws
        self._behaviours = tuple(modules_of(flavour)[0].values())
        self._conditions = conditions
        self._max_branches, self._max_conditions = limits_of(flavour)

    def moved(self) -> list[Branch]:
        """The branches after a move, or with decreasing probability more."""
        often = (self.tune,) * 4 + (self.change_action, self.change_condition) * 2
        moves = (
            *often,
            self.add_condition,
            self.drop_condition,
            self.add_branch,
            self.split_branch,
            self.drop_branch,
            self.swap_branches,
        )
        make_moves(moves, self._draws)
        return self.branches

    def tune(self) -> bool:
        """Another value of a parameter."""
        places = [
            (i, j, k)
            for i, branch in enumerate(self.branches)
            for j, node in enumerate((*branch.conditions, branch.action))
            for k in range(len(node.parameters))
        ]
        if not places:
            return False
        i, j, k = any_of(places, self._draws)
        node = (*self.branches[i].conditions, self.branches[i].action)[j]
        value = near(node.module.parameters[k], node.parameters[k], self._draws)
        self._put(i, j, node._replace(parameters=(*node.parameters[:k], value, *node.parameters[k + 1 :])))
        return True

    def change_action(self) -> bool:
        i = any_of(range(len(self.branches)), self._draws)
        others = [one for one in self._behaviours if one.name != self.branches[i].action.name]
        if not others:
            return False
        self.branches[i] = self.branches[i]._replace(action=self._action(others))
        return True

    def change_condition(self) -> bool:
        i = any_of(range(len(self.branches)), self._draws)
        j = any_of(range(len(self.branches[i].conditions)), self._draws)
        others = [one for one in self._conditions if one.name != self.branches[i].conditions[j].name]
        if not others:
            return False
        self._put(i, j, self._condition(others))
        return True

    def add_condition(self) -> bool:
        i = any_of(range(len(self.branches)), self._draws)
        if len(self.branches[i].conditions) == self._max_conditions or not self._conditions:
            return False
        conditions = (*self.branches[i].conditions, self._condition(self._conditions))
        self.branches[i] = self.branches[i]._replace(conditions=conditions)
        return True

    def drop_condition(self) -> bool:
        """The grammar has one at least in each branch."""
        i = any_of(range(len(self.branches)), self._draws)
        conditions = self.branches[i].conditions
        if len(conditions) == 1:
            return False
        j = any_of(range(len(conditions)), self._draws)
        self.branches[i] = self.branches[i]._replace(conditions=conditions[:j] + conditions[j + 1 :])
        return True

    def add_branch(self) -> bool:
        """A new branch anywhere. If the one before never ended, it gets a new condition, too."""
        if len(self.branches) == self._max_branches or not self._conditions:
            return False
        new = Branch((self._condition(self._conditions),), self._action(self._behaviours))
        self._insert(any_of(range(len(self.branches) + 1), self._draws), new)
        return True

    def split_branch(self) -> bool:
        """A branch twice, so that both copies can change."""
        if len(self.branches) == self._max_branches or not self._conditions:
            return False
        i = any_of(range(len(self.branches)), self._draws)
        self._insert(i + 1, self.branches[i])
        return True

    def drop_branch(self) -> bool:
        if len(self.branches) == 1:
            return False
        del self.branches[any_of(range(len(self.branches)), self._draws)]
        return True

    def swap_branches(self) -> bool:
        if len(self.branches) == 1:
            return False
        i = any_of(range(len(self.branches)), self._draws)
        k = any_of([k for k in range(len(self.branches)) if k != i], self._draws)
        self.branches[i], self.branches[k] = self.branches[k], self.branches[i]
        return True

    def _insert(self, i: int, branch: Branch) -> None:
        """Insert a branch, and let the one before end, which may be the last one because it never did."""
        self.branches.insert(i, branch)
        if i > 0 and not any(map(_may_hold, self.branches[i - 1].conditions)):
            self.branches[i - 1] = self.branches[i - 1]._replace(conditions=(self._condition(self._conditions),))

    def _condition(self, some: Sequence[Module]) -> TreeNode:
        module = any_of(some, self._draws)
        return condition(module.name, *drawn_values(module, self._draws))

    def _action(self, some: Sequence[Module]) -> TreeNode:
        module = any_of(some, self._draws)
        return action(module.name, *drawn_values(module, self._draws))

    def _put(self, i: int, j: int, node: TreeNode) -> None:
        branch = self.branches[i]
        if j == len(branch.conditions):
            self.branches[i] = branch._replace(action=node)
        else:
            conditions = (*branch.conditions[:j], node, *branch.conditions[j + 1 :])
            self.branches[i] = branch._replace(conditions=conditions)


def _may_hold(node: TreeNode) -> bool:
    return not node.module.has_beta or node.parameters[0] > 0.0
