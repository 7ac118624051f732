"""Runs a race to its end, as an iterator of events.

A race asks for a batch of experiments, and continues when it has all their costs. An experiment that is in the record
is looked up there; any other is run and recorded. A race depends only on the costs, so an interrupted race is resumed
by running it again with its record: only experiments that had not finished are run.

Idle workers run speculative experiments: those that the race will ask for if nothing is eliminated. This is possible
because an experiment is a pure function of configuration and seed. A speculative experiment that the race does not ask
for costs time, but no budget, and does not influence the race. While the race proposes configurations, in a thread of
its own, workers run what is upcoming; its results are held until the configurations have their numbers.

If the problem has an evaluator, it computes the costs when a whole batch has run, by comparing the alive
configurations. It may replace earlier costs on the same instance.
"""

from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Generic, TypeVar

from mercator_design.errors import RaceError
from mercator_design.race.elimination.race import Experiment
from mercator_design.race.elimination.summary import Scores
from mercator_design.race.executors.executor import Executor, ExecutorStopped, Failed, Items, attempt
from mercator_design.race.methods.next_batch import NextBatch
from mercator_design.race.session.evaluation import Testing, experiment_of, known_tests, results_of, test_of
from mercator_design.race.session.events import (
    ConfigurationAdded,
    Event,
    ExperimentDone,
    IterationEnded,
    Measurement,
    RaceEnded,
    ScoreRevised,
    SpeculativeDone,
    TestDone,
)
from mercator_design.race.session.journal import Journal
from mercator_design.race.session.outcome import ExperimentFailed, OnFailure, is_fatal, read_result
from mercator_design.race.session.record import Record, another_race
from mercator_design.race.session.task import Problem, RaceResult
from mercator_design.race.session.workload import Workload

T = TypeVar("T")


class RaceRun(Generic[T]):
    """A running race with its tests: an iterator of its events in the order in which they happen.

    Events that are already in the record come again, except those of speculative experiments, in the order in which the
    race asks for their experiments. When an event is returned, the race is in the state after this event.

    Args:
        problem: The problem to race on.
        executor: Runs experiments; their results do not depend on it.
        record: The race so far; new events are recorded there. By default in memory.
        on_failure: Whether an experiment that fails stops the race, or rejects its configuration.
        testing: What to test when the race has ended.
        stopped: Returns whether to stop; called before each experiment.

    Iterating raises:
        RaceError: The record is of another race or cannot be written, or all configurations were rejected.
        ExperimentFailed, ExecutorLost, WorkerUnfit: see `on_failure`; the last two, of `Executor.run`, do not obey it.
        ExecutorStopped: see `stopped`; running experiments have finished and are recorded.
    """

    def __init__(
        self,
        problem: Problem[T],
        executor: Executor,
        record: Record | Journal | None = None,
        *,
        on_failure: OnFailure = "stop",
        testing: Testing | None = None,
        stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        if record is None:
            record = Record()
            record.begin(problem.start())
        self.problem = problem
        self._optimizer = problem.optimizer
        self._executor = executor
        self._journal, self._record = record, record.record
        self.view = self._record.view  # after all events that are recorded
        self.view.live = lambda: self._optimizer.progress
        self._on_failure = on_failure
        self._testing = testing
        self._stopped = stopped
        self._events = self._run()
        self._pending: deque[Event] = deque()  # events that were not returned yet
        self._batch: list[Experiment] = []  # the experiments that the race has asked for
        self._missing: dict[Experiment, int] = {}  # those of the batch that have not finished, with their numbers
        self._work = Workload()  # what workers run or get next
        self._next_batch: NextBatch | None = None  # for the next batch, while the race proposes it
        self._failures: dict[int, ExperimentFailed] = {}  # by the number of the experiment or test
        self._seen: set[int] = set()  # configurations whose event was returned
        self._n_told = self._n_iterations = self._n_revised = self._n_ends = 0
        self._ended = False
        self._result: RaceResult | None = None

    def __iter__(self) -> Iterator[Event]:
        return self

    def __next__(self) -> Event:
        return next(self._events)

    def close(self) -> None:
        """Stop the race, as if its iterator had ended; the race of a journal can be resumed."""
        self._events.close()

    def finish(self) -> RaceResult:
        """Run to the end and return the result; raises what iterating raises."""
        deque(self, maxlen=0)
        return self.result

    @property
    def result(self) -> RaceResult:
        """The result of the race.

        Raises:
            RaceError: The race has not ended yet.
        """
        if self._result is None:
            raise RaceError("result: expected a race that has ended, found one that is not finished")
        return self._result

    def _run(self) -> Generator[Event, None, None]:
        yield from self._run_race()
        best, numbers = self._optimizer.best.configuration, [self._optimizer.best.configuration]
        if self._testing is not None:
            yield from self._run_tests(self._testing)
            numbers = self._testing.configurations(self._optimizer)
        known, finished = self.view.test_scores(), self.view.results()
        tests = {number: self._scores(known[number]) for number in numbers if number in known}
        scores = self._scores(self.view.scores(best).values())
        self._result = RaceResult(configuration=best, scores=scores, tests=tests, finished=finished)

    def _scores(self, values: Iterable[float]) -> Scores:
        return Scores(tuple(values), self.problem.possible_scores)

    def _run_race(self) -> Iterator[Event]:
        """Run the race to its end under each of the record's budgets."""
        record = self._record
        yield from self._advance()
        for place, result in self._executor.run(
            self.problem.function, Items(self._next_item, lambda: len(self._work.todo))
        ):
            self._work.end(place, result)
            if self._next_batch is None:
                self._receive()
            yield from self._advance()
        if self._next_batch is not None:  # stopped
            self._take(self._next_batch)
            yield from self._unseen()
        self._check_end(is_complete=self._ended)
        for found, what, noted in (
            (self._n_told, "experiments", record.experiments),
            (self._n_iterations, "iterations", record.iterations),
            (self._n_revised, "batches with revised scores", record.revised),
        ):
            if found != len(noted):
                raise another_race(f"{found} {what} in all", f"{len(noted)}")
        if unknown := record.configurations.keys() - {*record.experiments.configurations}:
            raise another_race("no configurations but those that were raced", f"{len(unknown)} others")

    def _run_tests(self, testing: Testing) -> Iterator[Event]:
        """Run the tests that the record does not have."""
        problem, tests = self.problem, testing.experiments(self._optimizer)
        known = known_tests(problem, tests, self._record.tests)
        yield from known.values()
        missing = {one: place for place, one in enumerate(one for one in tests if one not in known)}
        results = results_of(problem, self._executor, [*missing], self._optimizer.configurations, known, self._is_over)
        for where, result in results:
            self._accept(result, test_of(problem, where, result), missing[where])
            yield from self._unseen()
        self._check_end(is_complete=all(one in self._record.tests for one in tests))

    def _check_end(self, *, is_complete: bool) -> None:
        if self._failures:
            raise self._failures[min(self._failures)]
        if not is_complete:
            raise ExecutorStopped

    def _is_over(self) -> bool:
        return bool(self._failures) or self._stopped()

    def _note(self, *events: Event) -> None:
        self._journal.note(*events)
        self._pending += events

    def _unseen(self) -> Iterator[Event]:
        while self._pending:
            yield self._pending.popleft()

    def _item(self, experiment: Experiment) -> T:
        upcoming = self._next_batch and self._next_batch.upcoming.get(experiment)
        return self.problem.item(experiment, upcoming or self._optimizer.configurations[experiment.configuration])

    def _cost(self, score: float | None) -> float:
        return float("inf") if score is None else self.problem.cost(score)

    def _next_item(self, place: int) -> T | None:
        """The next item to run: first those of the batch, then speculative ones while workers would be idle."""
        if self._ended or self._is_over():
            raise StopIteration
        if self._next_batch is not None and not self._work.todo:
            self._take(self._next_batch)
        experiment = self._work.todo.popleft() if self._work.todo else self._next_speculative()
        if experiment is None:
            return None
        self._work.begin(place, experiment)
        return self._item(experiment)

    def _next_speculative(self) -> Experiment | None:
        def lookahead() -> list[Experiment]:
            known = self._record.scores_of(self._batch, self._n_told) if self.problem.evaluate is None else {}
            costs = {one: self._cost(score) for one, score in known.items()}
            return self._optimizer.lookahead(2 * self._executor.jobs, costs) if self.problem.speculates else []

        part = 1 - len(self._missing) / max(len(self._batch), 1)
        return self._work.next_likely(lookahead, self._record.speculative, part)

    def _advance(self) -> Iterator[Event]:
        """Tell the race its costs and ask for the next batch, until an experiment has to run or the race has ended."""
        while not (self._ended or self._is_over()):
            if self._next_batch is not None:
                if not self._next_batch.done and not self._work.is_done:
                    return
                self._take(self._next_batch)
            self._evaluate()
            yield from self._unseen()
            if self._missing or self._failures:
                return
            if self._batch:
                finished = [self._record.experiments[self._n_told + k] for k in range(len(self._batch))]
                self._revise()
                self._n_told += len(self._batch)
                self._optimizer.tell([self.problem.cost_of(one) for one in finished])
                self._note_iterations()
                yield from self._unseen()
            self._ask()
            if self._batch or self._next_batch is not None:
                continue
            self._note_end()
            yield from self._unseen()
            if not self._ended:
                self._optimizer.extend(self._record.budgets[self._n_ends])
        yield from self._unseen()

    def _ask(self) -> None:
        """Ask for the next batch; in a thread if experiments that have not run are upcoming."""
        self._work.forget_likely()
        is_ahead = self._n_told == len(self._record.experiments) and self.problem.speculates and self.problem.predicts
        if not (is_ahead and self._optimizer.upcoming):
            self._batch = self._optimizer.ask()
            if self._batch:
                self._look_up()
            return
        self._next_batch = NextBatch(self._optimizer, {*self._work.under_way, *self._record.speculative})
        self._batch = []
        self._work.todo.extend(self._next_batch.upcoming)

    def _take(self, next_batch: NextBatch) -> None:
        """Take the batch that was asked for, and record the results that are held, if their numbers were right."""
        self._batch, self._next_batch = next_batch.batch(), None
        self._work.keep(next_batch.is_right)
        if self._batch:
            self._look_up()
        self._receive()

    def _receive(self) -> None:
        """Record the results that are held."""
        for experiment, result in self._work.held.items():
            is_asked_for = experiment in self._missing
            if is_asked_for and (self.problem.evaluate is None or read_result(result)[2]):
                self._finish(experiment, result)
            elif isinstance(result, Measurement) and not read_result(result)[2]:  # a failure runs again if asked for
                self._note(SpeculativeDone(**experiment._asdict(), **result._asdict()))
        self._work.held.clear()

    def _note_iterations(self) -> None:
        for ended in self._optimizer.iterations[self._n_iterations :]:
            self._n_iterations += 1
            iteration = IterationEnded.of(ended)
            if (known := self._record.iterations.get(ended.iteration)) is None:
                self._note(iteration)
                continue
            if replace(known, note="") != replace(iteration, note=""):  # another version may write another note
                raise another_race(f"{iteration}", f"{known}")
            self._pending.append(known)

    def _look_up(self) -> None:
        """Look up the experiments of a batch in the record; the others are missing."""
        self._note_configurations()
        known = self._record.experiments
        for number, experiment in enumerate(self._batch, start=self._n_told):
            if (one := known.get(number)) is None:
                self._missing[experiment] = number
                continue
            expected = (*experiment, self.problem.seed(experiment.instance), self._optimizer.iteration)
            found = (one.configuration, one.instance, one.seed, one.iteration)
            if expected != found:
                what = "configuration {} on instance {} with seed {} in iteration {}"
                raise another_race(f"experiment {number}: {what.format(*expected)}", what.format(*found))
            self._pending.append(one)
        self._pending += self._record.revised.get(self._n_told, {}).values()
        under_way = {*self._work.under_way, *self._work.held}
        for experiment in list(self._missing):
            if experiment in self._record.speculative:
                if self.problem.evaluate is None:
                    self._finish(experiment, self._record.speculative[experiment])
            elif experiment not in under_way:
                self._work.todo.append(experiment)

    def _evaluate(self) -> None:
        """Evaluate a batch when all of it has run: for each instance earlier configurations first, then new ones."""
        if (
            self.problem.evaluate is None
            or not self._missing
            or not self._record.speculative.keys() >= self._missing.keys()
        ):
            return
        for instance in dict.fromkeys(experiment.instance for experiment in self._batch):
            asked = [e for e in self._batch if e.instance == instance and e in self._record.speculative]
            before = [Experiment(configuration, instance) for configuration in self._optimizer.competitors(instance)]
            alive = [experiment.configuration for experiment in (*before, *asked)]
            known = self._record.revised.get(self._n_told, {})
            for experiment in (*before, *asked):
                if self._is_over():
                    return
                if experiment in self._missing:
                    self._finish(experiment, self._evaluated(experiment, alive))
                elif experiment in before and experiment not in known:
                    self._revise_score(experiment, self._evaluated(experiment, alive))

    def _evaluated(self, experiment: Experiment, alive: Sequence[int]) -> Measurement | Failed:
        assert self.problem.evaluate is not None  # noqa: S101 - for mypy; callers have checked
        return attempt(partial(self.problem.evaluate, self._item(experiment)), alive, Exception)

    def _revise_score(self, experiment: Experiment, result: Measurement | Failed) -> None:
        """Record that the evaluation of a batch has replaced a score."""
        done = experiment_of(self.problem, self._n_told, experiment, result)
        revised = ScoreRevised(experiment=self._n_told, **experiment._asdict(), score=done.score, failure=done.failure)
        self._accept(result, done, self._n_told, revised)

    def _revise(self) -> None:
        """Report to the race the costs that the evaluation of a batch has replaced."""
        if not (revised := self._record.revised.get(self._n_told)):
            return
        instances = set() if self.problem.evaluate is None else {experiment.instance for experiment in self._batch}
        for number, instance in revised:
            if instance not in instances or number not in self._optimizer.competitors(instance):
                raise another_race("no revised score", f"that of configuration {number} on instance {instance}")
        self._n_revised += 1
        self._optimizer.revise({experiment: self._cost(one.score) for experiment, one in revised.items()})

    def _finish(self, experiment: Experiment, result: Measurement | Failed) -> None:
        """Record an experiment that the race has asked for."""
        done = experiment_of(self.problem, self._missing.pop(experiment), experiment, result)
        self._accept(result, done, done.experiment)

    def _accept(
        self,
        result: Measurement | Failed,
        done: ExperimentDone | TestDone,
        number: int,
        revised: ScoreRevised | None = None,
    ) -> None:
        """Record what has run, or the score that it revises; a failure is recorded only if the race continues."""
        if done.failure and self._stopped():  # perhaps because of the stop; a resumed race tries again
            return
        if is_fatal(result, self._on_failure):
            self._failures[number] = ExperimentFailed(done, result)
        else:
            self._note(revised or done)

    def _note_configurations(self) -> None:
        numbers = dict.fromkeys(experiment.configuration for experiment in self._batch)
        values, parents = self._optimizer.configurations, self._optimizer.parents
        if new := self._record.new_configurations(numbers, values, parents):
            self._journal.note(*new)
        for one in [number for number in numbers if number not in self._seen]:
            self._seen.add(one)
            self._record.configurations[one] = values[one]  # once in memory is enough
            self._pending.append(ConfigurationAdded(configuration=one, parent=parents[one], values=values[one]))

    def _note_end(self) -> None:
        budget = self._record.budgets[self._n_ends]
        end = RaceEnded(budget=budget, experiments=self._n_told, winner=self._optimizer.best.configuration)
        if self._n_ends == len(self._record.ends):
            self._journal.note(self._record.with_digest(end))
        noted = self._record.ends[self._n_ends]
        self._pending.append(noted)
        if (noted.budget, noted.experiments, noted.winner) != (end.budget, end.experiments, end.winner):
            raise another_race(f"the end {end}", f"{noted}")
        self._n_ends += 1
        self._ended = self._n_ends == len(self._record.budgets)
