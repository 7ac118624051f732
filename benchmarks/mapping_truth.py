"""Maps against the truth, for the benchmark of maps. Metres and degrees in what is returned, rounded."""

import math
from collections.abc import Sequence

import numpy as np

from mercator_design.arrays import Floats
from mercator_design.mapping.merit.merits import MapMerit
from mercator_design.mapping.merit.trajectories import AbsoluteError, RelativeError
from mercator_design.mapping.poses import between, interpolate, transform, wrap
from mercator_design.mapping.track import Track


def pose_errors(error: AbsoluteError | None) -> dict[str, float]:
    """The absolute error of the ways of one map; millimetres and degrees."""
    if error is None:
        raise ValueError("expected a map of two or more poses")
    return {
        "rmse": round(1e3 * error.rmse, 3),
        "median": round(1e3 * error.median, 3),
        "largest": round(1e3 * error.largest, 2),
        "yaw": round(math.degrees(error.yaw_rms), 4),
    }


def aligned(track: Track) -> Floats:
    """The pose of a track's frame in that of the truth; the rotation is that of the headings."""
    log = track.log
    if log.truth_times is None or log.truth is None:
        raise ValueError(f"{log.name} has no true poses")
    true = interpolate(log.truth_times, log.truth, track.times)
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


def occupancy(merit: MapMerit) -> dict[str, dict[str, float]]:
    """The agreement of the occupied cells of one map with the walls, within a cell, for each width of cells."""
    figures = ("precision", "recall", "f1")
    return {f"{one.tolerance:g}": {name: round(getattr(one, name), 4) for name in figures} for one in merit.cells}


def relation_errors(error: RelativeError | None) -> dict[str, float]:
    """The errors of relative poses."""
    if error is None:
        raise ValueError("expected places that are seen again")
    return {
        "metres": round(error.translation, 5),
        "metres_median": round(error.translation_median, 5),
        "metres_sd": round(error.translation_sd, 5),
        "degrees": round(math.degrees(error.rotation), 4),
        "degrees_median": round(math.degrees(error.rotation_median), 4),
        "pairs": error.pairs,
    }
