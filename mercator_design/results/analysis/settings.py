"""Missions and robots with other settings, as `mdesign sweep` and its like vary them: by the paths of keys.

A path is that of a key of the mission, as --set has it, or one below `robot_model`, of a key of the robot model.
`arena.scale` is no key of a mission: it multiplies all places and lengths of the arena, its floor, its placement, its
lights and what the objective has of them, while robots and what they sense, heights and times stay as they are.
"""

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import yaml

from mercator_design.config.loading import parse
from mercator_design.config.writing import dump, plain
from mercator_design.errors import MercatorError, MissionError, excerpt
from mercator_design.missions.mission import Mission, parse_mission
from mercator_design.sim.robot_model import RobotModel
from mercator_design.sim.simulate import Simulator, robot_model_of

OF_ROBOTS = "robot_model."
SCALE = "arena.scale"
MAX_SCALE = 1000.0

_LENGTHS = {"apothem", "radius", "inner_radius", "size", "side", "square_side", "circle_radius"}
_PLACES = {"vertices", "center", "centers", "point", "poses", "waiting", "position", "square_center", "circle_center"}
"""Keys with places of the arena: x and y, and perhaps what stays as it is, or lists of such."""
_SCALED = ("arena", "floor", "placement", "lights", "objective", "objectives")


class Setting(NamedTuple):
    """A mission and its robots with one value of a key.

    value: As in YAML.
    simulator: None if the value is impossible.
    failure: Why it is.
    """

    value: Any
    simulator: Simulator | None
    failure: str = ""

    @property
    def label(self) -> str:
        """The value as a text."""
        return self.value if isinstance(self.value, str) else json.dumps(self.value)


def is_of_setting(assignment: str) -> bool:
    """Whether an assignment is none of the mission itself: of its robot model, or a scale of its arena."""
    path = assignment.partition("=")[0].strip()
    return path.startswith(OF_ROBOTS) or path == SCALE


def settings_of(
    mission: Mission,
    robot_model: RobotModel | None,
    key: str,
    values: Sequence[Any],
    *,
    overrides: Sequence[str] = (),
    keeps_density: bool = False,
) -> list[Setting]:
    """The settings of the values of a key; that of an impossible value has a failure.

    Args:
        mission: The mission.
        robot_model: The robots. [default: the mission's]
        key: What is varied: a path, see this module.
        values: Its values, as in YAML.
        overrides: Assignments that hold for all values.
        keeps_density: Whether the arena grows with the number of robots, which is varied: its area for each robot is
            the mission's.

    Raises:
        MissionError: Density is to be kept, and another key than the number of robots is varied.
    """
    if keeps_density and key != "robots":
        raise MissionError(f"the density is kept where the number of robots varies, found {excerpt(key)}")
    found = []
    for value in values:
        assignments = [*overrides]
        if keeps_density and isinstance(value, int) and value > 0:
            assignments.append(f"{SCALE}={math.sqrt(value / mission.robots)!r}")
        assignments.append(f"{key}={_yaml(value)}")
        try:
            simulator = _simulator_with(mission, robot_model, assignments)
            simulator.refuse_impossible()
            simulator.check_placement()
            found.append(Setting(value, simulator))
        except MercatorError as error:
            found.append(
                Setting(value, None, "; ".join(_without_place(one, assignments[-1]) for one in error.messages))
            )
    return found


def _without_place(message: str, assignment: str) -> str:
    """A message without the assignment and its key, which whoever shows it names."""
    place = f"--set {excerpt(assignment)}: "
    own = message.removeprefix(place)
    return own if own == message else own.removeprefix(f"{_path(assignment).removeprefix(OF_ROBOTS)}: ")


def _simulator_with(mission: Mission, robot_model: RobotModel | None, assignments: Sequence[str]) -> Simulator:
    own = [one for one in assignments if not is_of_setting(one)]
    scale = math.prod(_scale(one) for one in assignments if _path(one) == SCALE)
    content = plain(mission)
    if scale != 1.0:
        content = scaled(content, scale)
    changed = parse_mission(dump(content), name=mission.name, overrides=own)
    if robot_model is None or any(_path(one) == "robot_model" for one in own):
        robot_model = robot_model_of(changed)
    of_robots = [one.strip().removeprefix(OF_ROBOTS) for one in assignments if _path(one).startswith(OF_ROBOTS)]
    return Simulator(changed, _robots_with(robot_model, of_robots) if of_robots else robot_model)


def _yaml(value: Any) -> str:  # noqa: ANN401
    """A value as a line of YAML; JSON's 1e-05 would be a text there."""
    text: str = yaml.safe_dump(value, default_flow_style=True, width=10**6)
    return text.removesuffix("...\n").strip()


def _path(assignment: str) -> str:
    return assignment.partition("=")[0].strip()


def _scale(assignment: str) -> float:
    try:
        scale = float(assignment.partition("=")[2])
    except ValueError:
        scale = math.nan
    if not 0.0 < scale <= MAX_SCALE:
        raise MissionError(f"--set {excerpt(assignment)}: expected a number above 0 and at most {MAX_SCALE:g}")
    return scale


def scaled(mission: Mapping[str, Any], scale: float) -> dict[str, Any]:
    """A mission as data, in another size; see this module."""

    def part(value: Any) -> Any:  # noqa: ANN401 - dicts, lists and scalars
        if isinstance(value, list):
            return [part(one) for one in value]
        if not isinstance(value, Mapping):
            return value
        return {
            key: _multiplied(one, scale) if key in _LENGTHS else _moved(one, scale) if key in _PLACES else part(one)
            for key, one in value.items()
        }

    return {key: part(value) if key in _SCALED else value for key, value in mission.items()}


def _multiplied(value: Any, scale: float) -> Any:  # noqa: ANN401
    return [_multiplied(one, scale) for one in value] if isinstance(value, list) else value * scale


def _moved(value: Any, scale: float) -> Any:  # noqa: ANN401
    """A place with x and y multiplied, or a list of places."""
    if value and isinstance(value[0], list):
        return [_moved(one, scale) for one in value]
    return [*(one * scale for one in value[:2]), *value[2:]]


def _robots_with(model: RobotModel, assignments: Sequence[str]) -> RobotModel:
    """A robot model with other values; what is null on the way to one is made, noise as normally distributed."""
    content = plain(model)
    for one in assignments:
        place = content
        for step in _path(one).split(".")[:-1]:
            if isinstance(place, dict) and place.get(step, "") is None:
                place[step] = {"distribution": "gaussian"} if step.endswith("noise") else {}
            place = place.get(step) if isinstance(place, dict) else None
    try:
        return parse(dump(content), RobotModel, error=MissionError, label=model.name, overrides=assignments)
    except MissionError as error:
        raise MissionError(*(each.replace("--set ", f"--set {OF_ROBOTS}", 1) for each in error.messages)) from None
