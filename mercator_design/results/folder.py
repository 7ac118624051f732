"""The run folder of a race: its files, in the order in which they are written, and how to resume from them.

journal.jsonl      all events so far (see race/session/journal.py); its lock reserves the folder
...                the files that the task needs (see race/session/task.py): of a mission its file and the robot
                   model's, with all defaults and overrides; and plugins/, files/ and floor.png if there are any
provenance.json    versions, seed, budget, platform, start of the race
failed/            the control software of failed experiments, if there are any
fsm.txt            the winner; its name depends on the task
results.csv        all configurations of the race, the elites first
front.csv          of several objectives: the designs tested for the front; front-N.txt is configuration N of it
comparison.json    the winner and others on fresh instances, for the report (results/analysis/comparison.py)
report.html        the report (show/report/)

When a race has finished, its provenance is written again, with "finished", before the last two.
"""

import contextlib
import json
import math
import os
import platform
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, Self

from mercator_design import __version__
from mercator_design.designer import GOAL, Designer
from mercator_design.errors import RaceError
from mercator_design.race.session.evaluation import Testing
from mercator_design.race.session.events import BudgetExtended, ExperimentDone, TestDone
from mercator_design.race.session.journal import Journal, now
from mercator_design.race.session.task import RaceResult, Task
from mercator_design.results.analysis.front import FRONT, front_csv, front_of
from mercator_design.results.files import (
    JOURNAL,
    check_same,
    read_provenance,
    restored,
    resume_command,
    without_provenance,
    wrong_end,
)
from mercator_design.results.provenance import PROVENANCE, Provenance, Request, write
from mercator_design.results.tables import configuration_rows
from mercator_design.software.architectures import decoded
from mercator_design.software.files import fsm_file_text
from mercator_design.system.csv_text import write_csv
from mercator_design.system.files import remove_drafts, write_bytes, write_text

_RESULTS = "results.csv"
_LIBRARIES = ("numpy", "scipy", "numba", "pymunk", "joblib", "optuna", "cmaes")


class RunFolder:
    """The folder of one race; a context manager that closes the journal.

    Attributes:
        path: The path of the folder.
        task: The task; its race has not begun.
        journal: The journal so far, locked by this process.
    """

    def __init__(self, path: Path, task: Task[Any], journal: Journal, provenance: Provenance) -> None:
        self.path = path
        self.task = task
        self.journal = journal
        self._provenance = provenance

    @property
    def testing(self) -> Testing | None:
        """The tests after the end of the race."""
        return self._provenance.testing

    @classmethod
    def create(cls, path: Path, task: Task[Any], *, request: Request, testing: Testing | None = None) -> Self:
        """Create a run folder; also in a folder where a race was interrupted before it began.

        Raises:
            RaceError: if the folder has files, or cannot be written.
        """
        start = task.start()
        provenance = Provenance(
            race=start,
            request=request,
            testing=testing,
            score_low=_finite(task.possible_scores.low),
            score_high=_finite(task.possible_scores.high),
            maximise=task.maximise,
            started=now(),
            python=sys.version.split()[0],
            libraries={name: version(name) for name in _LIBRARIES},
            platform=platform.platform(),
            machine=platform.machine(),
            cores=os.cpu_count(),
        )
        with _naming(path):
            path.mkdir(parents=True, exist_ok=True)
            journal = _claimed(path)
        folder = cls(path, task, journal, provenance)
        try:
            with _naming(path):
                folder._remove_drafts()
                for name, data in task.files().items():
                    (path / name).parent.mkdir(parents=True, exist_ok=True)
                    write_bytes(path / name, data)
                write(path, provenance)
            journal.begin(start)
            journal.sync()
        except BaseException:
            folder.__exit__(None)
            raise
        return folder

    @classmethod
    def reopen(cls, path: Path) -> Self:
        """Open the run folder of a race that has begun.

        Raises:
            RaceError: if there is no race, if this program would run another race, if another process runs it, or if
                its journal is corrupt.
            MissionError: if its mission, robot model or plugins cannot be read.
        """
        provenance = read_provenance(path)
        task = restored(path)
        with _naming(path):
            journal = Journal(path / JOURNAL, new=False)
        folder = cls(path, task, journal, provenance)
        try:
            if not journal.record.start:
                journal.begin(provenance.race)
            check_same(path, journal.record, provenance)
            if missing := wrong_end(path, journal.record):
                journal.notes.append(missing)
            with _naming(path):
                folder._remove_drafts()
        except BaseException:
            folder.__exit__(None)
            raise
        return folder

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.journal.__exit__(kind)

    def extend(self, budget: int) -> None:
        """Extend the budget of the race.

        Raises:
            RaceError: if the new budget is smaller.
        """
        if budget < self.journal.record.budget:
            raise RaceError(
                f"{self.path}: expected a budget of {self.journal.record.budget}, as before, or more, found {budget}"
            )
        if budget > self.journal.record.budget:
            self.journal.note(BudgetExtended(budget=budget))

    def test(self, testing: Testing | None) -> None:
        """Set the tests.

        Raises:
            RaceError: if they cannot be written.
        """
        self._provenance = replace(self._provenance, testing=testing)
        with _naming(self.path):
            write(self.path, self._provenance)

    def keep_failed(self, finished: ExperimentDone | TestDone) -> str:
        """Write the files of a failed experiment; return the command that runs it alone.

        Raises:
            RaceError: if they cannot be written.
        """
        with _naming(self.path):
            return self.task.command_of_failed(finished, self.path, self._header())

    def finish(self, result: RaceResult, *, seconds: float) -> None:
        """Write the results of the race: the winner first, in case there is no space for all.

        Args:
            result: The result of the race.
            seconds: Run time of this process [s].

        Raises:
            RaceError: if they cannot be written.
        """
        shown, optimizer = result.headline, self.task.optimizer
        digest = self.journal.record.ends[-1].digest
        header = self._header() | {
            "score": f"{shown.scores.mean:.6g}{shown.scores.possible.limit} (mean {shown.where})",
            "spread": f"{shown.scores.standard_deviation or 0.0:.6g} (standard deviation of these)",
        }
        if shown.is_fresh:
            raced = result.scores
            header["score in the race"] = f"{raced.mean:.6g} (mean of {len(raced.values)} runs)"
        if GOAL in self.journal.record.start:
            header["objectives"] = f"{self.journal.record.start[GOAL]}; the score is by the first"
        header |= {"budget": str(optimizer.budget), "journal": digest[:16]}
        finished = replace(
            self._provenance,
            finished=now(),
            budget=optimizer.budget,
            experiments=optimizer.used,
            winner=result.configuration,
            journal=digest,
            seconds=seconds,
        )
        files: dict[str, Callable[[], None]] = {
            self.task.WINNER: lambda: write_text(self.path / self.task.WINNER, self.task.winner_text(result, header)),
            **self._front_files(),
            _RESULTS: lambda: write_csv(self.path / _RESULTS, self._results()),
            PROVENANCE: lambda: write(self.path, finished),
        }
        complete = [JOURNAL]
        for name, write_file in files.items():
            try:
                write_file()
            except OSError as error:
                missing = ", ".join(one for one in files if one not in complete)
                raise RaceError(
                    f"{self.path}: {missing} cannot be written: {error.strerror or error}; the race has ended and "
                    f"{', '.join(complete)} {'is' if len(complete) == 1 else 'are'} complete; to write the rest when "
                    f"there is space: {resume_command(self.path, self.journal.record.start['task'])}"
                ) from None
            complete.append(name)
        self._provenance = finished

    def _front_files(self) -> dict[str, Callable[[], None]]:
        """What writes the table of the front, and the files of its designs."""
        if not isinstance(self.task, Designer) or self.task.n_objectives == 1:
            return {}
        designer, record = self.task, self.journal.record

        def write_front() -> None:
            designs = front_of(designer, record)
            names = designer.simulator.mission.objective_names
            for one in designs:
                if one.is_on_front:
                    scores = zip(names, one.scores, strict=True)
                    header = self._header() | {f"score, {name}": each.summary for name, each in scores}
                    text = fsm_file_text(decoded(record.configurations[one.configuration], designer.flavour), header)
                    write_text(self.path / one.file, text)
            write_text(self.path / FRONT, front_csv(designer, record, designs))

        return {FRONT: write_front}

    def _results(self) -> Iterator[list[Any]]:
        """The head and the rows of a table of the configurations that were raced, the elites first."""
        elites = [elite.configuration for elite in self.task.optimizer.elites]
        ranks = {configuration: rank for rank, configuration in enumerate(elites, start=1)}
        (number, *names), rows = configuration_rows(self.journal.record, self.task.possible_scores, first=elites)
        yield [number, "elite_rank", *names]
        for row in rows:
            yield [row[0], ranks.get(row[0]), *row[1:]]

    def _header(self) -> dict[str, str]:
        """The header of the winner's file."""
        overrides = self._provenance.request.set
        header = self.task.header() if overrides is None else self.task.header() | {"set": json.dumps(overrides)}
        return header | {"seed": str(self._provenance.race["seed"]), "mercator_design": __version__}

    def _remove_drafts(self) -> None:
        """Remove incomplete files of an interruption."""
        for name in (PROVENANCE, _RESULTS, self.task.WINNER, *self.task.files()):
            remove_drafts(self.path / name)


def _finite(limit: float) -> float | None:
    return limit if math.isfinite(limit) else None


def _claimed(path: Path) -> Journal:
    """Open the journal, which reserves the folder: of two races at the same time, one fails and writes nothing.

    The journal of a race that was interrupted before it began is empty, and there is no provenance.
    """
    file = path / JOURNAL
    is_new = not file.exists()
    if any(path.iterdir()) if is_new else (path / PROVENANCE).exists() or file.stat().st_size:
        raise _taken(path)
    journal = Journal(file, new=is_new)
    if journal.record.start:  # written by another process just now
        journal.__exit__(None)
        raise _taken(path)
    return journal


def _taken(path: Path) -> RaceError:
    """The error on a folder that is not empty, with advice."""
    taken = f"{path}: expected a new or empty folder for the results, found files in it"
    if (path / JOURNAL).exists() and (path / PROVENANCE).exists():
        return RaceError(f"{taken}: a race; resume it with --resume {path}")
    with contextlib.suppress(RaceError):
        if (path / JOURNAL).exists() and (lost := without_provenance(path)):
            return RaceError(taken, lost)
    return RaceError(taken)


@contextlib.contextmanager
def _naming(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise RaceError(f"{path}: results cannot be written: {error.strerror or error}") from None
