"""What devices measured, against the equations of the Mercator paper (sections 4.2 and 4.3) on hand-made motion."""

import dataclasses
import itertools
import math

import numpy as np
import pytest

from mercator_design.errors import SimulationError
from mercator_design.fsm import parse
from mercator_design.missions.trace import every_nth
from mercator_design.modules.flavour import define_flavour
from mercator_design.modules.perception import ground_by_vote, light_direction, nearest_label, perceive
from mercator_design.modules.reference import N_READINGS
from mercator_design.sim import devices
from mercator_design.sim.devices import DEVICES, PARTS, Recording
from mercator_design.sim.kernels.noise import LIDAR_DRAWS, draw, noise
from mercator_design.sim.kernels.swarm import new_history
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.robot_parts import (
    AmbientLight,
    Gaussian,
    LidarNeighbours,
    LightCamera,
    LightRing,
    Neighbours,
    Uniform,
)
from tests.sim.test_light import lights
from tests.sim.worlds import STOP, at, look, simulator

pytestmark = pytest.mark.together("kernels")  # compiled once

MERCATOR = load_robot_model("mercator")
EXPLORE = parse("--nstates 1 --s0 0 --rwm0 20")
TWO_STATES = parse(
    "--nstates 2 --s0 0 --rwm0 20 --n0 1 --n0x0 0 --c0x0 5 --p0x0 0.2 --s1 1 --n1 1 --n1x0 0 --c1x0 5 --p1x0 0.2"
)
MOTION = ("velocity", "accelerometer", "gyroscope", "imu", "locator", "quaternion")
PERIOD = 0.1
WIDE = (-1e9, 1e9)


def device(name, **changes):
    """A device of Mercator's own motion, changed."""
    return dataclasses.replace(getattr(MERCATOR, name), **changes)


def with_device(name, **changes):
    """Mercator with one of them changed."""
    return dataclasses.replace(MERCATOR, **{name: device(name, **changes)})


def moved(poses, commands, robot_model=MERCATOR):
    """A recording of one robot that was at poses (cycles + 1, 3), under commands (cycles, 2)."""
    history = new_history(len(commands), 1, everything=True)
    history.poses[:, 0] = poses
    history.commands[:, 0] = commands
    scene = simulator().instance(0).scene
    return Recording(robot_model, scene, history, np.array([1], dtype=np.uint64), PERIOD)


def along(speed, turn, cycles=40, start=(0.3, -0.2, 2.0)):
    """Poses of a robot that goes along an arc, and the commands that make it."""
    times = PERIOD * np.arange(cycles + 1.0)
    headings = start[2] + turn * times
    if turn:
        x = start[0] + speed / turn * (np.sin(headings) - math.sin(start[2]))
        y = start[1] - speed / turn * (np.cos(headings) - math.cos(start[2]))
    else:
        x, y = start[0] + speed * times * math.cos(start[2]), start[1] + speed * times * math.sin(start[2])
    half = 0.5 * turn * 0.147
    return np.column_stack([x, y, headings]), np.tile([speed - half, speed + half], (cycles, 1))


MOTIONS = {"straight": along(0.3, 0.0), "spin": along(0.0, 4.08), "arc": along(0.2, -0.7), "back": along(-0.1, 0.4)}


def quaternion_about_z(angle):
    return np.array([math.cos(angle / 2), 0, 0, math.sin(angle / 2)])


def product(p, q):
    """The Hamilton product of two quaternions (w, x, y, z)."""
    a, u, b, v = p[0], p[1:], q[0], q[1:]
    return np.array([a * b - u @ v, *(a * v + b * u + np.cross(u, v))])


def inverse(q):
    return q * [1, -1, -1, -1]


def angle_about_z(q):
    w, x, y, z = q
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


@pytest.mark.parametrize("name", MOTIONS)
class TestMotion:
    @pytest.mark.parametrize(("forward", "quarter"), [("x", 0.0), ("y", math.pi / 2)])
    def test_velocity(self, name, forward, quarter):
        """Equations 3 to 5, of the treads' commanded speeds; or the y axis points forwards."""
        poses, commands = MOTIONS[name]
        found = moved(poses, commands, with_device("velocity", forward=forward)).measure("velocity")[:, 0]
        first = quaternion_about_z(poses[0, 2])
        for cycle, pose in enumerate(poses[1:]):
            speed = commands[cycle - 1].mean() if cycle else 0.0  # treads carry out the command before
            angle = angle_about_z(product(inverse(first), quaternion_about_z(pose[2]))) + quarter
            assert found[cycle] == pytest.approx([speed * math.cos(angle), speed * math.sin(angle)], abs=1e-12)

    @pytest.mark.parametrize("forward", ["x", "y"])
    def test_accelerometer(self, name, forward):
        """Equations 6 to 9: the change of that vector in a cycle, in g; gravity along z."""
        axes = {key: device(key, forward=forward) for key in ("velocity", "accelerometer")}
        recording = moved(*MOTIONS[name], dataclasses.replace(MERCATOR, **axes))
        found, before = recording.measure("accelerometer")[:, 0], np.zeros(2)
        for cycle, velocity in enumerate(recording.measure("velocity")[:, 0]):
            change = (velocity - before) / (9.81 * PERIOD)
            assert found[cycle] == pytest.approx([*change, 1.0], abs=1e-12)
            before = velocity

    def test_gyroscope(self, name):
        """Equations 10 and 11: the turn from the cycle before."""
        poses, commands = MOTIONS[name]
        found = moved(poses, commands).measure("gyroscope")[:, 0]
        for cycle in range(len(found)):
            before, now = (quaternion_about_z(poses[k, 2]) for k in (cycle, cycle + 1))
            turn = angle_about_z(product(now, inverse(before))) / PERIOD
            assert found[cycle] == pytest.approx([0, 0, turn], abs=1e-9)

    def test_imu(self, name):
        """4.2.5: against the world, whose north all share."""
        poses, commands = MOTIONS[name]
        found = moved(poses, commands).measure("imu")[:, 0]
        yaw = [angle_about_z(quaternion_about_z(heading)) for heading in poses[1:, 2]]
        assert found == pytest.approx(np.column_stack([np.zeros((len(yaw), 2)), yaw]), abs=1e-9)

    def test_locator(self, name):
        """Equation 12."""
        poses, commands = MOTIONS[name]
        assert moved(poses, commands).measure("locator")[:, 0] == pytest.approx(poses[1:, :2] - poses[0, :2])

    def test_quaternion(self, name):
        """Equation 13; a quaternion and its opposite are the same rotation."""
        poses, commands = MOTIONS[name]
        found = moved(poses, commands).measure("quaternion")[:, 0]
        first = quaternion_about_z(poses[0, 2])
        for now, heading in zip(found, poses[1:, 2], strict=True):
            expected = product(inverse(first), quaternion_about_z(heading))
            assert min(np.abs(now - expected).max(), np.abs(now + expected).max()) < 1e-12


def test_a_straight_drive_in_plain_numbers():
    """From heading 2: forwards is y whichever way the robot stood at the start; full speed is felt in one cycle."""
    recording = moved(*MOTIONS["straight"])
    assert recording.measure("velocity")[5, 0] == pytest.approx([0, 0.3], abs=1e-12)
    assert recording.measure("accelerometer")[:3, 0] == pytest.approx(
        np.array([[0, 0, 1], [0, 0.3 / 0.981, 1], [0, 0, 1]]), abs=1e-12
    )
    assert recording.measure("locator")[-1, 0] == pytest.approx([1.2 * math.cos(2), 1.2 * math.sin(2)])


def test_time_stamps():
    """Readings are those at the end of each cycle."""
    trace = look(duration=2.0).trace
    assert trace.times() == pytest.approx(np.arange(1, 21) / 10)
    assert trace.times(5) == pytest.approx([0.5, 1.0, 1.5, 2.0])
    assert len(trace.measure("imu", 5)) == 4


@pytest.mark.parametrize("name", MOTION)
def test_ranges(name):
    bounds = (-0.25, 0.125)
    recording = moved(*MOTIONS["arc"], with_device(name, range=bounds))
    clipped, free = recording.measure(name), moved(*MOTIONS["arc"]).measure(name)
    assert np.array_equal(clipped, free.clip(*bounds))
    assert not np.array_equal(clipped, free)
    noisy = with_device(name, range=bounds, noise=Gaussian(sd=9.0))
    found = moved(*MOTIONS["arc"], noisy).measure(name)
    assert (found.min(), found.max()) == bounds


class TestProximity:
    """Four walls at 0.3, 0.03, 2.5 m and a box at 0.2 m from the ring."""

    def test_distances_and_what_is_too_near_or_too_far(self):
        walls = "arena.walls={shape: polygon, vertices: [[-0.443, -0.173], [2.643, -0.173], [2.643, 3], [-0.443, 3]]}"
        box = "[{center: [0.0, 0.443], size: [0.3, 0.2]}]"
        found = look(placement=at((0, 0, 0)), obstacles=box, overrides=[walls]).recording.measure("proximity")[0, 0]
        front_left, front, front_right, right, back_right, back, back_left, left = found
        assert (front, right) == (math.inf, -math.inf)  # 2.5 and 0.03 m
        assert back == pytest.approx(0.3)
        assert left == pytest.approx(0.2)
        assert [front_right, back_right] == pytest.approx([0.173 * math.sqrt(2) - 0.143] * 2)
        assert back_left == pytest.approx(0.443 * math.sqrt(2) - 0.143)
        assert front_left == math.inf  # past the box, to a wall 2.643 m away

    @pytest.mark.parametrize(("gap", "reads"), [(0.0499, "near"), (0.0501, "it"), (1.9999, "it"), (2.0001, "far")])
    def test_limits(self, gap, reads):
        found = look(sides=4, apothem=3.0, placement=at((3.0 - 0.143 - gap, 0, 0))).recording.measure("proximity")
        assert found[0, 0, 1] == (pytest.approx(gap) if reads == "it" else -math.inf if reads == "near" else math.inf)

    def test_noise_is_on_what_is_measured_only(self):
        """5000 readings of 0.3 m; six standard errors, chance below 1e-8."""
        sensors = dataclasses.replace(MERCATOR.proximity, noise=Gaussian(mean=0.01, sd=0.02))
        model = dataclasses.replace(MERCATOR, proximity=sensors)
        world = simulator(robot_model=model, duration=500, sides=4, apothem=3.0, placement=at((2.557, 0, 0)))
        found = world.run(STOP, 1).recording.measure("proximity")[:, 0]
        assert found[:, 1].mean() == pytest.approx(0.31, abs=6 * 0.02 / math.sqrt(5000))
        assert found[:, 1].std() == pytest.approx(0.02, abs=6 * 0.02 / math.sqrt(10_000))
        assert (found[:, 5] == math.inf).all()


@pytest.mark.usefixtures("registries")
def test_what_is_measured_follows_from_the_constants_of_the_flavour():
    text = "schema: 1\nbehaviours: {stop: 1}\nconstants: {neighbour_range: 0.3}\n"
    define_flavour(text, "near")
    world = simulator(robots=2, duration=1, sides=4, apothem=3.0, placement=at((0, 0, 0), (0.5, 0, 0)))
    far, near = (world.run(parse("--nstates 1 --s0 1", one), 1).recording for one in ("watermelon", "near"))
    assert np.isfinite(far.measure("neighbour_places")).any()
    assert not np.isfinite(near.measure("neighbour_places")).any()


class TestAmbientLight:
    SENSOR = AmbientLight(position=(0.09, 0.02), height=0.05)

    def lux(self, *rows, sensor=SENSOR, pose=(0.2, 0.1, 1.0), overrides=(), **world):
        model = dataclasses.replace(MERCATOR, ambient_light=sensor)
        world = {"apothem": 3.0, "placement": at(pose), **world}
        recording = look(model, overrides=[lights(*rows), *overrides], **world).recording
        return recording.measure("ambient_light")[0, 0, 0]

    def test_the_law(self):
        """Each light adds 138.9171 + exp(-9.145603 x) lux at x = distance / intensity, up to x = 2.5."""
        pose = (0.2, 0.1, 1.0)
        c, s = math.cos(1.0), math.sin(1.0)
        place = (0.2 + 0.09 * c - 0.02 * s, 0.1 + 0.09 * s + 0.02 * c, 0.05)
        rows = [(1.0, 0.5, 0.8, 3.0), (-1.0, 0.2, 1.5, 2.0), (0.3, 0.2, 0.4, 5.0), (2.0, 2.0, 1.0, 0.5)]
        expected = 0.0
        for x, y, z, intensity in rows:
            away = math.dist(place, (x, y, z)) / intensity
            expected += 138.9171 + math.exp(-9.145603 * away) if away <= 2.5 else 0.0
        assert 3 * 138.9171 < expected < 4 * 138.9171  # the last one is out of reach
        assert self.lux(*rows, pose=pose) == pytest.approx(expected)

    def test_it_does_not_depend_on_the_heading_of_a_sensor_at_the_centre(self):
        sensor = AmbientLight(height=0.05)
        found = [self.lux((1, 1, 1, 2.0), sensor=sensor, pose=(0, 0, h)) for h in (0.0, 2.0, -1.0)]
        assert found == pytest.approx([found[0]] * 3)

    @pytest.mark.parametrize(("height", "dark"), [(0.06, False), (0.2, True)])
    def test_boxes_hide_lights(self, height, dark):
        """Over a box of 6 cm at 0.39 m the line to a light at 0.3 m, 0.91 m away, passes at 0.157 m."""
        box = f"[{{center: [0.5, 0], size: [0.04, 0.6], height: {height}}}]"
        assert (self.lux((1.0, 0, 0.3, 3.0), pose=(0, 0, 0), obstacles=box) == 0.0) == dark

    def test_robots_and_walls_hide_lights(self):
        low, high = (1.0, 0, 0.06, 3.0), (1.0, 0, 1.0, 3.0)
        other = {"robots": 2, "placement": at((0, 0, 0), (0.5, 0, 0))}
        assert [self.lux(low, **other), self.lux(high, **other) > 0] == [0.0, True]
        outside = {"pose": (0, 0, 0), "sides": 4, "apothem": 0.6}
        assert [self.lux(low, **outside), self.lux(high, **outside) > 0] == [0.0, True]
        assert self.lux(low, overrides=["arena.wall_height=0.055"], **outside) > 0

    def test_its_range(self):
        sensor = dataclasses.replace(self.SENSOR, range=(10.0, 200.0))
        assert self.lux(sensor=sensor) == 10.0
        assert self.lux((1, 1, 1, 5.0), (1, -1, 1, 5.0), sensor=sensor) == 200.0


def test_the_lidar_measures_what_neighbours_are_found_with():
    """Same draws: the noise of a beam in a cycle is number cycle * beams + beam of its device."""
    placement = at((0, 0, 0), (0.5, 0.1, 0))
    outcome = simulator(robots=2, duration=2.0, placement=placement).run(STOP, 1)
    quiet = dataclasses.replace(MERCATOR, lidar=dataclasses.replace(MERCATOR.lidar, noise=None))
    still = simulator(robots=2, duration=2.0, placement=placement, robot_model=quiet).run(STOP, 1)
    found, base = outcome.recording.measure("lidar"), still.recording.measure("lidar")
    row = outcome.recording.scene.lidar.noise
    with np.errstate(over="ignore"):
        for cycle, beam in itertools.product((0, 7, 19), np.flatnonzero(base[0, 0])):
            drawn = noise(row, outcome.recording.noise_keys[0], LIDAR_DRAWS, cycle * 719 + int(beam))
            assert found[cycle, 0, beam] == pytest.approx(base[0, 0, beam] + drawn, abs=1e-12)
        assert draw(outcome.recording.noise_keys[0], LIDAR_DRAWS, 3) != draw(
            outcome.recording.noise_keys[1], LIDAR_DRAWS, 3
        )


def test_the_points_of_the_lidar_lie_where_its_beams_ended():
    """On the walls of a square room, whichever way the robots look; nothing where nothing was measured."""
    lidar = dataclasses.replace(MERCATOR.lidar, noise=None, ring_radius=0.035, first_angle=0.7)
    model = dataclasses.replace(MERCATOR, lidar=lidar)
    placement = at((0.3, 0.2, 1.0), (-0.5, 0.1, -2.0))
    recording = look(
        model, robots=2, sides=4, apothem=1.5, placement=placement, overrides=["arena.wall_height=1"]
    ).recording
    points, distances = recording.measure("lidar_points")[0], recording.measure("lidar")[0]
    on_walls = np.abs(np.abs(points).max(axis=-1) - 1.5) < 1e-9
    head = np.array([[-0.5, 0.1], [0.3, 0.2]])[:, None]
    on_heads = np.abs(np.linalg.norm(points - head, axis=-1) - 0.035) < 1e-9
    assert (on_walls | on_heads).all()
    assert on_heads.any(axis=1).all()
    assert (distances > 0).all()
    assert np.isnan(look(model, sides=4, apothem=1.5, placement=at((0, 0, 0))).recording.measure("lidar_points")).all()


def test_wheels_are_as_set_with_noise():
    drive = dataclasses.replace(MERCATOR.drive, noise=Gaussian(sd=0.1))
    world = simulator(duration=100, apothem=900, robot_model=dataclasses.replace(MERCATOR, drive=drive))
    outcome = world.run(EXPLORE, 1, record=True)
    wheels = outcome.recording.measure("wheels")[:, 0]
    assert wheels.shape == (1000, 2)
    # 2000 draws; six standard errors, chance below 1e-8.
    shares = wheels / 0.3 - 1
    assert shares.mean() == pytest.approx(0, abs=6 * 0.1 / math.sqrt(2000))
    assert shares.std() == pytest.approx(0.1, abs=6 * 0.1 / math.sqrt(4000))
    assert abs(np.corrcoef(shares.T)[0, 1]) < 6 / math.sqrt(1000)
    # They move the robot one cycle later.
    velocity = np.linalg.norm(outcome.recording.measure("velocity")[1:, 0], axis=1)
    assert velocity == pytest.approx(wheels[:-1].mean(axis=1))


def test_leds_show_the_state():
    colours = ((0, 0, 0), (255, 1, 2), (3, 4, 5), (6, 7, 8))
    model = dataclasses.replace(MERCATOR, leds=dataclasses.replace(MERCATOR.leds, colors=colours))
    outcome = simulator(robots=2, duration=10, robot_model=model).run(TWO_STATES, 1)
    shown = outcome.recording.measure("leds")
    assert shown.shape == (100, 2, 5, 3)
    assert set(outcome.history.states.ravel()) == {0, 1}
    for state, colour in ((0, (0, 0, 0)), (1, (255, 1, 2))):
        assert (shown[outcome.history.states == state] == colour).all()


def test_the_ground_is_what_was_read():
    outcome = simulator(robots=2, duration=3).run(EXPLORE, 1, record=True)
    assert np.array_equal(outcome.recording.measure("ground"), outcome.history.readings[..., 5:8])


NOISY = dataclasses.replace(
    MERCATOR,
    **{name: device(name, range=WIDE, noise=Gaussian(mean=0.25, sd=0.5)) for name in MOTION},
    ambient_light=AmbientLight(height=0.05, range=WIDE, noise=Gaussian(mean=0.25, sd=0.5)),
    proximity=dataclasses.replace(MERCATOR.proximity, noise=Gaussian(sd=0.02), weight_noise=Gaussian(sd=0.02)),
    lidar=dataclasses.replace(MERCATOR.lidar, noise=Uniform(half_width=0.005)),
    drive=dataclasses.replace(MERCATOR.drive, noise=Gaussian(sd=0.05)),
    light=LightRing(angles=(0.1, 1.5, 3.0, 4.5), height=0.05, noise=Gaussian(sd=0.02)),
    neighbours=Neighbours(loss=0.2, noise=Gaussian(sd=0.1)),
)


@pytest.fixture(scope="module")
def noisy():
    world = simulator(robots=3, duration=30, robot_model=NOISY, overrides=[lights((0.5, 0.2, 1.0, 5.0))])
    return world.run(EXPLORE, 2, record=True).recording


@pytest.mark.parametrize("name", DEVICES)
class TestEveryDevice:
    @pytest.mark.parametrize("every", [7, 10, 1000])
    def test_every_tenth_cycle_is_measured_as_among_all(self, noisy, name, every):
        found = noisy.measure(name, every)
        cycles = sorted({*range(every, 301, every), 300})
        assert np.array_equal(found, noisy.measure(name)[np.array(cycles) - 1], equal_nan=True)
        assert (every_nth(300, every) + 1).tolist() == cycles

    def test_measuring_changes_nothing(self, noisy, name):
        before = [part.copy() for part in noisy.history]
        once = noisy.measure(name)
        once += 1.0  # what is returned is the caller's
        assert np.array_equal(noisy.measure(name) + 1.0, once, equal_nan=True)
        assert all(np.array_equal(*parts) for parts in zip(before, noisy.history, strict=True))

    def test_plain_python_measures_the_same(self, noisy, name, monkeypatch):
        compiled = noisy.measure(name, 60)
        monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
        assert np.array_equal(noisy.measure(name, 60), compiled, equal_nan=True)

    def test_a_robot_without_it(self, noisy, name):
        if name == "wheels":
            return
        without = dataclasses.replace(noisy, robot_model=dataclasses.replace(NOISY, **{PARTS[name]: None}))
        with pytest.raises(SimulationError, match=f"robot mercator has no {name.replace('_', ' ')}"):
            without.measure(name)

    def test_what_was_not_recorded(self, name):
        recording = simulator(duration=0.5, robot_model=NOISY).run(STOP, 1).recording
        if name in {"wheels", "ground", "neighbours", "light", "velocity", "accelerometer"}:
            with pytest.raises(SimulationError, match="record=True"):
                recording.measure(name)
        else:
            assert len(recording.measure(name)) == 5


def made(recording):
    """Readings (cycles, robots, fields), made by the robot's own functions of what its sensors measured."""
    model, scene = recording.robot_model.reference_model, recording.scene
    weights, places, lights = map(recording.measure, ("proximity_weights", "neighbour_places", "light_sensors"))
    levels, labels = recording.measure("ground_sensors"), scene.ground.labels.reshape(-1, 3)
    found = np.empty((*recording.history.states.shape, 10))
    for cycle, i in np.ndindex(recording.history.states.shape):
        near = places[cycle, i][~np.isnan(places[cycle, i, :, 0])]
        ground = levels[cycle, i].mean(axis=0)
        if len(labels):
            ground = labels[nearest_label(labels.ravel(), *ground)]
        if model.ground_vote_cycles:
            latest = levels[max(0, cycle - int(model.ground_vote_cycles) + 1) : cycle + 1, i, :, 0]
            blacks, whites = (latest < model.ground_vote_black).sum(), (latest > model.ground_vote_white).sum()
            ground = np.full(3, ground_by_vote(model, blacks, whites))
        found[cycle, i] = perceive(
            model,
            weights[cycle, i],
            scene.proximity.counts_x,
            scene.proximity.counts_y,
            near[:, 0],
            np.cos(near[:, 1]),
            np.sin(near[:, 1]),
            len(near),
            len(near),
            ground,
            light_direction(model, lights[cycle, i], scene.light.directions_x, scene.light.directions_y),
            [0.0] * N_READINGS,
        )[:10]
    return found


EPUCK = load_robot_model("epuck")
FORGETFUL = dataclasses.replace(EPUCK, reference_model=EPUCK.reference_model._replace(neighbour_memory=0.0))
LIDAR = dataclasses.replace(NOISY, neighbours=LidarNeighbours())


@pytest.mark.parametrize("model", [NOISY, LIDAR, FORGETFUL], ids=["camera", "lidar", "e-puck"])
def test_controllers_read_what_devices_measured(model):
    """Noise and losses included, on a floor that changes."""
    scale = 0.25 if model is FORGETFUL else 1.0
    spot = f"{{shape: disc, center: [0, 0], radius: {0.6 * scale}, color: black, name: spot}}"
    visited = "{name: visited, zones: [spot], color: gray, lasts: 3}"
    world = simulator(
        robots=4,
        duration=20,
        apothem=1.226 * scale,
        robot_model=model,
        placement=f"{{shape: disc, radius: {scale}}}",
        floor=f"{{background: white, zones: [{spot}], dynamics: [{visited}]}}",
        overrides=[lights((0.5, 0.2, 0.5, 2.0))],
    )
    outcome = world.run(EXPLORE, 3, record=True)
    read = outcome.history.readings[..., :10]  # the others: test_motion_senses.py
    assert made(outcome.recording) == pytest.approx(read, abs=1e-9)
    assert np.ptp(read[:, :, [0, 2, 3, 5, 8]], axis=(0, 1)).min() > 0.1  # each sense had something to read


def test_places_of_neighbours_are_by_robot():
    model = dataclasses.replace(MERCATOR, neighbours=Neighbours())
    placement = at((0, 0, 1.0), (0.5, 0, 0), (0, -1.0, 0))
    places = look(model, robots=3, placement=placement).recording.measure("neighbour_places")
    assert places.shape == (1, 3, 3, 2)
    assert places[0, 0, 1] == pytest.approx([0.5, -1.0])
    assert places[0, 1, 0] == pytest.approx([0.5, math.pi])
    seen = ~np.isnan(places[0, :, :, 0])
    assert seen.tolist() == [[False, True, False], [True, False, False], [False, False, False]]


def test_places_are_those_of_the_cycle_not_what_is_remembered():
    model = dataclasses.replace(EPUCK, neighbours=Neighbours(loss=0.5))
    recording = (
        simulator(robots=2, duration=20, apothem=0.5, robot_model=model, placement=at((0, 0, 0), (0.2, 0, 0)))
        .run(STOP, 1, record=True)
        .recording
    )
    counted = recording.measure("neighbours")[..., 0]  # the e-puck's count has no memory
    assert np.array_equal(counted, (~np.isnan(recording.measure("neighbour_places")[..., 0])).sum(axis=2))
    assert set(counted.ravel()) == {0.0, 1.0}


def test_a_camera_has_no_light_sensors():
    model = dataclasses.replace(MERCATOR, light=LightCamera(height=0.154, range=10.0))
    with pytest.raises(SimulationError, match="robot mercator has no light sensors"):
        look(model).recording.measure("light_sensors")


@pytest.mark.parametrize(
    ("shape", "names"),
    [
        ((2,), ("wheels", "velocity", "locator")),
        ((3,), ("ground", "accelerometer", "gyroscope", "imu")),
        ((4,), ("quaternion", "light_sensors")),
        ((8,), ("proximity", "proximity_weights")),
        ((1, 3), ("ground_sensors",)),
        ((3, 2), ("neighbour_places",)),
        ((719,), ("lidar",)),
        ((1,), ("ambient_light",)),
        ((5, 3), ("leds",)),
        ((719, 2), ("lidar_points",)),
    ],
)
def test_shapes(noisy, shape, names):
    for name in names:
        assert noisy.measure(name).shape == (300, 3, *shape)


def test_unknown_devices_are_named():
    with pytest.raises(SimulationError, match="expected a device: wheels, leds"):
        look().recording.measure("radar")


@pytest.mark.parametrize("every", [0, -1])
def test_every_counts_from_one(every):
    trace = look().trace
    for ask in (lambda: trace.measure("imu", every), lambda: trace.times(every)):
        with pytest.raises(SimulationError, match="every"):
            ask()


NOISES = {
    "gaussian": (Gaussian(mean=0.25, sd=0.5), 0.5, 3.0),
    "uniform": (Uniform(mean=0.25, half_width=0.5), 0.5 / math.sqrt(3), 1.8),
}


@pytest.mark.parametrize("kind", NOISES)
def test_moments_of_noise_and_independence(kind):
    """3000 cycles of two standing robots: errors of 18 values of seven devices each.

    Six standard errors for 36 means and as many variances, 6.5 for the correlations of 2556 pairs, with those of the
    cycle before: chance below 1e-6 for all together.
    """
    given, sd, kurtosis = NOISES[kind]
    devices = {name: device(name, range=WIDE, noise=given) for name in MOTION}
    model = dataclasses.replace(MERCATOR, ambient_light=AmbientLight(height=0.05, range=WIDE, noise=given), **devices)
    still = dataclasses.replace(MERCATOR, **{name: device(name, range=WIDE) for name in MOTION})
    world = {"robots": 2, "duration": 300, "placement": at((0, 0, 0.2), (0.6, 0, 1))}
    errors = []
    for name in (*MOTION, "ambient_light"):
        measured, exact = (
            simulator(robot_model=each, **world).run(STOP, 1, record=True).recording.measure(name)
            for each in (model, still)
        )
        errors.append((measured - exact).reshape(3000, -1))
    errors = np.hstack(errors)
    n, values = errors.shape
    assert values == 2 * (2 + 3 + 3 + 3 + 2 + 4 + 1)
    assert errors.mean(axis=0) == pytest.approx(np.full(values, 0.25), abs=6 * sd / math.sqrt(n))
    spread = math.sqrt(kurtosis - 1) * sd**2
    assert errors.var(axis=0) == pytest.approx(np.full(values, sd**2), abs=6 * spread / math.sqrt(n))
    if kind == "uniform":
        assert np.abs(errors - 0.25).max() <= 0.5
    both = np.hstack([errors[1:], errors[:-1]])
    correlation = np.corrcoef(both.T) - np.eye(2 * values)
    assert np.abs(correlation).max() < 6.5 / math.sqrt(n - 1)


@pytest.mark.parametrize(
    "name", ["mercator", "mercator-argos", "mercator-chocolate", "epuck", "mercator-pseudo-reality"]
)
def test_recording_gives_the_same_experiment(name):
    """It senses everything, where otherwise only what is read is sensed; two states read different senses."""
    pfsm = parse(
        "--nstates 2 --s0 0 --rwm0 20 --n0 1 --n0x0 0 --c0x0 3 --p0x0 1 --w0x0 9 "
        "--s1 4 --att1 3 --n1 1 --n1x0 0 --c1x0 0 --p1x0 0.5",
        flavour="chocolate",
    )
    scale = 0.25 if name == "epuck" else 1.0
    world = simulator(
        robots=6,
        duration=30,
        apothem=1.226 * scale,
        robot_model=load_robot_model(name),
        placement=f"{{shape: disc, radius: {scale}}}",
        floor=f"{{zones: [{{shape: disc, center: [0, 0], radius: {0.5 * scale}, color: black}}]}}",
    )
    for seed in range(3):
        alone, recorded = world.run(pfsm, seed), world.run(pfsm, seed, record=True)
        assert alone.score == recorded.score
        assert np.array_equal(alone.trace.poses, recorded.trace.poses)
        assert np.array_equal(alone.trace.states, recorded.trace.states)
        assert len(np.unique(alone.trace.states)) == 2


def test_what_would_be_too_large_is_refused_before_it_is_computed(monkeypatch):
    recording = simulator().run(STOP, 1, record=True).recording
    beams = len(recording.scene.lidar.beams_x)
    cycles, robots = recording.history.states.shape
    assert recording.values("lidar") == robots * beams
    monkeypatch.setattr(devices, "MAX_SIZE", 0)
    monkeypatch.setattr(devices, "fill_lidar", lambda scene, poses, *_: None if len(poses) == 1 else 1 / 0)
    size = math.ceil(cycles * robots * beams * 8 / 2**20)
    with pytest.raises(SimulationError, match=f"lidar: a recording of {size} MiB, expected at most 0 MiB; record"):
        recording.measure("lidar")
