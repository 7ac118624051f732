"""Where robots may start.

What is decided here: the distribution that a robot's first pose is proposed from. Whether a proposed pose is
free of walls and other robots is the simulator's to say; it asks for more candidates until one is.
"""

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, TypeAlias

import numpy as np

from mercator_design.loading import FieldError, Length, Range
from mercator_design.missions.arena import Arena, Array, Coordinate, Point, Size

Heading: TypeAlias = float | Literal["uniform"]


@dataclass(frozen=True, slots=True, kw_only=True)
class DiscPlacement:
    """Anywhere on a disc or ring, uniform by area (as CoreLoopFunctions of the ARGoS missions)."""

    fixed: ClassVar[bool] = False  # whether each call of `candidates` gives the same

    shape: Literal["disc"] = "disc"
    center: Point = (0.0, 0.0)
    radius: Size
    inner_radius: Annotated[float, Range(0.0, 1000.0)] = 0.0
    heading: Heading = "uniform"

    def __post_init__(self) -> None:
        if self.inner_radius >= self.radius:
            raise FieldError("inner_radius", f"expected less than the radius {self.radius:g}")

    def points(self, u: Array, v: Array) -> Array:
        """The points (n, 2) of the region that pairs of uniform draws from [0, 1) stand for."""
        radius = np.sqrt(self.inner_radius**2 + u * (self.radius**2 - self.inner_radius**2))
        angle = 2.0 * math.pi * v
        return np.column_stack([self.center[0] + radius * np.cos(angle), self.center[1] + radius * np.sin(angle)])

    def candidates(self, rng: np.random.Generator, _robot: int, n: int) -> Array:
        """Poses (n, 3) for a robot; new ones at each call."""
        return _poses(self, rng, n)


@dataclass(frozen=True, slots=True, kw_only=True)
class RectanglePlacement:
    """Anywhere on a rectangle, uniform by area."""

    fixed: ClassVar[bool] = False

    shape: Literal["rectangle"] = "rectangle"
    center: Point = (0.0, 0.0)
    size: tuple[Size, Size]
    heading: Heading = "uniform"

    def points(self, u: Array, v: Array) -> Array:
        """As in `DiscPlacement`."""
        (x, y), (width, height) = self.center, self.size
        return np.column_stack([x + width * (u - 0.5), y + height * (v - 0.5)])

    def candidates(self, rng: np.random.Generator, _robot: int, n: int) -> Array:
        """Poses (n, 3) for a robot; new ones at each call."""
        return _poses(self, rng, n)


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedPlacement:
    """The same poses in each instance, in the order of the robots."""

    fixed: ClassVar[bool] = True

    shape: Literal["poses"] = "poses"
    poses: Annotated[tuple[tuple[Coordinate, Coordinate, float], ...], Length(1, 1000)]

    def candidates(self, _rng: np.random.Generator, robot: int, _n: int) -> Array:
        """The pose (1, 3) of a robot; the same at each call."""
        return np.array([self.poses[robot]], dtype=float)


Placement: TypeAlias = DiscPlacement | RectanglePlacement | FixedPlacement


def _poses(placement: DiscPlacement | RectanglePlacement, rng: np.random.Generator, n: int) -> Array:
    u, v, turns = rng.random((3, n))  # three draws a pose whatever the heading, so that fixing it moves no robot
    headings = 2.0 * math.pi * turns if placement.heading == "uniform" else np.full(n, placement.heading)
    return np.column_stack([placement.points(u, v), headings])


def outside(placement: Placement, arena: Arena) -> str | None:
    """The field of a placement that lies outside the walls, if one does; a region only if all of it does."""
    if isinstance(placement, FixedPlacement):
        inside = arena.contains(np.array(placement.poses, dtype=float)[:, :2])
        return None if inside.all() else f"poses[{int(np.argmin(inside))}]"
    u, v = np.meshgrid((np.arange(64) + 0.5) / 64, (np.arange(64) + 0.5) / 64)
    return None if arena.contains(placement.points(u.ravel(), v.ravel())).any() else "center"
