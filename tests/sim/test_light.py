"""The direction of lights: the ring of the e-puck, the camera of Chocolate on Mercator, and what hides a light."""

import dataclasses
import math

import numpy as np
import pytest

from mercator_design.fsm import parse
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.robot_parts import Gaussian, LightCamera, LightRing, Uniform
from tests.sim.worlds import STOP, at, look, simulator

pytestmark = pytest.mark.together("kernels")  # compiled once

MERCATOR = load_robot_model("mercator")
CHOCOLATE = dataclasses.replace(load_robot_model("mercator-chocolate"), light=LightCamera(height=0.154, range=13.57))
EPUCK = load_robot_model("epuck")
ANGLES = EPUCK.light.angles
HIGH = 0.5  # [m]


def with_ring(model=EPUCK, **changes):
    return dataclasses.replace(model, light=dataclasses.replace(EPUCK.light, **{"noise": None, **changes}))


def lights(*rows, seen_by=None):
    """An override: lights at (x, y, z, intensity)."""
    seen = "" if seen_by is None else f", seen_by: {seen_by}"
    return "lights=[" + ", ".join(f"{{position: [{x}, {y}, {z}], intensity: {i}{seen}}}" for x, y, z, i in rows) + "]"


def towards(model, *rows, pose=(0, 0, 0), seen_by=None, overrides=(), **world):
    """The vector towards the light that the first robot reads."""
    world = {"apothem": 3.0, "placement": at(pose), **world}
    outcome = look(model, overrides=[lights(*rows, seen_by=seen_by), *overrides], **world)
    return outcome.history.readings[0, 0, 8:10]


def ring_law(*rows, pose=(0, 0, 0), height=0.001, threshold=0.2):
    """What the ring reads by argos3-epuck, and the direction by the reference model 1.2."""
    readings = np.zeros(8)
    for x, y, z, intensity in rows:
        away = math.dist((x, y, z), (*pose[:2], height)) / intensity
        bearing = math.atan2(y - pose[1], x - pose[0]) - pose[2]
        for k, angle in enumerate(ANGLES):
            off = abs(math.remainder(bearing - angle, 2 * math.pi))
            if away <= 2.5 and off < math.pi / 2:
                readings[k] += math.exp(-2 * away) * (1 - 2 * off / math.pi)
    readings = readings.clip(0, 1)
    vector = np.array([readings @ np.cos(ANGLES), readings @ np.sin(ANGLES)])
    return vector / np.linalg.norm(vector) if (readings > threshold).any() else np.zeros(2)


class TestRing:
    @pytest.mark.parametrize("bearing", np.linspace(-3.1, 3.1, 9).tolist())
    @pytest.mark.parametrize("pose", [(0, 0, 0), (0.4, -0.7, 2.5)])
    def test_one_light(self, bearing, pose):
        light = (pose[0] + math.cos(bearing), pose[1] + math.sin(bearing), HIGH, 2.0)
        assert towards(with_ring(), light, pose=pose) == pytest.approx(ring_law(light, pose=pose))
        vector = towards(with_ring(), light, pose=pose)
        assert np.linalg.norm(vector) == pytest.approx(1.0)
        # The sensors are not evenly spaced, so the vector is only near the truth.
        assert abs(math.remainder(math.atan2(*vector[::-1]) - bearing + pose[2], 2 * math.pi)) < 0.35

    def test_lights_add_up_to_one_at_most(self):
        few = [(1, 0.2, HIGH, 2.0), (-0.3, 1.5, 1.0, 4.0), (0.5, -2.0, 0.75, 5.0)]
        assert towards(with_ring(), *few) == pytest.approx(ring_law(*few))
        many = [(0.5, 0.1, 0.1, 20.0)] * 3 + [(-0.1, -0.8, 0.1, 20.0)]
        assert towards(with_ring(), *many) == pytest.approx(ring_law(*many))

    @pytest.mark.parametrize(("intensity", "perceived"), [(0.99, False), (1.01, True)])
    def test_a_light_is_perceived_above_the_threshold(self, intensity, perceived):
        """In the direction of a sensor it reads exp(-2 x): 0.2 at x = 0.805."""
        away, height = 0.8047, 0.001
        light = (away * math.cos(ANGLES[2]), away * math.sin(ANGLES[2]), height, intensity)
        assert towards(with_ring(), light).any() == perceived

    @pytest.mark.parametrize(("away", "perceived"), [(2.49, True), (2.51, False)])
    def test_the_reach(self, away, perceived):
        """exp(-2 * 2.5) is far below 0.2, so another decay and threshold."""
        model = with_ring(decay=0.1)
        light = (0.0, away, 0.001, 1.0)
        assert towards(model, light).any() == perceived
        assert towards(with_ring(decay=0.1, reach=2.6), light).any()

    def test_the_range_is_horizontal(self):
        light = (0.0, 1.0, 2.0, 9.0)
        assert towards(with_ring(range=1.01), light).any()
        assert not towards(with_ring(range=0.99), light).any()

    def test_a_light_of_no_intensity_is_none(self):
        assert not towards(with_ring(), (1, 0, HIGH, 0.0)).any()
        assert not towards(with_ring()).any()

    def test_noise(self):
        """Uniform on each of eight readings of one sensor: 5000 cycles; moments within six standard errors, < 1e-8.

        A ring of one sensor reads a direction of 1 or 0: above the threshold in a known share of cycles.
        """
        ring = LightRing(angles=(0.0,), height=0.001, noise=Uniform(half_width=0.1))
        model = dataclasses.replace(EPUCK, light=ring)
        away = -math.log(0.17) / 2  # reads 0.17, so above 0.2 with chance 0.35
        ready = simulator(
            duration=500,
            apothem=3.0,
            robot_model=model,
            placement=at((0, 0, 0)),
            overrides=[lights((away, 0, 0.001, 1.0))],
        )
        found = ready.run(STOP, 1, record=True).history.readings[:, 0, 8]
        assert set(found) == {0.0, 1.0}
        assert found.mean() == pytest.approx(0.35, abs=6 * math.sqrt(0.35 * 0.65 / 5000))
        assert abs(np.corrcoef(found[1:], found[:-1])[0, 1]) < 6 / math.sqrt(5000)


class TestCamera:
    def test_the_direction_of_the_vectors_to_the_lights_added_up(self):
        pose = (0.5, -0.2, 1.0)
        rows = [(1.5, 1.0, 0.1, 1.0), (-1.0, 0.3, 2.0, 9.0)]
        vectors = []
        for x, y, *_ in rows:
            away, bearing = math.hypot(x - 0.5, y + 0.2), math.atan2(y + 0.2, x - 0.5) - 1.0
            vectors.append([away * math.cos(bearing), away * math.sin(bearing)])
        assert towards(CHOCOLATE, rows[0], pose=pose) == pytest.approx(vectors[0] / np.linalg.norm(vectors[0]))
        both = np.sum(vectors, axis=0)
        assert towards(CHOCOLATE, *rows, pose=pose) == pytest.approx(both / np.linalg.norm(both))
        assert not towards(CHOCOLATE, (1, 0, 1, 1.0), (-1, 0, 1, 1.0)).any()  # they cancel

    def test_its_range(self):
        for range_, seen in [(1.01, True), (0.99, False)]:
            model = dataclasses.replace(CHOCOLATE, light=LightCamera(height=0.154, range=range_))
            assert towards(model, (0, 1, 5.0, 0.1)).any() == seen

    def test_noise_turns_the_vector(self):
        """An error of d N(0, 0.2) in any direction: of the sine of the angle, 10 000 times; six standard errors."""
        light = LightCamera(height=0.154, range=10.0, noise=Gaussian(sd=0.2))
        model = dataclasses.replace(CHOCOLATE, light=light)
        world = {"apothem": 3.0, "placement": at((0, 0, 0)), "overrides": [lights((1.5, 0, 1, 1.0))]}
        outcome = simulator(duration=1000, robot_model=model, **world).run(STOP, 1, record=True)
        x, y = outcome.history.readings[:, 0, 8:10].T
        assert np.hypot(x, y) == pytest.approx(1.0)
        random = np.random.default_rng(1)
        size, angle = 0.2 * random.standard_normal(1_000_000), random.uniform(0, 2 * math.pi, 1_000_000)
        expected = size * np.sin(angle) / np.hypot(1 + size * np.cos(angle), size * np.sin(angle))
        n = len(y)
        assert y.mean() == pytest.approx(0, abs=6 * expected.std() / math.sqrt(n))
        assert (y**2).mean() == pytest.approx((expected**2).mean(), abs=6.1 * (expected**2).std() / math.sqrt(n))


@pytest.mark.parametrize("model", [with_ring(), CHOCOLATE], ids=["ring", "camera"])
def test_some_lights_are_seen_by_some_robots_only(model):
    world = {"robots": 3, "apothem": 3.0, "placement": at((0, 0, 0), (1, 0, 0), (-1, 0, 0))}
    outcome = look(model, overrides=[lights((0.2, 1, HIGH, 5.0), seen_by=[0, 2])], **world)
    assert outcome.history.readings[0, :, 8:10].any(axis=1).tolist() == [True, False, True]


def hides(height, light, model=None, **world):
    """Whether a box of a height 0.5 m ahead hides a light from a robot at the origin."""
    box = f"[{{center: [0.5, 0], size: [0.02, 0.5], height: {height}}}]"
    return not towards(model or with_ring(), light, obstacles=box, **world).any()


class TestOcclusion:
    """The sensors of the e-puck are at 1 mm: a box at 0.49 m hides what is below a line over its nearer edge."""

    def test_a_low_box_hides_a_low_light_and_not_a_high_one(self):
        away, height = 1.0, 0.08
        line = 0.001 + (height - 0.001) / 0.49 * away
        assert hides(height, (away, 0, line - 0.01, 3.0))
        assert not hides(height, (away, 0, line + 0.01, 3.0))

    def test_the_farther_the_light_the_higher_it_must_be(self):
        assert not hides(0.08, (1.0, 0, 0.3, 3.0))
        assert hides(0.08, (2.8, 0, 0.3, 9.0))

    def test_a_box_beside_or_behind_the_light_hides_nothing(self):
        assert not hides(1.0, (0, 1.0, 0.05, 3.0))
        assert not hides(1.0, (0.4, 0, 0.05, 3.0))
        assert not hides(1.0, (-1.0, 0, 0.05, 3.0))

    def test_a_switch(self):
        assert not hides(1.0, (1.0, 0, 0.05, 3.0), with_ring(occlusion=False))

    def test_a_sensor_above_the_light_looks_down_on_it(self):
        """From 0.5 m on a light at 0.1 m, 1 m away: the line passes the nearer edge of the box at 0.304 m."""
        model = with_ring(height=0.5)
        assert not hides(0.29, (1.0, 0, 0.1, 3.0), model)
        # The far edge decides, at 0.51 m: 0.296 m.
        assert hides(0.297, (1.0, 0, 0.1, 3.0), model)
        assert hides(0.35, (1.0, 0, 0.1, 3.0), model)

    @pytest.mark.parametrize(("z", "seen"), [(0.2, False), (0.5, True)])
    def test_the_arenas_walls_hide_what_is_outside_and_low(self, z, seen):
        """A wall of 0.08 m at 0.5 m; the light 2 m away: it must be above 0.317 m."""
        vector = towards(with_ring(), (2.0, 0, z, 6.0), sides=4, apothem=0.5)
        assert vector.any() == seen

    def test_a_wall_of_a_corner_inwards(self):
        walls = "arena.walls={shape: polygon, vertices: [[-1, -1], [1, -1], [1, 1], [0, 0], [-1, 1]]}"
        world = {"pose": (-0.3, 0.06, 0.78), "overrides": [walls]}
        assert not towards(with_ring(), (0.5, 0.06, 0.05, 3.0), **world).any()
        assert towards(with_ring(), (0.5, 0.06, 0.5, 3.0), **world).any()

    @pytest.mark.parametrize("model", [with_ring(), with_ring(MERCATOR)], ids=["disc", "box"])
    def test_the_body_of_another_robot(self, model):
        half, height = (0.035, 0.076) if model.body == EPUCK.body else (0.143, 0.114)
        near = 0.6 - half
        line = 0.001 + (height - 0.001) / near * 1.2
        for z, seen in [(line - 0.01, False), (line + 0.01, True)]:
            world = {"robots": 2, "placement": at((0, 0, 0), (0.6, 0, 0))}
            assert towards(model, (1.2, 0, z, 3.0), **world).any() == seen
        aside = {"robots": 2, "placement": at((0, 0, 0), (0.6, half + 0.01, 0))}
        assert towards(model, (1.2, 0, 0.05, 3.0), **aside).any()

    def test_a_light_on_a_robots_own_body_is_not_hidden_by_it(self):
        assert towards(with_ring(MERCATOR), (0.1, 0, 0.05, 3.0)).any()


PHOTOTAXIS = parse("--nstates 1 --s0 2", flavour="chocolate")
ANTI_PHOTOTAXIS = parse("--nstates 1 --s0 3", flavour="chocolate")


@pytest.mark.parametrize("name", ["epuck", "mercator-chocolate"])
def test_phototaxis_goes_to_the_light_and_anti_phototaxis_away(name):
    """Five robots from anywhere near the middle, in each of six experiments."""
    scale = 0.4 if name == "epuck" else 1.0
    light = np.array([-1.2, 0.3]) * scale
    world = simulator(
        robots=5,
        duration=30,
        apothem=2.2 * scale,
        robot_model=load_robot_model(name),
        placement=f"{{shape: disc, radius: {0.7 * scale}}}",
        overrides=[lights((*light, 0.3, 5.0))],
    )

    def distances(pfsm, seed):
        poses = world.run(pfsm, seed).trace.poses[[0, -1], :, :2]
        return np.linalg.norm(poses - light, axis=2).mean(axis=1)

    for seed in range(6):
        start, end = distances(PHOTOTAXIS, seed)
        assert end < 0.5 * start
        start, end = distances(ANTI_PHOTOTAXIS, seed)
        assert end > 1.6 * start


@pytest.mark.parametrize("name", ["epuck", "mercator-chocolate"])
def test_compiled_engine_referee_and_plain_python_agree(name, monkeypatch):
    """With lights, noise, memory, votes, losses: all that this robot has."""
    light = LightCamera(height=0.154, range=5.0, occlusion=True, noise=Gaussian(sd=0.1))
    model = load_robot_model(name)
    model = model if name == "epuck" else dataclasses.replace(model, light=light)
    box = "[{center: [0.3, 0.3], size: [0.1, 0.1], height: 0.3}]"
    world = simulator(
        robots=4,
        duration=3,
        obstacles=box,
        robot_model=model,
        placement="{shape: disc, radius: 0.6}",
        overrides=[lights((0.8, 0.7, 0.4, 3.0), (-0.5, 0.9, 0.1, 2.0), seen_by=[0, 1, 3])],
    )
    compiled = world.run(PHOTOTAXIS, 1, record=True)
    assert 0 < np.abs(compiled.history.readings[..., 8]).mean() < 1
    others = [world.run(PHOTOTAXIS, 1, record=True, referee=True)]
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    others.append(world.run(PHOTOTAXIS, 1, record=True))
    for name_ in compiled.history._fields:
        for other in others:
            assert np.array_equal(getattr(compiled.history, name_), getattr(other.history, name_)), name_


def test_a_camera_sees_no_light_above_its_view():
    beacon = "[{{position: [1, 0, {height}], kind: beacon}}]"
    model = load_robot_model("mercator-chocolate")
    for height, seen in ((0.3, True), (0.31, False)):
        world = simulator(
            duration=0.1,
            apothem=3.0,
            robot_model=model,
            placement=at((0, 0, 0)),
            overrides=[f"lights={beacon.format(height=height)}"],
        )
        readings = world.run(parse("--nstates 1 --s0 1", "chocolate"), 1, record=True).history.readings
        assert readings[0, 0, 8] == (1.0 if seen else 0.0)
