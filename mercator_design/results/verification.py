"""Verifies a run folder: its journal is valid, and its experiments give the same results again."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from mercator_design.errors import RaceError
from mercator_design.race import Experiment
from mercator_design.race.executors.executor import Executor, in_order
from mercator_design.race.session.events import ExperimentDone, TestDone
from mercator_design.race.session.task import Task
from mercator_design.results.files import JOURNAL, check_configurations, read_journal, wrong_end


def verify(
    path: Path,
    task: Task[Any],
    number: int,
    executor: Executor,
    announce: Callable[[str], None] = lambda what: None,  # noqa: ARG005 - a name for the reader
    stopped: Callable[[], bool] = lambda: False,
) -> list[str]:
    """Check a run folder, and run a sample of its experiments again; return what was checked, as sentences.

    Args:
        path: The folder.
        task: The task, from `restored`.
        number: Number of experiments to run again, evenly spread over the race.
        executor: Runs the experiments.
        announce: Called with a message if there is something to compile.
        stopped: Returns whether to stop; called before each experiment.

    Raises:
        RaceError: if something differs.
        ExecutorStopped: see `stopped`; running experiments have finished.
    """
    reading = read_journal(path)
    record = reading.record
    torn = f"; {reading.torn}: incomplete, for example after a loss of power" if reading.torn else ""
    checked = [f"{JOURNAL}: {reading.lines} lines are valid{torn}"]
    if missing := wrong_end(path, record):
        raise RaceError(missing)
    check_configurations(path, record, task.optimizer.space)
    for end in record.ends:
        which = "all" if end.experiments == len(record.experiments) else "the first"
        checked.append(f"{JOURNAL}: the digest, of {which} {end.experiments} experiments, is {end.digest[:16]}")
    if record.is_complete:
        winner = record.ends[-1].winner
        if not task.is_winner(path / task.WINNER, record.configurations[winner]):
            raise RaceError(f"{path / task.WINNER}: expected configuration {winner}, found another")
        checked.append(f"{task.WINNER}: is configuration {winner}, the winner")
    ran: list[ExperimentDone | TestDone] = [one for _, one in sorted(record.experiments.items())]
    ran += [one for _, one in sorted(record.tests.items())]
    finished = [one for one in ran if one.score is not None]
    n = min(number, len(finished)) if task.evaluate is None else 0  # an evaluator compares with others
    sample = [finished[k * len(finished) // n] for k in range(n)]
    task.prepare(announce)
    items = [
        task.item(
            Experiment(one.configuration, one.instance),
            record.configurations[one.configuration],
            test=isinstance(one, TestDone),
        )
        for one in sample
    ]
    found_again = in_order(executor, task.function, items, stopped=stopped)
    for one, (score, outcome, scores) in zip(sample, found_again, strict=True):
        if (score, outcome, scores) != (one.score, one.outcome, one.scores):
            if isinstance(one, ExperimentDone):
                what = f"experiment {one.experiment}"
            else:
                what = f"test on instance {one.instance}"
            raise RaceError(
                f"{path}: {what}: expected score {one.score!r} and digest {one.outcome}, found "
                f"{score!r} and {outcome}: the last digits may differ on another kind of machine"
            )
    tests = sum(isinstance(one, TestDone) for one in finished)
    among = f"{len(finished) - tests} experiments" + (f" and {tests} tests" if tests else "")
    if task.evaluate is not None:
        return [*checked, f"{among} were not run again, as their targetEvaluator compares them with others"]
    return [*checked, f"{n} of {among} were run again, with the same results"]
