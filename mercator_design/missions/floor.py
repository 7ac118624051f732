"""The floor: a background, an image, and painted zones, later ones over earlier ones.

This module defines zones and dynamics in mission files, and makes the `FloorTable` of an instance (tiles may be drawn
at random). floor_kernels.py computes the colour at a point, for sensors and objectives.
"""

import hashlib
import io
import math
import typing
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mercator_design.arrays import Floats, Numbers
from mercator_design.config import spelling
from mercator_design.config.colours import RGB, Colour, ColourName, rgb
from mercator_design.config.schema import FieldError, FilePath, KeywordsOf, Length, Name, Range, checked
from mercator_design.errors import excerpt
from mercator_design.missions.arena import Angle, Point, Size, check_polygon
from mercator_design.missions.calls import Call, copied
from mercator_design.missions.pictures import painted_over, read_picture
from mercator_design.missions.plugins import DYNAMICS, OF_A_PLUGIN, Site, change_of
from mercator_design.plugins.places import first_line

_COLOURS = (Colour, *typing.get_args(Colour))

DISC, RECTANGLE, HALF_PLANE, RING, POLYGON = 0.0, 1.0, 2.0, 3.0, 4.0
"""The kind of a zone: the first number of its row in a table."""

_MAX_ROWS = 10_000
"""Rows of numbers of a dynamic, which its kernel visits in every cycle."""


class FloorTable(NamedTuple):
    """The floor of one instance, as numbers for the kernels.

    Only dynamics may write into it: into `zones` and `numbers`.
    """

    zones: Floats  # (zones, 9): kind, five numbers of the shape, red, green, blue
    background: Floats  # (3,) red, green, blue in 0 .. 255
    image: NDArray[np.uint8]  # (rows, columns, 3), the first row at the top (+y); (1, 1, 3) if there is none
    extent: Floats  # (4,) left, bottom, width, height of the image [m]; widths 0 if there is none
    vertices: Floats  # (vertices, 2) of the polygons among the zones [m]
    changes: Numbers  # (dynamics, 3) number of the kernel, its first row in `numbers`, and the row after them
    numbers: Floats  # (rows, columns) what the dynamics keep

    def copy(self) -> "FloorTable":
        """A copy that does not change with this floor: itself, if it has no dynamics."""
        return self if not len(self.changes) else self._replace(zones=self.zones.copy(), numbers=self.numbers.copy())


ZoneRow: TypeAlias = tuple[float, float, float, float, float, float, float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Disc:
    """The points at most `radius` from `center`."""

    shape: Literal["disc"] = "disc"
    center: Point  # [m] x, y
    radius: Size  # [m] from the center to the border
    color: Colour  # of the floor there: a name, or red, green, blue of 0 to 255
    name: Name | None = None  # by which objectives and dynamics refer to it

    def rows(self, _rng: np.random.Generator, _corners: list[Point]) -> list[ZoneRow]:
        return [(DISC, *self.center, self.radius, 0.0, 0.0, *rgb(self.color))]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ring:
    """The points at least `inner_radius` and at most `radius` from `center`."""

    shape: Literal["ring"] = "ring"
    center: Point  # [m] x, y
    radius: Size  # [m] from the center to the outer border
    inner_radius: Size  # [m] from the center to the inner border
    color: Colour  # of the floor there: a name, or red, green, blue of 0 to 255
    name: Name | None = None  # by which objectives and dynamics refer to it

    def __post_init__(self) -> None:
        if self.inner_radius >= self.radius:
            found = f"{self.inner_radius:g} m"
            raise FieldError("inner_radius", f"expected less than the radius, {self.radius:g} m, found {found}")

    def rows(self, _rng: np.random.Generator, _corners: list[Point]) -> list[ZoneRow]:
        return [(RING, *self.center, self.radius, self.inner_radius, 0.0, *rgb(self.color))]


@dataclass(frozen=True, slots=True, kw_only=True)
class Rectangle:
    """A rectangle with its border."""

    shape: Literal["rectangle"] = "rectangle"
    center: Point  # [m] x, y
    size: tuple[Size, Size]  # [m] along its own x and y
    angle: Angle = 0.0  # [rad] of its own x
    color: Colour  # of the floor there: a name, or red, green, blue of 0 to 255
    name: Name | None = None  # by which objectives and dynamics refer to it

    def rows(self, _rng: np.random.Generator, _corners: list[Point]) -> list[ZoneRow]:
        width, height = self.size
        return [(RECTANGLE, *self.center, width / 2.0, height / 2.0, self.angle, *rgb(self.color))]


@dataclass(frozen=True, slots=True, kw_only=True)
class HalfPlane:
    """The side of the line through `point` to which `normal` points, with the line."""

    shape: Literal["half_plane"] = "half_plane"
    point: Point  # [m] x, y of a point of the border
    normal: Point  # x, y of a vector across the border, of any length
    color: Colour  # of the floor there: a name, or red, green, blue of 0 to 255
    name: Name | None = None  # by which objectives and dynamics refer to it

    def __post_init__(self) -> None:
        if math.hypot(*self.normal) < 1e-6:
            raise FieldError("normal", "expected a direction, found no length")

    def rows(self, _rng: np.random.Generator, _corners: list[Point]) -> list[ZoneRow]:
        return [(HALF_PLANE, *self.point, *self.normal, 0.0, *rgb(self.color))]


@dataclass(frozen=True, slots=True, kw_only=True)
class PolygonZone:
    """A simple polygon, its corners in either sense; the last side closes it."""

    shape: Literal["polygon"] = "polygon"
    vertices: Annotated[tuple[Point, ...], Length(3, 360)]  # [m] x, y of the corners
    color: Colour  # of the floor there: a name, or red, green, blue of 0 to 255
    name: Name | None = None  # by which objectives and dynamics refer to it

    def __post_init__(self) -> None:
        check_polygon(self.vertices, side="side")

    def rows(self, _rng: np.random.Generator, corners: list[Point]) -> list[ZoneRow]:
        first = len(corners)
        corners.extend(self.vertices)
        return [(POLYGON, float(first), float(len(corners)), 0.0, 0.0, 0.0, *rgb(self.color))]


@dataclass(frozen=True, slots=True, kw_only=True)
class Tiles:
    """Squares whose colours are drawn for each instance, each colour `colors[colour]` times."""

    shape: Literal["tiles"] = "tiles"
    centers: Annotated[tuple[Point, ...], Length(1, 1000)]  # [m] x, y of the squares' centers
    size: Size  # [m] of a square's side
    colors: Mapping[ColourName, Annotated[int, Range(0, 1000)]]  # how many squares have each colour
    name: Name | None = None  # by which objectives and dynamics refer to it

    def __post_init__(self) -> None:
        if sum(self.colors.values()) != len(self.centers):
            found = f"{sum(self.colors.values())} for {len(self.centers)} centers"
            raise FieldError("colors", f"expected one tile for each center, found {found}")

    def rows(self, rng: np.random.Generator, _corners: list[Point]) -> list[ZoneRow]:
        half = self.size / 2.0
        deck = [colour for colour, count in self.colors.items() for _ in range(count)]
        drawn = zip(self.centers, rng.permutation(len(deck)), strict=True)
        return [(RECTANGLE, *center, half, half, 0.0, *rgb(deck[card])) for center, card in drawn]


@dataclass(frozen=True, slots=True, kw_only=True)
class Image:
    """A picture on the floor, its first row at the top (+y).

    It is read once, here, and sent with the mission, because the file may change, or a worker may not have it. So
    images of the same pixels are equal, wherever their files are.
    """

    path: Annotated[str, FilePath()] = field(compare=False)  # of a PNG, JPEG, BMP or PPM
    size: tuple[Size, Size]  # [m] width and height
    center: Point = (0.0, 0.0)  # [m] x, y
    pixels: NDArray[np.uint8] = field(init=False, repr=False, compare=False)  # as `read_picture`
    digest: str = field(init=False)  # of the pixels

    def __post_init__(self) -> None:
        pixels = read_picture(self.path)
        digest = hashlib.sha256(f"{pixels.shape}".encode() + pixels.tobytes()).hexdigest()[:16]
        object.__setattr__(self, "pixels", pixels)
        object.__setattr__(self, "digest", digest)

    def png(self) -> bytes:
        """A PNG file of the same pixels."""
        from PIL import Image as Pillow

        file = io.BytesIO()
        Pillow.fromarray(self.pixels).save(file, "PNG")
        return file.getvalue()

    def extent(self) -> Floats:
        """Left, bottom, width and height [m]."""
        width, height = self.size
        return np.array([self.center[0] - width / 2.0, self.center[1] - height / 2.0, width, height])


Zone: TypeAlias = Disc | Ring | Rectangle | HalfPlane | PolygonZone | Tiles


@dataclass(frozen=True, slots=True, kw_only=True)
class Dynamics(Call):
    """A function of DYNAMICS with its parameters, which changes the floor during an experiment."""

    FUNCTIONS: ClassVar = DYNAMICS
    KIND: ClassVar = "dynamic"

    parameters: Annotated[Mapping[str, Any], KeywordsOf(DYNAMICS, "name", OF_A_PLUGIN)]

    def rows(self, site: Site) -> list[tuple[float, ...]]:
        """The rows of numbers that the dynamic keeps in an instance.

        Raises:
            FieldError: if the function fails, or does not return such rows.
        """
        with self.reporting(partial(FieldError, "name"), FieldError):
            rows = self.function(site, **self.with_paths(copied))
            try:
                numbers = [tuple(map(float, row)) for row in rows]
            except (TypeError, ValueError) as error:
                raise self._wrong(f"must return rows of numbers: {error}") from None
        if len({len(row) for row in numbers}) > 1:
            raise self._wrong("must return rows of one length")
        if len(numbers) > _MAX_ROWS:
            raise self._wrong(f"returned {len(numbers)} rows of numbers; expected at most {_MAX_ROWS}")
        return numbers

    def _wrong(self, what: str) -> FieldError:
        return FieldError("name", f"{first_line(self.function)}{self.KIND} {self.name} {what}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Floor:
    """Background, image over it, zones over both in their order, and dynamics in their order."""

    background: Colour = "gray"  # where there is nothing else
    image: Image | None = None
    zones: Annotated[tuple[Zone, ...], Length(high=1000)] = ()  # the later over the earlier
    dynamics: Annotated[tuple[Dynamics, ...], Length(high=100)] = ()  # what changes zones during an experiment
    pixels: NDArray[np.uint8] = field(init=False, repr=False, compare=False)  # of the image over the background

    def __post_init__(self) -> None:
        there = self.image.pixels if self.image else np.zeros((1, 1, 3), dtype=np.uint8)
        object.__setattr__(self, "pixels", painted_over(there, rgb(self.background)))
        checked(self._mistakes())

    def _mistakes(self) -> Iterator[FieldError]:
        names = [zone.name for zone in self.zones]
        for index, name in enumerate(names):
            if name is not None and name in names[:index]:
                yield FieldError(f"zones[{index}].name", f"two zones are called '{name}'")
        zones, _ = self._painted(np.random.default_rng(0))
        for index, dynamics in enumerate(self.dynamics):
            unknown = [*self.unknown_zones(f"dynamics[{index}]", dynamics)]
            yield from unknown
            try:
                if not unknown:
                    dynamics.rows(Site(zones, self.zone_rows(), np.random.default_rng(0)))
            except FieldError as error:
                for wrong in (error, *error.others):
                    yield FieldError(f"dynamics[{index}].{wrong.field}", wrong.message)

    def unknown_zones(self, field: str, call: Call) -> Iterator[FieldError]:
        """The zones in parameters that the floor does not have, with their paths, which begin with `field`."""
        known = list(self.zone_rows())
        for place, zone in call.zones():
            if zone not in known:
                near = spelling.nearest(zone, known)
                hint = f"did you mean '{near}'?" if near else f"known: {excerpt(', '.join(known)) or 'none'}"
                yield FieldError(f"{field}.{place}", f"no zone is called '{excerpt(zone)}'; {hint}")

    def realise(self, rng: np.random.Generator) -> FloorTable:
        """The floor of one instance, when it starts.

        The draws are the colours of tiles, in the order of the zones, then those of the dynamics in their order.

        Raises:
            FieldError: if a dynamic fails in this instance.
        """
        zones, vertices = self._painted(rng)
        kept = []
        for index, dynamics in enumerate(self.dynamics):
            try:
                kept.append(dynamics.rows(Site(zones, self.zone_rows(), rng)))
            except FieldError as wrong:
                raise FieldError(f"dynamics[{index}].{wrong.field}", wrong.message) from None
        ends = np.cumsum([0, *map(len, kept)])
        numbers = np.zeros((ends[-1], max((len(row) for table in kept for row in table), default=0)))
        for first, table in zip(ends, kept, strict=False):
            for k, row in enumerate(table):
                numbers[first + k, : len(row)] = row
        kernels = [change_of(dynamics.name) for dynamics in self.dynamics]
        return FloorTable(
            zones=zones,
            background=np.array(rgb(self.background)),
            image=self.pixels,
            extent=self.image.extent() if self.image else np.zeros(4),
            vertices=vertices,
            changes=np.column_stack([np.array(kernels, dtype=np.int64), ends[:-1], ends[1:]]),
            numbers=numbers,
        )

    def _painted(self, rng: np.random.Generator) -> tuple[Floats, Floats]:
        """The zones, and the vertices of the polygons among them, as in FloorTable."""
        corners: list[Point] = []
        rows = [row for zone in self.zones for row in zone.rows(rng, corners)]
        return np.array(rows, dtype=float).reshape(-1, 9), np.array(corners, dtype=float).reshape(-1, 2)

    def colours(self) -> dict[RGB, Colour]:
        """The colours of background and zones, and those that dynamics may paint, as written; without the image."""
        written: list[Colour] = [self.background]
        for zone in self.zones:
            written += zone.colors if isinstance(zone, Tiles) else [zone.color]
        for dynamics in self.dynamics:
            written += [value for kind, value, _ in dynamics.values() if kind in _COLOURS]
        return {rgb(colour): colour for colour in written}

    def with_rows(self) -> Iterator[tuple[Zone, range]]:
        """Each zone, and its rows in every table of this floor."""
        first = 0
        for zone in self.zones:
            yield zone, range(first, first := first + len(zone.rows(np.random.default_rng(0), [])))  # whatever is drawn

    def zone_rows(self) -> dict[str, tuple[int, ...]]:
        """The rows of each named zone in every table of this floor."""
        return {zone.name: tuple(rows) for zone, rows in self.with_rows() if zone.name is not None}
