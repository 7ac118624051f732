"""Where the robots are: walls around them, boxes among them, lights above them. Metres and radians.

What is decided here: an arena is the inside of one simple polygon, and its border is the inner face of the
walls, so that the numbers in a mission file are what a tape measure between the walls shows.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mercator_design.loading import FieldError, Length, NonNegative, Range

WALL_THICKNESS = 0.01
"""Of the outer walls [m], which stand outside the polygon; as the boxes of the ARGoS missions' dodecagon."""

Coordinate: TypeAlias = Annotated[float, Range(-1000.0, 1000.0)]
Size: TypeAlias = Annotated[float, Range(0.0, 1000.0, exclusive_low=True)]
Angle: TypeAlias = Annotated[float, Range(-1000.0, 1000.0)]
Height: TypeAlias = Annotated[float, Range(0.001, 100.0)]
Point: TypeAlias = tuple[Coordinate, Coordinate]
Array: TypeAlias = NDArray[np.float64]

_SHORTEST_WALL = 0.001
"""[m]"""

_SMALLEST_AREA = 1e-6
"""Of a polygon that is not a line [m2]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RegularPolygon:
    """Walls of equal length around the origin."""

    shape: Literal["regular_polygon"] = "regular_polygon"
    sides: Annotated[int, Range(3, 360)]  # how many walls
    apothem: Size  # [m] from the centre to the inner face of a wall
    rotation: Angle = 0.0  # [rad] direction from the centre to the middle of the first wall

    def corners(self) -> Array:
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

    def corners(self) -> Array:
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

    def corners(self) -> Array:
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
    """The walls and what stands between them; what is lower than a sensor is not in its way."""

    walls: RegularPolygon | Polygon  # around the arena; numbers are those of their inner faces
    wall_height: Height = 0.08  # [m] of the walls above the floor
    obstacles: tuple[Box, ...] = ()  # boxes in the arena, which may be walls
    room: RegularPolygon | Polygon | None = None  # around the arena; its walls reach to the ceiling

    def corners(self) -> Array:
        """The corners of the walls' inner face (n, 2), counter-clockwise."""
        return self.walls.corners()

    @property
    def area(self) -> float:
        """Between the walls, obstacles included [m2]."""
        return _signed_area(self.corners())

    def contains(self, points: Array) -> NDArray[np.bool_]:
        """Whether each of the points (n, 2) lies between the walls; obstacles do not matter."""
        start = self.corners()
        end = np.roll(start, -1, axis=0)
        x, y = points[:, :1], points[:, 1:]
        straddles = (start[:, 1] > y) != (end[:, 1] > y)
        rise = np.where(end[:, 1] == start[:, 1], 1.0, end[:, 1] - start[:, 1])  # level walls straddle nothing
        left_of_wall = x < start[:, 0] + (end[:, 0] - start[:, 0]) * (y - start[:, 1]) / rise
        crossings = np.sum(straddles & left_of_wall, axis=1)
        return np.asarray(crossings % 2 == 1, dtype=np.bool_)


def check_polygon(vertices: Sequence[Point], *, side: str) -> None:
    """Make sure that corners are those of a simple polygon.

    Args:
        vertices: The corners, in either sense.
        side: What a side of it is called.

    Raises:
        FieldError: naming the corner.
    """
    if len(vertices) < 3:
        raise FieldError("vertices", f"expected at least 3 corners, found {len(vertices)}")
    for index, vertex in enumerate(vertices):
        if vertex in vertices[:index]:
            raise FieldError(f"vertices[{index}]", f"a corner for the second time; the last {side} closes by itself")
    corners = np.array(vertices, dtype=float)
    lengths = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    if lengths.min() < _SHORTEST_WALL:
        raise FieldError(
            f"vertices[{int(np.argmin(lengths))}]", f"the {side} from here is shorter than {_SHORTEST_WALL:g} m"
        )
    crossing = _crossing(corners)
    if crossing is not None:
        first, second = crossing
        raise FieldError(f"vertices[{second}]", f"the {side} from here crosses or touches {side} {first}")
    if abs(_signed_area(corners)) < _SMALLEST_AREA:
        raise FieldError("vertices", "the corners enclose no area")


def rectangle_corners(center: tuple[float, float], size: tuple[float, float], angle: float) -> Array:
    """The corners (4, 2) of a rectangle, counter-clockwise."""
    along = 0.5 * size[0] * np.array([math.cos(angle), math.sin(angle)])
    across = 0.5 * size[1] * np.array([-math.sin(angle), math.cos(angle)])
    around = np.array([-along - across, along - across, along + across, -along + across])
    return np.asarray(center + around, dtype=np.float64)


def _signed_area(corners: Array) -> float:
    """Positive if counter-clockwise (the shoelace formula)."""
    x, y = corners[:, 0], corners[:, 1]
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def walls_meet(first: Array, second: Array) -> bool:
    """Whether the sides of two polygons of corners (n, 2) and (m, 2) touch."""
    others = _segments(second)
    return any(_meet(wall, other, adjacent=False) for wall in _segments(first) for other in others)


def _crossing(corners: Array) -> tuple[int, int] | None:
    """The first two walls that meet other than at a common corner; wall i goes from corner i to the next."""
    n = len(corners)
    walls = _segments(corners)
    for i in range(n):
        for j in range(i + 1, n):
            if _meet(walls[i], walls[j], adjacent=j == i + 1 or (i == 0 and j == n - 1)):
                return i, j
    return None


_Segment: TypeAlias = tuple[tuple[float, float], tuple[float, float]]


def _segments(corners: Array) -> list[_Segment]:
    points = [(float(x), float(y)) for x, y in corners]
    return list(zip(points, [*points[1:], points[0]], strict=True))


def _meet(first: _Segment, second: _Segment, *, adjacent: bool) -> bool:
    """Whether two segments touch; if adjacent, elsewhere than at the corner they share."""
    (a, b), (c, d) = first, second
    sides = _side(a, b, c), _side(a, b, d), _side(c, d, a), _side(c, d, b)
    if adjacent:
        p, corner, q = (a, b, d) if b == c else (c, a, b)
        ahead = (p[0] - corner[0]) * (q[0] - corner[0]) + (p[1] - corner[1]) * (q[1] - corner[1])
        return not any(sides) and ahead > 0.0
    if sides[0] != sides[1] and sides[2] != sides[3]:
        return True
    return not any(sides) and all(
        max(min(a[k], b[k]), min(c[k], d[k])) <= min(max(a[k], b[k]), max(c[k], d[k])) for k in (0, 1)
    )


def _side(a: tuple[float, float], b: tuple[float, float], p: tuple[float, float]) -> int:
    """1 if p lies left of the line from a to b, -1 if right, 0 if on it."""
    turn = (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
    return (turn > 0.0) - (turn < 0.0)
