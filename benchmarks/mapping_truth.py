"""Maps against the truth, for the benchmark of maps. Metres and degrees in what is returned, rounded."""

import math
from collections.abc import Sequence

import numpy as np

from benchmarks.mapping_logs import mission_of
from mercator_design import seeds
from mercator_design.arrays import Floats
from mercator_design.mapping.merit.occupancy import agreement
from mercator_design.mapping.merit.trajectories import near_pairs, relative_error, swarm_error
from mercator_design.mapping.poses import between, interpolate, transform, wrap
from mercator_design.mapping.swarm import SwarmMap
from mercator_design.mapping.track import Track
from mercator_design.missions.walls import walls_above

_LIDAR_HEIGHT = 0.154


def truth_of(track: Track) -> Floats:
    """The true poses (n, 3) at the turns of a track."""
    times, poses = track.log.truth_times, track.log.truth
    if times is None or poses is None:
        raise ValueError(f"{track.log.name} has no true poses")
    return interpolate(times, poses, track.times)


def pose_errors(found: SwarmMap, *, only_keyframes: bool) -> dict[str, float]:
    """The absolute error in the largest map; millimetres and degrees."""
    estimated, true = [], []
    for number, turns in found.turns_of(0):
        track = found.tracks[number]
        rows = np.intersect1d(turns, track.keyframes.turns) if only_keyframes else turns
        estimated.append(track.poses[rows])
        true.append(truth_of(track)[rows])
    error = swarm_error(estimated, true)
    return {
        "rmse": round(1e3 * error.rmse, 3),
        "median": round(1e3 * error.median, 3),
        "largest": round(1e3 * error.largest, 2),
        "yaw": round(math.degrees(error.yaw_rms), 4),
    }


def aligned(track: Track) -> Floats:
    """The pose of a track's frame in that of the truth; the rotation is that of the headings."""
    true = truth_of(track)
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


def occupancy(found: SwarmMap, arena: str, cell: float) -> dict[str, float]:
    """The agreement of the occupied cells of the largest map with the walls, within a cell."""
    from mercator_design.mapping.plan.occupancy import occupancy_of
    from mercator_design.mapping.plan.ways import ways_of

    ways = ways_of(found, 0)
    estimated = [found.tracks[number].poses[turns] for number, turns in found.turns_of(0)]
    true = [truth_of(found.tracks[number])[turns] for number, turns in found.turns_of(0)]
    alignment = swarm_error(estimated, true).alignment
    score = agreement(transform(alignment, occupancy_of(ways, cell).centres), open_walls(arena), cell)
    return {"precision": round(score.precision, 4), "recall": round(score.recall, 4), "f1": round(score.f1, 4)}


def relations(found: SwarmMap, seed: int) -> dict[str, float]:
    """The errors of relative poses in the largest map, of near scans that are far apart in the log."""
    parts = [(found.tracks[number], turns) for number, turns in found.turns_of(0)]
    estimated = np.concatenate([track.poses[turns] for track, turns in parts])
    true = np.concatenate([truth_of(track)[turns] for track, turns in parts])
    scans = np.concatenate([track.times[turns] for track, turns in parts])
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
