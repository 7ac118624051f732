"""Refines all keyframes of a component together: random pairs of keyframes by their points, odometry, and sightings."""

import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mercator_design.arrays import Floats, Numbers
from mercator_design.jit import compiled
from mercator_design.mapping.frames.fragment import Fragment
from mercator_design.mapping.joint.kernels import (
    N_BINS,
    add_motion_factors,
    add_point_factors,
    add_sighting_factors,
)
from mercator_design.mapping.joint.pairing import pairs_of_nodes
from mercator_design.mapping.joint.sightings import SightingFactors, sighting_factors
from mercator_design.mapping.joint.solving import solve
from mercator_design.mapping.joint.uncertainty import sampled
from mercator_design.mapping.poses import between, compose, interpolate, wrap
from mercator_design.mapping.track import Points

ROUNDS = 6
STEPS = 2
"""Steps of Gauss and Newton in a round."""
GATES, SCALES = (0.25, 0.05), (0.10, 0.015)
"""[m] In the first and the last round: between points that match, and of residuals in the weight."""
NEIGHBOURS, SPARSE_NEIGHBOURS = 6, 12
"""Keyframes with which each one is compared in a round, beside the one before it."""
POINT_SD, SPARSE_POINT_SD = 0.06, 0.3
"""[m] Larger than the lidar's noise, as the points of a pair share errors: together they must not overrule odometry."""
SIGHTING_SD = 0.015
"""[m]"""

_SPARSE = 0.3
"""[m] Between keyframes of a log that is sparse."""
_MAX_POINTS = 120
"""Points of a keyframe that are compared with another one."""
_MIN_SHARE = 0.25
_SCALE_LIMITS = 0.7, 1.4
_MIN_DRIVEN = 0.25
"""[m^2] Sum of the squared steps of a robot that tells its scale."""


class Refined(NamedTuple):
    """Poses of keyframes in the frame of the component."""

    poses: list[Floats]  # of each part: (k, 3) of its keyframes
    scales: list[float]  # of each part: the factor of its odometry's distances
    lengths: list[float]  # [m^2] of each part, by which its robot's scale is known: 0 if the robot stands
    pairs: int  # pairs of keyframes that held in the last round
    sightings: int
    motions: Floats  # (samples, sum of k, 3) draws of small motions of the keyframes, as uncertain as they are


class _Nodes(NamedTuple):
    """All keyframes of a component, in the order of parts and times."""

    parts: Numbers  # (k,)
    times: Floats  # (k,) [s] on the robot's clock
    poses: Floats  # (k, 3)
    first: Numbers  # (k + 1,)
    points: Points  # (p, 2), those of a keyframe in the order of bearings
    normals: Points
    bins: NDArray[np.int32]  # (k, N_BINS + 1)


def refine(
    parts: Sequence[Fragment],
    frames: Floats,
    offsets: Floats,
    generator: np.random.Generator,
    *,
    clocks: Numbers | None = None,
    with_sightings: bool = True,
    rounds: int = ROUNDS,
    samples: int = 0,
    report: Callable[[float], None] | None = None,
) -> Refined:
    """Refine the keyframes of the parts of a component.

    Args:
        parts: The fragments.
        frames: (parts, 3) where they stand.
        offsets: (parts,) [s] of their clocks.
        generator: Draws the pairs.
        clocks: (parts,) the offsets of two parts are known to each other if these are the same; None: all are.
        with_sightings: Whether sightings of robots count.
        rounds: Each has new pairs.
        samples: How many draws there are of how uncertain the poses are.
        report: Called with the share that is done.
    """
    tied = np.zeros(len(parts), np.int64) if clocks is None else clocks
    nodes = _nodes(parts, frames)
    poses = nodes.poses.copy()
    robots = [next(k for k, other in enumerate(parts) if part.is_of_robot(other)) for part in parts]
    scales, lengths = [part.track.scale for part in parts], [0.0] * len(parts)
    edges, raw = _motions(parts, nodes)
    seen = (
        sighting_factors(parts, frames, offsets, _keyframe_times(parts), tied)
        if with_sightings
        else SightingFactors.none()
    )
    is_sparse = bool(len(raw) and np.median(np.hypot(raw[:, 0], raw[:, 1])) > _SPARSE)
    sigma, wanted = (SPARSE_POINT_SD, SPARSE_NEIGHBOURS) if is_sparse else (POINT_SD, NEIGHBOURS)
    held, motions = 0, np.zeros((samples, len(poses), 3))
    for number in range(rounds if len(poses) > 1 else 0):
        progress = number / max(rounds - 1, 1)
        gate, scale = (low * (high / low) ** progress for low, high in (GATES, SCALES))
        pairs = np.ascontiguousarray(
            np.concatenate([edges, pairs_of_nodes(poses, nodes.parts, wanted, generator)]), dtype=np.int64
        )
        measured = _scaled(raw, [scales[k] for k in nodes.parts[edges[:, 0]]])
        for _ in range(STEPS):
            held, equations = _equations(nodes, poses, pairs, edges, measured, seen, gate, scale, sigma)
            poses = compose(poses, solve(poses, *equations))
            poses[:, 2] = wrap(poses[:, 2])
        scales, lengths = _estimated_scales(robots, scales, nodes, poses, edges, raw)
        if number == rounds - 1:
            together, information, _ = equations
            motions = sampled(poses, together, information, samples, generator)
        if report:
            report((number + 1) / rounds)
    ends = np.searchsorted(nodes.parts, np.arange(len(parts) + 1))
    found = [poses[low:high] for low, high in itertools.pairwise(ends)]
    return Refined(found, scales, lengths, held, len(seen.pairs), motions)


def _keyframe_times(parts: Sequence[Fragment]) -> list[Floats]:
    found = []
    for part in parts:
        keyframes = part.track.keyframes
        found.append(part.track.times[keyframes.turns[keyframes.segments == part.segment]])
    return found


def _nodes(parts: Sequence[Fragment], frames: Floats) -> _Nodes:
    numbers, poses, points, normals, first, bins = [], [], [], [], [0], []
    for number, (part, frame) in enumerate(zip(parts, frames, strict=True)):
        keyframes = part.track.keyframes
        for k in np.flatnonzero(keyframes.segments == part.segment):
            own, across = keyframes.of(int(k))
            place = (np.arctan2(own[:, 1], own[:, 0]).astype(float) / (2.0 * math.pi) + 0.5) * N_BINS
            at = np.floor(place).astype(np.int64) % N_BINS
            order = np.argsort(at, kind="stable")
            numbers.append(number)
            poses.append(compose(frame, keyframes.poses[k]))
            points.append(own[order])
            normals.append(across[order])
            first.append(first[-1] + len(own))
            bins.append(np.searchsorted(at[order], np.arange(N_BINS + 1)).astype(np.int32))
    times = _keyframe_times(parts)
    nothing = np.empty((0, 2), dtype=np.float32)
    return _Nodes(
        np.array(numbers, dtype=np.int64),
        np.concatenate(times) if times else np.empty(0),
        np.array(poses, dtype=float).reshape(-1, 3),
        np.array(first, dtype=np.int64),
        np.ascontiguousarray(np.concatenate([nothing, *points])),
        np.ascontiguousarray(np.concatenate([nothing, *normals])),
        np.array(bins, dtype=np.int32).reshape(-1, N_BINS + 1),
    )


def _motions(parts: Sequence[Fragment], nodes: _Nodes) -> tuple[Numbers, Floats]:
    """Pairs (m, 2) of each keyframe and the one before it in its part, and how odometry moves (m, 3), unscaled."""
    later = np.flatnonzero(nodes.parts[1:] == nodes.parts[:-1]) + 1
    raw = np.zeros((len(nodes.parts), 3))
    for number, part in enumerate(parts):
        own = nodes.parts == number
        raw[own] = interpolate(part.track.log.odometry_times, part.track.log.odometry, nodes.times[own])
    return np.column_stack([later, later - 1]), between(raw[later - 1], raw[later])


def _scaled(raw: Floats, scales: Sequence[float]) -> Floats:
    factor = np.asarray(scales, dtype=float)
    return np.column_stack([raw[:, 0] * factor, raw[:, 1] * factor, raw[:, 2]])


def _deviations(motions: Floats) -> Floats:
    """Standard deviations (m, 3) of measured motions, whose scale is known."""
    step, turned = np.hypot(motions[:, 0], motions[:, 1]), np.abs(motions[:, 2])
    place = 0.01 + 0.04 * step
    return np.column_stack([place, place, 0.02 + 0.03 * turned + 0.04 * step])


def _equations(
    nodes: _Nodes,
    poses: Floats,
    pairs: Numbers,
    edges: Numbers,
    measured: Floats,
    seen: SightingFactors,
    gate: float,
    scale: float,
    sigma: float,
) -> tuple[int, tuple[Numbers, Floats, Floats]]:
    """How many pairs hold, and the pairs (m, 2), information (m, 3, 3) and gradients (m, 3) of all factors."""
    n, m = len(pairs), len(edges)
    together = np.concatenate([pairs, edges, seen.pairs])
    information, gradients = np.zeros((len(together), 3, 3)), np.zeros((len(together), 3))
    held = compiled(add_point_factors)(
        *(poses, pairs, nodes.points, nodes.normals, nodes.first, nodes.bins),
        *(_MAX_POINTS, gate, scale, sigma, _MIN_SHARE),
        *(np.zeros((10, 3)), information[:n], gradients[:n]),
    )
    compiled(add_motion_factors)(
        poses, edges, measured, _deviations(measured), information[n : n + m], gradients[n : n + m]
    )
    compiled(add_sighting_factors)(
        *(poses, seen.pairs, seen.heads, seen.places, SIGHTING_SD, 3.0 * SIGHTING_SD),
        *(information[n + m :], gradients[n + m :]),
    )
    return held, (together, information, gradients)


def _estimated_scales(
    robots: Sequence[int], known: Sequence[float], nodes: _Nodes, poses: Floats, edges: Numbers, raw: Floats
) -> tuple[list[float], list[float]]:
    """The factors of the odometries' distances that fit the map best, and the squares of these; of each part.

    Args:
        robots: The first part of the robot of each part.
        known: Of each part; a robot that hardly drives keeps it.
        nodes: The keyframes.
        poses: (k, 3)
        edges: (m, 2)
        raw: (m, 3) motions by odometry.
    """
    moved = between(poses[edges[:, 1]], poses[edges[:, 0]])
    scales, lengths = list(known), [0.0] * len(robots)
    of_edges = np.array(robots)[nodes.parts[edges[:, 0]]]
    for robot in sorted(set(robots)):
        own = of_edges == robot
        length = float(np.sum(raw[own, :2] ** 2))
        if length > _MIN_DRIVEN:
            factor = float(np.clip(float(np.sum(moved[own, :2] * raw[own, :2])) / length, *_SCALE_LIMITS))
            for k in range(len(robots)):
                if robots[k] == robot:
                    scales[k], lengths[k] = factor, length
    return scales, lengths
