"""The trees that are designed, as a space of parameters.

They have the shape of AutoMoDe-Maple: the root is a sequence*, each of its children, a *branch*, is a selector of some
conditions and then an action that never succeeds. So the robot does what the action of a branch says until a condition
of the branch succeeds. The grammar has the number of branches, and for each its conditions, its action and the
parameters of the modules chosen. Switches are those of the form of 2018 (old_text.py).
"""

import functools
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from mercator_design.errors import FsmError
from mercator_design.modules.flavour import flavour_of
from mercator_design.modules.grammar import Chosen, GrammarParameter, Value, choices, module_parameters, numbers_text
from mercator_design.modules.module import Module
from mercator_design.plugins.registries import by_entries
from mercator_design.tree.tree import Tree, TreeNode, action, condition, place_of


class Branch(NamedTuple):
    """A child of the root: leaves that are conditions, and one that is an action."""

    conditions: tuple[TreeNode, ...]
    action: TreeNode


class _BranchNames(NamedTuple):
    """Names of a branch's parameters, with its modules by number and by name."""

    number: str  # of conditions
    conditions: tuple[tuple[str, Mapping[str, Chosen], Mapping[str, Chosen]], ...]
    action: tuple[str, Mapping[str, Chosen], Mapping[str, Chosen]]


def parameters_of(flavour: str) -> Iterator[GrammarParameter]:
    """The grammar of a flavour; numbers with one value are none of its parameters. Maple has 41 parameters."""
    behaviours, conditions = modules_of(flavour)
    max_branches, max_conditions = limits_of(flavour)
    before = "--rootnode 0 --nchildsroot "  # text that is still to be written before the next value
    if max_branches > 1:
        yield GrammarParameter("NumBranches", before, low=1, high=max_branches)
        before = ""
    else:
        before += "1 "
    for i in range(max_branches):
        exists = ("NumBranches", range(i + 1, max_branches + 1)) if max_branches > 1 else None
        before += f"--n{i} 0 --nc{i} "
        number = f"NumConditions{i}"
        if max_conditions > 1:
            yield GrammarParameter(number, before, low=1, high=max_conditions, condition=exists)
            before = ""
        else:
            before += "1 "
        for j in range(max_conditions):
            place, active = f"{i}x{j}", (number, range(j + 1, max_conditions + 1)) if max_conditions > 1 else exists
            switch = f"{before}--c{place} "
            yield GrammarParameter(f"C{place}", switch, values=numbers_text(conditions), condition=active)
            yield from module_parameters(conditions, place, f"C{place}")
            before = ""
        yield GrammarParameter(f"A{i}", f"--a{i} ", values=numbers_text(behaviours), condition=exists)
        yield from module_parameters(behaviours, f"{i}", f"A{i}")


def module_of(parameter: str, number: str, flavour: str) -> Module:
    """The module that a category of the grammar stands for: a behaviour of A0, a condition of C0x0."""
    return modules_of(flavour)[0 if parameter.startswith("A") else 1][int(number)]


def to_tree(configuration: Mapping[str, Value], flavour: str) -> Tree:
    """The tree of a configuration: a value for each active parameter of the grammar."""
    return tree_of(to_branches(configuration, flavour), flavour)


def from_tree(tree: Tree) -> dict[str, Value]:
    """The configuration of a tree; the inverse of `to_tree`.

    Raises:
        FsmError: The tree has not the shape of those that are designed, or more branches or conditions.
    """
    return from_branches(branches_of(tree), tree.flavour)


def tree_of(branches: Sequence[Branch], flavour: str) -> Tree:
    """The tree of some branches."""
    children = tuple(TreeNode("selector", (*branch.conditions, branch.action)) for branch in branches)
    return Tree(TreeNode("sequence*", children), flavour)


def branches_of(tree: Tree) -> tuple[Branch, ...]:
    """The branches of a tree.

    Raises:
        FsmError: as `from_tree`.
    """
    branches = shape_of(tree)
    if branches is None:
        raise FsmError(
            f"the root: {tree.flavour} designs a sequence* of branches, each a selector of conditions and an action "
            "with p = 0; this tree has another shape"
        )
    max_branches, max_conditions = limits_of(tree.flavour)
    if len(branches) > max_branches:
        raise FsmError(f"the root: {tree.flavour} designs 1 to {max_branches} branches, found {len(branches)}")
    for i, branch in enumerate(branches):
        if len(branch.conditions) > max_conditions:
            n = len(branch.conditions)
            raise FsmError(f"{place_of(str(i))}: {tree.flavour} designs 1 to {max_conditions} conditions, found {n}")
        for j, node in enumerate((*branch.conditions, branch.action)):
            if node.name in flavour_of(tree.flavour).not_designed:
                raise FsmError(f"{place_of(f'{i}{j}')}: {tree.flavour} does not design with {node.name}")
    return branches


def shape_of(tree: Tree) -> tuple[Branch, ...] | None:
    """The branches of a tree, if it has the shape of those that are designed, whatever their number."""
    found = []
    for branch in tree.root.children:
        *tested, acting = branch.children or (branch,)
        is_branch = branch.kind == "selector" and bool(tested) and all(node.kind == "condition" for node in tested)
        if not is_branch or acting.kind != "action" or acting.p != 0.0:
            return None
        found.append(Branch(tuple(tested), acting))
    return tuple(found) if found and tree.root.kind == "sequence*" else None


def to_branches(configuration: Mapping[str, Value], flavour: str) -> tuple[Branch, ...]:
    """The branches of a configuration's tree, without the checks of `Tree`."""
    branches = []
    for names in _names(flavour)[: int(configuration.get("NumBranches", 1))]:
        conditions = []
        for name, by_number, _ in names.conditions[: int(configuration.get(names.number, 1))]:
            chosen = by_number[str(configuration[name])]
            conditions.append(condition(chosen.name, *chosen.values(configuration)))
        name, by_number, _ = names.action
        chosen = by_number[str(configuration[name])]
        branches.append(Branch(tuple(conditions), action(chosen.name, *chosen.values(configuration))))
    return tuple(branches)


def from_branches(branches: Sequence[Branch], flavour: str) -> dict[str, Value]:
    """The configuration of the tree of some branches."""
    max_branches, max_conditions = limits_of(flavour)
    configuration: dict[str, Value] = {"NumBranches": len(branches)} if max_branches > 1 else {}
    for branch, names in zip(branches, _names(flavour), strict=False):
        if max_conditions > 1:
            configuration[names.number] = len(branch.conditions)
        places = [*zip(branch.conditions, names.conditions, strict=False), (branch.action, names.action)]
        for node, (name, _, by_name) in places:
            configuration[name] = by_name[node.name].number
            by_name[node.name].put(configuration, node.parameters)
    return configuration


@by_entries
@functools.cache
def _names(flavour: str) -> tuple[_BranchNames, ...]:
    """The names of the grammar for each branch."""
    behaviours, conditions = modules_of(flavour)
    max_branches, max_conditions = limits_of(flavour)
    return tuple(
        _BranchNames(
            f"NumConditions{i}",
            tuple((f"C{i}x{j}", *choices(conditions, f"{i}x{j}")) for j in range(max_conditions)),
            (f"A{i}", *choices(behaviours, f"{i}")),
        )
        for i in range(max_branches)
    )


@by_entries
@functools.cache
def modules_of(flavour: str) -> tuple[Mapping[int, Module], Mapping[int, Module]]:
    """The behaviours and the conditions that a flavour designs with, by their numbers."""
    return flavour_of(flavour).designed("behaviour"), flavour_of(flavour).designed("condition")


@by_entries
@functools.cache
def never_of(flavour: str) -> TreeNode | None:
    """A condition that never holds: the last one whose probability may be 0; None if there is none."""
    for module in reversed([*modules_of(flavour)[1].values()]):
        if module.has_beta:
            return condition(module.name, 0.0, *(float(parameter.low) for parameter in module.parameters[1:]))
    return None


def limits_of(flavour: str) -> tuple[int, int]:
    """Largest numbers of branches and of conditions of a branch."""
    return flavour_of(flavour).limit("branches"), flavour_of(flavour).limit("conditions")
