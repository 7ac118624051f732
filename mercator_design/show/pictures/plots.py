"""Plots of experiments: trajectories, presence, states, LEDs, distances and the score over time."""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from mercator_design.arrays import Floats
from mercator_design.config.colours import STATE_COLOURS
from mercator_design.errors import excerpt, printable
from mercator_design.modules.reference import LED_COLOURS
from mercator_design.results.experiments.experiment import ShownExperiment
from mercator_design.show.pictures.figures import draw_caption, house_style, save_figure
from mercator_design.show.pictures.scenery import (
    OUTSIDE,
    draw_arena,
    draw_floor,
    led_colour,
    limits,
    name_zones,
    state_colour,
)
from mercator_design.software.architectures import DARK

_COLUMN, _WIDTH, _LEFT = 4.9, 3.7, 0.6  # [inches] a column, the axes in it, and the space left of them
_ABOVE, _BELOW = 0.3, 0.5  # [inches] the space for the legend, and for the axis
_HEAD, _FOOT = 0.4, 0.35  # [inches] the title and the caption
_MAX_PIECES = 200_000  # of all trajectories
_MAX_DISTANCES = 50_000_000  # between robots, over all times
_CELLS = 50  # of the map of presence, along its longer side
_HEIGHTS = {
    "trajectories": _WIDTH,
    "presence": _WIDTH,
    "states": 1.5,
    "leds": 1.5,
    "distances": 1.3,
    "score": 1.1,
}  # of axes [inches]
_CURVE, _OTHER = "#0072b2", "#d55e00"


def save_plots(path: Path, shown: Sequence[ShownExperiment], kinds: Sequence[str], *, caption: str) -> None:
    """Write a figure with a row for each kind, of KINDS, and a column for each experiment.

    The suffix .png, .svg or .pdf is the format.

    Raises:
        OSError: The file cannot be written.
    """
    with house_style():
        save_figure(path, plots(shown, kinds, caption=caption))


def plots(shown: Sequence[ShownExperiment], kinds: Sequence[str], *, caption: str) -> Figure:
    """The figure of `save_plots`."""
    rows = [_ABOVE + _HEIGHTS[kind] + _BELOW for kind in kinds]
    width, height = _COLUMN * len(shown), _HEAD + sum(rows) + _FOOT
    figure = Figure(figsize=(width, height))
    for column, one in enumerate(shown):
        left = _COLUMN * column + _LEFT
        middle = (left + 0.5 * _WIDTH) / width
        title = f"{excerpt(printable(one.title))}\n{one.subtitle}"
        figure.text(middle, 1.0 - 0.08 / height, title, ha="center", va="top", size=8.0)
        bottom = height - _HEAD
        for kind, row in zip(kinds, rows, strict=True):
            bottom -= row
            place = (left / width, (bottom + _BELOW) / height, _WIDTH / width, _HEIGHTS[kind] / height)
            KINDS[kind](figure.add_axes(place), one)
    draw_caption(figure, caption, 0.1 / height, "bottom")
    return figure


def _trajectories(axes: Axes, shown: ShownExperiment) -> None:
    """The paths of the robots' centres, in the colours of their states."""
    _set_scene(axes, shown)
    axes.set_facecolor(OUTSIDE)
    mission = shown.mission
    if mission is not None:
        draw_arena(axes, mission)
        draw_floor(axes, mission, shown.trace.floor)
        name_zones(axes, mission, shown.trace.floor, shown.trace.zone_rows)
    poses, n = shown.trace.poses, shown.trace.cycles
    kept = np.append(np.arange(0, n, math.ceil(shown.trace.states.size / _MAX_PIECES)), n)
    pieces = np.stack([poses[kept[:-1], :, :2], poses[kept[1:], :, :2]], axis=2).reshape(-1, 2, 2)
    colours = [state_colour(number) for cycle in kept[1:].tolist() for number in shown.colours_at(cycle).tolist()]
    axes.add_collection(LineCollection(list(pieces), colors=colours, linewidths=0.7, zorder=5), autolim=False)
    start, end = poses[0], poses[-1]
    axes.scatter(start[:, 0], start[:, 1], s=14.0, facecolors="white", edgecolors="black", linewidths=0.6, zorder=6)
    axes.scatter(end[:, 0], end[:, 1], s=16.0, color="black", edgecolors="white", linewidths=0.6, zorder=7)
    handles = [
        Line2D([], [], marker="o", color="white", markeredgecolor="black", markersize=4.0, label="start"),
        Line2D([], [], marker="o", color="black", linewidth=0.0, markersize=4.0, label="end"),
    ]
    handles += [Line2D([], [], color=state_colour(number), label=name) for number, name in shown.legend]
    _legend(axes, handles)


def _presence(axes: Axes, shown: ShownExperiment) -> None:
    """A map of the time that the robots' centres were at each place."""
    low, high = _set_scene(axes, shown)
    cell = float((high - low).max()) / _CELLS
    edges = [low[k] + cell * np.arange(1 + np.ceil((high[k] - low[k]) / cell)) for k in (0, 1)]
    places = shown.trace.positions.reshape(-1, 2)
    counts, _, _ = np.histogram2d(places[:, 0], places[:, 1], bins=edges)
    seconds = counts.T * shown.trace.control_period
    shortest = shown.trace.control_period
    image = axes.pcolormesh(
        *edges,
        np.ma.masked_equal(seconds, 0.0),
        cmap="viridis",
        norm=LogNorm(shortest, max(float(seconds.max()), 2.0 * shortest)),
        rasterized=True,
        zorder=3,
    )
    if shown.mission is not None:
        draw_arena(axes, shown.mission)
    beside = axes.inset_axes((1.03, 0.0, 0.03, 1.0))
    axes.figure.colorbar(image, cax=beside, format=lambda seconds, _: f"{seconds:g}")
    axes.set_title(f"time of robots in a cell of {100.0 * cell:.0f} cm [s]", size="medium")  # beside the bar is no room


def _states(axes: Axes, shown: ShownExperiment) -> None:
    """The state of each robot over time."""
    numbers = np.array([shown.colours_at(cycle) for cycle in range(1, shown.trace.cycles + 1)])
    _rows_of_robots(axes, shown, numbers, [state_colour(number) for number in range(DARK, len(STATE_COLOURS))])
    _legend(axes, [Patch(color=state_colour(number), label=name) for number, name in shown.legend])


def _leds(axes: Axes, shown: ShownExperiment) -> None:
    """The colour of each robot's LEDs over time, white where modules do not set it."""
    leds = shown.led_colours
    if leds is None:
        axes.set_axis_off()
        axes.text(0.5, 0.5, "no module sets the LEDs", ha="center", va="center", transform=axes.transAxes)
        return
    _rows_of_robots(axes, shown, leds[1:], ["white", *map(led_colour, range(len(LED_COLOURS)))], "robot, LEDs")
    names = [*LED_COLOURS]
    seen = [number for number in np.unique(leds).tolist() if number >= 0]
    _legend(axes, [Patch(color=led_colour(number), label=names[number]) for number in seen], columns=len(names))


def _rows_of_robots(
    axes: Axes, shown: ShownExperiment, numbers: NDArray[np.int8], colours: Sequence[str], label: str = "robot"
) -> None:
    """Colours of robots (cycles, robots) over time, by number from -1."""
    trace = shown.trace
    axes.imshow(
        numbers.T,
        aspect="auto",
        interpolation="nearest",
        cmap=ListedColormap(colours),
        vmin=-1.5,
        vmax=len(colours) - 1.5,
        extent=(0.0, trace.cycles * trace.control_period, trace.robots - 0.5, -0.5),
    )
    axes.set(xlabel="time [s]", ylabel=label)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))


def _distances(axes: Axes, shown: ShownExperiment) -> None:
    """Distances between the robots' centres over time: to the nearest robot, and of all pairs."""
    trace = shown.trace
    every = math.ceil((trace.cycles + 1) * trace.robots**2 / _MAX_DISTANCES)
    times = trace.control_period * np.arange(0, trace.cycles + 1, every)
    axes.set(xlabel="time [s]", ylabel="distance [m]", xlim=(0.0, times[-1]))
    if trace.robots == 1:
        axes.text(0.5, 0.5, "one robot", ha="center", va="center", transform=axes.transAxes)
        return
    nearest, pairs = _distances_of(trace.poses[::every, :, :2])
    axes.fill_between(times, nearest.min(axis=1), nearest.max(axis=1), color=_CURVE, alpha=0.2, linewidth=0.0)
    axes.plot(times, nearest.mean(axis=1), color=_CURVE, linewidth=1.0, label="to the nearest: mean, and range")
    axes.plot(times, pairs, color=_OTHER, linewidth=1.0, label="of all pairs: mean")
    axes.set_ylim(bottom=0.0)
    _legend(axes)


def _distances_of(places: Floats) -> tuple[Floats, Floats]:
    """Distances (cycles, robots) to the nearest robot, and the mean over all pairs (cycles,)."""
    robots = places.shape[1]
    nearest, means = np.zeros(places.shape[:2]), np.zeros(len(places))
    for k, row in enumerate(places):
        between = cdist(row, row)
        means[k] = between.sum() / (robots * (robots - 1))
        np.fill_diagonal(between, np.inf)
        nearest[k] = between.min(axis=1)
    return nearest, means


def _score(axes: Axes, shown: ShownExperiment) -> None:
    """The score if the experiment had ended earlier."""
    trace, curve = shown.trace, shown.curve
    axes.set(xlabel="time [s]", ylabel="score", xlim=(0.0, trace.cycles * trace.control_period))
    if not len(curve.cycles):
        axes.text(0.5, 0.5, "there is no score", ha="center", va="center", transform=axes.transAxes)
        return
    axes.plot(curve.cycles * trace.control_period, curve.scores, color=_CURVE, linewidth=1.0, label="score so far")
    axes.margins(y=0.08)
    _legend(axes)


KINDS: Mapping[str, Callable[[Axes, ShownExperiment], None]] = {
    "trajectories": _trajectories,
    "presence": _presence,
    "states": _states,
    "leds": _leds,
    "distances": _distances,
    "score": _score,
}
"""The kinds of plots, by name."""


def usual_kinds(shown: Sequence[ShownExperiment]) -> list[str]:
    """The kinds of plots that have something to show."""
    return [kind for kind in KINDS if kind != "leds" or any(one.led_colours is not None for one in shown)]


def _set_scene(axes: Axes, shown: ShownExperiment) -> tuple[Floats, Floats]:
    low, high = limits(shown)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x [m]", ylabel="y [m]", aspect="equal")
    return low, high


def _legend(axes: Axes, handles: Sequence[Line2D | Patch] | None = None, columns: int = 6) -> None:
    if handles is None or handles:
        axes.legend(
            handles=handles,
            loc="lower center",
            bbox_to_anchor=(0.5, 1.0),
            ncols=columns,
            frameon=False,
            fontsize=6.5,
            columnspacing=1.0,
            handlelength=1.2,
            borderpad=0.1,
        )
