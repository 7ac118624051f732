"""A mission: robots, arena, floor, placement, duration and objectives, in one YAML file.

This module defines the keys of a mission file, checks their consistency, and finds the file of a name. The files in
`scenarios/` are found automatically.

Most missions have one objective. One with several has a score by each of them. If it gives weights, they are summed to
one cost; else nothing sums them, and the score by the first objective stands where there is room for one figure.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from mercator_design.config import shipped
from mercator_design.config.loading import parse, read
from mercator_design.config.schema import (
    FieldError,
    FilePath,
    Length,
    Name,
    Range,
    check,
)
from mercator_design.config.writing import digest_of, plain
from mercator_design.config.yaml_tree import FromFile
from mercator_design.errors import MissionError
from mercator_design.missions.arena import Arena, Light, walls_meet
from mercator_design.missions.calls import Call, NamedFile
from mercator_design.missions.floor import Floor, FloorTable
from mercator_design.missions.objectives.scoring import Direction, Objective, Scored, Weight, weighted
from mercator_design.missions.placement import Placement, outside
from mercator_design.missions.score_limits import ExperimentSize
from mercator_design.missions.trace import Trace
from mercator_design.scores import ScoreRange
from mercator_design.seeds import generator

_MAX_CYCLES = 10_000_000
"""Robots times cycles: their trace has 250 MB."""
MAX_OBJECTIVES = 4
"""A front of more has nearly all designs: few are better in all of them."""


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


def _one_or_several(
    objective: Objective | None, objectives: tuple[Objective, ...], weights: tuple[Weight, ...]
) -> Iterator[FieldError]:
    if (objective is None) == (not objectives):
        found = "neither" if objective is None else "both"
        yield FieldError("objective", f"expected either objective or objectives, found {found}")
    elif len(objectives) == 1:
        yield FieldError("objectives", "expected two or more, found one: write it as objective")
    for k, one in enumerate(objectives):
        if one in objectives[:k]:
            yield FieldError(f"objectives[{k}]", f"expected another one than objectives[{objectives.index(one)}]")
    if weights and len(weights) != len(objectives):
        expected = f"expected none, or one for each of {len(objectives)} objectives"
        yield FieldError("weights", f"{expected}, found {len(weights)}")


def _zones_known(floor: Floor, objective: Objective | None, objectives: tuple[Objective, ...]) -> Iterator[FieldError]:
    if objective is not None:
        yield from floor.unknown_zones("objective", objective)
    for k, one in enumerate(objectives):
        yield from floor.unknown_zones(f"objectives[{k}]", one)


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
    UNWRITTEN: ClassVar = ("objective", "objectives", "weights")
    CHECKS: ClassVar = (
        _one_or_several,
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
    objective: Objective | None = None  # what is scored
    objectives: Annotated[tuple[Objective, ...], Length(0, MAX_OBJECTIVES)] = ()  # instead of objective: two or more
    weights: tuple[Weight, ...] = ()  # of the objectives, in their order, if they are summed to one cost

    def __post_init__(self) -> None:
        check(self)

    def __repr__(self) -> str:
        return f"<Mission {self.name}: {self.summary}>"

    @property
    def summary(self) -> str:
        """Robots, duration and objective in a line."""
        robots = f"{self.robots} robot{'s' * (self.robots != 1)}"
        return f"{robots}, {self.duration:g} s, {self.goal}"

    @property
    def all_objectives(self) -> tuple[Objective, ...]:
        """Its objective, or all of them."""
        return tuple(one for _, one in self.placed_objectives())

    def placed_objectives(self) -> Iterator[tuple[str, Objective]]:
        """Its objectives, each with its place in the file."""
        if self.objective is not None:
            yield "objective", self.objective
        yield from ((f"objectives[{k}]", one) for k, one in enumerate(self.objectives))

    @property
    def is_ranked_by_all(self) -> bool:
        """Whether it has several objectives that nothing sums to one cost."""
        return bool(self.objectives) and not self.weights

    @property
    def objective_names(self) -> tuple[str, ...]:
        """The names of the objectives; those that occur again have a number."""
        names = [one.name for one in self.all_objectives]
        return tuple(
            f"{name} ({names[: k + 1].count(name)})" if name in names[:k] else name for k, name in enumerate(names)
        )

    @property
    def direction(self) -> Direction:
        """Whether a higher or a lower score is better."""
        return "minimise" if self.weights else self.all_objectives[0].direction

    @property
    def goal(self) -> str:
        """The directions and names of its objectives, in words."""
        goals = [f"{one.direction} {name}" for one, name in zip(self.all_objectives, self.objective_names, strict=True)]
        together = " and ".join(filter(None, [", ".join(goals[:-1]), goals[-1]]))
        return f"{together}, weighted" if self.weights else together

    @property
    def score_name(self) -> str:
        """What its score is, for axes and tables."""
        if self.weights:
            return "weighted cost (minimise)"
        first = f"score ({self.all_objectives[0].name}, {self.direction}"
        return f"{first}; the first of {len(self.objectives)} objectives)" if self.objectives else f"{first})"

    def scored(self, trace: Trace) -> Scored:
        """The scores of an experiment.

        Raises:
            MissionError: if an objective fails, or its value is not a score.
        """
        scores = tuple(one(trace) for one in self.all_objectives)
        return Scored(self.score_of(scores), scores)

    def score_of(self, scores: Sequence[float]) -> float:
        """The score that stands for those by each objective: their weighted cost, else that by the first."""
        maximised = [one.direction == "maximise" for one in self.all_objectives]
        return weighted(scores, self.weights, maximised) if self.weights else scores[0]

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
        ranges = self.possible_by_objective()
        if not self.weights:
            return ranges[0]
        best, worst = (
            weighted([one[one.maximise == is_best] for one in ranges], self.weights, [one.maximise for one in ranges])
            for is_best in (True, False)
        )
        return ScoreRange(best, worst)

    def possible_by_objective(self) -> tuple[ScoreRange, ...]:
        """The ranges of the scores by each objective.

        Raises:
            MissionError: if a function of a plugin fails.
        """
        floor = self.realise_floor(generator(0, "floor"))
        size = ExperimentSize(self.robots, self.cycles, floor, self.floor.zone_rows())
        return tuple(one.possible_scores(size) for one in self.all_objectives)

    def compared_by(self) -> dict[str, ScoreRange]:
        """By what its designs are compared, with the ranges of scores: each of several objectives, else one nameless.

        Raises:
            MissionError: if a function of a plugin fails.
        """
        if not self.is_ranked_by_all:
            return {"": self.possible_scores()}
        return dict(zip(self.objective_names, self.possible_by_objective(), strict=True))

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
        scored = content["objectives"] if self.objectives else [content["objective"]]
        there = [*scored, *content["floor"]["dynamics"]]
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
        return [*self.all_objectives, *self.floor.dynamics]

    def cost(self, score: float) -> float:
        """The cost of a score: what a race minimises."""
        return -score if self.direction == "maximise" else score

    def costs(self, scores: Sequence[float]) -> tuple[float, ...]:
        """The costs of the scores by each objective."""
        return tuple(one.cost(score) for one, score in zip(self.all_objectives, scores, strict=True))

    def score(self, cost: float) -> float:
        """The score of a cost."""
        return 0.0 - cost if self.direction == "maximise" else cost


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
