"""The folder that a race writes: what is in it, in which order it appears, and how a race goes on from it.

journal.jsonl      what has happened so far (see race/journal.py), written as it happens; it claims the folder
...                what the task needs to go on (see race/task.py): of a mission its own file, the robot model's and
                   plugins/ if there were any, with every default and override filled in
provenance.json    versions, seed, budget, platform, what makes the race
failed/            the control software of experiments that failed, if there were any
fsm.txt            the winner; its name depends on the task
results.csv        every configuration that was raced, the elites first

A run that came to its end has "finished" in its provenance, which is written anew after all else.
"""

import contextlib
import json
import os
import platform
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from mercator_design import __version__
from mercator_design.design import Designer
from mercator_design.errors import RaceError, excerpt
from mercator_design.files import Unreadable, read_small, write_bytes, write_text
from mercator_design.race import Experiment
from mercator_design.race.executors import Executor, in_order
from mercator_design.race.journal import Finished, Journal, Reading, Record, Tested, read
from mercator_design.race.summary import Scores
from mercator_design.race.task import Result, Task
from mercator_design.race.testing import Testing
from mercator_design.race.tuner import Tuner

if TYPE_CHECKING:
    import pandas as pd

JOURNAL = "journal.jsonl"
_LIBRARIES = ("numpy", "scipy", "numba", "pymunk", "joblib", "optuna", "cmaes")
_LARGEST_PROVENANCE = 1024 * 1024  # bytes
_START: Mapping[str, type] = {"mercator_design": str, "name": str, "method": str, "budget": int, "seed": int}
TASKS: Mapping[str, type[Task[Any]]] = {"mission": Designer, "scenario": Tuner}
"""What can be raced, by the name that a race's start has for it."""


class RunFolder:
    """The folder of one race; a context manager that closes the journal.

    Attributes:
        path: Of the folder.
        task: What is raced; its race has not begun.
        journal: Of the race so far, which this process has to itself.
        testing: What is tested when the race has ended.
    """

    def __init__(self, path: Path, task: Task[Any], journal: Journal, provenance: dict[str, Any]) -> None:
        self.path = path
        self.task = task
        self.journal = journal
        self._provenance = provenance
        testing = provenance.get("testing")
        self.testing = None if testing is None else Testing(**testing)

    @classmethod
    def create(cls, path: Path, task: Task[Any], *, request: Mapping[str, Any], testing: Testing | None = None) -> Self:
        """A new one.

        Raises:
            RaceError: if the folder has files in it already, or cannot be written.
        """
        start = task.start()
        provenance: dict[str, Any] = {
            "race": start,
            "request": dict(request),
            "testing": None if testing is None else asdict(testing),
            "started": _now(),
            "python": sys.version.split()[0],
            "libraries": {name: version(name) for name in _LIBRARIES},
            "platform": platform.platform(),
            "machine": platform.machine(),
            "cores": os.cpu_count(),
        }
        with _naming(path):
            path.mkdir(parents=True, exist_ok=True)
            if any(path.iterdir()):
                raise RaceError(f"{path}: expected a new or empty folder for the results, found files in it")
            # Claims the folder: of two races that got here at once, one fails, and writes nothing.
            journal = Journal(path / JOURNAL, new=True)
        folder = cls(path, task, journal, provenance)
        try:
            with _naming(path):
                for name, data in task.files().items():
                    (path / name).parent.mkdir(exist_ok=True)
                    write_bytes(path / name, data)
                folder._write_provenance()
            journal.begin(start)
            journal.sync()
        except BaseException:
            folder.__exit__(None, None, None)
            raise
        return folder

    @classmethod
    def reopen(cls, path: Path) -> Self:
        """That of a race which has begun.

        Raises:
            RaceError: if there is none, if it is not the race that this program would run, if another process runs it,
                or if its journal is corrupt.
            MissionError: if its mission, robot model or plugins cannot be read.
        """
        provenance = read_provenance(path)
        start = provenance["race"]
        task = restored(path)
        with _naming(path):
            journal = Journal(path / JOURNAL, new=False)
        folder = cls(path, task, journal, provenance)
        try:
            if not journal.start:
                journal.begin(start)
            _check_start(path, journal, start)
        except BaseException:
            folder.__exit__(None, None, None)
            raise
        return folder

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.journal.__exit__(kind, error, traceback)

    def extend(self, budget: int) -> None:
        """Let the race go on to a larger budget when it has ended under the one it has.

        Raises:
            RaceError: if the budget is smaller than that.
        """
        if budget < self.journal.budget:
            raise RaceError(
                f"{self.path}: expected a budget of {self.journal.budget}, as before, or more, found {budget}"
            )
        if budget > self.journal.budget:
            self.journal.note([{"event": "extend", "budget": budget}])

    def test(self, testing: Testing | None) -> None:
        """Let these be the tests, from now on.

        Raises:
            RaceError: if that cannot be written.
        """
        self.testing = testing
        self._provenance["testing"] = None if testing is None else asdict(testing)
        with _naming(self.path):
            self._write_provenance()

    def keep_failed(self, finished: Finished | Tested) -> str:
        """Write what an experiment that failed needs; gives the command that runs it alone.

        Raises:
            RaceError: if it cannot be written.
        """
        with _naming(self.path):
            return self.task.command_of_failed(finished, self.path, self._header())

    def finish(self, result: Result, **figures: Any) -> None:  # noqa: ANN401 - whatever JSON can hold
        """Write what the race came to: the winner first, that it is not lost where there is no room for all.

        Raises:
            RaceError: if it cannot be written.
        """
        scores, race = result.scores, self.task.race
        tested = result.tests.get(result.configuration)
        header = self._header() | {
            "score": f"{scores.mean:.6g} (mean of {len(scores.values)} experiments in the race)",
            "spread": f"{scores.standard_deviation or 0.0:.6g} (standard deviation)",
            **(
                {"test": f"{tested.mean:.6g} (mean of {len(tested.values)} tests on fresh instances)"} if tested else {}
            ),
            "budget": str(race.budget),
            "journal": self.journal.ends[-1].digest[:16],
        }
        with _naming(self.path):
            write_text(self.path / self.task.WINNER, self.task.winner_text(result, header))
            results = _by_configuration(self.journal)
            ranks = {elite.configuration: rank for rank, elite in enumerate(race.elites, start=1)}
            results.insert(0, "elite_rank", results.index.map(ranks.get).astype("Int64"))
            in_order = results.sort_values(["elite_rank", "configuration"], na_position="last")
            write_text(self.path / "results.csv", in_order.to_csv())
            self._provenance |= {
                "finished": _now(),
                "budget": race.budget,
                "experiments": race.used,
                "winner": result.configuration,
                "journal": self.journal.ends[-1].digest,
                **figures,
            }
            self._write_provenance()

    def _header(self) -> dict[str, str]:
        """What the file of a winner says of where it comes from."""
        start, request = self._provenance["race"], self._provenance["request"]
        raced_with = {"set": json.dumps(request["set"])} if "set" in request else {}
        return {
            **self.task.header(),
            **raced_with,
            "seed": str(start["seed"]),
            "mercator_design": __version__,
        }

    def _write_provenance(self) -> None:
        write_text(self.path / "provenance.json", json.dumps(self._provenance, indent=2) + "\n")


def _check_start(path: Path, journal: Journal, start: Mapping[str, Any]) -> None:
    if {key: journal.start.get(key) for key in start} != start:
        raise RaceError(f"{path}: expected {JOURNAL} to be of the race in provenance.json, found another race")


def verify(
    path: Path,
    task: Task[Any],
    number: int,
    executor: Executor,
    announce: Callable[[str], None] = lambda what: None,  # noqa: ARG005 - a name for the reader
    stopped: Callable[[], bool] = lambda: False,
) -> list[str]:
    """Check a run folder, and run a sample of its experiments again; gives what was checked, in sentences.

    Args:
        path: The folder.
        task: As `restored` gives it.
        number: Experiments to run again, evenly spread over the race.
        executor: Runs them.
        announce: Called with a sentence if there is something to compile.
        stopped: Asked before each whether to stop.

    Raises:
        RaceError: if something is not as it was.
        Stopped: see `stopped`; what was under way has been waited for.
    """
    reading = read_journal(path)
    record = reading.record
    checked = [
        f"{JOURNAL}: {reading.lines} lines are whole" + (f"; {reading.torn}, as if torn" if reading.torn else "")
    ]
    for place, end in enumerate(record.ends, start=1):
        if record.digest(place) != end.digest:
            found = f"expected {end.digest}, found {record.digest(place)}"
            raise RaceError(f"{path / JOURNAL}: digest of the first {end.experiments} experiments: {found}")
        which = "all" if end.experiments == len(record.experiments) else "the first"
        checked.append(f"{JOURNAL}: the digest, of {which} {end.experiments} experiments, is {end.digest[:16]}")
    if record.is_complete:
        winner = record.ends[-1].winner
        if not task.is_winner(path / task.WINNER, record.configurations[winner]):
            raise RaceError(f"{path / task.WINNER}: expected configuration {winner}, found another")
        checked.append(f"{task.WINNER}: is configuration {winner}, the winner")
    ran: list[Finished | Tested] = [record.experiments[number] for number in sorted(record.experiments)]
    ran += [record.tests[where] for where in sorted(record.tests)]
    finished = [one for one in ran if one.score is not None]
    n = min(number, len(finished))
    sample = [finished[k * len(finished) // n] for k in range(n)]
    task.prepare(announce)
    items = [
        task.item(
            Experiment(one.configuration, one.instance),
            record.configurations[one.configuration],
            test=isinstance(one, Tested),
        )
        for one in sample
    ]
    found_again = in_order(executor, task.function, items, stopped=stopped)
    for one, (score, outcome) in zip(sample, found_again, strict=True):
        if (score, outcome) != (one.score, one.outcome):
            what = f"experiment {one.experiment}" if isinstance(one, Finished) else f"test on instance {one.instance}"
            raise RaceError(
                f"{path}: {what}: expected score {one.score!r} and digest {one.outcome}, found "
                f"{score!r} and {outcome}: figures may differ in their last digits on another kind of machine"
            )
    tests = sum(isinstance(one, Tested) for one in finished)
    among = f"{len(finished) - tests} experiments" + (f" and {tests} tests" if tests else "")
    return [*checked, f"{n} of {among} were run again: all as they were"]


def task_of(path: Path) -> Task[Any]:
    """The task of a run folder, as this program understands it.

    Raises:
        RaceError: if there is none.
        MissionError: if its mission, robot model or plugins cannot be read.
    """
    start = read_provenance(path)["race"]
    return TASKS[start["task"]].restore(path, start)


def restored(path: Path) -> Task[Any]:
    """The task of a run folder, whose experiments this program runs as they were run.

    Raises:
        RaceError: if there is none, or this program would run another race.
        MissionError: if its mission, robot model or plugins cannot be read.
    """
    task, start = task_of(path), read_provenance(path)["race"]
    here = json.loads(json.dumps(task.start()))
    for key in here:
        if key != "mercator_design" and here[key] != start.get(key):  # another version may do all the same
            raise RaceError(
                f"{path}: {key}: raced with {excerpt(str(start.get(key)))} by mercator_design "
                f"{start['mercator_design']}, found {excerpt(str(here[key]))} in mercator_design {__version__}: "
                "the race cannot be continued, verified or ablated by this"
            )
    return task


def read_provenance(path: Path) -> dict[str, Any]:
    """What a run folder says of where it comes from.

    Raises:
        RaceError: if it is none.
    """
    file = path / "provenance.json"
    try:
        provenance = json.loads(read_small(file, _LARGEST_PROVENANCE))
        valid = isinstance(provenance["request"], dict) and _is_start(provenance["race"])
    except Unreadable as error:
        raise RaceError(f"{path}: expected the folder of a race, found that {file.name}: {error}") from None
    except (ValueError, KeyError, TypeError, RecursionError):
        valid = False
    if not valid:
        raise RaceError(f"{file}: expected what mdesign race writes, found something else")
    found: dict[str, Any] = provenance
    return found


class OtherVersion(RaceError):  # noqa: N818 - nothing is wrong with it
    """A journal was written by another version of this program, which says other things of races."""


def read_journal(path: Path) -> Reading:
    """The journal of a run folder as it is; others may be writing it.

    Raises:
        OtherVersion: see there.
        RaceError: if there is none, or it is corrupt.
    """
    reading = read(path / JOURNAL)
    start = reading.record.start
    if start and not _is_start(start):
        found = excerpt(str(start.get("mercator_design", "another version")))
        raise OtherVersion(
            f"{path / JOURNAL}, line 1: expected the start of a race as mercator_design {__version__} writes it, found "
            f"that of another build ({found}), which can read it"
        )
    return reading


def _is_start(start: object) -> bool:
    """Whether it has what reports and `Task.restore` read."""
    if not isinstance(start, dict) or str(start.get("task")) not in TASKS:
        return False
    wanted = {**_START, **TASKS[str(start["task"])].START}
    return all(isinstance(start.get(key), kind) for key, kind in wanted.items())


def experiments_table(path: Path) -> "pd.DataFrame":
    """The experiments of a run folder so far, a row each in order of their numbers.

    Columns: experiment, iteration, configuration, instance, seed, score (NaN if it failed), failure (why, or empty).

    Raises:
        RaceError: if there is no journal, or it is corrupt.
    """
    return _experiments(read_journal(path).record)


def tests_table(path: Path) -> "pd.DataFrame":
    """The tests of a run folder so far, a row each by configuration and test instance.

    Columns: configuration, instance, seed, score (NaN if it failed), failure (why, or empty).

    Raises:
        RaceError: if there is no journal, or it is corrupt.
    """
    tests = read_journal(path).record.tests
    return _table([tests[where] for where in sorted(tests)], ("configuration", "instance", "seed", "score", "failure"))


def configurations_table(path: Path) -> "pd.DataFrame":
    """The configurations of a run folder that were raced so far, a row each, by number.

    Columns: first_iteration, experiments, failed (how many of these), mean, standard_deviation (of the scores); if
    there were tests, tests (how many had a score), test_mean, test_low and test_high (the confidence interval of the
    mean at 95 %); parent (the elite it was sampled from), and what the task has of them: the fsm of a mission.

    Raises:
        RaceError: if there is no journal, or it is corrupt.
    """
    return _by_configuration(read_journal(path).record)


def _experiments(record: Record) -> "pd.DataFrame":
    finished = [record.experiments[number] for number in sorted(record.experiments)]
    return _table(finished, ("experiment", "iteration", "configuration", "instance", "seed", "score", "failure"))


def _table(rows: Sequence[object], names: Sequence[str]) -> "pd.DataFrame":
    import pandas as pd

    table = pd.DataFrame({name: [getattr(row, name) for row in rows] for name in names})
    return table.astype({"score": float})


def _by_configuration(record: Record) -> "pd.DataFrame":
    import pandas as pd

    table = _experiments(record)
    results = table.groupby("configuration").agg(
        first_iteration=("iteration", "min"),
        experiments=("score", "size"),
        failed=("score", lambda scores: int(scores.isna().sum())),
        mean=("score", "mean"),
        standard_deviation=("score", "std"),
    )
    tests = {configuration: Scores(scores) for configuration, scores in record.test_scores().items()}
    if tests:
        figures = {c: (len(t.values), t.mean, *(t.confidence_interval or (None, None))) for c, t in tests.items()}
        names = ["tests", "test_mean", "test_low", "test_high"]
        tested = pd.DataFrame.from_dict(figures, orient="index", columns=names)
        results = results.join(tested).astype({"tests": "Int64"})
    results["parent"] = [record.parents[number] for number in results.index]
    results["parent"] = results["parent"].astype("Int64")
    configurations = [record.configurations[number] for number in results.index]
    columns = TASKS[record.start["task"]].columns(record.start, configurations)
    return results.join(pd.DataFrame(columns, index=results.index, dtype=object))


@contextlib.contextmanager
def _naming(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise RaceError(f"{path}: cannot write results there: {error.strerror or error}") from None


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
