"""What the lidar reads, against every beam cast at every wall, box and disc."""

import dataclasses
import math

import numpy as np
import pytest

from mercator_design.sim.kernels.lidar import GROUP, _meet_disc, _meet_wall, scan
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.robot_parts import DiscBody, Neighbours, Uniform
from tests.sim.worlds import STOP, at, look, simulator
from tests.tiers import some

MERCATOR = load_robot_model("mercator")
TALL = "arena.wall_height=1.0"


def with_lidar(model=MERCATOR, **changes):
    """A model whose lidar may be one that sees no robots: so these are perceived by camera."""
    changes = {"noise": None, **changes}
    return dataclasses.replace(model, neighbours=Neighbours(), lidar=dataclasses.replace(model.lidar, **changes))


def turn(robot_model, **world):
    """One turn of each robot's lidar (robots, beams)."""
    return look(robot_model, **world).recording.measure("lidar")[0]


def distances_along(angles, origin, segments, discs):
    """Along each ray the distance to the nearest segment (n, 2, 2) or disc (n, 3); infinity if there is none."""
    ray = np.stack([np.cos(angles), np.sin(angles)], axis=1)[:, None]
    start, along = segments[:, 0] - origin, segments[:, 1] - segments[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        across = ray[..., 0] * along[:, 1] - ray[..., 1] * along[:, 0]
        distance = (start[:, 0] * along[:, 1] - start[:, 1] * along[:, 0]) / across
        place = (start[:, 0] * ray[..., 1] - start[:, 1] * ray[..., 0]) / across
        hit = (distance >= 0) & (place >= 0) & (place <= 1)
    found = np.where(hit, distance, np.inf).min(axis=1, initial=np.inf)
    to = discs[:, :2] - origin
    ahead = ray[..., 0] * to[:, 0] + ray[..., 1] * to[:, 1]
    past = ray[..., 0] * to[:, 1] - ray[..., 1] * to[:, 0]
    chord = np.sqrt(np.clip(discs[:, 2] ** 2 - past**2, 0, None))
    hit = (ahead > 0) & (np.abs(past) <= discs[:, 2])
    return np.minimum(found, np.where(hit, ahead - chord, np.inf).min(axis=1, initial=np.inf))


def sides_of(corners):
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


def in_the_way(mission, model, poses, i):
    """The segments and discs that the lidar of robot i may meet."""
    lidar, arena, body = model.lidar, mission.arena, model.body
    outlines = [box.corners() for box in arena.obstacles if box.height > lidar.height]
    outlines += [arena.corners()] * (arena.wall_height > lidar.height)
    outlines += [arena.room.corners()] if arena.room else []
    discs = []
    for x, y, heading in np.delete(poses, i, axis=0):
        if body.height <= lidar.height:
            discs.append((x, y, lidar.head_radius))
        elif isinstance(body, DiscBody):
            discs.append((x, y, body.radius))
        else:
            c, s = math.cos(heading), math.sin(heading)
            signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
            outlines.append([x, y] + signs * [body.length / 2, body.width / 2] @ np.array([[c, s], [-s, c]]))
    segments = [sides_of(corners) for corners in outlines]
    return np.concatenate([np.zeros((0, 2, 2)), *segments]), np.array(discs).reshape(-1, 3)


def check(world, model, seed):
    """Compare one turn of all robots' lidars with rays cast at everything; the number of beams that met something.

    A beam that passes within 1e-9 rad of an edge may fall on either side of it.
    """
    outcome = world.run(STOP, seed, record=True)
    found = outcome.recording.measure("lidar")[0]
    poses, lidar = outcome.trace.poses[1], model.lidar
    met = 0
    for i in range(len(poses)):
        segments, discs = in_the_way(world.mission, model, poses, i)
        angles = poses[i, 2] + lidar.first_angle + 2 * math.pi / lidar.beams * np.arange(lidar.beams)
        casts = np.array([distances_along(angles + off, poses[i, :2], segments, discs) for off in (-1e-9, 0, 1e-9)])
        casts -= lidar.ring_radius
        nearest, furthest = lidar.range
        casts = np.where((casts >= nearest) & (casts <= furthest), casts, 0.0)
        low, high = casts.min(axis=0) - 1e-7, casts.max(axis=0) + 1e-7
        assert ((low <= found[i]) & (found[i] <= high)).all()
        assert (high - low < 1e-4).mean() > 0.98
        met += (found[i] > 0).sum()
    return met


def random_arena(random):
    """Overrides: walls, convex or not; boxes lower and higher than the lidars; perhaps a room."""
    n = int(random.integers(5, 12))
    angles = np.sort((np.arange(n) + random.uniform(-0.25, 0.25, n)) * 2 * math.pi / n)
    radii = random.uniform(1.6, 3.2, n)
    vertices = np.round(np.column_stack([radii * np.cos(angles), radii * np.sin(angles)]), 3).tolist()
    boxes = []
    for _ in range(random.integers(0, 4)):
        x, y = random.uniform(-0.6, 0.6, 2)
        length, width = random.uniform(0.02, 0.5, 2)
        angle, height = random.uniform(-3, 3), random.choice([0.05, 0.14, 0.5])
        boxes.append(
            f"{{center: [{x:.3f}, {y:.3f}], size: [{length:.3f}, {width:.3f}], angle: {angle:.3f}, height: {height}}}"
        )
    overrides = [f"arena.walls={{shape: polygon, vertices: {vertices}}}", f"arena.obstacles=[{', '.join(boxes)}]"]
    overrides.append(f"arena.wall_height={random.choice([0.03, 0.08, 0.5])}")
    if random.random() < 0.5:
        overrides.append("arena.room={shape: regular_polygon, sides: 4, apothem: 3.3, rotation: 0.3}")
    return overrides


LIDARS = {
    "heads": with_lidar(),
    "bodies": with_lidar(height=0.04, ring_radius=0.035, first_angle=math.pi / 16, range=(0.1, 2.0)),
    "discs": with_lidar(
        dataclasses.replace(MERCATOR, body=DiscBody(radius=0.15, height=0.2, mass=2.0)), beams=97, first_angle=17.0
    ),
    "few beams": with_lidar(height=0.04, beams=8, first_angle=-0.3),
}


@pytest.mark.swept
@pytest.mark.parametrize("name", some(LIDARS, 1))
def test_every_beam_ends_where_geometry_says(name):
    random = np.random.default_rng(list(LIDARS).index(name))
    model = LIDARS[name]
    met = 0
    for seed in range(25):
        world = simulator(robots=6, duration=0.1, robot_model=model, overrides=random_arena(random))
        met += check(world, model, seed)
    assert met > 25 * 6 * model.lidar.beams * 0.05


@pytest.mark.parametrize(("beams", "sides"), [(8, 4), (24, 12), (720, 6)])
def test_no_beam_slips_through_a_corner(beams, sides):
    """Beams that go exactly to the corners of a regular polygon, whichever way the robot looks."""
    model = with_lidar(beams=beams, first_angle=0.0)
    for heading in (0.0, 2 * math.pi / sides, -math.pi / sides):
        found = turn(model, sides=sides, apothem=1.5, placement=at((0, 0, heading)), overrides=[TALL])[0]
        angles = heading + np.arange(beams) * 2 * math.pi / beams
        off = (angles + math.pi / sides) % (2 * math.pi / sides) - math.pi / sides
        assert found == pytest.approx(1.5 / np.cos(off), abs=1e-9)


@pytest.mark.parametrize(
    ("heading", "near", "direction"),
    [(2.919, 0.476, -2.938), (0.468, 0.432, -1.704), (-0.525, 0.751, -0.254), (-0.138, 0.402, 0.333)],
)
def test_a_wall_seen_edge_on_is_met_by_the_beams_along_it_at_most(heading, near, direction):
    """Whatever rounding makes of it: in these cases its two ends seem to lie in the wrong order."""
    lidar = simulator(robot_model=with_lidar()).instance(0).scene.lidar
    found = np.full(719, np.inf)
    x, y = math.cos(direction), math.sin(direction)
    far = near + 1.0
    _meet_wall(
        lidar,
        near * x,
        near * y,
        far * x,
        far * y,
        math.cos(heading),
        math.sin(heading),
        found,
        np.ones(45, dtype=bool),
    )
    assert np.isfinite(found).sum() <= 2
    assert found.min() > near - 1e-6


def test_a_large_disc_right_beside_a_lidar_of_few_beams_is_not_behind_it():
    model = with_lidar(beams=8, head_radius=0.3, range=(0.0, 12.0), first_angle=0.1)
    model = dataclasses.replace(model, body=DiscBody(radius=0.15, mass=2.0))
    for bearing in np.linspace(0.0, 6.2, 40):
        other = (0.3001 * math.cos(bearing), 0.3001 * math.sin(bearing), 0.0)
        scene = simulator(robots=2, robot_model=model, placement=at((0, 0, 0), other)).instance(0).scene
        found = np.full(8, np.inf)
        _meet_disc(scene.lidar, *other[:2], 0.3, 1.0, 0.0, found, np.ones(1, dtype=bool))
        beams = 0.1 + np.arange(8) * math.pi / 4
        assert np.isinf(found[np.cos(beams - bearing) < 0]).all()
        assert np.isfinite(found[np.cos(beams - bearing) > 0.03]).all()


def test_a_robot_that_touches_a_wall():
    """The wall is at 0.143 m from its centre: measured; and too near for a robot of half the size."""
    placement = at((2.0 - 0.14301, 0, 0))
    found = turn(with_lidar(beams=720), sides=4, apothem=2.0, placement=placement, overrides=[TALL])[0]
    assert found[360] == pytest.approx(0.14301)
    assert found[[180, 540]] == pytest.approx(2.0)
    small = dataclasses.replace(with_lidar(beams=720), body=DiscBody(radius=0.05, mass=1.0))
    found = turn(small, sides=4, apothem=2.0, placement=at((2.0 - 0.0501, 0, 0)), overrides=[TALL])[0]
    off = np.abs(np.arange(720) - 360) * 0.5 - math.degrees(math.acos(0.0501 / 0.1))
    assert not found[off < -0.5].any()
    assert found[off > 0.5].all()


@pytest.mark.parametrize(("apothem", "reads"), [(11.999, True), (12.001, False)])
def test_the_range_of_the_lidar(apothem, reads):
    found = turn(
        with_lidar(beams=8, first_angle=0.0), sides=4, apothem=apothem, overrides=[TALL], placement=at((0, 0, 0))
    )
    assert (found[0, ::2] > 0).all() == reads
    assert not found[0, 1::2].any()  # the corners are farther


def test_mercator_sees_heads_and_not_what_is_lower_than_its_lidar():
    """A 7 cm head at 1 m; a lower box before it, and walls and bodies of 8 and 11 cm, are not seen."""
    world = {
        "robots": 2,
        "apothem": 2.0,
        "placement": at((0, 0, 0), (1, 0, 1)),
        "obstacles": "[{center: [0.4, 0], size: [0.1, 0.5], height: 0.15}]",
    }
    found = turn(with_lidar(), **world)[0]
    assert (found > 0).sum() in {int(2 * math.asin(0.035) / (2 * math.pi / 719)), 9}
    assert found.max() <= 1.0
    assert found[found > 0].min() == pytest.approx(0.965, abs=3e-4)
    higher = {**world, "obstacles": "[{center: [0.4, 0], size: [0.1, 0.5], height: 0.16}]"}
    found = turn(with_lidar(), **higher)[0]
    assert found[359] == pytest.approx(0.35, abs=1e-4)
    assert found.max() < 0.5
    assert not turn(with_lidar(head_radius=0.0), **world).any()


def test_the_room_is_seen_over_low_walls():
    room = "arena.room={shape: regular_polygon, sides: 4, apothem: 3.0}"
    model = with_lidar(beams=8, first_angle=0.0)
    found = turn(model, sides=4, apothem=2.0, placement=at((0, 0, 0)), overrides=[room])[0]
    assert found[::2] == pytest.approx(3.0)
    found = turn(model, sides=4, apothem=2.0, placement=at((0, 0, 0)), overrides=[room, TALL])[0]
    assert found[::2] == pytest.approx(2.0)


def test_first_angle_and_ring():
    """The first beam goes where the model says; distances count from the ring."""
    model = with_lidar(beams=8, first_angle=math.pi / 2, ring_radius=0.035)
    found = turn(model, sides=4, apothem=2.0, placement=at((0.5, 0, 0)), overrides=[TALL])[0]
    assert found[[0, 2, 4, 6]] == pytest.approx([1.965, 2.465, 1.965, 1.465])


class TestNoise:
    """Uniform within 5 mm on what is measured; 719 beams of 40 cycles of 3 robots that see walls all around.

    86 280 draws. Bounds of six standard errors of mean and variance: chance below 1e-8 each.
    """

    def measured(self, **changes):
        model = with_lidar(**changes)
        placement = at((0, 0, 0), (0.6, 0, 1), (-0.6, 0.2, 2))
        world = simulator(robots=3, duration=4.0, robot_model=model, placement=placement, overrides=[TALL])
        return world.run(STOP, 5).recording.measure("lidar")

    def test_moments(self):
        noisy, quiet = self.measured(noise=Uniform(half_width=0.005)), self.measured()
        assert np.array_equal(noisy > 0, quiet > 0)
        errors = (noisy - quiet)[quiet > 0]
        n = len(errors)
        assert n == 86_280
        assert np.abs(errors).max() <= 0.005 + 1e-12
        sd = 0.005 / math.sqrt(3)
        assert errors.mean() == pytest.approx(0.0, abs=6 * sd / math.sqrt(n))
        assert (errors**2).mean() == pytest.approx(sd**2, abs=6 * math.sqrt(0.8) * sd**2 / math.sqrt(n))

    def test_beams_cycles_and_robots_draw_independently(self):
        """Correlations of at least 719 pairs, six standard errors, 1 + 1 + 1 of them: chance below 1e-8."""
        errors = self.measured(noise=Uniform(half_width=0.005)) - self.measured()
        for one, other in [
            (errors[1:], errors[:-1]),
            (errors[:, 1:], errors[:, :-1]),
            (errors[..., 1:], errors[..., :-1]),
        ]:
            correlation = np.corrcoef(one.ravel(), other.ravel())[0, 1]
            assert abs(correlation) < 6 / math.sqrt(one.size)

    def test_noise_stays_within_the_range_and_nothing_stays_nothing(self):
        noise = Uniform(half_width=3.0)
        found = self.measured(noise=noise, range=(0.1, 1.3))
        quiet = self.measured(range=(0.1, 1.3))
        assert found.max() == 1.3
        assert found.min() == 0.0
        assert not found[quiet == 0].any()


def test_compiled_and_plain_lidars_agree_to_the_last_bit():
    random = np.random.default_rng(3)
    for model in (MERCATOR, with_lidar(height=0.04, noise=Uniform(half_width=0.01))):
        world = simulator(robots=4, duration=0.3, robot_model=model, overrides=random_arena(random))
        outcome = world.run(STOP, 1)
        measured = outcome.recording.measure("lidar")
        assert measured.any()
        found, hits, covered = (
            np.zeros(719),
            np.zeros(719, dtype=np.int64),
            np.zeros(math.ceil(719 / GROUP), dtype=bool),
        )
        for cycle in range(3):
            poses = outcome.trace.poses[cycle + 1]
            rows = np.hstack([poses, np.cos(poses[:, 2:]), np.sin(poses[:, 2:])])
            for i in range(4):
                with np.errstate(over="ignore"):
                    key = outcome.recording.noise_keys[i]
                    scan(outcome.recording.scene, rows, i, key, cycle, found, hits, covered)
                assert np.array_equal(found, measured[cycle, i])
