"""A map as a picture: cells, pieces of walls, the ways of robots and a scale."""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.figure import Figure

from mercator_design.mapping.front.surfels import CELL
from mercator_design.mapping.plan.plans import Plan
from mercator_design.show.charts import COLOURS, rounded_up
from mercator_design.show.maps.summary import known
from mercator_design.show.pictures.figures import file_of, house_style

UNKNOWN = 0.88
"""The level of gray of cells of which nothing is known; free ones are white."""

_WALL = "#1c2430"
_MAX_WIDTH, _MAX_HEIGHT = 9.0, 8.0  # inches
_MARGIN = 0.15  # [m]
_ELLIPSE = math.sqrt(5.991)  # standard deviations of an ellipse of 95 %
_ELLIPSE_SHARE = 0.01  # of the picture's width that half a usual ellipse takes
_MAX_NAME = 30  # characters in the legend
_MAX_ELLIPSES = 30  # of a robot


def picture_of(plan: Plan, caption: str = "") -> bytes:
    """A map as PNG."""
    with house_style():
        low, high = _limits(plan)
        width, height = np.maximum(high - low, 0.5)
        scale = min(_MAX_WIDTH / width, _MAX_HEIGHT / height)
        figure = Figure(figsize=(max(3.0, scale * width), max(2.5, scale * height)), layout="constrained")
        axes = figure.add_subplot()
        draw_map(axes, plan)
        _draw_ellipses(axes, plan)
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
        _draw_scale(axes, float(width), low)
        return file_of(figure, ".png", caption)


def draw_map(axes: Axes, plan: Plan) -> None:
    """Draw cells, walls and ways."""
    grid = plan.occupancy
    share = grid.hits / np.maximum(grid.hits + grid.crossings, 1)
    gray = np.where(known(plan), 1.0 - 0.6 * share * grid.occupied, UNKNOWN)
    rows, columns = gray.shape
    x, y = grid.corner.tolist()
    extent = (x, x + columns * grid.resolution, y, y + rows * grid.resolution)
    axes.imshow(gray, cmap="gray", vmin=0.0, vmax=1.0, origin="lower", extent=extent, interpolation="nearest")
    along = 0.5 * CELL * np.column_stack([plan.pieces[:, 3], -plan.pieces[:, 2]])
    strokes = np.stack([plan.pieces[:, :2] - along, plan.pieces[:, :2] + along], axis=1)
    axes.add_collection(LineCollection(list(strokes), colors=_WALL, linewidths=1.4, zorder=3))
    for number, way in enumerate(plan.ways):
        if len(way.poses):
            colour = COLOURS[number % len(COLOURS)]
            axes.plot(way.poses[:, 0], way.poses[:, 1], color=colour, linewidth=0.7, alpha=0.8, zorder=2)
            axes.plot(*way.poses[0, :2], "o", color=colour, markersize=4.0, zorder=4, label=way.name[:_MAX_NAME])
    if 0 < len(plan.ways) <= len(COLOURS):
        axes.legend(fontsize=6, loc="upper right", framealpha=0.9)
    axes.set_aspect("equal")
    axes.set_axis_off()


def magnification_of(plan: Plan) -> float:
    """How many times as large as they are ellipses are drawn, to be seen: 1, 2, 5, 10 and so on."""
    covariances = np.concatenate([np.zeros((0, 3, 3)), *(way.covariances for way in plan.ways)])
    if not covariances[:, :2, :2].any():
        return 1.0
    low, high = _limits(plan)
    usual = _ELLIPSE * math.sqrt(float(np.median(covariances[:, 0, 0] + covariances[:, 1, 1])))
    return max(1.0, rounded_up(_ELLIPSE_SHARE * float((high - low).max()) / max(usual, 1e-6)))


def _draw_ellipses(axes: Axes, plan: Plan) -> None:
    """Draw where some of the keyframes were with 95 %, magnified."""
    scale = 2.0 * _ELLIPSE * magnification_of(plan)
    for number, way in enumerate(plan.ways):
        every = max(1, math.ceil(len(way.keyframes) / _MAX_ELLIPSES))
        places = way.keyframe_poses[::every, :2]
        values, vectors = np.linalg.eigh(way.covariances[::every, :2, :2])
        widths, heights = scale * np.sqrt(np.maximum(values.T, 0.0))
        angles = np.degrees(np.arctan2(vectors[:, 1, 0], vectors[:, 0, 0]))
        colour = COLOURS[number % len(COLOURS)]
        axes.add_collection(
            EllipseCollection(
                *(widths, heights, angles),
                units="xy",
                offsets=places,
                offset_transform=axes.transData,
                facecolors="none",
                edgecolors=colour,
                linewidths=0.5,
                zorder=4,
            )
        )


def _limits(plan: Plan) -> tuple[np.ndarray, np.ndarray]:
    """The lower left and upper right corner [m] of what is shown."""
    places = np.concatenate([plan.pieces[:, :2], *(way.poses[:, :2] for way in plan.ways)])
    if not len(places):
        return np.zeros(2), np.ones(2)
    return places.min(axis=0) - _MARGIN, places.max(axis=0) + _MARGIN


def _draw_scale(axes: Axes, width: float, low: np.ndarray) -> None:
    """A bar of 1, 2 or 5 times a power of ten metres, about a fifth of the width."""
    power = 10.0 ** math.floor(math.log10(width / 5.0))
    length = max(step * power for step in (1.0, 2.0, 5.0) if step * power <= width / 4.0 or step == 1.0)
    x, y = low[0] + 0.03 * width, low[1] + 0.02 * width
    axes.plot([x, x + length], [y, y], color=_WALL, linewidth=2.5, solid_capstyle="butt", zorder=5)
    axes.text(x + 0.5 * length, y + 0.01 * width, f"{length:g} m", ha="center", va="bottom", fontsize=7, zorder=5)
