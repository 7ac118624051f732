"""The arena, its floor and lights, seen from above, for pictures of missions and of experiments."""

import itertools
import math
from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.image import AxesImage
from matplotlib.patches import Polygon as Area
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray
from scipy import ndimage

from mercator_design.arrays import Flags, Floats
from mercator_design.config.colours import STATE_COLOURS, hex_of
from mercator_design.missions.arena import Light
from mercator_design.missions.floor import FloorTable
from mercator_design.missions.floor_kernels import colours_at
from mercator_design.missions.mission import Mission
from mercator_design.modules.reference import LED_COLOURS
from mercator_design.results.experiments.experiment import ShownExperiment
from mercator_design.software.architectures import DARK

PIXELS = 800
"""Number of the floor's pixels along its longer side."""
OUTSIDE, WALL, OBSTACLE = "#e4e9ee", "#2b3440", "#8c6239"
UNKNOWN = "#8a949c"
"""Colour of robots whose control software is not known, or no part of it active."""

_LED_COLOURS = [hex_of(*levels) for levels in LED_COLOURS.values()]
_FINER = 2  # points along a pixel's side
_BAND = 50 * _FINER  # rows of points that are coloured at once: all of them take 150 MB
_CELLS = 200  # of the grid on which places for names are found, along the arena's longer side
_LIGHT, _OFF = "#ffd23f", "#6b7580"


def state_colour(number: int) -> str:
    """The colour of robots, by its number in STATE_COLOURS; that of DARK is UNKNOWN, too."""
    return UNKNOWN if number == DARK else hex_of(*STATE_COLOURS[number])


def led_colour(number: int) -> str:
    """The colour of LEDs, by its number in LED_COLOURS."""
    return _LED_COLOURS[number]


def extent(mission: Mission) -> tuple[Floats, Floats]:
    """The lower left and upper right corner of what is shown: the arena, and lights and a room near it."""
    corners = mission.arena.corners()
    low, high = corners.min(axis=0), corners.max(axis=0)
    reach = 0.5 * float((high - low).max())
    near = [np.array(light.position[:2]) for light in mission.lights]
    near += list(mission.arena.room.corners()) if mission.arena.room else []
    shown = [point for point in near if (point > low - reach).all() and (point < high + reach).all()]
    points = np.vstack([corners, *shown])
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.05 * float((high - low).max())
    return low - margin, high + margin


def limits(shown: ShownExperiment) -> tuple[Floats, Floats]:
    """The lower left and upper right corner of what is shown."""
    if shown.mission is not None:
        return extent(shown.mission)
    places = shown.trace.poses[..., :2].reshape(-1, 2)
    margin = 2.0 * shown.robot_model.body.corner
    return places.min(axis=0) - margin, places.max(axis=0) + margin


def placed(outline: Floats, poses: Floats) -> Floats:
    """An outline (points, 2) at poses (robots, 3): (robots, points, 2)."""
    c, s = np.cos(poses[:, 2, np.newaxis]), np.sin(poses[:, 2, np.newaxis])
    x, y = outline[:, 0], outline[:, 1]
    return np.stack([c * x - s * y + poses[:, :1], s * x + c * y + poses[:, 1:2]], axis=-1)


def arena_grid(mission: Mission, along: int) -> Floats:
    """The centres (rows, columns, 2) of the cells of `_centres`."""
    return np.stack(np.meshgrid(*_centres(mission, along)), axis=-1)


def _centres(mission: Mission, along: int) -> tuple[Floats, Floats]:
    """Coordinates x and y of the centres of square cells that cover the arena, `along` its longer side, first at +y.

    There are at least two rows and columns of pixels, also in a thin arena.
    """
    corners = mission.arena.corners()
    low, high = corners.min(axis=0), corners.max(axis=0)
    cell = float((high - low).max()) / along
    columns, rows = (max(2 * _FINER, math.ceil(length / cell - 1e-9)) for length in high - low)
    return low[0] + cell * (np.arange(columns) + 0.5), low[1] + cell * (np.arange(rows)[::-1] + 0.5)


def _bounds(x: Floats, y: Floats) -> tuple[float, float, float, float]:
    """Left, right, bottom and top of cells with such centres."""
    half = 0.5 * (x[1] - x[0])
    return x[0] - half, x[-1] + half, y[-1] - half, y[0] + half


def draw_arena(axes: Axes, mission: Mission) -> None:
    """The walls, whose inner face is the arena's border, the room around them, and the obstacles."""
    if mission.arena.room is not None:
        room = mission.arena.room.corners()
        axes.add_patch(Area(room, facecolor="none", edgecolor=WALL, linewidth=0.8, linestyle=(0, (5, 3)), zorder=1))
    corners = mission.arena.corners()
    axes.add_patch(Area(corners, facecolor="none", edgecolor=WALL, linewidth=5.0, joinstyle="miter", zorder=2))
    for box in mission.arena.obstacles:
        axes.add_patch(Area(box.corners(), facecolor=OBSTACLE, edgecolor="white", linewidth=0.6, zorder=4))


def draw_floor(axes: Axes, mission: Mission, floor: FloorTable) -> None:
    """The colours of the floor, clipped to the arena."""
    x, y = (one[: len(one) - len(one) % _FINER] for one in _centres(mission, PIXELS * _FINER))
    bands = [_mean_colours(floor, x, some) for some in np.split(y, range(_BAND, len(y), _BAND))]
    show_pixels(axes, mission, x, y, np.vstack(bands))


def _mean_colours(floor: FloorTable, x: Floats, y: Floats) -> NDArray[np.uint8]:
    """The colours of pixels, of _FINER points along each side."""
    colours = colours_at(floor, np.stack(np.meshgrid(x, y), axis=-1))
    within = itertools.product(range(_FINER), repeat=2)  # faster than the mean over two axes
    pixels = sum(colours[down::_FINER, right::_FINER] for down, right in within) / _FINER**2
    return np.round(pixels).astype(np.uint8)


def show_pixels(axes: Axes, mission: Mission, x: Floats, y: Floats, pixels: NDArray[np.uint8]) -> AxesImage:
    """Show the colours of a floor, clipped to the arena, in a grid of cells with such centres."""
    image = axes.imshow(pixels, extent=_bounds(x, y), interpolation="antialiased", aspect="equal", zorder=3)
    image.set_clip_path(Area(mission.arena.corners(), transform=axes.transData))
    return image


def name_zones(axes: Axes, mission: Mission, floor: FloorTable, zone_rows: Mapping[str, tuple[int, ...]]) -> None:
    """Draw the names of connected zones where there is most space in them."""
    grid = arena_grid(mission, _CELLS)
    inside = mission.arena.contains(grid.reshape(-1, 2)).reshape(grid.shape[:2])
    for name, rows in zone_rows.items():
        zone = covered(floor, rows, grid) & inside
        if ndimage.label(zone)[1] == 1:
            x, y = grid[_deepest_cell(zone)]
            text = axes.text(x, y, name, ha="center", va="center", size=7.0, color="black", zorder=7)
            text.set_path_effects([withStroke(linewidth=2.0, foreground="white")])


def covered(floor: FloorTable, rows: tuple[int, ...], grid: Floats) -> Flags:
    """The cells that some rows of a floor cover, also under later zones."""
    zones = floor.zones[list(rows)]
    zones[:, 6:] = 1.0
    nothing = floor._replace(zones=zones, background=np.zeros(3), extent=np.zeros(4))
    return np.asarray(colours_at(nothing, grid)[..., 0] > 0.0, dtype=np.bool_)


def _deepest_cell(zone: Flags) -> tuple[int, int]:
    """The cell farthest from the zone's border; of several, that nearest to their middle."""
    depth = ndimage.distance_transform_edt(np.pad(zone, 1))[1:-1, 1:-1]
    deepest = np.argwhere(depth >= depth.max() - 1.0)
    row, column = deepest[np.argmin(np.linalg.norm(deepest - deepest.mean(axis=0), axis=1))]
    return int(row), int(column)


def draw_light(axes: Axes, light: Light, low: Floats, high: Floats) -> None:
    """A sun at the light's place on the ground, with its height; at the border, with its place, if that is far away.

    It is hollow if the light is off.
    """
    place = np.array(light.position[:2])
    margin = 0.04 * (high - low)
    shown = np.clip(place, low + margin, high - margin)
    on = light.intensity > 0.0
    axes.scatter(
        shown[:1],
        shown[1:],
        s=160.0,
        marker=(14, 1, 0),
        facecolors=_LIGHT if on else "none",
        edgecolors="black" if on else _OFF,
        linewidths=0.7,
        zorder=8,
    )
    lines = [f"light, {light.position[2]:g} m high" if on else "light, off"]
    if (shown != place).any():
        lines.append(f"at ({place[0]:g}, {place[1]:g}) m")
    if light.seen_by is not None:
        lines.append(f"for robots {', '.join(map(str, light.seen_by))}")
    upper, right = shown[1] > low[1] + 0.85 * (high - low)[1], shown[0] > 0.5 * (low + high)[0]
    text = axes.annotate(
        "\n".join(lines),
        shown,
        xytext=(-9 if right else 9, -4 if upper else 0),
        textcoords="offset points",
        ha="right" if right else "left",
        va="top" if upper else "center",
        size=6.5,
        zorder=9,
    )
    text.set_path_effects([withStroke(linewidth=2.0, foreground="white")])
