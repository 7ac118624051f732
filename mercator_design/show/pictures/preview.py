"""A mission as a picture, seen from above: floor, walls, obstacles, lights, where robots may start, and one start.

This module does not depend on kinds of zones or bodies: the floor comes from `colours_at` point by point, the starting
area from the placement (fixed poses have none), and the robots from an instance. The same mission, seed and versions of
libraries give the same file.
"""

import json
import textwrap
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon as Area
from matplotlib.ticker import MultipleLocator
from scipy import ndimage

from mercator_design.arrays import Floats
from mercator_design.missions.mission import Mission
from mercator_design.missions.placement import FixedPlacement, Region, covers
from mercator_design.results.experiments.preview import MissionPreview
from mercator_design.show.charts import rounded_up
from mercator_design.show.pictures.figures import file_of, house_style
from mercator_design.show.pictures.scenery import (
    OUTSIDE,
    PIXELS,
    arena_grid,
    draw_arena,
    draw_floor,
    draw_light,
    extent,
    name_zones,
    placed,
)
from mercator_design.sim.world import Instance
from mercator_design.system.files import write_bytes

_WIDTH = 4.6  # of the picture [inches]
_BESIDE = 0.01  # visible distance of the start area's border from the walls, as a part of the arena's longer side

_START, _HEADING = "#0072b2", "#d55e00"
_START_AREA, _REACH_OF_CENTRES, _OUT_OF_REACH = "start area", "reach of centres", "out of reach"
_REACH, _HIDDEN = "#5b6770", "#b3123f"
_CORNER = 3  # cells of the grid of `Reach`: half the width of a place out of reach that is worth showing


def save_preview(path: Path, preview: MissionPreview, *, caption: str = "") -> None:
    """Write the picture of a mission, with the floor and the starting poses of an instance.

    The suffix .png or .svg is the format.
    """
    write_bytes(path, picture_of(preview, suffix=path.suffix, caption=caption))


def picture_of(preview: MissionPreview, *, suffix: str, caption: str = "") -> bytes:
    """As `save_preview`, but the contents of the file."""
    with house_style():
        figure = draw_preview(preview)
        if suffix.lower() == ".svg":
            figure.axes[0].images[0].set_interpolation("none")  # all pixels: the viewer scales the picture
        return file_of(figure, suffix, caption)


def draw_preview(preview: MissionPreview) -> Figure:
    """The picture of a mission at the start of an instance; in metres."""
    mission, instance = preview.mission, preview.instance
    low, high = extent(mission)
    size = high - low
    title = _title(mission)
    head, foot, side = 0.29 + 0.135 * (1 + title.count("\n")), 0.4, 0.5  # around the axes [inches]
    scale = min((_WIDTH - 1.5 * side) / size[0], 2.0 * _WIDTH / size[1])
    width, height = scale * size
    figure = Figure(figsize=(_WIDTH, height + head + foot))
    left, total = (_WIDTH - width + 0.5 * side) / 2.0, height + head + foot
    axes = figure.add_axes((left / _WIDTH, foot / total, width / _WIDTH, height / total))
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", facecolor=OUTSIDE)
    axes.set_xlabel("x [m]", labelpad=1.0, loc="left")
    axes.set_ylabel("y [m]", labelpad=1.0)
    axes.tick_params(length=2.0, width=0.6, pad=2.0)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MultipleLocator(rounded_up(0.5 / scale)))
    figure.text(0.5, 1.0 - 0.06 / total, mission.name, ha="center", va="top", weight="bold", size=10.0)
    figure.text(0.5, 1.0 - 0.25 / total, title, ha="center", va="top", size=7.5, linespacing=1.25)
    draw_arena(axes, mission)
    draw_floor(axes, mission, instance.scene.floor)
    legend: list[Artist] = []
    if not isinstance(mission.placement, FixedPlacement) and _draw_start_area(axes, mission, mission.placement):
        legend.append(Line2D([], [], color=_START, linewidth=1.0, linestyle="dashed", label=_START_AREA))
    legend += _draw_reach(axes, preview)
    place = (1.0 - (_WIDTH - left - width) / _WIDTH, 0.0)
    figure.legend(
        handles=legend,
        loc="lower right",
        bbox_to_anchor=place,
        ncols=len(legend),
        frameon=False,
        fontsize=7.0,
        borderpad=0.0,
        columnspacing=1.0,
    )
    _draw_robots(axes, instance)
    name_zones(axes, mission, instance.scene.floor, instance.zone_rows)
    for light in mission.lights:
        draw_light(axes, light, low, high)
    return figure


def _title(mission: Mission) -> str:
    """Robots, duration and objective, and the objective's parameters, in a line or more each."""
    parameters = "; ".join(
        f"{name}: {_value_text(value)}"
        for one in mission.all_objectives
        for name, value in one.parameters.items()
        if value != {}
    )
    robots = f"{mission.robots} robot{'s' * (mission.robots != 1)}"
    goal = f"{robots}, {mission.duration:g} s: {mission.goal}"
    return "\n".join([goal, *textwrap.wrap(parameters, 72, max_lines=3, placeholder=" ...")])


def _value_text(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {_value_text(item)}" for key, item in value.items())
    if isinstance(value, tuple):
        return ", ".join(_value_text(item) for item in value)
    if isinstance(value, float):
        return f"{value:g}"
    return json.dumps(value) if value is None or isinstance(value, bool) else str(value)  # as in YAML


def _draw_start_area(axes: Axes, mission: Mission, placement: Region) -> bool:
    """Draw the border of the starting area, within the arena; return False if that area is too small to show."""
    grid = arena_grid(mission, PIXELS)
    covered = covers(placement, grid.reshape(-1, 2)).reshape(grid.shape[:2])
    x, y = grid[0, :, 0], grid[:, 0, 1]
    inside = mission.arena.contains_grid(x, y)
    depth = ndimage.distance_transform_edt(np.pad(inside, 1))[1:-1, 1:-1]
    smooth = ndimage.gaussian_filter((covered & (depth > _BESIDE * PIXELS)).astype(float), 1.0)
    if smooth.max() <= 0.5:
        return False
    for colour, width, style in (("white", 1.8, "solid"), (_START, 1.0, "dashed")):
        _draw_border(axes, x, y, smooth, colour, width, style, zorder=3.6).set_label(f"_{_START_AREA}")
    return True


def _draw_border(
    axes: Axes, x: Floats, y: Floats, values: Floats, colour: str, width: float, style: str, *, zorder: float
) -> ContourSet:
    """Draw the border of the area where values are above 0.5."""
    border = axes.contour(
        x, y, values, levels=[0.5], colors=[colour], linewidths=width, linestyles=style, zorder=zorder
    )
    vars(border).pop("_contour_generator", None)  # 15 MB that only labels of the line would need
    return border


def _draw_reach(axes: Axes, preview: MissionPreview) -> list[Artist]:
    """Draw the border of the area that the robots' centres can reach; hatch the area that their discs cannot cover.

    Returns the drawn elements, for a legend.
    """
    reach = preview.reach
    if reach is None or not reach.reached.any():
        return []
    rows, columns = reach.reached.shape
    x, y = (reach.low[k] + reach.cell * (np.arange(n) + 0.5) for k, n in enumerate((columns, rows)))
    centres = ndimage.gaussian_filter(reach.reached.astype(float), 1.0)
    for colour, width in (("white", 1.4), (_REACH, 0.7)):
        _draw_border(axes, x, y, centres, colour, width, "dotted", zorder=3.5).set_label(f"_{_REACH_OF_CENTRES}")
    drawn: list[Artist] = [Line2D([], [], color=_REACH, linewidth=0.7, linestyle="dotted", label=_REACH_OF_CENTRES)]
    away = reach.cell * ndimage.distance_transform_edt(~reach.reached)
    covered = away <= min(preview.instance.robot_model.body.half_size)
    hidden = ndimage.binary_opening(reach.inside & ~reach.built & ~covered, np.ones((3, 3)), iterations=_CORNER)
    if hidden.any():
        with mpl.rc_context({"hatch.color": _HIDDEN, "hatch.linewidth": 0.5}):
            area = axes.contourf(
                x, y, hidden.astype(float), levels=[0.5, 1.5], colors="none", hatches=["xxxx"], zorder=3.55
            )
            area.set_label(f"_{_OUT_OF_REACH}")
        label = Area(np.zeros((1, 2)), hatch="xxxx", facecolor="none", edgecolor=_HIDDEN, label=_OUT_OF_REACH)
        drawn.append(label)
    return drawn


def _draw_robots(axes: Axes, instance: Instance) -> None:
    """Draw the bodies, with an arrow towards their heading."""
    body = instance.robot_model.body.outline()
    arrow = np.array([[0.75, 0.0], [-0.45, 0.5], [-0.2, 0.0], [-0.45, -0.5]]) * np.abs(body).max(axis=0)
    poses = instance.swarm.poses[:, :3]
    for outline, head in zip(placed(body, poses), placed(arrow, poses), strict=True):
        axes.add_patch(Area(outline, facecolor="#f7f7f7", edgecolor="black", linewidth=0.8, alpha=0.92, zorder=5))
        axes.add_patch(Area(head, facecolor=_HEADING, edgecolor="none", zorder=6))
