"""Tests of a race's best configurations on separate instances.

Tests begin when the race has ended and do not count towards the budget. The race does not depend on them: a race that
has ended can be tested later, or tested more.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import takewhile
from typing import Annotated, Any, TypeVar

from mercator_design.config.schema import Range
from mercator_design.errors import RaceError
from mercator_design.race.elimination.fronts import MAX_FRONT, front_candidates
from mercator_design.race.elimination.race import Experiment
from mercator_design.race.executors.executor import Executor, Failed, attempt
from mercator_design.race.methods.optimizer import Optimizer
from mercator_design.race.session.events import ExperimentDone, Measurement, TestDone
from mercator_design.race.session.outcome import read_result
from mercator_design.race.session.task import Problem
from mercator_design.race.space.parameter import Configuration

T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True)
class Testing:
    """The tests of a race.

    runs: Number of test instances for each configuration.
    elites: Number of elites to test, best first (irace's testNbElites).
    iterations: Whether to test the same number of elites of each iteration (irace's testIterationElites).

    Raises:
        RaceError: There are no runs or elites.
    """

    runs: Annotated[int, Range(1)]
    elites: Annotated[int, Range(1)] = 1
    iterations: bool = False

    def __post_init__(self) -> None:
        for name, number in (("test runs", self.runs), ("test elites", self.elites)):
            if number < 1:
                raise RaceError(f"{name}: expected at least 1, found {number}")

    def configurations(self, race: Optimizer) -> list[int]:
        """The configurations to test: the winner first, then other elites, then former ones; then those of a front."""
        elites = [race.elites, *(i.elites for i in reversed(race.iterations) if self.iterations)]
        numbers = [elite.configuration for few in elites for elite in few[: self.elites]]
        if race.history.further:
            numbers += front_candidates(race.history.tables, race.history.former_elites, MAX_FRONT)
        return list(dict.fromkeys(numbers))

    def n_tests(self, elites: Sequence[Sequence[int]]) -> int:
        """The number of all tests, given the elites of each iteration that has ended, best first."""
        tested = elites if self.iterations else elites[-1:]
        return self.runs * len({number for few in tested for number in few[: self.elites]})

    def experiments(self, race: Optimizer) -> list[Experiment]:
        """All tests, in their order; test instances are counted from 0."""
        return [Experiment(c, instance) for c in self.configurations(race) for instance in range(self.runs)]


def known_tests(
    problem: Problem[T], tests: Sequence[Experiment], noted: Mapping[Experiment, TestDone]
) -> dict[Experiment, TestDone]:
    """The given tests that the record already has, in the order given.

    Raises:
        RaceError: One has another seed.
    """
    known = {one: noted[one] for one in tests if one in noted}
    for one in known.values():
        if one.seed != (seed := problem.test_seed(one.instance)):
            raise RaceError(f"journal: expected test instance {one.instance} to have seed {seed}, found {one.seed}")
    return known


def results_of(
    problem: Problem[T],
    executor: Executor,
    tests: Sequence[Experiment],
    configurations: Mapping[int, Configuration] | Sequence[Configuration],
    known: Collection[Experiment],
    stopped: Callable[[], bool],
) -> Iterator[tuple[Experiment, Measurement | Failed]]:
    """Run tests; yields their results in the order in which they finish.

    Args:
        problem: The problem of the race.
        executor: Runs the tests.
        tests: Configurations on test instances.
        configurations: The configurations, by number.
        known: Tests that have run before; an evaluator also compares with them.
        stopped: Returns whether to stop; called before each test.
    """

    def item(test: Experiment) -> T:
        return problem.item(test, configurations[test.configuration], test=True)

    ran: set[Experiment] = set()
    items = map(item, takewhile(lambda _: not stopped(), tests))
    for place, result in executor.run(problem.function, items):
        if problem.evaluate is None or read_result(result)[2]:
            yield tests[place], result
        else:
            ran.add(tests[place])
    if problem.evaluate is None:
        return
    todo = [one for one in tests if one in ran]
    alive: dict[int, list[int]] = {}  # by instance
    for one in (*known, *todo):
        alive.setdefault(one.instance, []).append(one.configuration)
    for one in sorted(todo, key=lambda test: test.instance):
        if stopped():
            return
        yield one, attempt(partial(problem.evaluate, item(one)), alive[one.instance], Exception)


def experiment_of(problem: Problem[T], number: int, where: Experiment, result: Measurement | Failed) -> ExperimentDone:
    """The event of an experiment of the current batch that has run."""
    return ExperimentDone(
        experiment=number,
        iteration=problem.optimizer.iteration,
        seed=problem.seed(where.instance),
        **_fields(where, result),
    )


def test_of(problem: Problem[T], where: Experiment, result: Measurement | Failed) -> TestDone:
    """The event of a test that has run."""
    return TestDone(seed=problem.test_seed(where.instance), **_fields(where, result))


def _fields(where: Experiment, result: Measurement | Failed) -> dict[str, Any]:
    found = dict(zip(("score", "outcome", "failure"), read_result(result), strict=True))
    scores = () if isinstance(result, Failed) or found["failure"] else result.scores
    return {**where._asdict(), **found, "scores": scores}
