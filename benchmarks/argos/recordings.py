"""Reading recordings of the original: what a file says, and the missions and robots that it speaks of."""

import dataclasses
import json
import math
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from benchmarks.json_file import read_json
from mercator_design.config import shipped
from mercator_design.errors import MercatorError
from mercator_design.missions.mission import Mission, load_mission
from mercator_design.sim.robot_model import RobotModel, load_robot_model

SHIPPED_XML = ("aggregation", "color_aggregation", "coverage")
MISSIONS = dict(zip(SHIPPED_XML, ("aggregation", "color_aggregation", "grid_exploration"), strict=True))
ROBOTS = dict(zip(SHIPPED_XML, (3, 3, 5), strict=True))
RANGES = dict(zip(SHIPPED_XML, (0.4, 0.4, 0.3), strict=True))  # [m] of proximity
VELOCITIES = dict(zip(SHIPPED_XML, (30.0, 30.0, 0.0), strict=True))  # [cm/s]; coverage sets none
STARTS = (0.0, -0.4, 0.0), (0.4, -0.6, 0.0)
"""Where robots stand until they are placed: the first of a mission file, and its others.

Found from the recorded starts: they are those of the original's generator with exactly these poses in the way. Files
written for other numbers of robots (`n` in the file's settings) put all of them at the first.
"""

WALL_SIZE = (0.01, 0.66)  # [m]
WALLS = tuple(
    ((sign * x, sign * y), number * math.pi / 6)
    for sign in (1, -1)
    for number, (x, y) in enumerate(
        ((1.231, 0.0), (1.066, 0.615), (0.615, 1.066), (0.0, 1.231), (-0.615, 1.066), (-1.066, 0.615))
    )
)
"""Centres [m], rounded to millimetres as they are in its files, and angles."""

_SETTINGS = {"base", "n_robots", "n", "prox_range", "velocity", "length"}
_ORIGINAL_SETTINGS = {"walls", "scale", "arena"}
_NUMBERS = {"prox_range", "velocity", "length", "scale"}


class RecordingError(MercatorError):
    """A file is not a recording that can be compared with."""

    exit_code = 2


def read(file: Path) -> dict[str, Any]:
    """The content of a file: JSON, gzip'd or not, with a list of runs of one kind.

    Raises:
        RecordingError: naming the file and the place in it.
    """
    data: dict[str, Any] = read_json(file, RecordingError)
    runs = data.get("runs") if isinstance(data, dict) else None
    if not isinstance(runs, list) or not runs or not all(isinstance(run, dict) for run in runs):
        raise RecordingError(f"{file}: expected an object with a list 'runs' of traces or of scores")
    if not isinstance(data.setdefault("meta", {}), dict):
        raise RecordingError(f"{file}: meta: expected an object")
    wanted = {"traces": ("name", "mission", "fsm", "robots"), "scores": ("name", "mission", "fsm", "scores")}
    data["kind"] = "traces" if "robots" in runs[0] else "scores"
    for number, run in enumerate(runs):
        for key in wanted[data["kind"]]:
            if key not in run:
                raise RecordingError(f"{file}: runs[{number}]: no '{key}', which each of a file of {data['kind']} has")
            if key in {"name", "mission", "fsm"} and not isinstance(run[key], str):
                raise RecordingError(f"{file}: runs[{number}].{key}: expected text, found {run[key]!r:.40}")
        if not isinstance(run.setdefault("settings", {}), dict):
            raise RecordingError(f"{file}: runs[{number}].settings: expected an object")
    return data


def walls(scale: float = 1.0) -> str:
    """The original's twelve walls, ends and all, as obstacles of a mission."""
    return json.dumps(
        [
            {"center": [scale * x, scale * y], "size": [WALL_SIZE[0], scale * WALL_SIZE[1]], "angle": angle}
            for (x, y), angle in WALLS
        ]
    )


def robot_model(model: RobotModel, settings: Mapping[str, float]) -> RobotModel:
    """A robot with a recording's `prox_range` [m], where 0 is blind, and `velocity` [cm/s], where these are set."""
    constants, drive = model.reference_model, model.drive
    if (proximity_range := settings.get("prox_range")) is not None:
        blind = {"obstacle_threshold": 2.0} if proximity_range == 0.0 else {}
        constants = constants._replace(proximity_range=max(proximity_range, 1e-3), **blind)
    if (velocity := settings.get("velocity")) is not None:
        drive = dataclasses.replace(drive, maximum_speed=velocity / 100.0)
    return dataclasses.replace(model, reference_model=constants, drive=drive)


def shipped_with_original(name: str, settings: Mapping[str, Any], files: Mapping[str, Path]) -> bool:
    """Whether a mission is made from one of the original's own files, of which all is known, its walls and starts too.

    Args:
        name: Of the mission, in the recording.
        settings: See `mission_and_robot`.
        files: By name the missions that were given for those of the recording.
    """
    base = settings.get("base", name)
    return name not in files and isinstance(base, str) and base in MISSIONS


def mission_and_robot(
    name: str, settings: Mapping[str, Any], files: Mapping[str, Path] = MappingProxyType({})
) -> tuple[Mission, RobotModel]:
    """What a mission of a recording is here: the file given for it, the original's, or a shipped one of its name.

    Args:
        name: Of the mission, in the recording.
        settings: `base`, the mission file that it was made from, if it is not the name; and what differs from that:
            `n_robots`, `n` (the file was written for so many), `prox_range` [m], `velocity` [cm/s], `length` [s]; of
            the original's files also `walls` (whether there are any), `scale`, `arena`.
        files: By name the missions that stand for those of the recording.

    Raises:
        RecordingError: if it is made from no known one, or a setting is not.
        MissionError: if the robots do not fit, or a file is wrong.
    """
    base = settings.get("base", name)
    original = shipped_with_original(name, settings, files)
    if not original and name not in files and (not isinstance(base, str) or base not in shipped.missions()):
        raise RecordingError(
            f"mission '{name}': made from '{base}', which is not shipped; say what it is with --mission '{name}'=FILE"
        )
    unknown = sorted(set(settings) - (_SETTINGS | _ORIGINAL_SETTINGS if original else _SETTINGS))
    if unknown:
        raise RecordingError(f"mission '{name}': what its '{unknown[0]}' means is not known here")
    if original:
        settings = {"prox_range": RANGES[base], "velocity": VELOCITIES[base], "length": 120, "scale": 1, **settings}
    for key in _NUMBERS & set(settings):
        if not isinstance(settings[key], int | float) or not 0 <= settings[key] < 1e6:
            raise RecordingError(f"mission '{name}': {key}: expected a number from 0, found {settings[key]!r}")
    robots = settings.get("n_robots", settings.get("n", ROBOTS[base] if original else 1))
    if not isinstance(robots, int) or not 1 <= robots <= 1000:
        raise RecordingError(f"mission '{name}': n_robots: expected a whole number from 1 to 1000, found {robots!r}")
    overrides = [f"duration={settings['length']}"] if "length" in settings else []
    if original or {"n_robots", "n"} & set(settings):
        overrides.append(f"robots={robots}")
    if not original:
        mission = load_mission(files.get(name, base), overrides)
        return mission, robot_model(load_robot_model(mission.robot_model), settings)
    waiting = [list(STARTS[0])] + (robots - 1) * [list(STARTS[0] if "n" in settings else STARTS[1])]
    overrides.append(f"placement.waiting={waiting}")
    if settings.get("walls", True):
        scale = settings["scale"]
        overrides += [f"arena.walls.apothem={1.5 * scale}", f"arena.obstacles={walls(scale)}"]
    else:
        overrides += ["arena.walls.apothem=99"]
    return load_mission(MISSIONS[base], overrides), robot_model(load_robot_model("mercator-argos"), settings)


def positive(text: str) -> int:
    """A whole number from 1."""
    number = int(text)
    if number < 1:
        raise ValueError
    return number


def named_file(text: str) -> tuple[str, Path]:
    """A mission's name in a recording, and the file that says what it is."""
    name, equals, file = text.partition("=")
    if not (name and equals and file):
        raise ValueError
    return name, Path(file)
