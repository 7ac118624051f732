"""What a study's folder has so far: its table, and the state of each cell. Nothing is locked or run."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import pandas as pd

from mercator_design.errors import RaceError, StudyError
from mercator_design.race.session.journal import Reading, is_locked
from mercator_design.results.files import JOURNAL, read_journal, read_provenance
from mercator_design.results.provenance import PROVENANCE
from mercator_design.studies.assessment import front_scores, known_rows, n_missing, others_on_front, read_assessment
from mercator_design.studies.folder import CELLS, read_facts
from mercator_design.studies.layout import Cell, StudyLayout
from mercator_design.studies.statistics.fronts import front_rows
from mercator_design.studies.table import RUN_COLUMNS, StudyTable

State = Literal["done", "to assess", "running", "interrupted", "to run"]
STATES: tuple[State, ...] = get_args(State)


@dataclass(frozen=True, slots=True, kw_only=True)
class CellStatus:
    """The state of a cell, and how many of its experiments have run."""

    cell: Cell
    state: State
    done: int
    total: int


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyStatus:
    """The state of a study."""

    name: str
    cells: tuple[CellStatus, ...]

    @property
    def counts(self) -> Mapping[State, int]:
        """The number of cells in each state."""
        return Counter(one.state for one in self.cells)

    @property
    def counts_by_kind(self) -> Mapping[tuple[str, str, int], Counter[State]]:
        """The number of cells in each state, by mission, method and budget."""
        found: dict[tuple[str, str, int], Counter[State]] = {}
        for one in self.cells:
            found.setdefault((one.cell.mission, one.cell.method, one.cell.budget), Counter())[one.state] += 1
        return found

    @property
    def is_done(self) -> bool:
        return all(one.state == "done" for one in self.cells)

    @property
    def done(self) -> int:
        """Experiments that have run."""
        return sum(one.done for one in self.cells)

    @property
    def total(self) -> int:
        """Experiments in all."""
        return sum(one.total for one in self.cells)


def read_status(path: Path, layout: StudyLayout | None = None) -> StudyStatus:
    """The state of a study, which other processes may be running; perhaps that of another layout in its folder.

    Raises:
        StudyError: It is no study's folder, or something in it is damaged.
    """
    return StudyReading(path).read(layout)


class StudyReading:
    """Reads the state of a study again and again: of journals what is new, of designs that are done nothing."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._layout: StudyLayout | None = None
        self._done: dict[Cell, CellStatus] = {}  # of this layout
        self._journals: dict[Cell, Reading] = {}

    def read(self, layout: StudyLayout | None = None) -> StudyStatus:
        """The state now, by default of the layout in the folder.

        Raises:
            StudyError: as `read_status`.
        """
        facts = read_facts(self.path)
        layout = layout or facts.layout
        if layout != self._layout:
            self._layout, self._done = layout, {}
        cells = [self._done.get(cell) or self._status(layout, cell) for cell in layout.cells]
        self._done = {one.cell: one for one in cells if one.state == "done"}
        return StudyStatus(name=facts.name, cells=tuple(cells))

    def _status(self, layout: StudyLayout, cell: Cell) -> CellStatus:
        folder = self.path / CELLS / cell.path
        try:
            return _status(folder, layout, cell, self._journals)
        except RaceError as error:
            raise StudyError(*error.messages) from None


def _status(folder: Path, layout: StudyLayout, cell: Cell, journals: dict[Cell, Reading]) -> CellStatus:
    """The state of a cell.

    Args:
        folder: Its run folder.
        layout: Of the study.
        cell: The cell.
        journals: Readings of the journals of races that have not ended; entered here.

    Raises:
        RaceError, StudyError: Something is damaged.
    """
    assessment = read_assessment(folder)
    others = others_on_front(folder) if layout.has_front(cell) else ()
    missing = n_missing(assessment, layout.realities, layout.runs, others)
    total = layout.n_experiments(cell)

    def status(state: State, left: int) -> CellStatus:
        return CellStatus(cell=cell, state=state, done=total - left, total=total)

    if not missing and assessment is not None:
        return status("done", 0)
    if not cell.budget:
        return status("to assess" if assessment is not None else "to run", missing)
    if not (folder / PROVENANCE).exists():
        return status("to run", total)
    if read_provenance(folder).finished:
        journals.pop(cell, None)
        return status("to assess", missing)
    journals[cell] = read_journal(folder, journals.get(cell))
    n_raced = len(journals[cell].record.experiments)
    return status("running" if is_locked(folder / JOURNAL) else "interrupted", total - n_raced)


def study_table(path: Path) -> StudyTable:
    """The table of all designs that are assessed in all realities.

    Raises:
        StudyError: There is no such design, it is no study's folder, or something in it is damaged.
    """
    facts = read_facts(path)
    layout, rows, fronts = facts.layout, list[tuple[Any, ...]](), list[dict[str, Any]]()
    for cell in layout.cells:
        folder, mission = path / CELLS / cell.path, layout.missions[cell.mission]
        found, others = read_assessment(folder), others_on_front(folder) if layout.has_front(cell) else ()
        if found is None or n_missing(found, layout.realities, layout.runs, others):
            continue
        start = (cell.method, mission.name, mission.robot_model, cell.budget, cell.repetition, layout.race_seed(cell))
        names = tuple(one.name for one in mission.objectives) or ("",)
        rows += (
            (*start, reality, instance, objective, score)
            for reality in layout.realities
            for instance, row in enumerate(known_rows(folder, found, reality, len(names))[: layout.runs])
            for objective, score in zip(names, row, strict=True)
        )
        if layout.has_front(cell):
            for reality in layout.realities:
                scores = {
                    file: own[: layout.runs] for file, own in front_scores(folder, found, reality, len(names)).items()
                }
                place = dict(zip(RUN_COLUMNS, (*start, reality), strict=False))
                fronts += front_rows(place, scores, {one.name: one.maximise for one in mission.objectives})
    if not rows:
        raise StudyError(f"{path}: expected designs that are assessed, found none yet")
    scored = {
        (mission.name, one.name) if mission.objectives else mission.name: one
        for mission in layout.missions.values()
        for one in mission.objectives or (mission,)
    }
    runs = pd.DataFrame(rows, columns=[*RUN_COLUMNS[:-1], "objective", RUN_COLUMNS[-1]])
    return StudyTable(
        name=facts.name,
        runs=runs if runs["objective"].any() else runs.drop(columns="objective"),
        directions={place: "maximise" if one.maximise else "minimise" for place, one in scored.items()},
        limits={place: (one.low, one.high) for place, one in scored.items()},
        fronts=pd.DataFrame(fronts),
    )
