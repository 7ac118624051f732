import pytest
from hypothesis import given
from hypothesis import strategies as st

from mercator_design.modules.perception import new_row
from mercator_design.modules.reference import ACTIONS, Readings, ReferenceModel
from mercator_design.tree.control import ACTING, FAILURE, NOT_TICKED, RUNNING, STATUSES, SUCCESS, tree_cycle
from mercator_design.tree.text import parse
from mercator_design.tree.tree import Tree, TreeNode, action, condition

NEVER, ALWAYS = 0.999999, 0.0
"""Draws with which no probability below 1 holds, and with which all above 0 do."""
BLACK, GRAY, WHITE = (Readings(ground_red=g, ground_green=g, ground_blue=g) for g in (0.0, 127.0, 255.0))
AHEAD = Readings(proximity_x=0.9)
STOP = action("stop")
FAILS, SUCCEEDS = condition("fixed probability", 0.0), condition("fixed probability", 1.0)
ENDS = action("stop", p=1.0)
"""An action that always succeeds."""


class Robot:
    """A tree with its memory."""

    def __init__(self, root, **constants):
        self.tree = Tree(root) if isinstance(root, TreeNode) else parse(root)
        self.model = ReferenceModel()._replace(**constants)
        self.program = self.tree.program()
        self.memory = new_row(self.program.memory)
        self.actions = new_row(ACTIONS)

    def cycle(self, readings=GRAY, u=NEVER, acting=0.0):
        """A cycle with one draw for all nodes, or a list, and one for the action; returns the wheels."""
        draws = u if isinstance(u, list) else [u] * (self.tree.draws - 1)
        tree_cycle(self.model, self.program, readings, self.memory, [*draws, acting], self.actions)
        return self.actions[0], self.actions[1]

    @property
    def status(self):
        return self.memory[STATUSES]

    @property
    def ticked(self):
        """The identifiers of the nodes that were ticked in this cycle."""
        return [each for k, (each, _) in enumerate(self.tree.preorder) if self.memory[STATUSES + k] != NOT_TICKED]


def test_the_worked_example_of_a_ring_of_branches():
    robot = Robot(
        "--nroot 3 --nchildroot 2 --n0 0 --nchild0 2 --n00 6 --c00 0 --p00 0.5 --n01 5 --a01 0 --rwm01 5 --p01 0 "
        "--n1 0 --nchild1 2 --n10 6 --c10 2 --p10 0.5 --n11 5 --a11 1 --p11 0"
    )
    table = [
        (GRAY, 0.9, ["", "0", "00", "01"], (1, 1), RUNNING),
        (BLACK, 0.9, ["", "0", "00", "01"], (1, 1), RUNNING),
        (BLACK, 0.1, ["", "0", "00", "1", "10", "11"], (0, 0), RUNNING),
        (BLACK, 0.1, ["", "1", "10", "11"], (0, 0), RUNNING),
        (WHITE, 0.1, ["", "1", "10"], (0, 0), SUCCESS),
        (GRAY, 0.9, ["", "0", "00", "01"], (1, 1), RUNNING),
    ]
    for readings, u, ticked, wheels, status in table:
        assert robot.cycle(readings, u) == wheels
        assert (robot.ticked, robot.status) == (ticked, status)


LEAVES = {SUCCESS: SUCCEEDS, FAILURE: FAILS, RUNNING: STOP}


def expected(kind, statuses, *, slip):
    """What a node does with children of some statuses: its own status, and how many it ticks."""
    if kind == "negation":
        return {SUCCESS: FAILURE, FAILURE: SUCCESS, RUNNING: RUNNING}[statuses[0]], 1
    passing = SUCCESS if kind.startswith("sequence") else FAILURE
    for n, status in enumerate(statuses, start=1):
        if status != passing:
            return status, n
    return (SUCCESS if slip and kind == "selector*" else passing), len(statuses)


@given(
    st.sampled_from(["selector", "selector*", "sequence", "sequence*", "negation"]),
    st.lists(st.sampled_from([*LEAVES]), min_size=1, max_size=5),
    st.booleans(),
)
def test_status_of_a_node_from_its_children(kind, statuses, slip):
    statuses = statuses[:1] if kind == "negation" else statuses
    robot = Robot(TreeNode(kind, tuple(LEAVES[each] for each in statuses)), starred_selector_succeeds=float(slip))
    robot.cycle(u=0.5)
    status, n = expected(kind, statuses, slip=slip)
    assert robot.status == status
    assert len(robot.ticked) == 1 + n
    assert robot.memory[ACTING] == (n if status == RUNNING else 0)


def test_a_starred_node_begins_with_the_child_that_was_running():
    """Plain nodes begin with the first."""
    children = (condition("black floor", 1.0), STOP)
    robot, plain = (Robot(TreeNode(kind, children)) for kind in ("sequence*", "sequence"))
    for one in (robot, plain):
        one.cycle(BLACK)
        assert one.ticked == ["", "0", "1"]
        one.cycle(GRAY)
    assert (robot.ticked, robot.status) == (["", "1"], RUNNING)
    assert (plain.ticked, plain.status) == (["", "0"], FAILURE)


def test_a_starred_node_keeps_its_child_while_it_is_not_ticked():
    first = TreeNode("sequence", (condition("white floor", 1.0), action("exploration", 1.0)))
    robot = Robot(TreeNode("selector", (first, TreeNode("sequence*", (condition("black floor", 1.0), STOP)))))
    assert robot.cycle(BLACK) == (0, 0)
    for _ in range(50):
        assert robot.cycle(WHITE) == (1, 1)
    robot.cycle(GRAY)
    assert robot.ticked == ["", "0", "00", "1", "11"]
    assert robot.status == RUNNING


@pytest.mark.parametrize("ends", [SUCCEEDS, FAILS])
def test_a_starred_node_begins_anew_after_it_ended(ends):
    robot = Robot(TreeNode("sequence*", (SUCCEEDS, action("stop", p=0.5), ends)))
    robot.cycle(u=0.9)
    assert robot.ticked == ["", "0", "1"]
    robot.cycle(u=0.1)
    assert robot.ticked == ["", "1", "2"]
    robot.cycle(u=0.9)
    assert robot.ticked == ["", "0", "1"]


def test_a_robot_stands_still_where_the_root_ends_and_nothing_is_ticked_twice():
    robot = Robot(TreeNode("selector", (action("exploration", 5.0, p=0.5),)))
    assert robot.cycle(u=0.9) == (1, 1)
    assert robot.memory[ACTING] == 1
    assert robot.cycle(u=0.1) == (0, 0)
    assert (robot.status, robot.memory[ACTING]) == (SUCCESS, 0)


def test_lamps_keep_their_colour_and_no_signal_is_sent_where_nothing_acts():
    robot = Robot(TreeNode("selector", (ENDS,)))
    robot.actions[2], robot.actions[3] = 5.0, 3.0
    robot.cycle(u=0.5)
    assert list(robot.actions[:4]) == [0, 0, 5, 0]


@pytest.mark.parametrize(("p", "u", "status"), [(0.0, 0.0, RUNNING), (1.0, NEVER, SUCCESS), (0.5, 0.5, RUNNING)])
def test_p_of_an_action(p, u, status):
    robot = Robot(TreeNode("selector", (action("stop", p=p),)))
    robot.cycle(u=u)
    assert robot.status == status


def test_straight_fails_before_an_obstacle_even_where_it_would_succeed():
    robot = Robot(TreeNode("sequence", (action("straight", p=1.0),)))
    assert robot.cycle(AHEAD) == (0, 0)
    assert robot.status == FAILURE
    robot.cycle(Readings(proximity_x=-0.9))
    assert robot.status == SUCCESS
    assert Robot(TreeNode("sequence", (action("straight"),))).cycle(Readings(proximity_x=0.09)) == (1, 1)


def test_exploration_goes_on_with_a_turn_that_was_interrupted():
    first = TreeNode("sequence", (condition("white floor", 1.0), STOP))
    robot = Robot(TreeNode("selector", (first, action("exploration", 10.0))))
    assert robot.cycle(AHEAD._replace(ground_red=127.0, ground_green=127.0, ground_blue=127.0), acting=0.35) == (1, 1)
    turned = [robot.cycle(GRAY)]
    assert robot.cycle(WHITE) == (0, 0)
    turned += [robot.cycle(GRAY), robot.cycle(GRAY), robot.cycle(GRAY)]
    assert turned == [(1, -1)] * 3 + [(1, 1)]


def test_nodes_of_one_behaviour_have_memories_of_their_own():
    exploring = action("exploration", 100.0)
    robot = Robot(TreeNode("selector", (TreeNode("sequence", (condition("white floor", 1.0), exploring)), exploring)))
    robot.cycle(AHEAD, acting=0.9)  # white: the first begins to turn
    assert robot.cycle(GRAY) == (1, 1)
    assert robot.cycle(WHITE) == (1, -1)


def test_curve_keeps_its_side_until_it_has_ended():
    robot = Robot(TreeNode("selector", (action("curve", 0.53, p=0.1),)))
    right, left = (1, 0.5), (0.5, 1)
    assert robot.cycle(acting=0.9) == right  # from the start, whatever is drawn
    assert robot.cycle(acting=0.9) == right
    assert robot.cycle(u=0.05) == (0, 0)
    assert robot.cycle(acting=0.5) == left
    assert robot.cycle(acting=0.1) == left
    assert robot.cycle(AHEAD) == (0, 0)
    assert robot.cycle(acting=0.49) == right


@pytest.mark.parametrize(
    ("x", "y", "wheels"),
    [(0.0, 0.0, (-1, 1)), (0.5, 0.0, (-1, 1)), (0.5, 0.1, (1, -1)), (-0.5, 0.0, (1, -1)), (-0.5, -0.1, (-1, 1))],
)
def test_rotation_turns_away_from_the_angle_of_the_proximity_vector(x, y, wheels):
    robot = Robot(TreeNode("selector", (action("rotation"),)))
    assert robot.cycle(Readings(proximity_x=x, proximity_y=y)) == wheels


@pytest.mark.parametrize(
    ("name", "parameters", "readings", "holds"),
    [
        ("light", (0.5,), Readings(light_x=0.0, light_y=-1.0), True),
        ("light", (0.5,), Readings(), False),
        ("obstacle", (0.5,), Readings(proximity_x=0.5), True),
        ("obstacle", (0.5,), Readings(proximity_x=0.49), False),
        ("obstacle", (0.5,), Readings(proximity_x=-0.6, proximity_y=-0.1), True),  # behind on the right
        ("obstacle", (0.5,), Readings(proximity_x=-0.6, proximity_y=0.1), False),
        ("close to neighbours", (0.5, 0.3), Readings(neighbours_x=0.3), True),
        ("close to neighbours", (0.5, 0.3), Readings(neighbours_x=0.3, neighbours_y=0.1), False),
        ("close to neighbours", (0.5, 0.3), Readings(), True),
    ],
)
def test_conditions_that_only_trees_have(name, parameters, readings, holds):
    robot = Robot(TreeNode("sequence", (condition(name, *parameters),)))
    for u in (0.0, 0.49):
        robot.cycle(readings, u)
        assert robot.status == (SUCCESS if holds else FAILURE)
    robot.cycle(readings, 0.5)
    assert robot.status == FAILURE


def test_a_tree_senses_what_any_of_its_leaves_reads():
    tree = Robot(TreeNode("selector", (condition("black floor", 0.5), action("attraction", 2.0)))).tree
    assert tree.reads == {"ground", "neighbours", "proximity"}
    assert len({*tree.program().reads}) == 1
