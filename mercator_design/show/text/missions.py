"""The shipped missions and robot models, as tables and as JSON."""

import json
from collections.abc import Sequence
from typing import Any

from mercator_design.config import shipped
from mercator_design.missions.mission import Mission, load_mission
from mercator_design.missions.objectives.scoring import Scored
from mercator_design.sim.robot_model import load_robot_model

_GAP = "  "


def missions_table(width: int | None) -> str:
    """A line for each mission: name, robots, duration, description, cut to a width; without one, the objective too."""
    rows = [("name", "robots", "time", "objective", "description")]
    for name in shipped.missions():
        mission = load_mission(name)
        time, goal = f"{mission.duration:g} s", mission.goal
        rows.append((mission.name, f"{mission.robots:>6}", f"{time:>5}", goal, mission.description))
    return _table([row if width is None else (*row[:3], row[4]) for row in rows], width)


def robot_models_table(width: int | None) -> str:
    """A line for each robot model: name, description; cut to a width, if one is given."""
    return _table([(name, load_robot_model(name).description) for name in shipped.robot_models()], width)


def _table(rows: Sequence[tuple[str, ...]], width: int | None) -> str:
    """Columns, the last of which takes the room that is left."""
    widths = [max(map(len, column)) for column in list(zip(*rows, strict=True))[:-1]]
    lines = []
    for *cells, last in rows:
        line = _GAP.join([*(f"{cell:<{n}}" for cell, n in zip(cells, widths, strict=True)), " ".join(last.split())])
        lines.append(line if width is None or len(line) <= width else f"{line[: width - 1]}…")
    return "\n".join(lines)


def scores_text(mission: Mission, scored: Scored) -> str:
    """The score of an experiment; of several objectives a figure for each."""
    if not mission.objectives:
        return f"score {scored.score:g}"
    each = [f"{name} {score:g}" for name, score in zip(mission.objective_names, scored.by_objective, strict=True)]
    return ", ".join([*each, *([f"weighted cost {scored.score:g}"] if mission.weights else [])])


def missions_json() -> str:
    """A list of the facts of `missions_facts`, with the files."""
    files = shipped.missions()
    return json.dumps([facts | {"file": str(files[name])} for name, facts in missions_facts().items()], indent=2)


def missions_facts() -> dict[str, dict[str, Any]]:
    """Name -> facts of the shipped missions."""
    return {name: facts_of(load_mission(name)) for name in shipped.missions()}


def facts_of(mission: Mission) -> dict[str, Any]:
    """The facts on a mission that `missions_table` shows, and its source and robot model."""
    return {
        "name": mission.name,
        "description": mission.description,
        "source": mission.source,
        "robots": mission.robots,
        "duration": mission.duration,
        "robot_model": mission.robot_model,
        "objective": ", ".join(mission.objective_names),
        "direction": mission.direction,
    }
