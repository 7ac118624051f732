"""Figures of the comparison."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from benchmarks.argos.correlations import correlation
from benchmarks.argos.recordings import WALLS
from benchmarks.argos.scores import SINGLE, Comparison
from benchmarks.argos.traces import Trace, apart, copies_apart, drive
from mercator_design.missions.arena import rectangle_corners

THEIRS, OURS, REPEATED, COPIES = "#999999", "#1f5fa8", "#d9730d", "#b8cfe8"
BODY = 0.286  # [m]


def _save(figure: Figure, file: Path) -> Path:
    FigureCanvasAgg(figure).print_png(file, metadata={"Software": None})  # type: ignore[no-untyped-call]
    return file


def contacts(traces: Sequence[Trace], displaced: float, file: Path) -> Path:
    """Scenes of contact: paths, recorded and replayed, and how far apart they are over time."""
    found = [(trace, *drive(trace)) for trace in traces]
    walls = [one for one in found if one[2][0] < one[0].cycles and one[2][1] == one[0].cycles]
    robots = [one for one in found if one[2][1] < one[0].cycles]
    walls.sort(key=lambda one: (one[0].range, -np.ptp(one[0].poses[..., :2], axis=0).sum()))
    robots.sort(key=lambda one: (one[0].range, -one[0].robots))
    chosen = [*walls[:2], *robots[:2]]
    figure = Figure(figsize=(3.3 * max(1, len(chosen)), 6.2), dpi=80, layout="constrained")
    if not chosen:
        figure.text(0.5, 0.5, "no contact in these runs", ha="center")
        return _save(figure, file)
    above, below = figure.subplots(2, len(chosen), squeeze=False, height_ratios=(3, 2))
    for paths, errors, (trace, ours, first) in zip(above, below, chosen, strict=True):
        _paths(paths, trace, ours)
        _errors(errors, trace, ours, first, displaced)
    for axes in below[1:]:
        axes.sharey(below[0])
    figure.suptitle("Driven by the same commands: paths and last places, theirs wide, ours narrow", fontsize=10)
    below[0].set_ylabel("distance of robots from theirs [mm]")
    figure.legend(
        *below[-1].get_legend_handles_labels(), loc="outside lower center", ncols=5, frameon=False, fontsize=9
    )
    return _save(figure, file)


def _paths(axes: Axes, trace: Trace, ours: np.ndarray) -> None:
    for center, angle in WALLS:
        axes.add_patch(Polygon(rectangle_corners(center, (0.01, 0.66), angle), color="black", lw=1))
    for i in range(trace.robots):
        axes.plot(*trace.poses[:, i, :2].T, color=THEIRS, lw=4, solid_capstyle="round")
        axes.plot(*ours[:, i, :2].T, color=OURS, lw=1)
        for poses, style in ((trace.poses, {"color": THEIRS, "lw": 3}), (ours, {"color": OURS, "lw": 1})):
            x, y, heading = poses[-1, i]
            corners = rectangle_corners((x, y), (BODY, BODY), heading)
            axes.add_patch(Polygon(corners, fill=False, ec=style["color"], lw=style["lw"]))
    axes.set(xticks=[], yticks=[], aspect="equal", xlim=(-1.3, 1.3), ylim=(-1.3, 1.3))
    axes.set_title(trace.name, fontsize=9)
    axes.set_axis_off()


def _errors(axes: Axes, trace: Trace, ours: np.ndarray, first: np.ndarray, displaced: float) -> None:
    least = 1e-3  # [mm] below the rounding of the recording
    seconds = 0.1 * np.arange(trace.cycles)
    error = 1e3 * apart(ours, trace.poses)[0]
    if first[1] < trace.cycles:
        spread = 1e3 * copies_apart(trace, displaced).mean(axis=2)
        label = f"ours from copies started {1e3 * displaced:g} mm elsewhere"
        axes.fill_between(seconds, spread.min(axis=0) + least, spread.max(axis=0) + least, color=COPIES, label=label)
    else:
        axes.axhline(1e3 * 1e-4, color=COPIES, lw=1)
    axes.plot(seconds, error.max(axis=1) + least, color=OURS, lw=0.7, label="the farthest robot")
    axes.plot(seconds, error.mean(axis=1) + least, color=OURS, lw=2, label="mean robot")
    for cycle, style, label in ((first[0], ":", "first touch of a wall"), (first[1], "--", "of another robot")):
        axes.axvline(0.1 * cycle if cycle < trace.cycles else math.nan, color="black", lw=0.8, ls=style, label=label)
    axes.set(yscale="log", xlabel="s", ylim=(least, 2e3), xlim=(0, seconds[-1]))
    axes.grid(visible=True, lw=0.3)


def means(comparisons: Sequence[Comparison], file: Path) -> Path:
    """Mean scores of the controllers, ours against theirs, a panel a mission; bars are standard errors."""
    comparisons = [c for c in comparisons if len({*c.means("score").ravel()}) > 1] or comparisons
    columns = min(4, len(comparisons))
    rows = -(-len(comparisons) // columns)
    figure = Figure(figsize=(3.1 * columns, 3.1 * rows + 0.4), dpi=80, layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in panels[len(comparisons) :]:
        axes.set_axis_off()
    for axes, comparison in zip(panels, comparisons, strict=False):
        theirs, ours = comparison.means("score")
        errors = [
            [one["score"].std(ddof=1) / math.sqrt(len(one["score"])) if len(one["score"]) > 1 else 0.0 for one in side]
            for side in zip(*((c.theirs, c.ours) for c in comparison.controllers), strict=True)
        ]
        again = [(c.theirs["score"].mean(), c.repeated["score"].mean()) for c in comparison.controllers if c.repeated]
        low, high = min(*theirs, *ours), max(*theirs, *ours)
        margin = 0.06 * (high - low) or 1.0
        axes.axline((low, low), (high + margin, high + margin), color=THEIRS, lw=0.8)
        axes.errorbar(
            theirs, ours, xerr=errors[0], yerr=errors[1], fmt="o", ms=3, lw=0.6, color=OURS, label="our seeds"
        )
        if again:
            label = "their seeds and random numbers"
            axes.plot(*np.array(again).T, "x", ms=5, mew=1.2, color=REPEATED, label=label)
        axes.set(xlim=(low - margin, high + margin), ylim=(low - margin, high + margin), aspect="equal")
        axes.locator_params(nbins=4)
        axes.ticklabel_format(scilimits=(-3, 4))
        axes.tick_params(labelsize=8)
        found = correlation(theirs, ours)
        title = f"Spearman {found:.3f}" if math.isfinite(found) else "all scores are equal"
        axes.set_title(f"{comparison.mission}\n{title}", fontsize=9)
    figure.supxlabel("mean score, original", fontsize=10)
    figure.supylabel("mean score, ours", fontsize=10)
    figure.legend(
        *panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=2, frameon=False, fontsize=9
    )
    return _save(figure, file)


def statistics(comparisons: Sequence[Comparison], file: Path) -> Path:
    """Means of the statistics of the controllers, ours against theirs, a panel a statistic, a colour a mission."""
    with_them = [name for name in SINGLE if any(len({*c.means(name).ravel()}) > 1 for c in comparisons)]
    figure = Figure(figsize=(12.4, 2.9 * max(1, -(-len(with_them) // 4)) + 0.5), dpi=80, layout="constrained")
    if not with_them:
        figure.text(0.5, 0.5, "no statistics were recorded", ha="center")
        return _save(figure, file)
    panels = figure.subplots(-(-len(with_them) // 4), 4, squeeze=False).ravel()
    for axes in panels[len(with_them) :]:
        axes.set_axis_off()
    for axes, name in zip(panels, with_them, strict=False):
        for number, comparison in enumerate(comparisons):
            theirs, ours = comparison.means(name)
            axes.plot(theirs, ours, "o", ms=2.5, color=f"C{number % 10}", label=comparison.mission)
        low, high = axes.get_xlim()
        axes.axline((low, low), (high, high), color=THEIRS, lw=0.8, zorder=0)
        axes.set_title(name, fontsize=9)
        axes.locator_params(nbins=4)
        axes.tick_params(labelsize=8)
    figure.supxlabel("mean over a controller's runs, original", fontsize=10)
    figure.supylabel("ours, with our seeds", fontsize=10)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=5, frameon=False, fontsize=9, markerscale=2)
    return _save(figure, file)
