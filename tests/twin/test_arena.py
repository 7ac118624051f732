"""The twin's arena: robots move and measure as in the simulator."""

import dataclasses
import math

import numpy as np
import pytest

from mercator_design.errors import MissionError
from mercator_design.jit import compiled
from mercator_design.robot.devices.samples import STREAMED
from mercator_design.robot.protocols.rvr_streaming import streaming
from mercator_design.robot.protocols.ydlidar import Turns, decoder, encode_command
from mercator_design.sim import devices
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.robot_parts import Gaussian
from mercator_design.twin import arena as of_arenas
from mercator_design.twin.arena import MEASURED, TREADS, without_noise
from mercator_design.twin.devices import lidar
from mercator_design.twin.devices.lidar import TwinLidar
from tests.sim.worlds import look
from tests.twin.arenas import MERCATOR, QUIET, Talk, arena

pytestmark = pytest.mark.together("kernels")  # compiled once

POSES = [(0.2, 0.1, 0.7), (-0.3, 0.4, -2.0), (0.5, -0.5, 3.0)]
LIGHT = ("lights=[{position: [0.5, 0.2, 1], intensity: 5}]",)
ROOM = ("arena.walls={shape: regular_polygon, sides: 4, apothem: 1.0}", "arena.wall_height=0.3")
FLOOR = "{background: gray, zones: [{name: z, shape: disc, center: [0.2, 0.1], radius: 0.2, color: red}]}"


class TestMeasuring:
    @pytest.mark.parametrize("device", MEASURED)
    def test_of_robots_at_rest_it_is_the_simulators(self, device):
        given = {"robots": len(POSES), "floor": FLOOR, "overrides": LIGHT}
        place = "{shape: poses, poses: " + str([list(pose) for pose in POSES]) + "}"
        simulated = look(QUIET, placement=place, **given).recording.measure(device)[0].reshape(len(POSES), -1)
        here = arena(*POSES, floor=FLOOR, overrides=LIGHT)
        for _ in range(here.cycle):
            here.step([(0.0, 0.0)] * 3)
        for robot in range(3):
            assert here.measure(robot, device) == pytest.approx(simulated[robot].tolist(), abs=1e-12)

    def test_of_robots_that_move(self):
        here = arena((0.0, 0.0, 0.5))
        for _ in range(100):
            here.step([(0.1, 0.2)])
        turn = 0.1 / MERCATOR.drive.tread_distance
        assert here.measure(0, "gyroscope") == pytest.approx([0.0, 0.0, turn])
        x, y = here.measure(0, "velocity")
        assert math.hypot(x, y) == pytest.approx(0.15)
        assert math.atan2(y, x) == pytest.approx(math.pi / 2 + here.poses[0, 2] - 0.5)
        assert here.measure(0, "imu")[2] == pytest.approx(here.poses[0, 2])
        assert here.measure(0, "locator") == pytest.approx(here.poses[0, :2].tolist())
        left, right = here.measure(0, TREADS)
        assert (right - left) / MERCATOR.drive.tread_distance == pytest.approx(here.poses[0, 2] - 0.5)
        assert 0.13 < 0.5 * (left + right) < 0.15

    def test_axes_have_y_forwards_whatever_the_model_has(self):
        along_x = dataclasses.replace(QUIET, velocity=dataclasses.replace(QUIET.velocity, forward="x"))
        found = []
        for model in (QUIET, along_x):
            here = arena((0.0, 0.0, 0.0), robot_model=model)
            for _ in range(50):
                here.step([(0.2, 0.2)])
            found.append(here.measure(0, "velocity"))
        assert found[0] == pytest.approx([0.0, 0.2], abs=1e-9)
        assert found[1] == pytest.approx(found[0])

    def test_noise_is_other_in_each_tick_and_the_same_for_a_seed(self):
        noisy = dataclasses.replace(QUIET, imu=dataclasses.replace(QUIET.imu, noise=Gaussian(sd=0.1)))
        rows = []
        for seed in (1, 1, 2):
            here = arena((0.0, 0.0, 0.0), robot_model=noisy, seed=seed)
            rows.append([])
            for _ in range(20):
                here.step([(0.0, 0.0)])
                rows[-1].append(here.measure(0, "imu")[2])
        assert rows[0] == rows[1]
        assert rows[0] != rows[2]
        assert len(set(rows[0])) == 20

    def test_without_noise(self):
        def noises(part):
            if dataclasses.is_dataclass(part):
                for field in dataclasses.fields(part):
                    value = getattr(part, field.name)
                    yield from [value] if "noise" in field.name else noises(value)

        shaken = load_robot_model("mercator-pseudo-reality")
        assert any(noises(shaken))
        assert not any(noises(without_noise(shaken)))
        assert without_noise(shaken).body == shaken.body

    def test_a_model_that_lacks_a_device(self):
        with pytest.raises(
            MissionError, match=r"^robot model mercator: a twin needs all devices; missing: imu, locator$"
        ):
            arena((0, 0, 0), robot_model=dataclasses.replace(MERCATOR, imu=None, locator=None))
        with pytest.raises(MissionError, match="robot model epuck: a twin needs all devices; missing: lidar, "):
            arena((0, 0, 0), robot_model=load_robot_model("epuck"))

    def test_a_model_with_other_proximity_sensors(self):
        ring = dataclasses.replace(MERCATOR.proximity, angles=(0.0, 1.0))
        with pytest.raises(MissionError, match=r"^robot model mercator: a hub has 8 proximity sensors, found 2$"):
            arena((0, 0, 0), robot_model=dataclasses.replace(MERCATOR, proximity=ring))


class TestTheLidar:
    def test_a_turn_is_the_simulators(self):
        """What is seen is as far, at the nearest beam, but for edges, of which one sample in 100 is."""
        room = ("arena.room={shape: regular_polygon, sides: 4, apothem: 2.4}",)
        place = "{shape: poses, poses: " + str([list(pose) for pose in POSES]) + "}"
        simulated = look(QUIET, robots=3, placement=place, overrides=room).recording.measure("lidar")[0, 0]
        here = arena(*POSES, overrides=room)
        lidar = TwinLidar(lambda time: here.scan(0, time), samples=here.samples)
        lidar.set_motor(on=True, now=-1.0)
        sent = lidar.receive(encode_command("scan"), 0.0) + lidar.advance(0.5)
        turns = Turns()
        _, *packets = decoder().receive(sent)
        (turn, *_) = [turn for packet in packets if (turn := turns.receive(packet))]
        beams = len(simulated)
        assert len(turn) == beams
        off = []
        for angle, found in turn:
            place = (angle + math.pi) / (2.0 * math.pi) * beams  # the simulator's first beam looks backwards
            k = math.floor(place)
            between = [simulated[k % beams], simulated[(k + 1) % beams]]
            off.append(abs(found - np.interp(place - k, [0.0, 1.0], between)))
        assert np.median(off) < 0.001
        assert np.mean(np.array(off) < 0.01) > 0.97
        heads = [r for _, r in turn if 0.0 < r < 1.5]
        assert len(heads) == pytest.approx(np.sum((simulated > 0.0) & (simulated < 1.5)), abs=2)

    @pytest.mark.parametrize("treads", [(-0.29, 0.29), (0.29, -0.29)])
    def test_a_sample_sees_from_where_the_robot_is_at_its_time(self, treads):
        """Robots turn by 33 degrees in a turn of the lidar: by its end, walls seem to be elsewhere."""
        here = arena((0.3, -0.2, 0.0), overrides=ROOM)
        lidar = TwinLidar(lambda time: here.scan(0, time), samples=here.samples)
        lidar.set_motor(on=True, now=-1.0)
        sent, poses = lidar.receive(encode_command("scan"), 0.0), [here.poses[0].copy()]
        for tick in range(1, 101):
            here.step([treads])
            sent += lidar.advance(tick * here.period)
            poses.append(here.poses[0].copy())
        _, *packets = decoder().receive(sent)
        assert abs(poses[-1][2]) > 3.0
        times, off, skewed, sample = here.period * np.arange(101), [], [], 0
        for packet in packets:
            for k, (angle, found) in enumerate(packet.points()):
                x, y, heading = (np.interp((sample + k) / 5000, times, each) for each in np.transpose(poses))
                off.append(max(abs(x + found * math.cos(heading + angle)), abs(y + found * math.sin(heading + angle))))
                skewed.append(max(abs(x + found * math.cos(angle)), abs(y + found * math.sin(angle))))
            sample += len(packet.samples)
        assert sample > 4500
        assert np.abs(np.array(off) - 1.0)[np.array(off) > 0.0].max() < 0.02
        assert np.median(np.abs(np.array(off) - 1.0)) < 0.002
        assert np.abs(np.array(skewed) - 1.0).max() > 0.2


class TestMoving:
    def test_odometry_drifts_as_the_robot_model_says(self):
        imu = dataclasses.replace(QUIET.imu, bias=0.2)
        locator = dataclasses.replace(QUIET.locator, scale_errors=(0.04, 0.04))
        here = arena((0.0, 0.0, 0.0), robot_model=dataclasses.replace(QUIET, imu=imu, locator=locator))
        for _ in range(200):
            here.step([(0.2, 0.2)])
        (x, _, heading), way = here.poses[0], math.hypot(*here.measure(0, "locator"))
        *_, yaw = here.measure(0, "imu")
        assert abs(yaw - heading) > 1e-3
        expected = x * (1.04 if way > x else 0.96) * math.sin(0.5 * yaw) / (0.5 * yaw)  # on an arc
        assert way == pytest.approx(expected, rel=0.02)
        assert here.measure(0, "quaternion")[3] == pytest.approx(math.sin(0.5 * yaw))

    def test_where_the_treads_take_it(self):
        here = arena((0.0, 0.0, 0.0), (0.0, 0.6, 1.0))
        for _ in range(300):
            here.step([(0.2, 0.2), (-0.1, 0.1)])
        (x, y, heading), (x_2, y_2, heading_2) = here.poses
        assert (x, y, heading) == pytest.approx((0.2 * (3.0 - 0.5 * 0.2 / 0.75), 0.0, 0.0), abs=0.002)
        assert (x_2, y_2) == pytest.approx((0.0, 0.6))
        assert heading_2 == pytest.approx(1.0 + 3.0 * 0.2 / MERCATOR.drive.tread_distance, abs=0.05)

    def test_not_through_walls(self):
        here = arena((0.9, 0.0, 0.0))
        for _ in range(300):
            here.step([(2.0, 2.0)])
        assert here.poses[0, 0] + MERCATOR.body.corner < 1.35
        assert here.poses[0, 0] > 1.0

    def test_the_treads_noise(self):
        drive = dataclasses.replace(QUIET.drive, noise=Gaussian(sd=0.2))
        here = arena((0.0, 0.0, 0.0), robot_model=dataclasses.replace(QUIET, drive=drive))
        for _ in range(200):
            here.step([(0.2, 0.2)])
        assert here.poses[0, 2] != 0.0
        assert here.poses[0, 0] == pytest.approx(0.37, abs=0.1)

    def test_a_floor_that_changes(self):
        """With time: it turns black after a second."""
        floor = (
            "{background: gray, zones: [{name: z, shape: disc, center: [0, 0], radius: 0.5, color: red}], "
            "dynamics: [{name: schedule, zones: [z], times: [1.0], colors: [black]}]}"
        )
        here = arena((0.0, 0.0, 0.0), floor=floor)
        seen = []
        for _ in range(200):
            here.step([(0.0, 0.0)])
            seen.append(here.measure(0, "ground_sensors")[0])
        assert seen[:95] == [255.0] * 95
        assert seen[105:] == [0.0] * 95


def test_all_that_is_compiled_is_compiled_in_the_rehearsal(monkeypatch):
    """Not in the first control cycle of a robot, which would be 0.4 s late."""
    used = set()
    for module in (of_arenas, lidar, devices):
        monkeypatch.setattr(module, "compiled", lambda kernel: used.add(kernel.__qualname__) or compiled(kernel))
    arena(*POSES, robot_model=MERCATOR).rehearse()
    rehearsed = used.copy()
    talk = Talk(*POSES, robot_model=MERCATOR)
    talk.robot.note_port("lidar", is_open=True, now=0.0)
    for name, target, values in streaming(STREAMED, 50):
        talk.send(name, target=target, **values)
    talk.hear("lidar", encode_command("scan"))
    talk.drive(0.1, 0.2, 1.5)
    assert {"change_floor", "put", "note_poses"} <= rehearsed
    assert used == rehearsed
