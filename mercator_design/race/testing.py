"""Tests of what a race found, on instances that it never sees.

They begin when the race has ended, count towards no budget, and nothing of the race depends on them. So a race that
has ended can still be tested, or tested more, and a race with tests is the same as one without.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

from mercator_design.errors import RaceError
from mercator_design.race.asking import Asking
from mercator_design.race.events import Measured, Tested
from mercator_design.race.executors import Executor, Stopped
from mercator_design.race.race import Experiment
from mercator_design.race.record import Record
from mercator_design.race.runner import ExperimentFailed, OnFailure, error_of, is_fatal, read_result

T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True)
class Testing:
    """What is tested.

    runs: test instances that a configuration is run on.
    elites: how many of the elites, best first (irace's testNbElites).
    iterations: whether as many of those of each iteration, too (irace's testIterationElites).
    """

    runs: int
    elites: int = 1
    iterations: bool = False

    def configurations(self, race: Asking) -> list[int]:
        """Those that are tested: the winner first, then the other elites, then former ones."""
        elites = [race.elites, *(i.elites for i in reversed(race.iterations) if self.iterations)]
        return list(dict.fromkeys(elite.configuration for few in elites for elite in few[: self.elites]))

    def experiments(self, race: Asking) -> list[Experiment]:
        """All tests, in their order; test instances are counted from 0."""
        return [Experiment(c, instance) for c in self.configurations(race) for instance in range(self.runs)]


def run_tests(
    experiments: Sequence[Experiment],
    *,
    record: Record,
    executor: Executor,
    function: Callable[[T], Measured],
    item: Callable[[Experiment], T],
    seed: Callable[[int], int],
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

    def items() -> Iterator[T]:
        for one in missing:
            if failures or stopped():
                return
            yield item(one)

    done = len(experiments) - len(missing)
    for place, result in executor.run(function, items()):
        score, outcome, failure = read_result(result)
        test = Tested(
            configuration=missing[place].configuration,
            instance=missing[place].instance,
            seed=seed(missing[place].instance),
            score=score,
            outcome=outcome,
            failure=failure,
        )
        if failure and stopped():  # perhaps because of that; when the race is resumed it is tried again
            continue
        if is_fatal(result, on_failure):  # not noted, as above
            failures[place] = ExperimentFailed(test, error_of(result))
            continue
        record.note_test(test)
        done += 1
        watch(done, len(experiments))
    if failures:
        raise failures[min(failures)]
    if done < len(experiments):
        raise Stopped
