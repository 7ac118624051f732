"""What is wrong or superfluous in a behaviour tree.

Each situation that a robot may be in gives every node the statuses that it may return. A starred node may begin with
any child that may run in some situation. Draws of nodes are taken to be independent of what happened before, so nodes
may be ticked that never are; a finding is certain.
"""

from collections.abc import Iterator

from mercator_design.missions.mission import Mission
from mercator_design.modules.architecture import out_of_domain
from mercator_design.modules.flavour import flavour_of
from mercator_design.modules.reference import ReferenceModel
from mercator_design.sim.checks.findings import (
    NEGLIGIBLE,
    Finding,
    chances_in,
    sense_findings,
    situations,
    why_never,
)
from mercator_design.sim.robot_model import RobotModel
from mercator_design.tree.control import FAILURE, RUNNING, SUCCESS
from mercator_design.tree.text import only_original
from mercator_design.tree.tree import Tree, TreeNode, children_of, place_of

_Statuses = frozenset[float]


def tree_findings(tree: Tree, mission: Mission | None = None, model: RobotModel | None = None) -> Iterator[Finding]:
    """All findings on a tree, in preorder; without a mission or a robot model, those that do not depend on it."""
    return _TreeLinter(tree, mission, model).findings()


class _TreeLinter:
    def __init__(self, tree: Tree, mission: Mission | None, model: RobotModel | None) -> None:
        model = model and model.with_flavour(tree.flavour)
        self.tree, self.mission, self.model = tree, mission, model
        self.situations = situations(mission, model)
        self.reference = model.reference_model if model else flavour_of(tree.flavour).reference_model(ReferenceModel())
        self.nodes: list[TreeNode] = [node for _, node in tree.preorder]
        self.places = [f"{place_of(identifier)} ({node.name or node.kind})" for identifier, node in tree.preorder]
        self.children = [[*children_of(k, tree.links[1])] for k in range(len(self.nodes))]
        self.chances = {
            k: chances_in(self.situations, node, self.reference, mission, model)
            for k, node in enumerate(self.nodes)
            if node.kind == "condition"
        }
        self.starts = [{0} for _ in self.nodes]  # children with which a starred node may begin
        self.ticked: list[bool] = []
        self.returned: list[set[float]] = []
        self._tick_all()

    def _tick_all(self) -> None:
        """Find the statuses of all situations, again as long as starred nodes may begin with more children."""
        before = None
        while before != self.starts:
            before = [set(one) for one in self.starts]
            self.ticked = [False] * len(self.nodes)
            self.returned = [set() for _ in self.nodes]
            for at in range(len(self.situations)):
                self._known: dict[int, _Statuses] = {}
                self._tick(0, at)

    def _tick(self, k: int, at: int) -> _Statuses:
        """The statuses that a node may return in a situation."""
        self.ticked[k] = True
        if (known := self._known.get(k)) is not None:
            return known
        found = self._known[k] = self._leaf(k, at) if self.nodes[k].is_leaf else self._inner(k, at)
        self.returned[k] |= found
        return found

    def _leaf(self, k: int, at: int) -> _Statuses:
        node = self.nodes[k]
        if node.kind == "condition":
            p = self.chances[k][at]  # perhaps NaN, which is not known
            may = {SUCCESS: not p <= NEGLIGIBLE, FAILURE: not p >= 1.0 - NEGLIGIBLE}
        else:
            may = {SUCCESS: node.p > 0.0, FAILURE: node.module.failure >= 0, RUNNING: node.p < 1.0}
        return frozenset(status for status, is_possible in may.items() if is_possible)

    def _inner(self, k: int, at: int) -> _Statuses:
        node = self.nodes[k]
        if node.kind == "negation":
            other = {SUCCESS: FAILURE, FAILURE: SUCCESS, RUNNING: RUNNING}
            return frozenset(other[status] for status in self._tick(self.children[k][0], at))
        passing = SUCCESS if node.kind.startswith("sequence") else FAILURE
        is_starred = node.kind.endswith("*")
        found: set[float] = set()
        for begin in sorted(self.starts[k]) if is_starred else (0,):
            passes = True
            for number, child in enumerate(self.children[k][begin:], start=begin):
                statuses = self._tick(child, at)
                found |= statuses - {passing}
                if is_starred and RUNNING in statuses:
                    self.starts[k].add(number)
                if passing not in statuses:
                    passes = False
                    break
            if passes:
                slip = node.kind == "selector*" and self.reference.starred_selector_succeeds != 0.0
                found.add(SUCCESS if slip else passing)
        return frozenset(found)

    def findings(self) -> Iterator[Finding]:
        found: list[str] = []
        only_original(self.tree, found.append)
        out_of_domain(self.tree, found.append)
        for one in found:
            place, _, words = one.partition(": ")
            yield Finding("out-of-domain", place, f"{words}; the original AutoMoDe would run it")
        parents, _ = self.tree.links
        for k, node in enumerate(self.nodes):
            if not self.ticked[k]:
                if self.ticked[parents[k]]:
                    yield Finding("never-ticked", self.places[k], self._why_not_ticked(parents[k], k))
                continue
            if node.is_leaf:
                yield from sense_findings(self.places[k], node.module, self.mission, self.model)
                yield from self._of_leaf(k, node)
        yield from self._without_end()

    def _why_not_ticked(self, parent: int, k: int) -> str:
        before = [one for one in self.children[parent] if one < k and self.ticked[one]][-1]
        passing = "succeeds" if self.nodes[parent].kind.startswith("sequence") else "fails"
        return f"is never ticked: {self.places[before]} before it never {passing}"

    def _of_leaf(self, k: int, node: TreeNode) -> Iterator[Finding]:
        if node.kind == "action":
            if RUNNING not in self.returned[k]:
                yield Finding("never-acts", self.places[k], f"never acts: its p is {node.p:g}")
            return
        chances = self.chances[k]
        if max(chances) <= NEGLIGIBLE:
            words = why_never(node, chances, self.situations, self.mission, self.model, "succeeds")
            yield Finding("never-succeeds", self.places[k], words)
        elif SUCCESS not in self.returned[k]:
            yield Finding("never-succeeds", self.places[k], "never succeeds in a situation in which it is ticked")
        elif FAILURE not in self.returned[k]:
            yield Finding("always-succeeds", self.places[k], "succeeds in every situation in which it is ticked")

    def _without_end(self) -> Iterator[Finding]:
        """Children of a starred root that run for ever: no other is ticked any more."""
        if not self.nodes[0].kind.endswith("*"):
            return
        for child in self.children[0]:
            if self.returned[child] == {RUNNING} and len(self.children[0]) > 1:
                message = "never succeeds or fails: a robot stays here to the end"
                yield Finding("absorbing-node", self.places[child], message, is_note=True)
