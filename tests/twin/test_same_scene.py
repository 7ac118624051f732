"""A robot of the twin perceives what a simulated one does in the same scene; see docs/explanation/twin.md."""

import dataclasses
import math

import pytest

from benchmarks.same_scene import BODY, HALF, MERCATOR, Unturned, World, angles_off, driven, motion_off, obstacle, pull
from benchmarks.twin_stepped import settings_of
from mercator_design.config.colours import COLOURS
from mercator_design.fsm import drive
from mercator_design.robot.protocols.multiflex import Distances
from mercator_design.robot.protocols.rvr_messages import Processor
from mercator_design.robot.protocols.rvr_streaming import StreamData
from mercator_design.robot.run.senses import Senses
from tests.tiers import some

pytestmark = pytest.mark.together("kernels")  # compiled once

ALONE = (0.0, 0.0, 0.0)


def senses(reads=("proximity",), **constants):
    model = dataclasses.replace(MERCATOR, reference_model=MERCATOR.reference_model._replace(**constants))
    return Senses(settings_of(model), reads, {"gray": COLOURS["gray"]})


def facing(yaw):
    """What the RVR tells when it stands still at a yaw [degrees]."""
    values = {"imu": {"pitch": 0.0, "roll": 0.0, "yaw": yaw}, "gyroscope": {"x": 0.0, "y": 0.0, "z": 0.0}}
    return StreamData(Processor.ST, 1, is_valid=True, values=values)


@pytest.mark.swept
@pytest.mark.parametrize("distance", some([0.02, 0.0495, 0.0505, 0.2, 0.39, 0.41], 2))
def test_a_wall(distance):
    """Distances come in millimetres, of which half a one weighs most where it is near: 0.0115 at 5 cm."""
    world = World([(HALF - BODY - distance, 0.0, 0.0)])
    simulated, perceived = world.simulated(), world.perceived()
    assert (simulated.proximity_x > 0.0) == (distance < 0.4)
    assert perceived[:2] == pytest.approx(simulated[:2], abs=0.0005 * 0.0572 / max(distance, 0.05) ** 2)


@pytest.mark.swept
@pytest.mark.parametrize(
    ("others", "count"),
    some(
        [
            ([(0.3, 0.0, 0.0)], 1),
            ([(0.77, 0.0, 0.0)], 1),  # a lidar measures to the side of a head that is seen
            ([(0.8, 0.0, 0.0)], 0),
            ([(0.35, 0.0, 0.0), (0.7, 0.0, 0.0)], 1),  # one behind the other
            ([(0.35, 0.0, 0.0), (0.69, 0.15, 0.0), (-0.5, 0.4, 1.0)], 3),
        ],
        2,
    ),
)
def test_neighbours(others, count):
    world = World([ALONE, *others])
    simulated, perceived = world.simulated(), world.perceived()
    assert simulated.neighbours == perceived.neighbours == count
    (length, angle), (found, towards) = pull(simulated), pull(perceived)
    assert found == pytest.approx(length, abs=0.004)
    assert math.remainder(towards - angle, math.tau) == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize(("away", "count"), [(0.5, 1), (0.9, 0)])
def test_a_wall_higher_than_the_lidar_is_a_neighbour(away, count):
    world = World([(HALF - away, 0.0, 0.0)], height=0.3)
    assert world.simulated().neighbours == world.perceived().neighbours == count


def test_the_first_readings_are_all_there():
    """On black, in front of a wall, with a neighbour."""
    world = World([(HALF - 0.3, 0.0, 0.0), (HALF - 0.3, 0.5, 0.0)])
    assert world.robots.robots[0].senses.stale(world.robots.now) == {}
    assert world.perceived() == pytest.approx(world.simulated(), abs=0.01)
    assert world.perceived()[5:8] == (0.0, 0.0, 0.0)


def test_obstacles_stay_where_they_are_while_the_robot_turns():
    """A quarter turn to the left after the hub has told of an obstacle in front: it is to the right."""
    robot = senses()
    robot.take(facing(0.0), 1.0)
    robot.take(Distances((65535, 200, *[65535] * 6)), 1.0)
    length, angle = obstacle(robot.readings(1.0))
    assert (length, angle) == (pytest.approx(0.143, abs=0.001), pytest.approx(0.0))
    robot.take(facing(90.0), 1.05)
    found, towards = obstacle(robot.readings(1.05))
    assert (found, towards) == (pytest.approx(length), pytest.approx(-math.pi / 2, abs=1e-6))
    robot.take(Distances((65535, 200, *[65535] * 6)), 1.16)
    assert obstacle(robot.readings(1.16))[1] == pytest.approx(0.0)


@pytest.mark.thorough
def test_a_robot_that_spins_by_a_wall():
    """Distances are up to 0.16 s old, in which it turns by 37 degrees."""
    wheels = [drive(-1.0, 1.0)]
    (median, most), (untold, _) = (
        (off[len(off) // 2], off[-1])
        for kind in (Senses, Unturned)
        for off in [sorted(angles_off(driven(World([(HALF - 0.33, 0.0, 0.0)], senses=kind), wheels, 4.0)))]
    )
    assert median < math.radians(6.0)
    assert most < math.radians(16.0)
    assert untold > math.radians(12.0)


@pytest.mark.thorough
def test_heading_and_place_follow_a_robot_that_drives():
    """The locator's samples are up to 60 ms old, in which a robot drives 18 mm; the heading is that of now."""
    for wheels in (drive(1.0, 1.0), drive(0.2, 1.0)):
        moments = [*driven(World([(-3.0, -1.0, 0.5)]), [wheels], 2.0)]
        turns, ways = motion_off(moments).T
        assert ways.max() < 0.02
        assert turns.max() < math.radians(3.0)
        last = moments[-1].perceived
        assert math.hypot(last.odometry_x, last.odometry_y) > 0.1
        assert (abs(last.heading) > 0.5) == (wheels.left < 1.0)


@pytest.mark.parametrize(("near", "needed"), [(0.0, False), (0.5, True)])
def test_who_reads_proximity_needs_the_lidar_where_neighbours_are_obstacles(near, needed):
    """As the simulator senses neighbours then: else a robot whose lidar fails would drive on blind."""
    assert ("lidar" in senses(neighbour_obstacle_range=near).stale(1.0)) == needed
