"""Maps against the truth, for the benchmark of maps. Metres and degrees in what is returned, rounded."""

import math
from collections.abc import Sequence

import numpy as np

from benchmarks.mapping_logs import mission_of
from mercator_design import seeds
from mercator_design.arrays import Floats
from mercator_design.mapping.logs import RobotLog
from mercator_design.mapping.merit.occupancy import agreement
from mercator_design.mapping.merit.trajectories import near_pairs, relative_error, swarm_error
from mercator_design.mapping.plan.occupancy import occupancy_of
from mercator_design.mapping.plan.ways import Way
from mercator_design.mapping.poses import between, interpolate, transform, wrap
from mercator_design.mapping.track import Track
from mercator_design.missions.walls import walls_above

_LIDAR_HEIGHT = 0.154


def truth_of(log: RobotLog, times: Floats) -> Floats:
    """The true poses (n, 3) of a robot at times on its clock."""
    if log.truth_times is None or log.truth is None:
        raise ValueError(f"{log.name} has no true poses")
    return interpolate(log.truth_times, log.truth, times)


def pose_errors(ways: Sequence[Way], *, only_keyframes: bool) -> dict[str, float]:
    """The absolute error of the ways of one map; millimetres and degrees."""
    estimated, true = [], []
    for way in ways:
        rows = way.is_keyframe if only_keyframes else np.ones(len(way.times), dtype=np.bool_)
        estimated.append(way.poses[rows])
        true.append(truth_of(way.log, way.times[rows]))
    error = swarm_error(estimated, true)
    return {
        "rmse": round(1e3 * error.rmse, 3),
        "median": round(1e3 * error.median, 3),
        "largest": round(1e3 * error.largest, 2),
        "yaw": round(math.degrees(error.yaw_rms), 4),
    }


def aligned(track: Track) -> Floats:
    """The pose of a track's frame in that of the truth; the rotation is that of the headings."""
    true = truth_of(track.log, track.times)
    turned = wrap(true[:, 2] - track.poses[:, 2])
    angle = float(np.arctan2(np.sin(turned).mean(), np.cos(turned).mean()))
    moved = transform(np.array([0.0, 0.0, angle]), track.poses[:, :2])
    return np.array([*(true[:, :2] - moved).mean(axis=0), angle])


def frame_error(
    tracks: Sequence[Track], alignments: Sequence[Floats], a: int, b: int, frame: Floats
) -> tuple[float, float]:
    """How wrong a frame of b in a is: metres at the middle of b's way, and degrees."""
    true = between(alignments[a], alignments[b])
    middle = tracks[b].poses[:, :2].mean(axis=0)[np.newaxis]
    difference = transform(frame, middle) - transform(true, middle)
    return float(np.linalg.norm(difference)), abs(math.degrees(float(wrap(frame[2] - true[2]))))


def open_walls(arena: str) -> Floats:
    """The pieces (m, 4) of walls with free floor before them that a lidar can see."""
    table = walls_above(mission_of(arena, 60.0).arena, _LIDAR_HEIGHT)
    found = []
    for (x, y, along_x, along_y), first, pieces in zip(table.sides, table.first, table.pieces, strict=True):
        for k in range(int(pieces)):
            if table.is_open[first + k]:
                low, high = k / pieces, (k + 1) / pieces
                found.append((x + low * along_x, y + low * along_y, x + high * along_x, y + high * along_y))
    return np.array(found)


def occupancy(ways: Sequence[Way], arena: str, cell: float) -> dict[str, float]:
    """The agreement of the occupied cells of one map with the walls, within a cell."""
    true = [truth_of(way.log, way.times) for way in ways]
    alignment = swarm_error([way.poses for way in ways], true).alignment
    score = agreement(transform(alignment, occupancy_of(ways, cell).centres), open_walls(arena), cell)
    return {"precision": round(score.precision, 4), "recall": round(score.recall, 4), "f1": round(score.f1, 4)}


def relations(ways: Sequence[Way], seed: int) -> dict[str, float]:
    """The errors of relative poses in one map, of near scans that are far apart in the log."""
    estimated = np.concatenate([way.poses for way in ways])
    true = np.concatenate([truth_of(way.log, way.times) for way in ways])
    scans = np.concatenate([way.times for way in ways])
    order = np.argsort(scans, kind="stable")
    pairs = near_pairs(true[order], seeds.generator(seed, "relations"), nearer=2.0, apart=30, limit=8000)
    apart = np.abs(scans[order][pairs[:, 0]] - scans[order][pairs[:, 1]]) >= 30.0
    error = relative_error(estimated[order], true[order], pairs[apart][:4000])
    return {
        "metres": round(error.translation, 5),
        "metres_median": round(error.translation_median, 5),
        "metres_sd": round(error.translation_sd, 5),
        "degrees": round(math.degrees(error.rotation), 4),
        "degrees_median": round(math.degrees(error.rotation_median), 4),
        "pairs": error.pairs,
    }
