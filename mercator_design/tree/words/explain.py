"""A behaviour tree in plain sentences: node by node, or branch by branch if it has the shape of designed trees."""

from collections.abc import Iterator, Sequence

from mercator_design.modules.flavour import flavour_of
from mercator_design.modules.module import KnownSwarm
from mercator_design.modules.words import module_words, robots_words, with_parameters
from mercator_design.tree.space.grammar import Branch, shape_of
from mercator_design.tree.tree import Tree, TreeNode

_DOES = {
    "selector": "ticks its children from the first, until one does not fail; fails if all fail",
    "selector*": "ticks its children from the one that was running last, until one does not fail; {} if all fail",
    "sequence": "ticks its children from the first, until one does not succeed; succeeds if all succeed",
    "sequence*": "ticks its children from the one that was running last, until one does not succeed",
    "negation": "fails where its child succeeds, and succeeds where it fails",
}


def node_words(node: TreeNode) -> str:
    """A node in a line, without its children: its kind; of a leaf its module, with the parameters."""
    if not node.is_leaf:
        return node.kind
    p = f", p {node.p:g}" * (node.p != 0.0)
    return f"{node.kind} {with_parameters(node.module, node.parameters)}{p}"


def explanation(tree: Tree, swarm: KnownSwarm) -> str:
    """A description of robots with a tree; their reference model gets the constants of the flavour."""
    swarm = swarm._replace(model=flavour_of(tree.flavour).reference_model(swarm.model))
    return "\n".join(_lines(tree, swarm))


def _lines(tree: Tree, swarm: KnownSwarm) -> Iterator[str]:
    nodes = [node for _, node in tree.preorder]
    actions, conditions = (sum(node.kind == kind for node in nodes) for kind in ("action", "condition"))
    parts = f"{_count(len(nodes), 'node')}: {_count(actions, 'action')} and {_count(conditions, 'condition')}"
    yield f"A behaviour tree of {tree.flavour} of {parts} among them."
    if swarm.robots is not None:
        yield robots_words(swarm.robots)
    yield f"In each control cycle ({swarm.cycle:g} s) the root is ticked, and ticks its children in turn."
    yield "At most one action acts; where the root succeeds or fails, the robot stands still."
    if (branches := shape_of(tree)) is not None:
        yield from _ring(branches, swarm)
        return
    for identifier, node in tree.preorder:
        indent = "  " * len(identifier)
        yield f"\n{indent}{identifier or 'root'}: {node_words(node)}"
        yield f"{indent}  {_node_sentence(node, swarm)}"
    yield ""


def _node_sentence(node: TreeNode, swarm: KnownSwarm) -> str:
    if node.kind == "condition":
        return f"It succeeds {_holds(node, swarm)}; otherwise it fails."
    if node.kind == "action":
        ends = f" It succeeds instead with probability {node.p:g} a cycle." * (node.p > 0.0)
        return f"The robot {module_words(node.module, node.parameters, swarm)}.{ends}"
    slip = swarm.model.starred_selector_succeeds != 0.0
    return f"It {_DOES[node.kind].format('succeeds' if slip else 'fails')}."


def _ring(branches: Sequence[Branch], swarm: KnownSwarm) -> Iterator[str]:
    """The branches of a designed tree, in each of which a robot is as in a state of a PFSM."""
    yield "The tree is a ring of branches; a robot begins with branch 0."
    yield "It stays in a branch until a condition of it succeeds. These are tested before it acts."
    for i, branch in enumerate(branches):
        acting = branch.action
        yield f"\nBranch {i}: {with_parameters(acting.module, acting.parameters)}"
        yield f"  The robot {module_words(acting.module, acting.parameters, swarm)}."
        if acting.module.failure >= 0:
            yield "  Where that fails, it stands still for a cycle, and begins again with branch 0."
        if i + 1 < len(branches):
            yield f"  It goes on to branch {i + 1} in the same cycle"
        else:
            yield "  It stands still for a cycle, and begins again with branch 0,"
        for node in branch.conditions:
            yield f"    {_holds(node, swarm)}"
            yield f"      [{with_parameters(node.module, node.parameters)}]"
    yield ""


def _holds(node: TreeNode, swarm: KnownSwarm) -> str:
    return module_words(node.module, node.parameters, swarm)


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'s' * (number != 1)}"
