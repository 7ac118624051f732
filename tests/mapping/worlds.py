"""Robots that drive along curves between straight walls, and what their lidars see: without the simulator."""

import math

import numpy as np

from mercator_design.mapping.front.scans import Preparation
from mercator_design.mapping.logs import RobotLog, Turn
from mercator_design.mapping.poses import between, compose, interpolate, inverse, transform
from mercator_design.mapping.track import Clusters, Keyframes, Track

HEAD = 0.035
PERIOD = 1.0 / 7.0
BEAMS = 360
NOTHING = np.empty((0, 2), dtype=np.float32)


def room(corners):
    """The walls (n, 4) of a polygon."""
    corners = np.asarray(corners, float)
    return np.column_stack([corners, np.roll(corners, -1, axis=0)])


def polygon(sides, apothem):
    """The walls of a regular polygon around the origin."""
    angles = math.pi * (2.0 * np.arange(sides) + 1.0) / sides
    return room(apothem / math.cos(math.pi / sides) * np.column_stack([np.cos(angles), np.sin(angles)]))


class Curve:
    """A robot's way: a Lissajous curve, heading along it."""

    def __init__(self, generator, centre=(0.0, 0.0), size=(1.0, 1.0), speed=0.15):
        self._centre, self._size = np.array(centre), np.array(size)
        self._rates = generator.uniform(0.7, 1.3, 2) * speed / self._size
        self._phases = generator.uniform(-math.pi, math.pi, 2)

    def at(self, times):
        """Poses (n, 3); the headings are unwrapped if the times are dense."""
        angles = np.asarray(times, float)[:, None] * self._rates + self._phases
        place = self._centre + self._size * np.sin(angles)
        speed = self._size * self._rates * np.cos(angles)
        return np.column_stack([place, np.unwrap(np.arctan2(speed[:, 1], speed[:, 0]))])


class Still:
    """A robot that stands."""

    def __init__(self, pose):
        self._pose = np.array(pose, float)

    def at(self, times):
        return np.tile(self._pose, (len(times), 1))


class Carried:
    """A robot that somebody carries elsewhere at some time: its way goes on from there, moved in the world."""

    def __init__(self, way, moment, motion):
        self.driven, self._moment, self._motion = way, moment, np.array(motion)

    def at(self, times):
        driven = self.driven.at(times)
        return np.where((np.asarray(times) < self._moment)[:, None], driven, compose(self._motion, driven))


def cast(origins, directions, walls, heads):
    """Ranges (n,) of rays from origins (n, 2) to walls (m, 4) and heads (k, n, 2), and the head that is hit or -1."""
    c, s = np.cos(directions), np.sin(directions)
    nearest, which = np.full(len(origins), 12.0), np.full(len(origins), -1)
    for x1, y1, x2, y2 in walls:
        ex, ey = x2 - x1, y2 - y1
        determinant = c * ey - s * ex
        with np.errstate(divide="ignore", invalid="ignore"):
            dx, dy = x1 - origins[:, 0], y1 - origins[:, 1]
            along, share = (dx * ey - dy * ex) / determinant, (dx * s - dy * c) / determinant
        hit = (along > 0.0) & (share >= 0.0) & (share <= 1.0) & (along < nearest)
        nearest[hit] = along[hit]
    for number, head in enumerate(heads):
        dx, dy = (head - origins).T
        forward, aside = dx * c + dy * s, dy * c - dx * s
        inside = HEAD**2 - aside**2
        along = forward - np.sqrt(np.maximum(inside, 0.0))
        hit = (inside > 0.0) & (along > 0.0) & (along < nearest)
        nearest[hit], which[hit] = along[hit], number
    return nearest, which


def seen(ways, number, walls, duration, generator, *, noise=0.005, clock=0.0, missing=0.0, begin=0.0):
    """The turns of a robot's lidar with times of its own clock, and the clusters of heads as the front end finds them.

    Returns:
        the turns; for each cluster (turn, time, x, y in the robot's frame at the middle of the turn, beams).
    """
    turns, clusters = [], []
    for turn in range(int(duration / PERIOD)):
        if generator.uniform() < missing:
            continue
        times = begin + PERIOD * (turn + np.arange(BEAMS) / BEAMS)
        angles = -2.0 * math.pi * np.arange(BEAMS) / BEAMS
        poses = ways[number].at(times)
        others = [way.at(times)[:, :2] for k, way in enumerate(ways) if k != number]
        ranges, which = cast(poses[:, :2], poses[:, 2] + angles, walls, others)
        ranges = ranges + generator.uniform(-noise, noise, BEAMS)
        middle = poses[BEAMS // 2]
        for head in range(len(others)):
            beams = np.flatnonzero(which == head)
            if len(beams) < 2 or np.ptp(beams) > BEAMS // 2:
                continue
            across = poses[beams, 2] + angles[beams]
            hits = poses[beams, :2] + ranges[beams, None] * np.column_stack([np.cos(across), np.sin(across)])
            x, y = transform(inverse(middle), hits.mean(axis=0)[None])[0]
            clusters.append((len(turns), times[beams].mean() + clock, x, y, len(beams)))
        turns.append(Turn(times + clock, angles, ranges))
    return turns, clusters


def drifting_log(ways, number, walls, duration, seed, *, scale=1.04, **options):
    """The log of a robot whose odometry is too long by a factor, and whose heading walks by 1 degree/sqrt(m)."""
    generator = np.random.default_rng([seed, number])
    turns, _ = seen(ways, number, walls, duration, generator, **options)
    clock, begin = options.get("clock", 0.0), options.get("begin", 0.0)
    times = np.arange(begin - 0.2, begin + duration + 0.2, 0.05)
    truth = ways[number].at(times)
    driven = getattr(ways[number], "driven", ways[number]).at(times)  # odometry does not feel that a robot is carried
    steps = between(driven[:-1], driven[1:])
    steps[:, :2] *= scale
    steps[:, 2] += generator.normal(0.0, math.radians(1.0), len(steps)) * np.sqrt(np.hypot(*steps[:, :2].T))
    odometry = np.zeros((len(times), 3))
    for k, step in enumerate(steps):
        odometry[k + 1] = compose(odometry[k], step)
    return RobotLog(f"robot {number}", turns, times + clock, odometry, truth_times=times + clock, truth=truth)


def perfect_track(ways, number, walls, duration, seed, *, clock=0.0, missing=0.0, begin=0.0, error=0.001):
    """A robot's track as a front end makes it, nearly without error; its frame begins at the robot's first turn."""
    generator = np.random.default_rng([seed, number])
    turns, clusters = seen(ways, number, walls, duration, generator, clock=clock, missing=missing, begin=begin)
    times = np.arange(begin - 0.2, begin + duration + 0.2, 0.05)
    truth = ways[number].at(times)
    odometry = compose(inverse(truth[0]), truth)
    log = RobotLog(f"robot {number}", turns, times + clock, odometry, truth_times=times + clock, truth=truth)
    middles = np.array([turn.middle for turn in turns])
    poses = interpolate(times + clock, odometry, middles) + generator.normal(0.0, error, (len(turns), 3))
    poses = between(poses[0], poses)
    poses[:, 2] = np.unwrap(poses[:, 2])
    rows = np.array([row for row, *_ in clusters], dtype=np.int64)
    found = Clusters(
        rows,
        np.array([one[1] for one in clusters]),
        np.array([one[2:4] for one in clusters], dtype=np.float32).reshape(-1, 2),
        np.array([one[4] for one in clusters], dtype=np.int64),
    )
    nothing = np.zeros(len(turns), dtype=np.int64)
    return Track(log, middles, poses, nothing, np.ones(len(turns)), np.zeros(len(turns)), _keyframes(log, poses), found)


def _keyframes(log, poses, every=3):
    preparation = Preparation(log)
    chosen = np.arange(0, len(log.turns), every)
    first, points, normals = [0], [], []
    for k in chosen:
        scan = preparation.scan(int(k))
        points.append(scan.points.astype(np.float32))
        normals.append(scan.normals.astype(np.float32))
        first.append(first[-1] + len(scan.points))
    nowhere = np.zeros(len(chosen), dtype=np.int64)
    return Keyframes(chosen, poses[chosen], nowhere, np.array(first), np.concatenate(points), np.concatenate(normals))


def true_frame(tracks, a, b):
    """The pose of robot b's frame in that of robot a: both begin at the robots' first turns."""
    starts = [
        interpolate(track.log.truth_times, track.log.truth, track.times[:1])[0] for track in (tracks[a], tracks[b])
    ]
    return between(starts[0], starts[1])
