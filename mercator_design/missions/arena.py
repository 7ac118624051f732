"""The arena: walls, boxes and lights. Metres and radians.

An arena is the inside of a simple polygon. Its border is the inner face of the walls, so the numbers in a mission file
are what a tape measure between the walls shows.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mercator_design.arrays import Flags, Floats
from mercator_design.config.schema import FieldError, Length, NonNegative, Radians, Range

WALL_THICKNESS = 0.01
"""[m] Thickness of the outer walls, which stand outside the polygon; as in the ARGoS missions' dodecagon."""

Coordinate: TypeAlias = Annotated[float, Range(-1000.0, 1000.0)]
Size: TypeAlias = Annotated[float, Range(0.0, 1000.0, exclusive_low=True)]
Angle: TypeAlias = Annotated[float, Range(-1000.0, 1000.0), Radians()]
Heading: TypeAlias = Annotated[float, Radians()]
Height: TypeAlias = Annotated[float, Range(0.001, 100.0)]
Point: TypeAlias = tuple[Coordinate, Coordinate]

_MIN_WALL = 0.001
"""[m]"""

_MIN_AREA = 1e-6
"""[m2] Area of a polygon that is not a line."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RegularPolygon:
    """Walls of equal length around the origin."""

    shape: Literal["regular_polygon"] = "regular_polygon"
    sides: Annotated[int, Range(3, 360)]  # how many walls
    apothem: Size  # [m] from the centre to the inner face of a wall
    rotation: Angle = 0.0  # [rad] direction from the centre to the middle of the first wall

    def corners(self) -> Floats:
        """The corners (sides, 2), counter-clockwise; the first wall ends at the first one."""
        angles = self.rotation + math.pi * (2.0 * np.arange(self.sides) + 1.0) / self.sides
        radius = self.apothem / math.cos(math.pi / self.sides)
        return radius * np.column_stack([np.cos(angles), np.sin(angles)])


@dataclass(frozen=True, slots=True, kw_only=True)
class Polygon:
    """Walls from corner to corner, in either sense; the last wall closes the polygon."""

    shape: Literal["polygon"] = "polygon"
    vertices: Annotated[tuple[Point, ...], Length(3, 360)]  # [m] the corners x, y, in either sense

    def __post_init__(self) -> None:
        check_polygon(self.vertices, side="wall")

    def corners(self) -> Floats:
        """The corners (n, 2), counter-clockwise, beginning with the first vertex."""
        vertices = np.array(self.vertices, dtype=float)
        if _signed_area(vertices) < 0.0:
            vertices = np.roll(vertices[::-1], 1, axis=0)
        return np.ascontiguousarray(vertices)


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """An obstacle, or a wall inside the arena."""

    center: Point  # [m] x, y
    size: tuple[Size, Size]  # [m] along its own x and y
    angle: Angle = 0.0  # [rad] of its own x
    height: Height = 0.08  # [m] of its top above the floor

    def corners(self) -> Floats:
        """The corners (4, 2), counter-clockwise."""
        return rectangle_corners(self.center, self.size, self.angle)


@dataclass(frozen=True, slots=True, kw_only=True)
class Light:
    """A point light above the floor."""

    position: tuple[Coordinate, Coordinate, Coordinate]  # [m] x, y, height
    intensity: NonNegative = 1.0  # as ARGoS counts it: the farther the reach, the greater; 0: off
    kind: Literal["lamp", "beacon"] | None = None  # light sensors sense no beacon, cameras no lamp; null: both do
    seen_by: Annotated[tuple[Annotated[int, Range(0, 999)], ...], Length(1, 1000)] | None = None  # robots; null: all


@dataclass(frozen=True, slots=True, kw_only=True)
class Arena:
    """The walls and obstacles; those lower than a sensor do not affect it."""

    walls: RegularPolygon | Polygon  # around the arena; numbers are those of their inner faces
    wall_height: Height = 0.08  # [m] of the walls above the floor
    obstacles: tuple[Box, ...] = ()  # boxes in the arena, which may be walls
    room: RegularPolygon | Polygon | None = None  # around the arena; its walls reach to the ceiling

    def corners(self) -> Floats:
        """The corners of the walls' inner face (n, 2), counter-clockwise."""
        return self.walls.corners()

    @property
    def area(self) -> float:
        """The area between the walls, obstacles included [m2]."""
        return _signed_area(self.corners())

    def contains(self, points: Floats) -> Flags:
        """Whether each of the points (n, 2) lies between the walls; obstacles do not matter."""
        return polygon_contains(self.corners(), points)

    def contains_grid(self, x: Floats, y: Floats) -> Flags:
        """Whether each point of a grid (len(y), len(x)) lies between the walls, as `contains` of it, but faster."""
        start = self.corners()
        straddles, crossing = _crossings(start, np.roll(start, -1, axis=0), y[:, np.newaxis])
        inside = np.zeros((len(y), len(x)), dtype=np.bool_)
        for wall in range(len(start)):  # all at once would fill the memory
            rows = np.flatnonzero(straddles[:, wall])
            inside[rows] ^= x < crossing[rows, wall, np.newaxis]
        return inside


def check_polygon(vertices: Sequence[Point], *, side: str) -> None:
    """Check that corners, in either sense, are those of a simple polygon; messages call its sides `side`.

    Raises:
        FieldError: naming the corner.
    """
    if len(vertices) < 3:
        raise FieldError("vertices", f"expected at least 3 corners, found {len(vertices)}")
    if len({(x, y) for x, y in vertices}) < len(vertices):
        index = next(k for k, vertex in enumerate(vertices) if vertex in vertices[:k])
        raise FieldError(f"vertices[{index}]", f"a corner for the second time; the last {side} closes by itself")
    corners = np.array(vertices, dtype=float)
    lengths = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    if lengths.min() < _MIN_WALL:
        raise FieldError(
            f"vertices[{int(np.argmin(lengths))}]", f"the {side} from here is shorter than {_MIN_WALL:g} m"
        )
    crossing = _crossing(corners)
    if crossing is not None:
        first, second = crossing
        raise FieldError(f"vertices[{second}]", f"the {side} from here crosses or touches {side} {first}")
    if abs(_signed_area(corners)) < _MIN_AREA:
        raise FieldError("vertices", "the corners enclose no area")


def polygon_contains(start: Floats, points: Floats) -> Flags:
    """Whether each of the points (n, 2) lies in the polygon of corners (m, 2), in either sense."""
    straddles, crossing = _crossings(start, np.roll(start, -1, axis=0), points[:, 1:])
    crossings = np.sum(straddles & (points[:, :1] < crossing), axis=1)
    return np.asarray(crossings % 2 == 1, dtype=np.bool_)


def _crossings(start: Floats, end: Floats, y: Floats) -> tuple[Flags, Floats]:
    """Whether sides (m,) cross level lines at y (n, 1), and the x where they do: (n, m) each."""
    straddles = (start[:, 1] > y) != (end[:, 1] > y)
    rise = np.where(end[:, 1] == start[:, 1], 1.0, end[:, 1] - start[:, 1])  # level sides straddle nothing
    return straddles, start[:, 0] + (end[:, 0] - start[:, 0]) * (y - start[:, 1]) / rise


def rectangle_corners(center: tuple[float, float], size: tuple[float, float], angle: float) -> Floats:
    """The corners (4, 2) of a rectangle, counter-clockwise."""
    along = 0.5 * size[0] * np.array([math.cos(angle), math.sin(angle)])
    across = 0.5 * size[1] * np.array([-math.sin(angle), math.cos(angle)])
    around = np.array([-along - across, along - across, along + across, -along + across])
    return np.asarray(center + around, dtype=np.float64)


def _signed_area(corners: Floats) -> float:
    """Positive if counter-clockwise (the shoelace formula)."""
    x, y = corners[:, 0], corners[:, 1]
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def walls_meet(first: Floats, second: Floats) -> bool:
    """Whether the sides of two polygons of corners (n, 2) and (m, 2) touch."""
    meet, _ = _meetings(first, second)
    return bool(meet.any())


def _crossing(corners: Floats) -> tuple[int, int] | None:
    """The first two walls that meet elsewhere than at a common corner; wall i goes from corner i to the next."""
    meet, level = _meetings(corners, corners)
    wall = np.arange(len(corners))
    following = np.roll(wall, -1)
    back, on = corners - np.roll(corners, -1, axis=0), np.roll(corners, -2, axis=0) - np.roll(corners, -1, axis=0)
    turns_back = level[wall, following] & ((back * on).sum(axis=1) > 0.0)
    meet[wall, following] = meet[following, wall] = turns_back
    found = np.argwhere(np.triu(meet, 1))
    return (int(found[0, 0]), int(found[0, 1])) if len(found) else None


def _meetings(first: Floats, second: Floats) -> tuple[Flags, Flags]:
    """Which sides of two polygons (n,) and (m,) touch, and which lie on the same line: (n, m) each."""
    of_starts, of_others_starts = _sides(first, second), _sides(second, first).T
    of_ends, of_others_ends = np.roll(of_starts, -1, axis=1), np.roll(of_others_starts, -1, axis=0)
    meet = (of_starts != of_ends) & (of_others_starts != of_others_ends)
    level = (of_starts == 0) & (of_ends == 0) & (of_others_starts == 0) & (of_others_ends == 0)
    i, j = np.nonzero(level)
    a, b, c, d = first[i], np.roll(first, -1, axis=0)[i], second[j], np.roll(second, -1, axis=0)[j]
    latest_begin = np.maximum(np.minimum(a, b), np.minimum(c, d))
    earliest_end = np.minimum(np.maximum(a, b), np.maximum(c, d))
    meet[i, j] |= (latest_begin <= earliest_end).all(axis=1)
    return meet, level


def _sides(corners: Floats, points: Floats) -> NDArray[np.int8]:
    """The side of the line through each wall on which points (m, 2) lie (n, m): 1 left, -1 right, 0 on it."""
    along = (np.roll(corners, -1, axis=0) - corners)[:, np.newaxis]
    x, y = points[:, 0] - corners[:, :1], points[:, 1] - corners[:, 1:]
    return np.sign(along[..., 0] * y - along[..., 1] * x).astype(np.int8)
