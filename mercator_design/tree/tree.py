"""The behaviour tree: its nodes, what makes it valid, and its tables for the kernels."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from mercator_design.errors import FsmError
from mercator_design.modules.flavour import flavour_of
from mercator_design.modules.module import BEHAVIOURS, CONDITIONS, Module, ModuleParameter
from mercator_design.modules.perception import Row
from mercator_design.modules.reference import senses_bits

KINDS = ("selector", "selector*", "sequence", "sequence*", "negation", "action", "condition")
"""The kinds of nodes, by their numbers in texts."""

SELECTOR, SELECTOR_STAR, SEQUENCE, SEQUENCE_STAR, NEGATION, ACTION, CONDITION = range(7)

MAX_CHILDREN = 10
MAX_DEPTH = 5
"""Limits of AutoMoDe's texts: children of a node, levels below the root."""

DEFAULT_FLAVOUR = "maple"

SUCCESS = ModuleParameter(name="p", flag="p", stem="P", low=0, high=1)
"""The parameter of an action: probability that it succeeds instead of acting, in each cycle in which it is ticked."""


class TreeNode(NamedTuple):
    """A node with its subtree.

    kind: One of KINDS.
    children: Of a selector, sequence or negation.
    name: Of the behaviour of an action, or of the condition.
    parameters: Of that module, in the order of its table.
    p: Of an action, see SUCCESS.
    """

    kind: str
    children: tuple["TreeNode", ...] = ()
    name: str = ""
    parameters: tuple[float, ...] = ()
    p: float = 0.0

    @property
    def is_leaf(self) -> bool:
        """Whether it is an action or a condition."""
        return self.kind in {"action", "condition"}

    @property
    def module(self) -> Module:
        """The behaviour or the condition of a leaf."""
        return (BEHAVIOURS if self.kind == "action" else CONDITIONS)[self.name]


def action(name: str, *parameters: float, p: float = 0.0) -> TreeNode:
    """A leaf that acts."""
    return TreeNode("action", (), name, parameters, p)


def condition(name: str, *parameters: float) -> TreeNode:
    """A leaf that is tested."""
    return TreeNode("condition", (), name, parameters)


class TreeProgram(NamedTuple):
    """A tree as tables of numbers: tuples here, numpy arrays of the same length in compiled code.

    Nodes are numbered in preorder: the root is 0, the first child of node k is k + 1. The memory begins with the number
    of the acting node and a status for each node; the others are the nodes' own.
    """

    kinds: Row  # of each node, place in KINDS
    parents: Row
    ends: Row  # number of the first node behind the subtree
    modules: Row  # of a leaf, position in BEHAVIOURS or CONDITIONS
    failures: Row  # of an action, position in FAILURE_CALLS; -1: it never fails
    starts: Row  # of each node, in `parameters`; and the end of the last
    parameters: Row  # behind those of an action, its probability to succeed
    memory_starts: Row  # of each node's own part of the memory; and the end of the last
    marks: Row  # of an action, place in the memory that is set to 1 where it succeeds or fails; 0: none
    reads: Row  # of each node that may act, all senses that the tree reads, as bits (module.SENSES)

    @property
    def memory(self) -> int:
        """Count of the numbers that it keeps from cycle to cycle."""
        return int(self.memory_starts[-1])


@dataclass(frozen=True, slots=True)
class Tree:
    """A valid behaviour tree.

    Raises:
        FsmError: on a root that is a leaf, a kind that does not exist, more levels than texts have, a module that does
            not exist in the flavour, a missing, superfluous or not finite parameter, and (unless `any_domain`) no
            children or too many, and a parameter outside its domain.
    """

    root: TreeNode
    flavour: str = DEFAULT_FLAVOUR
    any_domain: bool = field(default=False, compare=False, repr=False, kw_only=True)

    def __post_init__(self) -> None:
        flavour_of(self.flavour, "tree")
        if self.root.is_leaf:
            raise FsmError(f"the root: expected one of {', '.join(KINDS[:ACTION])}, found {self.root.kind!r}")
        seen = set()
        for identifier, node in identified(self.root):
            place = place_of(identifier)
            if len(identifier) > MAX_DEPTH:
                raise FsmError(f"{place}: expected at most {MAX_DEPTH} levels below the root")
            if identifier in seen:
                raise FsmError(f"{place}: two nodes have this identifier, as one has more than {MAX_CHILDREN} children")
            seen.add(identifier)
            self._check(place, node)

    def _check(self, place: str, node: TreeNode) -> None:
        if node.kind not in KINDS:
            raise FsmError(f"{place}: expected one of {', '.join(KINDS)}, found {node.kind!r}")
        if node.is_leaf:
            self._check_leaf(place, node)
            return
        n = len(node.children)
        if node.kind == "negation" and n != 1:
            raise FsmError(f"{place}: a negation has one child, found {n}")
        if not (1 <= n <= MAX_CHILDREN or self.any_domain):
            raise FsmError(f"{place}: a {node.kind} has 1 to {MAX_CHILDREN} children, found {n}")
        if node.name or node.parameters or node.p:
            raise FsmError(f"{place}: a {node.kind} has no behaviour, condition or parameters")

    def _check_leaf(self, place: str, node: TreeNode) -> None:
        kind = "behaviour" if node.kind == "action" else "condition"
        flavour_of(self.flavour).check_module(place, kind, node.name, node.parameters, any_domain=self.any_domain)
        SUCCESS.check(place, node.name, node.p, any_domain=self.any_domain)
        if node.children:
            raise FsmError(f"{place}: expected no children of {node.kind} {node.name}, found {len(node.children)}")
        if node.kind == "condition" and node.p:
            raise FsmError(f"{place}: only an action has a probability p to succeed, found {node.p:g}")

    def __repr__(self) -> str:
        return f"<Tree: {self.summary}>"

    @property
    def summary(self) -> str:
        """Flavour, number of nodes and actions in a line."""
        nodes = [node for _, node in self.preorder]
        acting = ", ".join(node.name for node in nodes if node.kind == "action") or "none"
        n, m = len(nodes), sum(node.kind == "condition" for node in nodes)
        return f"{self.flavour}, {n} nodes (actions: {acting}), {m} condition{'s' * (m != 1)}"

    @property
    def reads(self) -> frozenset[str]:
        """The senses that a robot must have to run this tree."""
        return frozenset().union(*(node.module.reads for _, node in self.nodes))

    @property
    def preorder(self) -> Iterator[tuple[str, TreeNode]]:
        """Every node, each before its children, behind its identifier: the numbers of children from the root down."""
        return identified(self.root)

    @property
    def nodes(self) -> Iterator[tuple[str, TreeNode]]:
        """The actions and conditions in preorder, behind their places in words."""
        for identifier, node in self.preorder:
            if node.is_leaf:
                yield place_of(identifier), node

    @property
    def links(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Of each node in preorder the numbers of its parent (0: the root) and of the first node behind its subtree."""
        ends = tuple(k + _size(node) for k, (_, node) in enumerate(self.preorder))
        parents = [0] * len(ends)
        for k in range(len(ends)):
            for child in children_of(k, ends):
                parents[child] = k
        return tuple(parents), ends

    @property
    def draws(self) -> int:
        """Uniform draws of a cycle: one for each node, and one for the behaviour that acts."""
        return sum(1 for _ in self.preorder) + 1

    def program(self) -> TreeProgram:
        """The tables that `control_cycle` runs on."""
        nodes = [node for _, node in self.preorder]
        n = len(nodes)
        kept = [_own_memory(node) for node in nodes]
        starts = [*itertools.accumulate(kept, initial=1 + n)]
        parents, ends = self.links
        values = [(*node.parameters, node.p) if node.kind == "action" else node.parameters for node in nodes]
        modules = [node.module if node.is_leaf else None for node in nodes]
        return TreeProgram(
            kinds=tuple(KINDS.index(node.kind) for node in nodes),
            parents=parents,
            ends=ends,
            modules=tuple(module.position if module else 0 for module in modules),
            failures=tuple(module.failure if module else -1 for module in modules),
            starts=(0, *itertools.accumulate(map(len, values))),
            parameters=tuple(float(value) for row in values for value in row),
            memory_starts=tuple(starts),
            marks=tuple(starts[k + 1] - 1 if module and module.end_mark else 0 for k, module in enumerate(modules)),
            reads=(senses_bits(self.reads),) * n,
        )


def identified(root: TreeNode) -> Iterator[tuple[str, TreeNode]]:
    """The nodes of a subtree in preorder, behind their identifiers below it; not those below the deepest level."""
    waiting = [("", root)]
    while waiting:
        identifier, node = waiting.pop()
        yield identifier, node
        if len(identifier) <= MAX_DEPTH:
            waiting += [(f"{identifier}{i}", child) for i, child in reversed([*enumerate(node.children)])]


def children_of(k: int, ends: Sequence[int]) -> Iterator[int]:
    """The numbers of the children of a node."""
    child = k + 1
    while child < ends[k]:
        yield child
        child = ends[child]


def place_of(identifier: str) -> str:
    """A node's place in words."""
    return f"node {identifier}" if identifier else "the root"


def _own_memory(node: TreeNode) -> int:
    if node.is_leaf:
        return node.module.memory
    return 1 if node.kind.endswith("*") else 0  # the child that a starred node begins with


def _size(node: TreeNode) -> int:
    return sum(1 for _ in identified(node))
