"""Runs the cells of a study, one after the other, each on all workers of an executor.

What that loses with many workers, and how parts in several processes lose less: docs/explanation/scaling.md.

What a cell has done is in its run folder: a race that was interrupted is resumed, a design that is assessed already is
not assessed again. So the same command resumes a study, and runs what is new in it.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from mercator_design.errors import StudyError
from mercator_design.modules.architecture import Software
from mercator_design.race.executors.executor import Executor
from mercator_design.race.session.events import ExperimentDone
from mercator_design.race.session.outcome import ExperimentFailed, OnFailure
from mercator_design.race.session.runner import RaceRun
from mercator_design.results.analysis.front import file_on_front
from mercator_design.results.files import flat, is_same, read_journal, read_provenance, wrong_end
from mercator_design.results.folder import RunFolder
from mercator_design.results.provenance import PROVENANCE, Provenance, Request
from mercator_design.software.architectures import decoded
from mercator_design.software.files import fsm_file_text, read_fsm
from mercator_design.studies.assessment import assess, n_missing, others_on_front, read_assessment
from mercator_design.studies.folder import StudyFolder
from mercator_design.studies.layout import Cell
from mercator_design.studies.resolving import Study
from mercator_design.system.files import write_text, writing

FSM = "fsm.txt"


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyProgress:
    """How far the cells of a process are.

    known: Experiments that had run before this process.
    """

    cell: Cell
    number: int  # of the cell, from 1
    n_cells: int
    is_assessed: bool  # whether its race has ended
    is_new: bool  # whether an experiment has run just now
    done: int  # experiments, of all cells
    known: int
    total: int


Watch = Callable[[StudyProgress], None]


class StudyRun:
    """A study that runs in this process.

    Args:
        study: The study.
        folder: Its folder.
        executor: Runs the experiments; entered by the caller.
        cells: Those to run; by default all.
        executor_name: Its name in the run folders.
        on_failure: As `RaceRun`.
        announce: Called with messages, as on the compilation of the simulator.
        watch: Called with the progress, after each experiment.
        stopped: Returns whether to stop; called before each experiment.
    """

    def __init__(
        self,
        study: Study,
        folder: StudyFolder,
        executor: Executor,
        *,
        cells: Sequence[Cell] | None = None,
        executor_name: str = "threads",
        on_failure: OnFailure = "stop",
        announce: Callable[[str], None] = lambda what: None,  # noqa: ARG005 - a name for the reader
        watch: Watch = lambda progress: None,  # noqa: ARG005
        stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        self.study, self.folder = study, folder
        self.layout = study.layout
        self.cells = self.layout.cells if cells is None else cells
        self._executor, self._executor_name = executor, executor_name
        self._on_failure: OnFailure = on_failure
        self._announce, self._watch, self._stopped = announce, watch, stopped
        self._prepared: set[tuple[str, str]] = set()
        self._options: dict[tuple[str, str, int], dict[str, object]] = {}
        self._total = sum(self.layout.n_experiments(cell) for cell in self.cells)
        self._done = self._known = 0

    def run(self) -> None:
        """Run all cells to their end.

        Raises:
            StudyError: A cell's folder has something else.
            ExecutorStopped, ExecutorLost, WorkerUnfit: as `RaceRun`; the same study resumes.
            ExperimentFailed: as `RaceRun`.
        """
        for number, cell in enumerate(self.cells, start=1):
            self._run_cell(number, cell)

    def _run_cell(self, number: int, cell: Cell) -> None:
        path, method = self.folder.cell(cell), self.study.methods[cell.method]
        if method.made:
            software = method.made[cell.repetition - 1]
            with writing(path, StudyError):
                path.mkdir(parents=True, exist_ok=True)
                if not (path / FSM).exists():
                    write_text(path / FSM, fsm_file_text(software, {"method": cell.method}))
        else:
            software = self._raced(number, cell, path)
        runs, mission = self.layout.runs, self.study.missions[cell.mission]
        others = others_on_front(path) if self.layout.has_front(cell) else ()
        left = n_missing(read_assessment(path), mission.realities, runs, others)
        self._note(number, cell, self.layout.n_assessed(cell) - left, is_new=False, is_assessed=True)
        before = self._done
        with writing(path, StudyError):
            assess(
                path,
                software,
                mission,
                self._executor,
                seed=self.layout.seed,
                runs=runs,
                watch=lambda done: self._note(number, cell, before + done - self._done, is_assessed=True),
                stopped=self._stopped,
            )

    def _raced(self, number: int, cell: Cell, path: Path) -> Software:
        """The winner of a cell's race, which is run as far as it has not."""
        if (path / PROVENANCE).exists():
            provenance = read_provenance(path)
            self._check(cell, path, provenance)
            if provenance.finished and (path / FSM).exists():
                if read_assessment(path) is None:
                    _check_designs(path, provenance)
                self._note(number, cell, cell.budget, is_new=False)
                return read_fsm(path / FSM).software
        started = time.monotonic()
        with self._opened(cell, path) as run_folder:
            if (kind := (cell.mission, cell.method)) not in self._prepared:
                run_folder.task.prepare(self._announce)
                self._prepared.add(kind)
            known = len(run_folder.journal.record.experiments)
            self._note(number, cell, known, is_new=False)
            run_folder.journal.open_session(self._executor_name, self._executor.jobs)
            race = RaceRun(
                run_folder.task,
                self._executor,
                run_folder.journal,
                on_failure=self._on_failure,
                stopped=self._stopped,
            )
            n_raced = 0
            try:
                for event in race:
                    if isinstance(event, ExperimentDone):
                        n_raced += 1
                        self._note(number, cell, int(n_raced > known))
            except ExperimentFailed as error:
                error.add_note(f"to run only this experiment: {run_folder.keep_failed(error.finished)}")
                raise
            run_folder.finish(race.result, seconds=round(time.monotonic() - started, 3))
        self._note(number, cell, cell.budget - n_raced, is_new=False)  # the rest of the budget, if any
        return read_fsm(path / FSM).software

    def _opened(self, cell: Cell, path: Path) -> RunFolder:
        if (path / PROVENANCE).exists():
            return RunFolder.reopen(path)
        designer, given = self.study.designer(cell), self.study.methods[cell.method].given
        request = Request(
            mission=designer.name,
            flavour=designer.flavour,
            method=given.race,
            executor=self._executor_name,
            jobs=self._executor.jobs,
        )
        return RunFolder.create(path, designer, request=request)

    def _check(self, cell: Cell, path: Path, provenance: Provenance) -> None:
        """Check that a run folder has the race of a cell, whose parts have the definitions of the study.

        Options that are not given are compared, too: another version may have other defaults.

        Raises:
            StudyError: It has another race.
        """
        method, mission = self.study.methods[cell.method], self.study.missions[cell.mission].simulator.mission
        expected = {
            "mission_digest": mission.digest,
            "budget": cell.budget,
            "seed": self.layout.race_seed(cell),
            "flavour": method.flavour,
            "method": method.given.race,
        }
        if (kind := (cell.mission, cell.method, cell.budget)) not in self._options:
            self._options[kind] = {"options": self.study.designer(cell).start()["options"]}
        found = flat(provenance.race)
        wrong = [
            f"{path}: {key}: expected {value}, as the study says, found a race with {found.get(key)}"
            for key, value in {**expected, **flat(self._options[kind])}.items()
            if not is_same(value, found.get(key))
        ]
        if provenance.budget not in {None, cell.budget}:
            wrong.append(f"{path}: budget: expected {cell.budget}, as the study says, found {provenance.budget}")
        if wrong:
            raise StudyError(*wrong)

    def _note(self, number: int, cell: Cell, more: int, *, is_new: bool = True, is_assessed: bool = False) -> None:
        self._done += more
        if not is_new:
            self._known += more
        self._watch(
            StudyProgress(
                cell=cell,
                number=number,
                n_cells=len(self.cells),
                is_assessed=is_assessed,
                is_new=is_new and more > 0,
                done=self._done,
                known=self._known,
                total=self._total,
            )
        )


def _check_designs(path: Path, provenance: Provenance) -> None:
    """Check that the files of a race that has ended have its designs: the winner, and the others of a front.

    Raises:
        StudyError: A file has other control software, or the journal has another end.
        RaceError: The journal cannot be read.
    """
    record = read_journal(path).record
    if missing := wrong_end(path, record):
        raise StudyError(missing)
    others = others_on_front(path)
    numbers = {file_on_front(number): number for number in record.configurations}
    for file, number in {FSM: provenance.winner, **{name: numbers.get(name) for name in others}}.items():
        configuration = None if number is None else record.configurations.get(number)
        if configuration is None or read_fsm(path / file).software != decoded(configuration, record.start["flavour"]):
            raise StudyError(
                f"{path / file}: expected the design that the race beside it made, found other control software: "
                f"delete {path / FSM} to have the designs written again"
            )
