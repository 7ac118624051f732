"""What the nodes of a tree did on a robot, from its log."""

import numpy as np

from mercator_design.results.experiments.robot_logs import read_logs
from mercator_design.sim.robot_model import load_robot_model

RING = (
    "--nroot 3 --nchildroot 2 --n0 0 --nchild0 2 --n00 6 --c00 5 --p00 0.2 --n01 5 --a01 0 --rwm01 5 --p01 0 "
    "--n1 0 --nchild1 2 --n10 6 --c10 5 --p10 0.2 --n11 5 --a11 1 --p11 0"
)
RUNNING = 1


def test_the_branch_of_each_cycle_is_found_again(robot):
    robot.run(RING, "--flavour", "maple", "--duration", "4")
    log, model = robot.folder / "log.jsonl", load_robot_model("mercator")
    shown = read_logs([log], model, simulator=None, seed=1, starts=(), warn=lambda _: None)
    assert set(np.unique(shown.trace.states)) == {0, 3, 6}
    branches = {0: set(), 3: {0, 1, 3}, 6: {0, 4, 6}}
    for statuses, state in zip(shown.activity[:, 0], shown.trace.states[:, 0], strict=True):
        assert set(np.flatnonzero(statuses == RUNNING)) == branches[state]
