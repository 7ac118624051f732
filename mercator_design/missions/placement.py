"""The places where robots may start.

A placement is the distribution of proposals for a robot's first pose. The simulator asks for proposals until one is
free of walls and other robots.
"""

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, TypeAlias

import numpy as np

from mercator_design.arrays import Flags, Floats
from mercator_design.config.schema import FieldError, Length, Range, checked
from mercator_design.missions.arena import Arena, Coordinate, Heading, Point, Size

Headings: TypeAlias = Heading | Literal["uniform"]
Pose: TypeAlias = tuple[Coordinate, Coordinate, Heading]  # x, y [m], heading [rad]


@dataclass(frozen=True, slots=True, kw_only=True)
class HalfPlaneLimit:
    """The side of the line through `point` to which `normal` points, with the line."""

    point: Point  # [m] x, y of a point of the border
    normal: Point  # x, y of a vector across the border, of any length

    def __post_init__(self) -> None:
        if math.hypot(*self.normal) < 1e-6:
            raise FieldError("normal", "expected a direction, found no length")

    def contains(self, points: Floats) -> Flags:
        """Whether each of the points (n, 2) is on this side."""
        return np.asarray((points - self.point) @ np.array(self.normal) >= 0.0, dtype=np.bool_)


@dataclass(frozen=True, slots=True, kw_only=True)
class DiscPlacement:
    """Anywhere on a disc or ring, uniform by area (as CoreLoopFunctions of the ARGoS missions) or by radius."""

    draws: ClassVar[int] = 3  # for a pose

    shape: Literal["disc"] = "disc"
    center: Point = (0.0, 0.0)  # [m] x, y
    radius: Size  # [m] from the center to the outer border
    inner_radius: Annotated[float, Range(0.0, 1000.0)] = 0.0  # [m] from the center to the inner border
    uniform_in: Literal["area", "radius"] = "area"  # radius: the denser, the nearer to the centre
    heading: Headings = "uniform"  # [rad] of all robots; uniform: drawn for each
    half_plane: HalfPlaneLimit | None = None  # the side of a line to which robots keep
    waiting: Annotated[tuple[Pose, ...], Length(0, 1000)] = ()  # where robots stand, and block, until placed

    def __post_init__(self) -> None:
        if self.inner_radius >= self.radius:
            found = f"{self.inner_radius:g} m"
            raise FieldError("inner_radius", f"expected less than the radius, {self.radius:g} m, found {found}")

    def points(self, u: Floats) -> Floats:
        """Points (n, 2) from uniform draws (2 or more, n) in [0, 1)."""
        if self.uniform_in == "radius":
            radius = self.inner_radius + u[0] * (self.radius - self.inner_radius)
        else:
            radius = np.sqrt(self.inner_radius**2 + u[0] * (self.radius**2 - self.inner_radius**2))
        angle = 2.0 * math.pi * u[1]
        return np.column_stack([self.center[0] + radius * np.cos(angle), self.center[1] + radius * np.sin(angle)])

    def contains(self, points: Floats) -> Flags:
        """Whether each of the points (n, 2) is in the region, whatever the half plane."""
        distances = np.linalg.norm(points - self.center, axis=1)
        return np.asarray((self.inner_radius <= distances) & (distances <= self.radius), dtype=np.bool_)


@dataclass(frozen=True, slots=True, kw_only=True)
class RectanglePlacement:
    """Anywhere on a rectangle, uniform by area."""

    draws: ClassVar[int] = 3

    shape: Literal["rectangle"] = "rectangle"
    center: Point = (0.0, 0.0)  # [m] x, y
    size: tuple[Size, Size]  # [m] along x and y
    heading: Headings = "uniform"  # [rad] of all robots; uniform: drawn for each
    half_plane: HalfPlaneLimit | None = None  # the side of a line to which robots keep
    waiting: Annotated[tuple[Pose, ...], Length(0, 1000)] = ()  # where robots stand, and block, until placed

    def points(self, u: Floats) -> Floats:
        (x, y), (width, height) = self.center, self.size
        return np.column_stack([x + width * (u[0] - 0.5), y + height * (u[1] - 0.5)])

    def contains(self, points: Floats) -> Flags:
        along, across = (np.abs(points - self.center) <= 0.5 * np.array(self.size)).T
        return np.asarray(along & across, dtype=np.bool_)


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnPlacement:
    """Anywhere on one of several regions, which is drawn for each pose, all alike."""

    draws: ClassVar[int] = 4

    shape: Literal["one_of"] = "one_of"
    regions: Annotated[tuple[DiscPlacement | RectanglePlacement, ...], Length(1, 100)]  # one is drawn for each robot
    heading: Headings = "uniform"  # [rad] of all robots; uniform: drawn for each
    half_plane: HalfPlaneLimit | None = None  # the side of a line to which robots keep
    waiting: Annotated[tuple[Pose, ...], Length(0, 1000)] = ()  # where robots stand, and block, until placed

    def __post_init__(self) -> None:
        checked(
            FieldError(f"regions[{index}].{field}", "expected beside the regions, not in one")
            for index, region in enumerate(self.regions)
            for field, usual in (("heading", "uniform"), ("half_plane", None), ("waiting", ()))
            if getattr(region, field) != usual
        )

    def points(self, u: Floats) -> Floats:
        """As in `DiscPlacement`; the last row of draws selects the region."""
        which = (u[-1] * len(self.regions)).astype(int)
        points = np.array([region.points(u) for region in self.regions], dtype=np.float64)
        return np.asarray(points[which, np.arange(len(which))], dtype=np.float64)

    def contains(self, points: Floats) -> Flags:
        return np.asarray(np.any([region.contains(points) for region in self.regions], axis=0), dtype=np.bool_)


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedPlacement:
    """The same poses in each instance, in the order of the robots."""

    waiting: ClassVar[tuple[Pose, ...]] = ()

    shape: Literal["poses"] = "poses"
    poses: Annotated[tuple[Pose, ...], Length(1, 1000)]  # x, y [m] and heading [rad] of each robot


Region: TypeAlias = DiscPlacement | RectanglePlacement | DrawnPlacement
Placement: TypeAlias = Region | FixedPlacement


def covers(placement: Region, points: Floats) -> Flags:
    """Whether a robot may start on each of the points (n, 2), whatever the walls."""
    inside = placement.contains(points)
    return inside if placement.half_plane is None else inside & placement.half_plane.contains(points)


def candidates(placement: Placement, rng: np.random.Generator, robot: int, n: int) -> Floats:
    """At most n poses (poses, 3) for a robot: new ones at each call, or its one fixed pose."""
    if isinstance(placement, FixedPlacement):
        return np.array([placement.poses[robot]], dtype=float)
    # The number of draws depends on neither heading nor half plane, so that these do not change other poses.
    u = rng.random((placement.draws, n))
    headings = 2.0 * math.pi * u[2] if placement.heading == "uniform" else np.full(n, placement.heading)
    poses = np.column_stack([placement.points(u), headings])
    return poses if placement.half_plane is None else poses[placement.half_plane.contains(poses[:, :2])]


def outside(placement: Placement, arena: Arena) -> str | None:
    """The field of a placement without a place inside the walls, or of a fixed pose outside; None if all is well."""
    if isinstance(placement, FixedPlacement):
        inside = arena.contains(np.array(placement.poses, dtype=float)[:, :2])
        return None if inside.all() else f"poses[{int(np.argmin(inside))}]"
    grid = (np.arange(64) + 0.5) / 64
    last = (np.arange(4096) % 97 + 0.5) / 97  # covers all regions of a drawn placement, if there are fewer
    u, v = np.meshgrid(grid, grid)
    points = placement.points(np.stack([u.ravel(), v.ravel(), last]))
    within = points
    for some in (points[::61], points):  # a few mostly tell
        within = some[arena.contains(some)]
        if len(within) and (placement.half_plane is None or placement.half_plane.contains(within).any()):
            return None
    if len(within):
        return "half_plane"
    return "regions" if isinstance(placement, DrawnPlacement) else "center"
