"""Behaviour trees as an architecture of control software."""

from collections import Counter
from collections.abc import Sequence

from mercator_design.modules.architecture import Architecture
from mercator_design.modules.flavour import flavour_of
from mercator_design.modules.module import KnownSwarm
from mercator_design.modules.perception import MutableRow
from mercator_design.modules.reference import Readings, ReferenceModel
from mercator_design.tree.control import STATUSES, ticked_from, tree_cycle
from mercator_design.tree.space.grammar import Branch, from_tree, modules_of, parameters_of, to_tree, tree_of
from mercator_design.tree.space.structure import TreeStructure
from mercator_design.tree.text import parse, to_text
from mercator_design.tree.tree import Tree, TreeNode, TreeProgram, action, condition
from mercator_design.tree.words.difference import difference
from mercator_design.tree.words.explain import explanation


def _simplest(flavour: str) -> Tree:
    """A tree of one branch."""
    behaviour, tested = (next(iter(modules.values())) for modules in modules_of(flavour))
    acting, leaf = (
        make(module.name, *(one.sampled[0] for one in module.parameters))
        for make, module in ((action, behaviour), (condition, tested))
    )
    return tree_of([Branch((leaf,), acting)], flavour)


def node_names(tree: Tree) -> tuple[str, ...]:
    """A name for each node: of an action its behaviour, of others the condition or kind and their identifier.

    The name of the root stands for no action.
    """
    found = ["none"]
    times = Counter(node.name for _, node in tree.preorder if node.kind == "action")
    seen: Counter[str] = Counter()
    for identifier, node in [*tree.preorder][1:]:
        seen[node.name] += 1
        if node.kind != "action":
            found.append(f"{(node.name or node.kind).rstrip('*')} {identifier}")
        else:
            found.append(f"{node.name} {seen[node.name]}" if times[node.name] > 1 else node.name)
    return tuple(found)


def acting_nodes(tree: Tree) -> tuple[int, ...]:
    """The numbers of the actions, in preorder."""
    return tuple(k for k, (_, node) in enumerate(tree.preorder) if node.kind == "action")


def _statuses(tree: Tree, memory: MutableRow) -> list[int]:
    """The status of each node in preorder, as control.py numbers them."""
    return [int(memory[STATUSES + k]) for k in range(tree.draws - 1)]


def _explanation(tree: Tree, names: Sequence[str], swarm: KnownSwarm) -> str:  # noqa: ARG001 - nodes have identifiers
    return explanation(tree, swarm)


def _reason(tree: Tree, model: ReferenceModel, active: int, readings: Readings, draws: Sequence[float]) -> str:
    """The last condition that succeeds before another node acts, or none does; else the behaviour that ends."""
    model = flavour_of(tree.flavour).reference_model(model)
    acting, succeeded = ticked_from(tree, model, active, readings, draws)
    if acting == active:
        return ""
    nodes: list[TreeNode] = [node for _, node in tree.preorder]
    tested = [nodes[k].name for k in succeeded if nodes[k].kind == "condition"]
    return tested[-1] if tested else nodes[active].name or "begin"


TREE = Architecture(
    name="tree",
    noun="behaviour tree",
    kind=Tree,
    program=TreeProgram,
    cycle=tree_cycle,
    parse=parse,
    text=to_text,
    parameters=parameters_of,
    decode=to_tree,
    encode=from_tree,
    structure=TreeStructure,
    simplest=_simplest,
    names=node_names,
    active=acting_nodes,
    activity=_statuses,
    explanation=_explanation,
    difference=difference,
    reason=_reason,
)
