"""The shipped missions as a table, and as JSON."""

import json

from mercator_design import shipped
from mercator_design.missions.mission import load_mission

_GAP = "  "


def missions_table(width: int | None) -> str:
    """A line for each: name, robots, duration, goal, description; cut to a width, if one is given."""
    loaded = [load_mission(name) for name in shipped.missions()]
    rows = [("name", "robots", "time", "objective", "description")]
    for mission in loaded:
        objective = mission.objective
        goal = f"{objective.direction} {objective.name}"
        rows.append((mission.name, str(mission.robots), f"{mission.duration:g} s", goal, mission.description))
    lengths = [max(len(row[k]) for row in rows) for k in range(4)]
    lines = [
        _GAP.join(
            [
                f"{row[0]:<{lengths[0]}}",
                f"{row[1]:>{lengths[1]}}",
                f"{row[2]:>{lengths[2]}}",
                f"{row[3]:<{lengths[3]}}",
                " ".join(row[4].split()),
            ]
        )
        for row in rows
    ]
    return "\n".join(line if width is None or len(line) <= width else f"{line[: width - 1]}…" for line in lines)


def missions_json() -> str:
    """A list of what `missions_table` shows, and source, robot model and file."""
    missions = []
    for name, path in shipped.missions().items():
        mission = load_mission(name)
        missions.append(
            {
                "name": mission.name,
                "description": mission.description,
                "source": mission.source,
                "robots": mission.robots,
                "duration": mission.duration,
                "robot_model": mission.robot_model,
                "objective": mission.objective.name,
                "direction": mission.objective.direction,
                "file": str(path),
            }
        )
    return json.dumps(missions, indent=2)
