"""Each seeded fault of a behaviour tree is found, and what is found is true of robots."""

import math
import random
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mercator_design.missions.mission import load_mission
from mercator_design.modules.perception import new_row
from mercator_design.modules.reference import ACTIONS, ReferenceModel
from mercator_design.sim.checks.findings import situations
from mercator_design.sim.checks.lint import Choice, chances_of, lint
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.software.files import read_fsm
from mercator_design.tree.control import FAILURE, RUNNING, STATUSES, SUCCESS, tree_cycle
from mercator_design.tree.text import parse
from mercator_design.tree.tree import Tree, TreeNode, action, condition
from tests.tree.maple import DATA
from tests.tree.strategies import trees

MISSION = load_mission("aggregation", ["robots=5"])  # its floor is gray and black
MERCATOR = load_robot_model("mercator")
BLACK, EXPLORE, STOP = condition("black floor", 0.5), action("exploration", 5.0), action("stop")


def branch(*children):
    return TreeNode("selector", children)


def found(*children, kind="sequence*", mission=None, flavour="maple"):
    tree = Tree(TreeNode(kind, children), flavour)
    return [(one.code, one.place) for one in lint(tree, (), mission, MERCATOR if mission else None)]


def test_a_sound_tree_has_no_findings():
    assert found(branch(BLACK, EXPLORE), branch(BLACK, STOP)) == []
    assert found(branch(BLACK, EXPLORE), branch(BLACK, STOP), mission=MISSION) == []


def test_what_is_behind_a_branch_that_never_ends():
    never = condition("fixed probability", 0.0)
    assert found(branch(never, EXPLORE), branch(BLACK, STOP)) == [
        ("never-succeeds", "node 00 (fixed probability)"),
        ("never-ticked", "node 1 (selector)"),
        ("absorbing-node", "node 0 (selector)"),
    ]
    assert found(branch(BLACK, EXPLORE), branch(never, STOP)) == [
        ("never-succeeds", "node 10 (fixed probability)"),
        ("absorbing-node", "node 1 (selector)"),
    ]


def test_it_depends_on_the_mission_what_conditions_can_succeed():
    white = branch(condition("white floor", 0.5), EXPLORE)
    assert found(branch(BLACK, STOP), white) == []
    assert ("never-succeeds", "node 10 (white floor)") in found(branch(BLACK, STOP), white, mission=MISSION)
    many = branch(condition("inverted neighbours count", 9.0, 10.0), EXPLORE)
    assert found(many, branch(BLACK, STOP)) == []
    assert found(many, branch(BLACK, STOP), mission=MISSION) == [
        ("always-succeeds", "node 00 (inverted neighbours count)"), ("never-ticked", "node 01 (exploration)"),
    ]  # fmt: skip


def test_conditions_that_exclude_each_other():
    both = TreeNode("sequence", (BLACK, condition("white floor", 0.5), STOP))
    assert found(both, EXPLORE, kind="selector") == [
        ("never-succeeds", "node 01 (white floor)"), ("never-ticked", "node 02 (stop)"),
    ]  # fmt: skip
    later = TreeNode("sequence*", (BLACK, action("stop", p=0.5), condition("white floor", 0.5), EXPLORE))
    assert found(later, EXPLORE, kind="selector") == []  # it goes on where it was, on another floor


def test_other_findings():
    assert found(branch(BLACK, action("stop", p=1.0)), STOP) == [
        ("never-acts", "node 01 (stop)"), ("absorbing-node", "node 1 (stop)"),
    ]  # fmt: skip
    light = branch(BLACK, action("phototaxis"))
    assert ("missing-sense", "node 01 (phototaxis)") in found(light, mission=MISSION)
    alone = replace(MISSION, robots=1)
    assert ("nothing-to-read", "node 01 (attraction)") in found(branch(BLACK, action("attraction", 2.0)), mission=alone)
    wide = parse(
        "--nroot 3 --nchildroot 1 --n0 0 --nchild0 2 --n00 6 --c00 0 --p00 1.5 --n01 5 --a01 1 --p01 0",
        tolerate=lambda _: None,
    )
    assert ("out-of-domain", "node 00") in [(one.code, one.place) for one in lint(wide, ())]


@given(trees(), st.integers(0, 2**32))
def test_findings_are_true(tree, seed):
    """A draw that a finding excludes has a probability below 1e-6 a cycle."""
    model, program = ReferenceModel(), tree.program()
    model = model._replace(count_wraps=0.0, starred_selector_succeeds=0.0)
    findings = {(one.code, one.place.split(" (")[0]) for one in lint(replace(tree, flavour="maple"), ())}
    places = [f"node {identifier}" if identifier else "the root" for identifier, _ in tree.preorder]
    draws, memory = random.Random(seed), new_row(program.memory)
    known = situations(None, None)
    for _ in range(200):
        tree_cycle(model, program, draws.choice(known), memory, [draws.random() for _ in range(tree.draws)],
                   new_row(ACTIONS))  # fmt: skip
        for k, place in enumerate(places):
            status = memory[STATUSES + k]
            assert status == 0.0 or ("never-ticked", place) not in findings
            assert status != SUCCESS or ("never-succeeds", place) not in findings
            assert status != FAILURE or ("always-succeeds", place) not in findings
            assert status != RUNNING or ("never-acts", place) not in findings


def test_published_trees():
    codes = {one.code for each in DATA["vectors"] for one in lint(parse(each["tree"]), ())}
    assert codes <= {"never-ticked", "never-succeeds", "always-succeeds", "never-acts", "absorbing-node"}


class TestVerbs:
    RING = (
        "--nroot 3 --nchildroot 2 --n0 0 --nchild0 2 --n00 6 --c00 2 --p00 0.5 --n01 5 --a01 0 --rwm01 5 --p01 0 "
        "--n1 0 --nchild1 2 --n10 6 --c10 0 --p10 0.9 --n11 5 --a11 1 --p11 0"
    )

    @pytest.fixture
    def ring(self, tmp_path):
        path = tmp_path / "ring.txt"
        path.write_text(f"# flavour: maple\n# score: 3\n{self.RING}\n")
        return path

    def test_lint(self, mdesign, ring):
        assert mdesign("fsm", "lint", ring)[:2] == (0, f"{ring}: no findings\n")
        code, out, _ = mdesign("fsm", "lint", ring, "--mission", "aggregation")
        assert (code, [line.partition(":")[0] for line in out.splitlines()]) == (
            3, ["never-succeeds", "never-ticked", "absorbing-node (note)"]
        )  # fmt: skip

    def test_simplify(self, mdesign, ring, tmp_path):
        simpler = tmp_path / "simpler.txt"
        code, out, _ = mdesign("fsm", "simplify", ring, "-o", simpler)
        assert (code, out.splitlines()[0]) == (0, "it is in its canonical form")
        code, out, _ = mdesign("fsm", "simplify", ring, "-o", simpler, "--mission", "aggregation")
        assert (code, out.splitlines()[1].partition(":")[0]) == (0, "node 1 is gone")
        file = read_fsm(simpler)
        assert file.software == parse(
            "--nroot 3 --nchildroot 1 --n0 0 --nchild0 2 --n00 6 --c00 5 --p00 0 --n01 5 --a01 0 --rwm01 5 --p01 0"
        )
        assert file.header == {"simplified from": self.RING, "simplified": "to its canonical form"}
        code, _, err = mdesign("fsm", "simplify", ring, "-o", tmp_path / "simpler.yaml")
        assert (code, "fsm.yaml is a form of PFSMs" in err) == (2, True)

    def test_another_shape_is_not_simplified(self, mdesign, ring, tmp_path):
        ring.write_text(ring.read_text().replace("--nroot 3", "--nroot 2"))
        code, _, err = mdesign("fsm", "simplify", ring, "-o", tmp_path / "simpler.txt")
        assert (code, "other behaviour trees have no canonical form" in err) == (3, True)

    def test_diff(self, mdesign, ring, tmp_path):
        other = tmp_path / "other.txt"
        other.write_text(ring.read_text().replace("0.9", "0.8"))
        assert mdesign("fsm", "diff", ring, ring)[:2] == (0, "the same behaviour tree\n")
        assert mdesign("fsm", "diff", ring, other)[:2] == (
            0, "these differ\n  node 10, black floor: beta 0.9 -> 0.8\n"
        )  # fmt: skip


def _by_all_orders(target, chances, targets):
    """The probability of a change, by adding a transition at a time to all sets that may be tested before it."""
    n, total = len(chances), 0.0
    for k in range(n):
        if targets[k] != target:
            continue
        others = [chances[j] for j in range(n) if j != k]
        sums = [1.0] + [0.0] * (n - 1)  # over all sets of m others, the products of what does not fire
        for p in others:
            for m in range(n - 1, 0, -1):
                sums[m] += sums[m - 1] * (1.0 - p)
        total += chances[k] * sum(sums[m] / math.comb(n - 1, m) for m in range(n)) / n
    return total


@given(st.lists(st.tuples(st.sampled_from([0.0, 1.0]) | st.floats(0, 1), st.integers(0, 2)), min_size=1, max_size=16))
def test_chances_of_up_to_16_transitions_are_exact(transitions):
    choices = [Choice([p, 0.5 * p], target) for p, target in transitions]
    for target in range(3):
        expected = [
            _by_all_orders(target, [share * p for p, _ in transitions], [to for _, to in transitions])
            for share in (1.0, 0.5)
        ]
        assert chances_of(target, choices).tolist() == pytest.approx(expected, abs=1e-12)
