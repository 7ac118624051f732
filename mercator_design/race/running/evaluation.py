"""Tests of what a race found, on instances that it never sees.

They begin when the race has ended, count towards no budget, and nothing of the race depends on them. So a race that
has ended can still be tested, or tested more, and a race with tests is the same as one without.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, TypeVar

from mercator_design.config.schema import Range
from mercator_design.errors import RaceError
from mercator_design.race.methods.optimizer import Optimizer
from mercator_design.race.racing.race import Experiment
from mercator_design.race.running.events import Measurement, TestDone
from mercator_design.race.running.executors import Executor, ExecutorStopped, Failed, attempt_here
from mercator_design.race.running.record import Record
from mercator_design.race.running.runner import ExperimentFailed, OnFailure, error_of, is_fatal, read_result

T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True)
class Testing:
    """What is tested.

    runs: test instances that a configuration is run on.
    elites: how many of the elites, best first (irace's testNbElites).
    iterations: whether as many of those of each iteration, too (irace's testIterationElites).
    """

    runs: Annotated[int, Range(1)]
    elites: Annotated[int, Range(1)] = 1
    iterations: bool = False

    def configurations(self, race: Optimizer) -> list[int]:
        """Those that are tested: the winner first, then the other elites, then former ones."""
        elites = [race.elites, *(i.elites for i in reversed(race.iterations) if self.iterations)]
        return list(dict.fromkeys(elite.configuration for few in elites for elite in few[: self.elites]))

    def experiments(self, race: Optimizer) -> list[Experiment]:
        """All tests, in their order; test instances are counted from 0."""
        return [Experiment(c, instance) for c in self.configurations(race) for instance in range(self.runs)]


def run_tests(
    experiments: Sequence[Experiment],
    *,
    record: Record,
    executor: Executor,
    function: Callable[[T], Measurement],
    item: Callable[[Experiment], T],
    seed: Callable[[int], int],
    evaluate: Callable[[T, Sequence[int]], Measurement] | None = None,
    on_failure: OnFailure = "stop",
    watch: Callable[[int, int], None] = lambda done, of: None,  # noqa: ARG005 - names for the reader
    stopped: Callable[[], bool] = lambda: False,
) -> None:
    """Run the tests that a record does not have, and note them there.

    Args:
        experiments: The tests, such as `Testing.experiments`.
        record: Of the race, which has ended.
        executor: Runs them.
        function: Gives what came of an item.
        item: What to give the function for a test.
        seed: Of a test instance.
        evaluate: If there is one, `function` only runs items, and this gives what came of one among configurations.
        on_failure: Whether a test that fails ends them all, or is noted as failed.
        watch: Called with the number of tests done, and of all.
        stopped: Whether to stop; asked before each test.

    Raises:
        ExperimentFailed: see `on_failure`.
        Stopped: see `stopped`; what was under way has been waited for and noted.
        RaceError: The record has a test on another instance, or cannot be written.
    """
    for one in experiments:
        if one in record.tests and record.tests[one].seed != seed(one.instance):
            raise RaceError(
                f"journal: expected test instance {one.instance} to have seed {seed(one.instance)}, "
                f"found {record.tests[one].seed}"
            )
    missing = [one for one in experiments if one not in record.tests]
    failures: dict[int, ExperimentFailed] = {}

    done = len(experiments) - len(missing)
    known = [one for one in experiments if one in record.tests]
    results = measured(missing, executor, function, item, evaluate, known, lambda: bool(failures) or stopped())
    for where, result in results:
        score, outcome, failure = read_result(result)
        test = TestDone(
            configuration=where.configuration,
            instance=where.instance,
            seed=seed(where.instance),
            score=score,
            outcome=outcome,
            failure=failure,
        )
        if failure and stopped():  # perhaps because of that; when the race is resumed it is tried again
            continue
        if is_fatal(result, on_failure):  # not noted, as above
            failures[missing.index(where)] = ExperimentFailed(test, error_of(result))
            continue
        record.note(test)
        done += 1
        watch(done, len(experiments))
    if failures:
        raise failures[min(failures)]
    if done < len(experiments):
        raise ExecutorStopped


def measured(
    tests: Sequence[Experiment],
    executor: Executor,
    function: Callable[[T], Measurement],
    item: Callable[[Experiment], T],
    evaluate: Callable[[T, Sequence[int]], Measurement] | None,
    known: Collection[Experiment],
    stopped: Callable[[], bool],
) -> Iterator[tuple[Experiment, Measurement | Failed]]:
    """What came of tests, in the order in which that is known.

    Args:
        tests: On test instances.
        executor: Runs them.
        function: Gives what came of an item, or only runs it.
        item: What to give the function for a test.
        evaluate: If there is one, it gives what came of an item that has run, when all have run.
        known: Tests that have run before, which the evaluator compares with, too.
        stopped: Asked before each whether to stop.
    """

    def items() -> Iterator[T]:
        for one in tests:
            if stopped():
                return
            yield item(one)

    ran: list[Experiment] = []
    for place, result in executor.run(function, items()):
        if evaluate is None or read_result(result)[2]:
            yield tests[place], result
        else:
            ran.append(tests[place])
    if evaluate is None:
        return
    for one in sorted(ran, key=lambda test: (test.instance, tests.index(test))):
        alive = [other.configuration for other in (*known, *tests) if other.instance == one.instance
                 and (other in known or other in ran)]  # fmt: skip
        if stopped():
            return
        yield one, attempt_here(partial(evaluate, item(one)), alive)
