"""The figures of a map: robots, walls, clocks and, where the truth is known, errors."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mercator_design.arrays import Flags, Floats
from mercator_design.mapping.merit.merits import MapMerit, merit_of
from mercator_design.mapping.merit.occupancy import Agreement
from mercator_design.mapping.merit.trajectories import AbsoluteError, RelativeError
from mercator_design.mapping.plan.plans import Plan
from mercator_design.mapping.plan.ways import Way


def figures(plans: Sequence[Plan], messages: Sequence[str], files: Sequence[Path], seed: int = 0) -> dict[str, Any]:
    """All figures, as JSON can have them.

    Args:
        plans: The maps, the largest first.
        messages: Sentences on the maps.
        files: What was written.
        seed: Of the places whose relations are compared with the truth.
    """
    return {
        "maps": [_of_plan(plan, seed) for plan in plans],
        "messages": list(messages),
        "files": [str(file) for file in files],
    }


def _of_plan(plan: Plan, seed: int) -> dict[str, Any]:
    grid, merit = plan.occupancy, merit_of(plan, seed)
    return {
        "robots": [_of_way(way) for way in plan.ways],
        "resolution": grid.resolution,
        "occupied_cells": int(grid.occupied.sum()),
        "free_area": round(float(grid.free.sum()) * grid.resolution**2, 3),
        "walls": round(float(lengths(plan.lines).sum()), 3),
        "residual": round(plan.looks.residual, 5),
        "size": [round(float(length), 3) for length in _size(plan.pieces)],
        "truth": None if merit is None else _of_merit(merit),
    }


def _of_merit(merit: MapMerit) -> dict[str, Any]:
    absolute = {"keyframes": merit.keyframes, "turns": merit.turns}
    relative = {
        "turn": merit.by_turn,
        "metre": merit.by_metre,
        "near": merit.relations,
        "between_robots": merit.between_robots,
    }
    covered = merit.coverage
    return {
        "ate": {name: _absolute(error) for name, error in absolute.items() if error is not None},
        "relative": {name: _relative(error) for name, error in relative.items() if error is not None},
        "cells": [_agreement(one) for one in merit.cells],
        "coverage": None
        if covered is None
        else {
            "share": round(float(covered.shares[-1]), 4),
            "times": [round(time, 2) for time in covered.moments.tolist()],
            "shares": [round(share, 4) for share in covered.shares.tolist()],
        },
    }


def _of_way(way: Way) -> dict[str, Any]:
    places = way.poses[:, :2]
    return {
        "name": way.name,
        "turns": len(way.turns),
        "matched": round(float(np.mean(way.shares > 0.0)), 4) if len(way.turns) else 0.0,
        "keyframes": len(way.keyframes),
        "path": round(float(np.hypot(*np.diff(places, axis=0).T).sum()), 3) if len(places) > 1 else 0.0,
        "clock_offset": round(way.offset, 4) if way.is_clock_known else None,
        "lag": round(way.track.lag, 4),
        "odometry_scale": round(way.track.scale, 4),
        "keyframe_sd": _deviations(np.mean(way.covariances, axis=0)) if len(way.covariances) else None,
        "frame_sd": _deviations(way.frame_covariance),
    }


def _deviations(covariance: Floats) -> list[float]:
    """Standard deviations x, y [m], heading [rad] of a covariance (3, 3)."""
    return [round(float(deviation), 6) for deviation in np.sqrt(np.diag(covariance))]


def _absolute(error: AbsoluteError) -> dict[str, float]:
    return {
        "rmse": round(error.rmse, 5),
        "median": round(error.median, 5),
        "largest": round(error.largest, 5),
        "yaw_rms": round(error.yaw_rms, 6),
    }


def _relative(error: RelativeError) -> dict[str, float]:
    return {
        "rmse": round(error.translation_rmse, 5),
        "mean": round(error.translation, 5),
        "median": round(error.translation_median, 5),
        "yaw_rmse": round(error.rotation_rmse, 6),
        "yaw_mean": round(error.rotation, 6),
        "yaw_median": round(error.rotation_median, 6),
        "pairs": error.pairs,
    }


def _agreement(found: Agreement) -> dict[str, float]:
    return {
        "cell": found.tolerance,
        "precision": round(found.precision, 4),
        "recall": round(found.recall, 4),
        "f1": round(found.f1, 4),
    }


def text(found: dict[str, Any]) -> str:
    """The figures in lines."""
    lines = []
    for number, plan in enumerate(found["maps"]):
        name = "map" if number == 0 else f"map {number + 1}"
        robots, (width, height) = plan["robots"], plan["size"]
        lines.append(
            f"{name}: {len(robots)} {'robot' if len(robots) == 1 else 'robots'}, {width:.2f} x {height:.2f} m, "
            f"{plan['walls']:.1f} m of walls to {1e3 * plan['residual']:.1f} mm rms, "
            f"{plan['occupied_cells']} occupied cells of {plan['resolution']:g} m"
        )
        for one in robots:
            offset = one["clock_offset"]
            clock = "" if offset is not None and abs(offset) <= 0.0005 else f", clock {clock_text(offset, 1.0, 3)} s"
            lines.append(
                f"  {one['name']}: {one['turns']} {'turn' if one['turns'] == 1 else 'turns'}, "
                f"{100 * one['matched']:.1f} % matched, {one['path']:.1f} m, "
                f"odometry x {one['odometry_scale']:.3f}{clock}{_uncertain(one['keyframe_sd'])}"
            )
        lines += _truth_lines(plan["truth"]) if plan["truth"] else []
    return "\n".join([*lines, *found["messages"]])


def _uncertain(deviations: list[float] | None) -> str:
    if deviations is None:
        return ""
    x, y, heading = deviations
    return f", +-{1e3 * math.hypot(x, y):.1f} mm, {math.degrees(heading):.2f} degrees"


RELATIVE = {
    "turn": "from turn to turn",
    "metre": "over 1 m",
    "near": "between near places",
    "between_robots": "between robots",
}
"""The relative errors of a summary, in words."""


def _truth_lines(truth: dict[str, Any]) -> list[str]:
    found = [
        f"  error of {what}: {1e3 * error['rmse']:.1f} mm rms, {1e3 * error['largest']:.1f} mm at most, "
        f"{np.degrees(error['yaw_rms']):.2f} degrees rms"
        for what, error in truth["ate"].items()
    ]
    found += [
        f"  error {RELATIVE[what]}: {1e3 * error['rmse']:.1f} mm rms, {np.degrees(error['yaw_rmse']):.2f} degrees rms"
        for what, error in truth["relative"].items()
    ]
    if truth["cells"]:
        scores = ", ".join(f"{one['f1']:.3f} (cells of {one['cell']:g} m)" for one in truth["cells"])
        found.append(f"  F1 of occupied cells: {scores}; {100 * truth['coverage']['share']:.1f} % of the walls")
    return found


def clock_text(offset: float | None, factor: float, digits: int) -> str:
    """The offset of a clock [s] times a factor, with its sign; a word if it is not known."""
    return "unknown" if offset is None else f"{factor * offset:+.{digits}f}"


def lengths(lines: Floats) -> Floats:
    """The lengths (m,) [m] of lines (m, 4)."""
    return np.asarray(np.hypot(lines[:, 2] - lines[:, 0], lines[:, 3] - lines[:, 1]))


def known(plan: Plan) -> Flags:
    """The cells (rows, columns) of which something is known."""
    return np.asarray(plan.occupancy.occupied | plan.occupancy.free)


def _size(pieces: Floats) -> Floats:
    return np.asarray(np.ptp(pieces[:, :2], axis=0)) if len(pieces) else np.zeros(2)
