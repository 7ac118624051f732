"""A race run to its end: what it asks for is looked up in a record of it, or run, noted there, and told.

A race asks for some experiments at a time, and decides when it has them all. Workers who would have to wait for the
last of them may run what it will ask for next if nothing is eliminated: an experiment is a pure function of
configuration and seed, so it may run before anyone asks. What the race then does not ask for is lost time and nothing
else; it does not count as part of the budget, and the race never sees it.

An evaluator may give the costs: it compares the configurations that are alive when all those of a batch have run, and
so may replace the costs of others that have run on the instance before.

So a race that was stopped is resumed by running it again with its record: it takes the same way, as it depends on the
costs alone, and only what had not finished is run.
"""

from collections import deque
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import count
from typing import Generic, Literal, TypeVar

from mercator_design.errors import MercatorError, RaceError, lack_of_memory
from mercator_design.race.methods.optimizer import Optimizer
from mercator_design.race.racing.race import Experiment
from mercator_design.race.running.events import (
    ConfigurationAdded,
    ExperimentDone,
    IterationEnded,
    Measurement,
    RaceEnded,
    ScoreRevised,
    SpeculativeDone,
    TestDone,
)
from mercator_design.race.running.executors import Executor, ExecutorStopped, Failed, Rejected, attempt_here
from mercator_design.race.running.record import Record
from mercator_design.scores import EXPECTED, is_score

T = TypeVar("T")
OnFailure = Literal["stop", "reject"]


class ExperimentFailed(RaceError):  # noqa: N818 - as TimeoutExpired, it says what happened
    """An experiment failed, and no failure is accepted."""

    def __init__(self, finished: ExperimentDone | TestDone, error: Exception | None) -> None:
        what = f"experiment {finished.experiment}" if isinstance(finished, ExperimentDone) else "a test"
        super().__init__(
            f"{what} (configuration {finished.configuration}, instance of seed {finished.seed}) failed: "
            f"{finished.failure}"
        )
        self.finished = finished
        if isinstance(error, MercatorError):
            self.exit_code = error.exit_code


@dataclass(kw_only=True)
class Runner(Generic[T]):
    """How the experiments of a race are run.

    function: gives what came of an item.
    item: what to give the function for an experiment of a configuration on an instance.
    seed: of an instance.
    cost: of a score.
    on_failure: whether an experiment that fails stops the race, or rejects its configuration.
    watch: called with experiments that have just been run or looked up.
    watch_iterations: called with an iteration that has ended, unless that was known.
    stopped: whether to stop; asked before each experiment.
    evaluate: if there is one, `function` only runs experiments, and this gives what came of one that has run among
        configurations, in the order of a batch.
    speculate: whether an idle worker runs what the race has not asked for.
    """

    race: Optimizer
    record: Record
    executor: Executor
    function: Callable[[T], Measurement]
    item: Callable[[Experiment], T]
    seed: Callable[[int], int]
    cost: Callable[[float], float]
    on_failure: OnFailure = "stop"
    watch: Callable[[Sequence[ExperimentDone]], None] = lambda finished: None  # noqa: ARG005 - a name for the reader
    watch_iterations: Callable[[IterationEnded], None] = lambda iteration: None  # noqa: ARG005
    stopped: Callable[[], bool] = lambda: False
    evaluate: Callable[[Experiment, Sequence[int]], Measurement] | None = None
    speculate: bool = True

    def __post_init__(self) -> None:
        self._batch: list[Experiment] = []  # that the race has asked for
        self._missing: dict[Experiment, int] = {}  # those of it that have not finished, with their numbers
        self._todo: deque[Experiment] = deque()  # those of these that have not begun
        self._under_way: dict[int, Experiment] = {}  # by the place of its item
        self._likely: Iterator[Experiment] | None = None  # what the race will ask for next; None if not yet found out
        self._failures: dict[int, ExperimentFailed] = {}  # by the experiment's number
        self._told = 0
        self._n_iterations = 0
        self._n_revised = 0
        self._n_ends = 0
        self._ended = False

    def run(self) -> None:
        """Run the race to its end under each of the record's budgets.

        Raises:
            RaceError: The record is of another race or cannot be written, or all configurations were rejected.
            ExperimentFailed: see `on_failure`.
            Stopped: see `stopped`.
        """
        self._advance()
        for place, result in self.executor.run(self.function, self._items()):
            experiment = self._under_way.pop(place)
            is_run = self.evaluate is not None and not read_result(result)[2]
            if experiment in self._missing and not is_run:
                self._finish(experiment, result)
            else:
                self._keep(experiment, result)
            self._advance()
        if self._failures:
            raise self._failures[min(self._failures)]
        if not self._ended:
            raise ExecutorStopped
        if self._told != len(self.record.experiments):
            raise _another(f"{self._told} experiments in all", f"{len(self.record.experiments)}")
        if self._n_iterations != len(self.record.iterations):
            raise _another(f"{self._n_iterations} iterations in all", f"{len(self.record.iterations)}")
        if self._n_revised != len(self.record.revised):
            raise _another(f"{self._n_revised} batches with revised scores", f"{len(self.record.revised)}")
        raced = {one.configuration for one in self.record.experiments.values()}
        if unknown := self.record.configurations.keys() - raced:
            raise _another("no configurations but those that were raced", f"{len(unknown)} others")

    def _items(self) -> Iterator[T | None]:
        """What to run next: what the race asks for, and before a worker is idle what it will probably ask for."""
        for place in count():
            if self._ended or self._failures or self.stopped():
                return
            experiment = self._todo.popleft() if self._todo else self._foreseen()
            if experiment is None:
                yield None
            else:
                self._under_way[place] = experiment
                yield self.item(experiment)

    def _foreseen(self) -> Experiment | None:
        if self._likely is None:
            self._likely = iter(self.race.foresee(2 * self.executor.jobs) if self.speculate else [])
        under_way = set(self._under_way.values())
        return next((e for e in self._likely if e not in under_way and e not in self.record.ahead), None)

    def _advance(self) -> None:
        """Tell what has finished and ask on, until something has to be run or the race has ended."""
        while not (self._failures or self._ended or self.stopped()):
            self._evaluate()
            if self._missing or self._failures:
                return
            if self._batch:
                finished = [self.record.experiments[self._told + k] for k in range(len(self._batch))]
                self._revise()
                self._told += len(self._batch)
                self.race.tell([float("inf") if one.score is None else self.cost(one.score) for one in finished])
                self._note_iterations()
            self._batch = self.race.ask()
            self._likely = None
            if self._batch:
                self._look_up()
                continue
            self._note_end()
            if not self._ended:
                self.race.extend(self.record.budgets[self._n_ends])

    def _note_iterations(self) -> None:
        for ended in self.race.iterations[self._n_iterations :]:
            self._n_iterations += 1
            iteration = IterationEnded(
                iteration=ended.iteration,
                postselection=ended.postselection,
                budget=ended.budget,
                used=ended.used,
                configurations=ended.n_configurations,
                instances=ended.n_instances,
                alive=ended.n_alive,
                elites=tuple(elite.configuration for elite in ended.elites),
                stagnant=ended.stagnant,
                note=ended.note,
            )
            known = self.record.iterations.get(ended.iteration)
            if known is None:
                self.record.note(iteration)
                self.watch_iterations(iteration)
            elif replace(known, note="") != replace(iteration, note=""):  # another version may say other words
                raise _another(f"{iteration}", f"{known}")

    def _look_up(self) -> None:
        """Find what is known of a batch; the others are missing."""
        self._note_configurations()
        known, replayed = self.record.experiments, []
        for number, experiment in enumerate(self._batch, start=self._told):
            one = known.get(number)
            if one is None:
                self._missing[experiment] = number
                continue
            expected = (*experiment, self.seed(experiment.instance), self.race.iteration)
            found = (one.configuration, one.instance, one.seed, one.iteration)
            if expected != found:
                what = "configuration {} on instance {} with seed {} in iteration {}"
                raise _another(f"experiment {number}: {what.format(*expected)}", what.format(*found))
            replayed.append(one)
        if replayed:
            self.watch(replayed)
        under_way = set(self._under_way.values())
        for experiment in list(self._missing):
            if experiment in self.record.ahead:
                if self.evaluate is None:
                    self._finish(experiment, self.record.ahead[experiment])
            elif experiment not in under_way:
                self._todo.append(experiment)

    def _evaluate(self) -> None:
        """Evaluate a batch when all of it has run: what is alive on an instance, those that ran there before first."""
        if self.evaluate is None or not self._missing or not self.record.ahead.keys() >= self._missing.keys():
            return
        for instance in dict.fromkeys(experiment.instance for experiment in self._batch):
            asked = [e for e in self._batch if e.instance == instance and e in self.record.ahead]
            before = [Experiment(configuration, instance) for configuration in self.race.beside(instance)]
            alive = [experiment.configuration for experiment in (*before, *asked)]
            known = self.record.revised.get(self._told, {})
            for experiment in (*before, *asked):
                if self._failures or self.stopped():
                    return
                if experiment in self._missing:
                    self._finish(experiment, attempt_here(partial(self.evaluate, experiment), alive))
                elif experiment in before and experiment not in known:
                    self._note_revised(experiment, attempt_here(partial(self.evaluate, experiment), alive))

    def _note_revised(self, experiment: Experiment, result: Measurement | Failed) -> None:
        score, _, failure = read_result(result)
        if is_fatal(result, self.on_failure):
            one = self._finished(self._told, experiment, result)
            self._failures[self._told] = ExperimentFailed(one, error_of(result))
        elif not (failure and self.stopped()):
            self.record.note(
                ScoreRevised(
                    experiment=self._told,
                    configuration=experiment.configuration,
                    instance=experiment.instance,
                    score=score,
                    failure=failure,
                )
            )

    def _revise(self) -> None:
        """Tell the race which costs the evaluation of a batch has replaced."""
        revised = self.record.revised.get(self._told, {})
        if revised:
            self._check_revised(revised)
            self._n_revised += 1
            costs = {e: float("inf") if one.score is None else self.cost(one.score) for e, one in revised.items()}
            self.race.revise(costs)

    def _check_revised(self, revised: Collection[Experiment]) -> None:
        instances = {experiment.instance for experiment in self._batch}
        for number, instance in revised:
            if self.evaluate is None or instance not in instances or number not in self.race.beside(instance):
                raise _another("no revised score", f"that of configuration {number} on instance {instance}")

    def _finish(self, experiment: Experiment, result: Measurement | Failed) -> None:
        """Note an experiment that the race has asked for."""
        one = self._finished(self._missing.pop(experiment), experiment, result)
        if one.failure and self.stopped():  # perhaps because of that; when the race is resumed it is tried again
            return
        if is_fatal(result, self.on_failure):  # not noted, as above
            self._failures[one.experiment] = ExperimentFailed(one, error_of(result))
            return
        self.record.note(one)
        self.watch([one])

    def _finished(self, number: int, experiment: Experiment, result: Measurement | Failed) -> ExperimentDone:
        score, outcome, failure = read_result(result)
        return ExperimentDone(
            experiment=number,
            iteration=self.race.iteration,
            configuration=experiment.configuration,
            instance=experiment.instance,
            seed=self.seed(experiment.instance),
            score=score,
            outcome=outcome,
            failure=failure,
        )

    def _keep(self, experiment: Experiment, result: Measurement | Failed) -> None:
        """Note an experiment that the race may yet ask for; if it failed, it may fail then."""
        if not read_result(result)[2] and isinstance(result, Measurement):
            self.record.note(SpeculativeDone(**experiment._asdict(), **result._asdict()))

    def _note_configurations(self) -> None:
        for number in dict.fromkeys(experiment.configuration for experiment in self._batch):
            values, parent = self.race.configurations[number], self.race.parents[number]
            if number not in self.record.configurations:
                self.record.note(ConfigurationAdded(configuration=number, parent=parent, values=values))
            elif (self.record.configurations[number], self.record.parents[number]) != (values, parent):
                found = f"{self.record.configurations[number]} from {self.record.parents[number]}"
                raise _another(f"configuration {number}: {values} from {parent}", found)
            self.record.configurations[number] = values  # once in memory is enough

    def _note_end(self) -> None:
        budget = self.record.budgets[self._n_ends]
        end = RaceEnded(budget=budget, experiments=self._told, winner=self.race.best.configuration)
        if self._n_ends == len(self.record.ends):
            self.record.note_end(end)
        noted = self.record.ends[self._n_ends]
        if (noted.budget, noted.experiments, noted.winner) != (end.budget, end.experiments, end.winner):
            raise _another(f"the end {end}", f"{noted}")
        self._n_ends += 1
        self._ended = self._n_ends == len(self.record.budgets)


def is_fatal(result: Measurement | Failed, on_failure: OnFailure) -> bool:
    """Whether a race stops at what came of an experiment.

    That there was no memory says nothing of a configuration: it stops every race, which can then be resumed.
    """
    if not read_result(result)[2]:
        return False
    error = error_of(result)
    return (on_failure == "stop" and not isinstance(error, Rejected)) or lack_of_memory(error) is not None


def error_of(result: Measurement | Failed) -> Exception | None:
    """What it raised, if it did."""
    return result.error if isinstance(result, Failed) else None


def read_result(result: Measurement | Failed) -> tuple[float | None, str, str]:
    """Score, digest and failure; what is no score is a failure."""
    if isinstance(result, Failed):
        return None, "", result.reason
    if not is_score(result.score):
        return None, "", f"{EXPECTED}, found {result.score}"
    return result.score, result.outcome, ""


def _another(expected: str, found: str) -> RaceError:
    return RaceError(
        f"journal: expected {expected}, found {found}: it is of another race, or of another version of this program"
    )
