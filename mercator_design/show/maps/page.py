"""The page of maps: figures, a picture, and a replay in which the map grows, in one file that makes no request."""

import base64
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from mercator_design.arrays import Floats
from mercator_design.errors import MissionError
from mercator_design.mapping import poses
from mercator_design.mapping.front.surfels import CELL
from mercator_design.mapping.plan.plans import Plan
from mercator_design.missions.floor import Floor
from mercator_design.missions.trace import Trace
from mercator_design.results.experiments.experiment import ShownExperiment, check_extent
from mercator_design.show.charts import STYLE, Axis, ChartLine, line_chart
from mercator_design.show.maps.picture import magnification_of
from mercator_design.show.maps.summary import RELATIVE, clock_text
from mercator_design.show.page import document, script_json, viewer_script, viewer_style
from mercator_design.show.replay import Replay, replay_of
from mercator_design.show.report.markup import Html, contents, figure, folded, note, section, table, text
from mercator_design.show.report.page import asset
from mercator_design.sim.robot_model import RobotModel

REPORT = "report.html"

_PERIOD = 0.1  # [s] of the replay
_MARGIN = 0.3  # [m] around the map


def page_of(
    plans: Sequence[Plan], found: dict[str, Any], pictures: Sequence[bytes], robot_model: RobotModel, command: str
) -> str:
    """The page.

    Args:
        plans: The maps.
        found: Their figures, as of `summary.figures`.
        pictures: Of each map, as PNG.
        robot_model: The model of the robots, for their shape.
        command: That made the maps.
    """
    names = [f"Map {number}" if len(plans) > 1 else "The map" for number in range(1, len(plans) + 1)]
    parts = [section("messages", "What to know", *map(note, found["messages"]))] if found["messages"] else []
    parts += [
        _map_section(number, name, facts, picture, magnification_of(plan))
        for number, (name, facts, picture, plan) in enumerate(zip(names, found["maps"], pictures, plans, strict=True))
    ]
    replays, players = [], []
    for name, plan in zip(names, plans, strict=True):
        replay = growing(plan, robot_model, name)
        if replay is not None:
            replays.append(replay)
            players.append(name)
    parts.append(_replay_section(replays, players))
    parts.append(section("made", "How it was made", text(command)))
    body = "".join(parts)
    robots = len({way.log.name for plan in plans for way in plan.ways})
    title = f"Map of {robots} robot{'s' * (robots != 1)}"
    head = f'<header class="top"><h1>{title}</h1><nav class="toc">{contents(body)}</nav></header>'
    styles = viewer_style() + STYLE + asset("page.css")
    return document(title, styles, f"{head}\n<main>{body}</main>", f"{viewer_script()}\n{asset('page.js')}")


def _map_section(number: int, name: str, facts: dict[str, Any], picture: bytes, magnification: float) -> Html:
    source = f"data:image/png;base64,{base64.b64encode(picture).decode()}"
    width, height = facts["size"]
    about = (
        f"{width:.2f} x {height:.2f} m, {facts['walls']:.1f} m of walls. The points of the lidars lie "
        f"{1e3 * facts['residual']:.1f} mm (rms) from them: their noise, and what is uncertain in the poses."
    )
    robots = table(
        ("robot", "turns", "matched", "way [m]", "odometry's scale", "lag [ms]", "clock [ms]", "keyframes", "frame"),
        [
            (
                *(one["name"], one["turns"], f"{100 * one['matched']:.1f} %", f"{one['path']:.1f}"),
                *(f"{one['odometry_scale']:.3f}", f"{1e3 * one['lag']:.1f}", clock_text(one["clock_offset"], 1e3, 1)),
                *(_deviation(one["keyframe_sd"]), _deviation(one["frame_sd"])),
            )
            for one in facts["robots"]
        ],
    )
    uncertain = note(
        f"Ellipses are where keyframes were with 95 %, drawn {magnification:g} times as large. The table has standard "
        "deviations: of keyframes in the whole map, and of the robot's frame against that of the first robot."
    )
    image = Html(f'<p><img src="{source}" alt="{name}, from above" style="max-width: 100%"></p>')
    known = _truth_parts(facts["truth"]) if facts["truth"] else []
    return section(f"map{number + 1}", name, note(about), image, uncertain, robots, *known)


def _deviation(deviations: list[float] | None) -> str:
    """A place and a heading in words."""
    if deviations is None:
        return ""
    x, y, heading = deviations
    return f"{1e3 * math.hypot(x, y):.1f} mm, {math.degrees(heading):.2f}\N{DEGREE SIGN}"


def _truth_parts(truth: dict[str, Any]) -> list[Html]:
    """Figures of merit against the truth."""
    errors = table(
        ("poses of", "error [mm, rms]", "median [mm]", "largest [mm]", "heading [degrees, rms]"),
        [
            (
                *(what, f"{1e3 * error['rmse']:.1f}", f"{1e3 * error['median']:.1f}", f"{1e3 * error['largest']:.1f}"),
                f"{math.degrees(error['yaw_rms']):.2f}",
            )
            for what, error in truth["ate"].items()
        ],
    )
    relative = table(
        ("relative poses", "error [mm, rms]", "mean [mm]", "median [mm]", "heading [degrees, rms]", "pairs"),
        [
            (
                *(RELATIVE[what], *(f"{1e3 * error[key]:.1f}" for key in ("rmse", "mean", "median"))),
                *(f"{math.degrees(error['yaw_rmse']):.2f}", error["pairs"]),
            )
            for what, error in truth["relative"].items()
        ],
    )
    found = [note("Against the true poses, after one alignment of all robots:"), errors]
    found += [note("Relative poses need no alignment:"), relative] if truth["relative"] else []
    if not truth["cells"]:
        return found
    cells = table(
        ("cells [m]", "F1", "precision", "recall"),
        [(one["cell"], *(f"{one[key]:.3f}" for key in ("f1", "precision", "recall"))) for one in truth["cells"]],
    )
    covered = truth["coverage"]
    curve = line_chart(
        [ChartLine("walls", covered["times"], [100.0 * share for share in covered["shares"]])],
        Axis("time", "s"),
        Axis("walls in the map", "%", low=0.0, high=100.0),
    )
    about = f"Walls in the map over time: {100 * covered['share']:.1f} % at the end, within 5 cm."
    return [
        *found,
        note("Occupied cells against the walls that lidars can see, within a cell:"),
        cells,
        figure(curve, about),
    ]


def _replay_section(replays: Sequence[Replay], names: Sequence[str]) -> Html:
    if not replays:
        return section("growth", "How it grew", note("The logs are too long for a replay."))
    tabs = "".join(
        f'<button type="button" aria-pressed="{str(k == 0).lower()}" data-replay="{k}">{name}</button>'
        for k, name in enumerate(names)
    )
    player = (
        f'<div class="tabs" role="group" aria-label="Maps">{tabs}</div><div id="replay"></div>'
        f'<script type="application/json" id="sources">{script_json(list(replays))}</script>'
    )
    about = note("Each piece of a wall appears when a keyframe first saw it; M hides the map.")
    keys = folded("Keys", note("Space plays; left and right are cycles; up and down change the speed; 0 shows all."))
    return section("growth", "How it grew", about, Html(player), keys)


def growing(plan: Plan, robot_model: RobotModel, title: str) -> Replay | None:
    """A replay of a map's robots, in which walls appear when they are first seen; None: it would be too long."""
    ways = [way for way in plan.ways if len(way.poses)]
    if not ways:
        return None
    begin = min(float(way.times[0] - way.offset) for way in ways)
    end = max(float(way.times[-1] - way.offset) for way in ways)
    cycles = max(1, math.ceil((end - begin) / _PERIOD))
    try:
        check_extent(title, cycles, len(ways), _PERIOD)
        shown = ShownExperiment(
            title=title,
            trace=Trace(
                poses=np.stack([_at(way.times - way.offset, way.poses, begin, cycles) for way in ways], axis=1),
                states=np.zeros((cycles, len(ways)), np.int8),
                floor=Floor(background="white").realise(np.random.default_rng(0)),
                zone_rows={},
                control_period=_PERIOD,
            ),
            robot_model=robot_model,
            names=tuple(way.name for way in ways),
        )
    except MissionError:
        return None
    replay = replay_of(shown)
    replay["header"]["map"] = _strokes(plan, begin)
    replay["header"]["arena"]["frame"] = _frame(plan)
    return replay


def _at(times: Floats, found: Floats, begin: float, cycles: int) -> Floats:
    moments = begin + _PERIOD * np.arange(cycles + 1, dtype=np.float64)
    return poses.interpolate(times, found, moments)


def _strokes(plan: Plan, begin: float) -> list[list[float]]:
    """Pieces as rows of x, y [m] of both ends and the cycle in which each is first seen, in the order of these."""
    first = plan.looks.first
    order = [k for k in np.argsort(first, kind="stable").tolist() if np.isfinite(first[k])]
    along = 0.5 * CELL * np.column_stack([plan.pieces[:, 3], -plan.pieces[:, 2]])
    ends = np.round(np.hstack([plan.pieces[:, :2] - along, plan.pieces[:, :2] + along]), 3)
    cycles = np.maximum(np.floor((first[order] - begin) / _PERIOD), 0.0)
    return [[*ends[k].tolist(), int(cycle)] for k, cycle in zip(order, cycles, strict=True)]


def _frame(plan: Plan) -> list[list[float]]:
    places = np.concatenate([plan.pieces[:, :2], *(way.poses[:, :2] for way in plan.ways)])
    (left, bottom), (right, top) = (places.min(axis=0) - _MARGIN).tolist(), (places.max(axis=0) + _MARGIN).tolist()
    return [[left, bottom], [right, bottom], [right, top], [left, top]]
