"""What is shown of a sweep: a table of its curves as text, CSV and data, and the figure for a paper.

The figure has the width of a column. Lines are means, bands their confidence intervals; a value without a score is
marked on the axis below, so that a hole is not read as a line.
"""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from mercator_design.results.analysis.sweep import OBJECTIVE, CurvePoint, SettingSweep, SweptRun
from mercator_design.show.charts import COLOURS
from mercator_design.show.pictures.figures import file_of, house_style
from mercator_design.show.text.columns import aligned
from mercator_design.system.csv_text import csv_text
from mercator_design.system.files import write_bytes

RUNS = "runs.csv"
CURVES = "curves.csv"
DATA = "sweep.json"
FIGURES = ("curves.png", "curves.pdf")

_WIDTH, _HEIGHT, _PANEL = 3.5, 2.6, 2.0  # [inch] of a column of a paper; heights alone, and of each of several
_MARKERS = "osD^vPX"


def runs_csv(sweep: SettingSweep, runs: Sequence[SweptRun]) -> str:
    """A row for each run."""
    return csv_text([sweep.columns, *sweep.rows(runs)])


def curves_csv(sweep: SettingSweep, points: Sequence[CurvePoint]) -> str:
    """A row for each method and value, and each of several objectives."""
    labels = {repr(one.value): one.label for one in sweep.settings}
    rows = [{"key": sweep.key, **_fields(one), "value": labels[repr(one.value)]} for one in points]
    return csv_text([[*rows[0]], *(one.values() for one in rows)])


def _fields(point: CurvePoint) -> dict[str, Any]:
    """A point as data; with its objective only if the mission has several."""
    return {
        "value": point.value,
        **{name: one for name, one in point._asdict().items() if name != OBJECTIVE or one},
    }


def sweep_text(sweep: SettingSweep, points: Sequence[CurvePoint]) -> str:
    """The tables of the curves, one for each objective, a row for each value; below them why values have no score."""
    methods = list(dict.fromkeys(one.method for one in points))
    lines = []
    for objective in dict.fromkeys(one.objective for one in points):
        cells = {(one.method, repr(one.value)): one for one in points if one.objective == objective}
        rows = [[sweep.key, *methods]]
        rows += [[one.label, *(_cell(cells[method, repr(one.value)]) for method in methods)] for one in sweep.settings]
        lines += [f"{objective} ({_direction(sweep, objective)})"] if objective else []
        lines += [*aligned(rows), *([""] if objective else [])]
    for setting in sweep.settings:
        failures = [one.failure for one in points if one.failure and repr(one.value) == repr(setting.value)]
        lines += [f"{sweep.key}={setting.label}: {failure}" for failure in dict.fromkeys(failures)]
    return "\n".join(lines).rstrip()


def _direction(sweep: SettingSweep, objective: str) -> str:
    return "maximise" if sweep.objectives[objective].maximise else "minimise"


def _cell(point: CurvePoint) -> str:
    if point.mean is None or point.low is None or point.high is None:
        return "no score"
    return f"{point.mean:.4g} ({point.low:.4g} to {point.high:.4g})"


def sweep_data(sweep: SettingSweep, points: Sequence[CurvePoint]) -> dict[str, Any]:
    """The curves as data for JSON."""
    simulators = [one.simulator for one in sweep.settings if one.simulator is not None]
    return {
        "schema": 1,
        "key": sweep.key,
        "values": [one.value for one in sweep.settings],
        "mission": simulators[0].mission.name if simulators else None,
        **(
            {"objectives": {name: _direction(sweep, name) for name in sweep.objectives}}
            if any(sweep.objectives)
            else {"direction": simulators[0].mission.direction if simulators else None}
        ),
        "seeds": [*sweep.seeds],
        "definition": sweep.definition,
        "designs": [{"name": one.name, "method": one.method} for one in sweep.designs],
        "curves": [_fields(one) for one in points],
    }


def sweep_figure(sweep: SettingSweep, points: Sequence[CurvePoint], suffix: str, *, log: bool = False) -> bytes:
    """The file of the figure; the suffix is its format.

    Args:
        sweep: What was run.
        points: Of its curves.
        suffix: .png, .pdf or .svg.
        log: Whether the values have a logarithmic axis, if they are numbers.
    """
    objectives = list(dict.fromkeys(one.objective for one in points))
    height = _HEIGHT if len(objectives) == 1 else _PANEL * len(objectives)
    with house_style():
        figure = Figure(figsize=(_WIDTH, height), layout="constrained")
        panels = figure.subplots(len(objectives), sharex=True, squeeze=False)[:, 0]
        for axes, objective in zip(panels, objectives, strict=True):
            _draw(axes, sweep, [one for one in points if one.objective == objective], log=log)
            if sweep.objectives:  # else no value is possible
                axes.set_ylabel(f"{objective or _score(sweep)}, {_direction(sweep, objective)}d")
        panels[-1].set_xlabel(f"{sweep.key} [{sweep.unit}]" if sweep.unit else sweep.key)
        panels[0].legend(fontsize=6.5, frameon=False)
        return file_of(figure, suffix)


def _score(sweep: SettingSweep) -> str:
    """The score of the mission, in words."""
    return f"score of {next(one.simulator.mission.name for one in sweep.settings if one.simulator is not None)}"


def _draw(axes: Axes, sweep: SettingSweep, points: Sequence[CurvePoint], *, log: bool) -> None:
    """The curves by one objective."""
    is_numeric = sweep.is_numeric
    places = {repr(one.value): float(one.value) if is_numeric else k for k, one in enumerate(sweep.settings)}
    for k, method in enumerate(dict.fromkeys(one.method for one in points)):
        colour, marker = COLOURS[k % len(COLOURS)], _MARKERS[k % len(_MARKERS)]
        own = sorted((one for one in points if one.method == method), key=lambda one: places[repr(one.value)])
        for part in _whole_parts(own):
            x = [places[repr(one.value)] for one in part]
            middle, low, high = ([_number(each) for each in one] for one in zip(*(p[3:6] for p in part), strict=True))
            axes.plot(x, middle, color=colour, marker=marker, ms=3, lw=1.1)
            axes.fill_between(x, low, high, color=colour, alpha=0.18, linewidth=0)
            if len(part) == 1:  # a band of one point is not seen
                axes.vlines(x, low, high, color=colour, lw=1.1)
        axes.plot([], [], color=colour, marker=marker, ms=3, lw=1.1, label=method)
    if holes := sorted({places[repr(one.value)] for one in points if one.mean is None}):
        across = axes.get_xaxis_transform()
        marks = [0.03] * len(holes)
        axes.plot(holes, marks, "x", color="#7a7a7a", ms=5, transform=across, label="no score", clip_on=False)
    if not is_numeric:
        axes.set_xticks(range(len(places)), [one.label for one in sweep.settings], rotation=20, ha="right")
    elif log:
        axes.set_xscale("log")
    elif all(isinstance(one.value, int) for one in sweep.settings):
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(linewidth=0.3)


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def _whole_parts(points: Sequence[CurvePoint]) -> list[list[CurvePoint]]:
    """The points between holes."""
    parts: list[list[CurvePoint]] = [[]]
    for one in points:
        if one.mean is None:
            parts.append([])
        else:
            parts[-1].append(one)
    return [part for part in parts if part]


def write_sweep(
    folder: Path, sweep: SettingSweep, runs: Sequence[SweptRun], *, command: str = "", log: bool = False
) -> None:
    """Write the files of a sweep: tables, figures, and data with the command.

    Raises:
        OSError: A file cannot be written.
    """
    points = sweep.curves(runs)
    data = {**sweep_data(sweep, points), "command": command}
    write_bytes(folder / DATA, (json.dumps(data, allow_nan=False) + "\n").encode())  # whose it is
    write_bytes(folder / RUNS, runs_csv(sweep, runs).encode())
    write_bytes(folder / CURVES, curves_csv(sweep, points).encode())
    for name in FIGURES:
        write_bytes(folder / name, sweep_figure(sweep, points, Path(name).suffix, log=log))
