"""The experiments, tests and configurations of a race as tables."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mercator_design.errors import RaceError
from mercator_design.race.elimination.summary import Scores
from mercator_design.race.session.record import Record
from mercator_design.results.files import TASKS, possible_scores, read_journal
from mercator_design.scores import ScoreRange

if TYPE_CHECKING:
    import pandas as pd

_OWN = {
    "configuration": "int64",
    "first_iteration": "int64",
    "experiments": "int64",
    "failed": "int64",
    "mean": "float64",
    "standard_deviation": "float64",
}
_OF_TESTS = {"tests": "Int64", "test_mean": "float64", "test_low": "float64", "test_high": "float64"}
_DTYPES = {**_OWN, **_OF_TESTS, "parent": "Int64"}
"""The columns of a table of configurations, with their types; Int64 may have empty cells."""


def experiments_table(path: Path) -> "pd.DataFrame":
    """The experiments of a run folder so far, a row each in order of their numbers.

    Columns: experiment, iteration, configuration, instance, seed, score (NaN if it failed), failure (why, or empty).

    Raises:
        RaceError: if there is no journal, or it is corrupt.
    """
    experiments = read_journal(path).record.view.results()
    return _table(experiments, ("experiment", "iteration", "configuration", "instance", "seed", "score", "failure"))


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
    mean at 95 %); parent (the elite it was sampled from), and what the task has of them: the fsm of a mission, the
    parameters of a program (`mean (parameter)` if one is called `mean`).

    Raises:
        RaceError: if there is no journal, or it is corrupt.
    """
    import pandas as pd

    record = read_journal(path).record
    if not record.start:
        raise RaceError(f"{path}: no race has begun here yet")
    TASKS[record.start["task"]].recall(path, record.start)
    names, rows = configuration_rows(record, possible_scores(path))
    dtypes = {name: dtype for name, dtype in _DTYPES.items() if name in names}
    return pd.DataFrame([*rows], columns=names, dtype=object).astype(dtypes).set_index("configuration")


def _table(rows: Sequence[object], names: Sequence[str]) -> "pd.DataFrame":
    import pandas as pd

    table = pd.DataFrame({name: [getattr(row, name) for row in rows] for name in names})
    return table.astype({"score": float})


def configuration_rows(
    record: Record, possible: ScoreRange, *, first: Sequence[int] = ()
) -> tuple[list[str], Iterator[list[Any]]]:
    """The columns of `configurations_table`, the number of the configuration first, and its rows one by one.

    These are plain lists: each race writes them at its end, and pandas takes long to import.

    Args:
        record: The record of the race.
        possible: The range of its scores.
        first: The configurations whose rows come first; those of the others follow in the order of their numbers.
    """
    numbers = list(dict.fromkeys([*first, *sorted(record.experiments.configurations)]))
    configurations = [record.configurations[number] for number in numbers]
    task = TASKS[record.start["task"]]
    task.check(record.start, configurations)
    columns = task.columns(record.start, configurations)
    tests = record.view.test_scores()
    # A parameter of a program may have the name of another column.
    others = [f"{name} (parameter)" if name in _DTYPES else name for name in columns]
    names = [*_OWN, *(_OF_TESTS if tests else ()), "parent", *others]

    def rows() -> Iterator[list[Any]]:
        for k, number in enumerate(numbers):
            own = [*map(record.experiments.current, record.experiments.numbers_of(number))]
            found = tuple(one.score for one in own if one.score is not None)
            scores = Scores(found)
            row: list[Any] = [number, min(one.iteration for one in own), len(own), len(own) - len(found)]
            row += [scores.mean if found else None, scores.standard_deviation]
            if tests:
                row += _tested(tests.get(number, ()), possible)
            yield [*row, record.parents[number], *(column[k] for column in columns.values())]

    return names, rows()


def _tested(found: tuple[float, ...], possible: ScoreRange) -> list[float | None]:
    if not found:
        return [None] * len(_OF_TESTS)
    scores = Scores(found, possible)
    return [len(found), scores.mean, *(scores.confidence_interval or (None, None))]
