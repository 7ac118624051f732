"""The part of an arena that the swarm's lidars have seen: of its floor, and of its walls."""

import math
from collections.abc import Iterator
from typing import Annotated

import numpy as np

from mercator_design.arrays import Flags, Floats
from mercator_design.config.schema import FieldError, NonNegative, Range
from mercator_design.errors import MissionError
from mercator_design.jit import compiled
from mercator_design.missions.arena import Size
from mercator_design.missions.plugins import objective
from mercator_design.missions.score_limits import ExperimentSize
from mercator_design.missions.trace import Trace, every_nth
from mercator_design.missions.walls import WallTable, meets_side

_MIN_CELL = 0.001
"""[m] Minimum side of a cell: smaller cells take minutes to count."""

_STEP = 0.5
"""[cells] Step along a beam; no cell whose middle it crosses is skipped."""


def _cells_not_too_fine(side: float, cells: int) -> Iterator[FieldError]:
    if side / cells < _MIN_CELL:
        yield FieldError("cells", f"expected cells of at least {_MIN_CELL:g} m, found {side / cells:g} m")


def _of_square(size: ExperimentSize, *, side: float, **_: object) -> tuple[float, float]:  # noqa: ARG001
    return 0.0, side * side


@objective(checks=(_cells_not_too_fine,), limits=_of_square)
def seen_area(
    trace: Trace,
    *,
    side: Annotated[float, Range(0.01, 1000.0)],  # [m] of the square, whose middle is the origin
    cells: Annotated[int, Range(1, 2000)],  # how many, along each side of the square
    reach: Size = 12.0,  # [m] from a robot to what it sees, at most
    every: Annotated[int, Range(1, 1000)] = 10,  # cycles from one look to the next
) -> float:
    """The area [m2] that some beam of a lidar has crossed by the end, no farther than `reach` from its robot.

    It is counted in `cells` x `cells` squares over a square of `side` metres around the origin, at every `every`-th
    cycle and the last. A beam that meets nothing marks no cells, as with the real device.
    """
    seen = np.zeros((cells, cells), dtype=np.bool_)
    positions = trace.positions[every_nth(trace.cycles, every)]
    points = trace.measure("lidar_points", every)
    compiled(_mark_seen)(np.ascontiguousarray(positions), points, side, reach, seen)
    return float(np.count_nonzero(seen)) * (side / cells) ** 2


def _mark_seen(positions: Floats, points: Floats, side: float, reach: float, seen: Flags) -> None:
    cells = len(seen)
    scale = cells / side
    for n in range(len(points)):
        for i in range(points.shape[1]):
            x, y = positions[n, i, 0], positions[n, i, 1]
            for k in range(points.shape[2]):
                to_x, to_y = points[n, i, k, 0] - x, points[n, i, k, 1] - y
                distance = math.sqrt(to_x * to_x + to_y * to_y)
                if not distance > 0.0:  # NaN where there is no point
                    continue
                steps = int(min(distance, reach) * scale / _STEP)
                stride = _STEP / (scale * distance)
                for step in range(steps + 1):
                    column = math.floor((x + step * stride * to_x) * scale + 0.5 * cells)
                    row = math.floor((y + step * stride * to_y) * scale + 0.5 * cells)
                    if 0 <= column < cells and 0 <= row < cells:
                        seen[row, column] = True


def _of_share(size: ExperimentSize, **_: object) -> tuple[float, float]:  # noqa: ARG001
    return 0.0, 1.0


@objective(limits=_of_share)
def seen_walls(
    trace: Trace,
    *,
    beams: Annotated[int, Range(1, 1000)] = 36,  # of a look, evenly around the robot
    every: Annotated[int, Range(1, 1000)] = 10,  # cycles from one look to the next
    reach: Size = 12.0,  # [m] from a robot to what it sees, at most
    turning_cost: NonNegative = 0.0,  # [s/rad] part of the share that is lost for each rad/s of the mean turning
) -> float:
    """The share of the walls that some lidar has seen by the end: of their pieces of 10 cm, those that a beam has met.

    It predicts how good a map of the logs is, as it ranks control software as the F1 of occupied cells does. Boxes
    count as walls if they are higher than the lidar; sides that nobody can see do not count. A look has `beams` from
    the robot's true pose, at every `every`-th cycle and the last; other robots hide nothing.
    """
    if trace.walls is None or not trace.walls.is_open.any():
        raise MissionError("the objective seen_walls needs walls or boxes that are higher than the robots' lidar")
    seen = np.zeros(len(trace.walls.is_open), dtype=np.bool_)
    poses = np.ascontiguousarray(trace.poses[1:][every_nth(trace.cycles, every)])
    compiled(_mark_pieces)(trace.walls, poses, beams, reach, seen)
    share = float(np.count_nonzero(seen & trace.walls.is_open) / np.count_nonzero(trace.walls.is_open))
    turned = float(np.abs(np.diff(trace.poses[..., 2], axis=0)).mean()) / trace.control_period
    return share * max(0.0, 1.0 - turning_cost * turned)


def _mark_pieces(walls: WallTable, poses: Floats, beams: int, reach: float, seen: Flags) -> None:
    sides = walls.sides
    for n in range(len(poses)):
        for i in range(poses.shape[1]):
            x, y = poses[n, i, 0], poses[n, i, 1]
            for k in range(beams):
                angle = poses[n, i, 2] + 2.0 * math.pi * k / beams
                ray_x, ray_y = math.cos(angle), math.sin(angle)
                nearest, met = reach, -1
                for w in range(len(sides)):
                    along_x, along_y = sides[w, 2], sides[w, 3]
                    if ray_x * along_y <= ray_y * along_x:
                        continue  # from behind
                    distance = meets_side(sides[w, 0] - x, sides[w, 1] - y, along_x, along_y, ray_x, ray_y)
                    if distance < nearest:
                        nearest, met = distance, w
                if met < 0:
                    continue
                along_x, along_y = sides[met, 2], sides[met, 3]
                to_x, to_y = x + nearest * ray_x - sides[met, 0], y + nearest * ray_y - sides[met, 1]
                part = (to_x * along_x + to_y * along_y) / (along_x * along_x + along_y * along_y)
                count = walls.pieces[met]
                seen[walls.first[met] + max(0, min(count - 1, int(part * count)))] = True
