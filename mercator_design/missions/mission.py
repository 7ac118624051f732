"""A mission: robots, arena, floor, placement, duration and objective, in one YAML file.

This module defines the keys of a mission file, checks their consistency, and finds the file of a name. The files in
`scenarios/` are found automatically.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from mercator_design.config import shipped
from mercator_design.config.loading import parse, read
from mercator_design.config.schema import (
    FieldError,
    FilePath,
    KeywordsOf,
    Length,
    Name,
    Range,
    check,
    checked,
    parameters_of,
    problems,
)
from mercator_design.config.writing import digest_of, plain
from mercator_design.config.yaml_tree import FromFile
from mercator_design.errors import MercatorError, MissionError, excerpt
from mercator_design.missions.arena import Arena, Light, walls_meet
from mercator_design.missions.calls import Call, NamedFile, copied
from mercator_design.missions.floor import Floor, FloorTable
from mercator_design.missions.objectives import OBJECTIVES
from mercator_design.missions.placement import Placement, outside
from mercator_design.missions.plugins import OF_A_PLUGIN, limits_of
from mercator_design.missions.score_limits import ExperimentSize
from mercator_design.missions.trace import Trace
from mercator_design.plugins.places import first_line
from mercator_design.plugins.registries import is_ours
from mercator_design.scores import ANY_SCORE, EXPECTED, ScoreRange, is_score
from mercator_design.seeds import generator

_NUMBERS: Any = (int, float, np.integer, np.floating, np.bool_)
"""The scores that an objective may return."""
_MAX_CYCLES = 10_000_000
"""Robots times cycles: their trace has 250 MB."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Objective(Call):
    """A function of OBJECTIVES with its parameters and direction."""

    FUNCTIONS: ClassVar = OBJECTIVES
    KIND: ClassVar = "objective"

    direction: Literal["maximise", "minimise"]  # whether a higher or a lower score is better
    parameters: Annotated[Mapping[str, Any], KeywordsOf(OBJECTIVES, "name", OF_A_PLUGIN)]

    def __post_init__(self) -> None:
        Call.__post_init__(self)
        defaults = {name: default for name, (_, default) in parameters_of(self.function).items()}
        checked(problems(self.function, defaults | {**self.parameters}))

    def __call__(self, trace: Trace) -> float:
        """The score of an experiment.

        Raises:
            MissionError: if the function fails, or its value is not a score.
        """
        with self.reporting(MissionError, MercatorError):
            found: Any = self.function(trace, **self.with_paths(copied))
            if not isinstance(found, _NUMBERS):
                what = f"{excerpt(repr(found))} of type {type(found).__name__}"
            elif is_score(found):
                self._check_limits(float(found), trace)
                return float(found)
            else:
                what = excerpt(str(found))
        raise MissionError(f"{first_line(self.function)}objective {self.name}: {EXPECTED}, found {what}")

    def _check_limits(self, score: float, trace: Trace) -> None:
        """Check that a plugin's score is within the limits that the plugin gives; ours are, as tests show."""
        if is_ours(self.function) or limits_of(self.function) is None:
            return
        possible = self.possible_scores(ExperimentSize(trace.robots, trace.cycles, trace.floor, trace.zone_rows))
        if not possible.has(score):
            expected = f"expected a score from {possible.low:g} to {possible.high:g}, as its limits are"
            raise MissionError(f"{first_line(self.function)}objective {self.name}: {expected}, found {score:g}")

    def possible_scores(self, size: ExperimentSize) -> ScoreRange:
        """The range of the scores of experiments of a size.

        Raises:
            MissionError: if the function that gives it fails, or does not return two numbers in order.
        """
        if (limits := limits_of(self.function)) is None:
            return ANY_SCORE._replace(maximise=self.direction == "maximise")
        defaults = {name: default for name, (_, default) in parameters_of(self.function).items()}
        with self.reporting(MissionError, MercatorError):
            found: Any = limits(size, **{**defaults, **self.with_paths(copied)})
            match found:
                case (low, high) if isinstance(low, _NUMBERS) and isinstance(high, _NUMBERS) and low <= high:
                    return ScoreRange(float(low), float(high), self.direction == "maximise")
        expected = "expected limits: the least and the largest score"
        raise MissionError(f"{first_line(limits)}objective {self.name}: {expected}, found {excerpt(repr(found))}")


def _whole_cycles(duration: float, control_period: float) -> Iterator[FieldError]:
    cycles = duration / control_period
    if round(cycles) < 1 or abs(cycles - round(cycles)) > 1e-6:
        period = f"a whole number of control periods ({control_period:g} s)"
        yield FieldError("duration", f"expected {period}, found {duration:g} s")


def _cycles_that_fit(robots: int, duration: float, control_period: float) -> Iterator[FieldError]:
    cycles = round(duration / control_period)
    if cycles * robots > _MAX_CYCLES:
        found = f"{robots} robots x {cycles} cycles"
        yield FieldError("duration", f"expected at most {_MAX_CYCLES} cycles of robots, found {found}")


def _obstacles_inside(arena: Arena) -> Iterator[FieldError]:
    centers = np.array([box.center for box in arena.obstacles], dtype=float).reshape(-1, 2)
    for index in np.flatnonzero(~arena.contains(centers)):
        yield FieldError(f"arena.obstacles[{index}].center", "lies outside the walls")


def _room_around(arena: Arena) -> Iterator[FieldError]:
    if arena.room is not None:
        room, corners = Arena(walls=arena.room), arena.corners()
        if not room.contains(corners).all() or walls_meet(room.corners(), corners):
            yield FieldError("arena.room", "does not contain the arena's walls")


def _lights_seen(robots: int, lights: tuple[Light, ...]) -> Iterator[FieldError]:
    for i, light in enumerate(lights):
        for j, robot in enumerate(light.seen_by or ()):
            if robot >= robots:
                expected = f"expected a robot's number, 0 to {robots - 1}, found {robot}"
                yield FieldError(f"lights[{i}].seen_by[{j}]", expected)


def _zones_known(floor: Floor, objective: Objective) -> Iterator[FieldError]:
    yield from floor.unknown_zones("objective", objective)


def _poses_for_all(robots: int, placement: Placement) -> Iterator[FieldError]:
    for name in ("poses", "waiting"):
        poses = getattr(placement, name, ())
        if poses and len(poses) < robots:
            expected = f"expected a pose for each of {robots} robots, found {len(poses)}"
            yield FieldError(f"placement.{name}", expected)


def _placement_inside(arena: Arena, placement: Placement) -> Iterator[FieldError]:
    place = outside(placement, arena)
    if place is not None:
        yield FieldError(f"placement.{place}", "lies outside the walls")


@dataclass(frozen=True, slots=True, kw_only=True)
class Mission(FromFile):
    """The contents of a mission file."""

    KIND: ClassVar = "mission"
    CHECKS: ClassVar = (
        _whole_cycles,
        _cycles_that_fit,
        _obstacles_inside,
        _room_around,
        _lights_seen,
        _zones_known,
        _poses_for_all,
        _placement_inside,
    )

    schema: Literal[1]  # version of this format
    name: Name  # by default the file's
    description: str = ""  # what the mission is, in a line
    source: str = ""  # where the mission was published
    robots: Annotated[int, Range(1, 1000)]  # how many
    robot_model: Annotated[str, FilePath(unless_name=True)] = "mercator"  # name of a shipped one, or a file's path
    duration: Annotated[float, Range(0.0, 86_400.0, exclusive_low=True)]  # [s] of an experiment
    control_period: Annotated[float, Range(0.001, 10.0)] = 0.1  # [s] from one control cycle to the next
    arena: Arena
    floor: Floor = Floor()
    lights: Annotated[tuple[Light, ...], Length(0, 100)] = ()  # above the floor
    placement: Placement  # where the robots start
    objective: Objective  # what is scored

    def __post_init__(self) -> None:
        check(self)

    def __repr__(self) -> str:
        return f"<Mission {self.name}: {self.summary}>"

    @property
    def summary(self) -> str:
        """Robots, duration and objective in a line."""
        robots = f"{self.robots} robot{'s' * (self.robots != 1)}"
        return f"{robots}, {self.duration:g} s, {self.objective.direction} {self.objective.name}"

    def realise_floor(self, rng: np.random.Generator) -> FloorTable:
        """As `Floor.realise`.

        Raises:
            MissionError: if a dynamic fails in this instance.
        """
        try:
            return self.floor.realise(rng)
        except FieldError as wrong:
            raise MissionError(f"{self.where(f'floor.{wrong.field}')}: {wrong.message}") from None

    @property
    def cycles(self) -> int:
        """The number of control cycles of an experiment."""
        return round(self.duration / self.control_period)

    def possible_scores(self) -> ScoreRange:
        """The range of the scores of this mission.

        Raises:
            MissionError: if a function of a plugin fails.
        """
        floor = self.realise_floor(generator(0, "floor"))
        size = ExperimentSize(self.robots, self.cycles, floor, self.floor.zone_rows())
        return self.objective.possible_scores(size)

    @property
    def digest(self) -> str:
        """Equal for equal missions, wherever their files are; contents of files count, except the robot model's.

        The order of the colours of tiles counts, too: what an instance draws depends on it. Missions that differ
        in it are equal to Python (==), but have other floors.
        """
        image = self.floor.image.digest if self.floor.image else ""
        return digest_of(self.with_files(robot_model="", image=image, named=lambda file: file.digest))

    def with_files(self, *, robot_model: str, image: str, named: Callable[[NamedFile], str]) -> dict[str, Any]:
        """The mission as a mapping for YAML, with other places of its files.

        Args:
            robot_model: The name of a shipped robot model, or a file.
            image: The file of the floor's image, if it has one.
            named: Returns the place of a file that a parameter of the objective or a dynamic names.
        """
        content: dict[str, Any] = plain(self)
        content["robot_model"] = robot_model
        if self.floor.image is not None:
            content["floor"]["image"]["path"] = image
        there = [content["objective"], *content["floor"]["dynamics"]]
        for call, called in zip(self._calls, there, strict=True):
            if call.files:
                called.update(plain(call.with_paths(named)))
        return content

    @property
    def files(self) -> dict[str, bytes]:
        """Contents of the files that parameters name, by their places in a run folder."""
        found = [each for call in self._calls for each in call.files.values()]
        return {file.copy: file.data for file in found}

    @property
    def _calls(self) -> list[Call]:
        """The parts whose parameters may name files."""
        return [self.objective, *self.floor.dynamics]

    def cost(self, score: float) -> float:
        """The cost of a score: what a race minimises."""
        return -score if self.objective.direction == "maximise" else score

    def score(self, cost: float) -> float:
        """The score of a cost."""
        return 0.0 - cost if self.objective.direction == "maximise" else cost


def load_mission(name_or_path: str | Path, overrides: Sequence[str] = ()) -> Mission:
    """The mission of a file, or a shipped one by its name.

    Args:
        name_or_path: a path if there is such a file, or if it looks like one (a separator, .yaml, .yml).
        overrides: assignments as `robots=20` or `floor.zones[0].radius=0.3`.

    Raises:
        MissionError: naming file, line and key.
    """
    path = shipped.find(str(name_or_path), shipped.missions(), "mission")
    defaults = {"name": _name_of(path)}
    return read(path, Mission, error=MissionError, overrides=overrides, defaults=defaults)


def parse_mission(
    text: str,
    *,
    name: str = "mission",
    folder: Path | None = None,
    files: bool = True,
    overrides: Sequence[str] = (),
) -> Mission:
    """The mission of a YAML text; `name` is its label in errors and, if it has none, its name.

    Relative paths in it start from `folder`, by default the working folder; without `files`, it may not name files.

    Raises:
        MissionError: naming line and key.
    """
    defaults = {"name": _name_of(Path(name))}
    return parse(
        text,
        Mission,
        error=MissionError,
        label=name,
        folder=folder,
        files=files,
        overrides=overrides,
        defaults=defaults,
    )


def _name_of(path: Path) -> str:
    """A valid name of a mission from that of a file."""
    return re.sub(r"^\W|[^\w .+-]", "_", path.stem)[:100] or "mission"
