"""The experiments, tests and configurations of a race as tables."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mercator_design.errors import RaceError
from mercator_design.race.racing.summary import Scores
from mercator_design.race.running.record import Record
from mercator_design.runs.files import TASKS, read_journal

if TYPE_CHECKING:
    import pandas as pd


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
    record = read_journal(path).record
    if not record.start:
        raise RaceError(f"{path}: no race has begun here yet")
    return configurations_of(record)


def _experiments(record: Record) -> "pd.DataFrame":
    return _table(
        record.results(), ("experiment", "iteration", "configuration", "instance", "seed", "score", "failure")
    )


def _table(rows: Sequence[object], names: Sequence[str]) -> "pd.DataFrame":
    import pandas as pd

    table = pd.DataFrame({name: [getattr(row, name) for row in rows] for name in names})
    return table.astype({"score": float})


def configurations_of(record: Record) -> "pd.DataFrame":
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
    task = TASKS[record.start["task"]]
    task.check(record.start, configurations)
    columns = task.columns(record.start, configurations)
    return results.join(pd.DataFrame(columns, index=results.index, dtype=object))
