"""The engine's short cuts are equal in distribution to all robots in Chipmunk's space, and more iterations."""

import pytest

from benchmarks import same_distribution
from mercator_design.jit import jittable
from mercator_design.sim.kernels import kernel
from mercator_design.sim.kernels.motion import glide
from tests.tiers import cases

pytestmark = pytest.mark.together("kernels")  # compiled once

FALSE_ALARM = 1e-6  # chance of a rejection if nothing differs, over the choice of seeds
PUSHING = "8 that push, the original's constants, 20 s"


@jittable
def late(scene, swarm):
    """`kernel.begin_motion`, but a robot is in the space only once its centre is near another, or a wall."""
    kernel.aim(scene, swarm)
    for i in range(len(swarm.poses)):
        close = False
        for j in range(len(swarm.poses)):
            x, y = swarm.poses[i, 0] - swarm.poses[j, 0], swarm.poses[i, 1] - swarm.poses[j, 1]
            close = close or (i != j and x * x + y * y < 4.0 * scene.half_width * scene.half_width)
        for k in range(len(scene.walls)):
            wall = scene.walls
            x, y = swarm.poses[i, 0] - wall[k, 0], swarm.poses[i, 1] - wall[k, 1]
            close = close or x * wall[k, 4] + y * wall[k, 5] < scene.half_width
        swarm.close[i] = close
        for k in range(3):
            swarm.former[i, k] = swarm.poses[i, k]
    return 0


@jittable
def glide_others(scene, swarm, meetings, step):
    """`kernel.begin_step`, but no more robots enter the space."""
    for i in range(len(swarm.poses)):
        if not swarm.close[i]:
            glide(scene, swarm, i, 1)


@pytest.mark.thorough
def test_robots_that_meet_too_late_are_found(capsys, monkeypatch):
    """Twenty experiments tell robots that are in the space a little later than they touch something."""
    engine = same_distribution.as_it_is  # compiled before
    engine(same_distribution.CROWDS[PUSHING], 1)
    monkeypatch.setattr(kernel, "begin_step", glide_others)
    monkeypatch.setattr(same_distribution, "CHECKED", 1)
    same = same_distribution.compare(20, rate=FALSE_ALARM, jobs=1, seed=1, crowds=[PUSHING], mark=late)
    assert not same
    assert "NOT reached" in capsys.readouterr().out


@pytest.mark.thorough
def test_few_experiments_of_all_crowds(capsys):
    assert same_distribution.main(["--experiments", "1", "--rate", str(FALSE_ALARM), "--jobs", "1"]) == 0
    text = capsys.readouterr().out
    assert "reached: 0 reject" in text
    for crowd in same_distribution.CROWDS:
        assert f"| {crowd} (" in text


@pytest.mark.thorough
def test_the_short_cuts_are_equal_in_distribution():
    """TEST_EFFORT=40 makes as many experiments as there are in docs/explanation/benchmarks.md."""
    assert same_distribution.main(["--experiments", str(len(cases(50))), "--rate", str(FALSE_ALARM)]) == 0
