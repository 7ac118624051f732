"""The cells of a study by names alone: what a folder can tell without the files of the plan."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from mercator_design.config.schema import Range
from mercator_design.race.elimination.fronts import MAX_FRONT
from mercator_design.scores import ANY_SCORE, ScoreRange

Count = Annotated[int, Range(0)]


@dataclass(frozen=True, slots=True, order=True)
class Cell:
    """One design of a study.

    mission: The label of the mission with its robot model.
    budget: 0 if the design is hand-made.
    repetition: From 1; of hand-made designs the number of the file.
    """

    mission: str
    method: str
    budget: int
    repetition: int

    @property
    def path(self) -> Path:
        """Its folder, below that of all cells."""
        return Path(self.mission, self.method, str(self.budget), str(self.repetition))

    def __str__(self) -> str:
        return f"{self.mission}, {self.method}, {f'budget {self.budget}, ' * bool(self.budget)}{self.repetition}"


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectiveRow:
    """What tables say of the scores by an objective."""

    name: str
    maximise: bool
    low: float | None  # the least possible score; None if there is none
    high: float | None  # the largest


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionRow:
    """What tables say of a mission with its robot model; of several objectives without weights, they show each."""

    name: str
    robot_model: str
    maximise: bool
    low: float | None  # the least possible score; None if there is none
    high: float | None  # the largest
    objectives: tuple[ObjectiveRow, ...] = ()  # several, each with scores of its own

    @property
    def possible_scores(self) -> ScoreRange:
        low = ANY_SCORE.low if self.low is None else self.low
        return ScoreRange(low, ANY_SCORE.high if self.high is None else self.high, self.maximise)


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyLayout:
    """What the cells of a study are made of.

    missions: By label.
    methods: The number of hand-made files of each; None if it races.
    flavours: Of each method.
    realities: Names, the design model first.
    seed: Of the study: repetition r has race seed `seed` + r - 1.
    runs: Instances on which each design is assessed in each reality.
    """

    missions: Mapping[str, MissionRow]
    methods: Mapping[str, Count | None]
    flavours: Mapping[str, str]
    budgets: tuple[Count, ...]
    repetitions: Count
    realities: tuple[str, ...]
    seed: Count
    runs: Count

    @property
    def cells(self) -> tuple[Cell, ...]:
        """All cells: first repetitions first, so that methods can be compared before all is done."""
        last = max([self.repetitions, *(n or 0 for n in self.methods.values())])
        return tuple(
            Cell(mission, method, budget, repetition)
            for repetition in range(1, last + 1)
            for mission in self.missions
            for method, n_files in self.methods.items()
            for budget in (self.budgets if n_files is None else (0,))
            if repetition <= (self.repetitions if n_files is None else n_files)
        )

    def part(self, number: int, n_parts: int) -> tuple[Cell, ...]:
        """The cells of one of several parts, numbered from 1."""
        return self.cells[number - 1 :: n_parts]

    def race_seed(self, cell: Cell) -> int:
        """The seed of a cell's race: the same for all methods, whose instances are the same; 0 without a race."""
        return self.seed + cell.repetition - 1 if cell.budget else 0

    def has_front(self, cell: Cell) -> bool:
        """Whether a cell's race gives a front."""
        return bool(cell.budget and self.missions[cell.mission].objectives)

    def n_assessed(self, cell: Cell) -> int:
        """The experiments of a cell's assessment, at most."""
        return self.runs * len(self.realities) * (1 + MAX_FRONT * self.has_front(cell))

    def n_experiments(self, cell: Cell) -> int:
        """The experiments of a cell: its race and its assessment, at most."""
        return cell.budget + self.n_assessed(cell)


def alike_on_disk(names: Iterable[str]) -> str:
    """What is wrong with names of folders if some disks take two for one, which differ only in case; else empty."""
    first: dict[str, str] = {}
    for name in names:
        if (other := first.setdefault(name.casefold(), name)) != name:
            return f"expected names that differ not only in case, which some disks ignore, found {other} and {name}"
    return ""
