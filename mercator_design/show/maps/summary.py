"""The figures of a map: robots, walls, clocks and, where the truth is known, errors."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mercator_design.arrays import Flags, Floats
from mercator_design.mapping import poses
from mercator_design.mapping.merit.trajectories import AbsoluteError, swarm_error
from mercator_design.mapping.plan.plans import Plan
from mercator_design.mapping.plan.ways import Way


def figures(plans: Sequence[Plan], messages: Sequence[str], files: Sequence[Path]) -> dict[str, Any]:
    """All figures, as JSON can have them.

    Args:
        plans: The maps, the largest first.
        messages: Sentences on the maps.
        files: What was written.
    """
    return {
        "maps": [_of_plan(plan) for plan in plans],
        "messages": list(messages),
        "files": [str(file) for file in files],
    }


def _of_plan(plan: Plan) -> dict[str, Any]:
    grid = plan.occupancy
    keyframes, turns = error_of(plan.ways, at_keyframes=True), error_of(plan.ways)
    return {
        "robots": [_of_way(way) for way in plan.ways],
        "resolution": grid.resolution,
        "occupied_cells": int(grid.occupied.sum()),
        "free_area": round(float(grid.free.sum()) * grid.resolution**2, 3),
        "walls": round(float(lengths(plan.lines).sum()), 3),
        "residual": round(plan.looks.residual, 5),
        "size": [round(float(length), 3) for length in _size(plan.pieces)],
        "errors": {} if turns is None or keyframes is None else {"keyframes": _rows(keyframes), "turns": _rows(turns)},
    }


def _of_way(way: Way) -> dict[str, Any]:
    places = way.poses[:, :2]
    return {
        "name": way.name,
        "turns": len(way.turns),
        "matched": round(float(np.mean(way.shares > 0.0)), 4) if len(way.turns) else 0.0,
        "keyframes": len(way.keyframes),
        "path": round(float(np.hypot(*np.diff(places, axis=0).T).sum()), 3) if len(places) > 1 else 0.0,
        "clock_offset": round(way.offset, 4),
        "lag": round(way.track.lag, 4),
        "odometry_scale": round(way.track.scale, 4),
    }


def _rows(error: AbsoluteError) -> dict[str, float]:
    return {
        "rmse": round(error.rmse, 5),
        "median": round(error.median, 5),
        "largest": round(error.largest, 5),
        "yaw_rms": round(error.yaw_rms, 6),
    }


def error_of(ways: Sequence[Way], *, at_keyframes: bool = False) -> AbsoluteError | None:
    """The error of all ways after one alignment of all together; None if the truth of any is not known."""
    estimates, truths = [], []
    for way in ways:
        if way.log.truth is None or way.log.truth_times is None:
            return None
        keyframes = way.track.keyframes.turns[way.keyframes]
        found, times = (way.keyframe_poses, way.track.times[keyframes]) if at_keyframes else (way.poses, way.times)
        estimates.append(found)
        truths.append(poses.interpolate(way.log.truth_times, way.log.truth, times))
    return swarm_error(estimates, truths) if sum(map(len, estimates)) > 1 else None


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
            clock = f", clock {one['clock_offset']:+.3f} s" if abs(one["clock_offset"]) > 0.0005 else ""
            lines.append(
                f"  {one['name']}: {one['turns']} {'turn' if one['turns'] == 1 else 'turns'}, "
                f"{100 * one['matched']:.1f} % matched, {one['path']:.1f} m, "
                f"odometry x {one['odometry_scale']:.3f}{clock}"
            )
        for what, error in plan["errors"].items():
            lines.append(
                f"  error of {what}: {1e3 * error['rmse']:.1f} mm rms, {1e3 * error['largest']:.1f} mm at most, "
                f"{np.degrees(error['yaw_rms']):.2f} degrees rms"
            )
    return "\n".join([*lines, *found["messages"]])


def lengths(lines: Floats) -> Floats:
    """The lengths (m,) [m] of lines (m, 4)."""
    return np.asarray(np.hypot(lines[:, 2] - lines[:, 0], lines[:, 3] - lines[:, 1]))


def known(plan: Plan) -> Flags:
    """The cells (rows, columns) of which something is known."""
    return np.asarray(plan.occupancy.occupied | plan.occupancy.free)


def _size(pieces: Floats) -> Floats:
    return np.asarray(np.ptp(pieces[:, :2], axis=0)) if len(pieces) else np.zeros(2)
