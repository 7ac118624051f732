"""A race run to its end: what it asks for is looked up in a record of it, or run, noted there, and told.

So a race that was stopped is resumed by running it again with its record: it takes the same way, as it depends on the
costs alone, and only what had not finished is run.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, Literal, NamedTuple, Protocol, TypeVar

from mercator_design.errors import MercatorError, RaceError
from mercator_design.race.executors import Executor, Failed
from mercator_design.race.journal import End, Finished, Record
from mercator_design.race.parameter import Configuration
from mercator_design.race.race import Experiment
from mercator_design.race.summary import Elite

T = TypeVar("T")
OnFailure = Literal["stop", "reject"]


class Measured(NamedTuple):
    """What came of an experiment."""

    score: float
    outcome: str  # digest of what happened in it


class Asking(Protocol):
    """What is run here, such as an `IteratedRace`."""

    configurations: list[Configuration]
    parents: list[int | None]
    budget: int

    @property
    def iteration(self) -> int: ...
    @property
    def best(self) -> Elite: ...
    def ask(self) -> list[Experiment]: ...
    def tell(self, costs: Sequence[float]) -> None: ...
    def extend(self, budget: int) -> None: ...


class Stopped(Exception):  # noqa: N818 - nothing is wrong
    """A race was stopped, as it was asked to; what had finished is noted."""


class ExperimentFailed(RaceError):  # noqa: N818 - as TimeoutExpired, it says what happened
    """An experiment failed, and no failure is accepted."""

    def __init__(self, finished: Finished, error: Exception | None) -> None:
        super().__init__(
            f"experiment {finished.experiment} (configuration {finished.configuration}, instance of seed "
            f"{finished.seed}) failed: {finished.failure}"
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
    stopped: whether to stop; asked before each experiment.
    """

    race: Asking
    record: Record
    executor: Executor
    function: Callable[[T], Measured]
    item: Callable[[Experiment], T]
    seed: Callable[[int], int]
    cost: Callable[[float], float]
    on_failure: OnFailure = "stop"
    watch: Callable[[Sequence[Finished]], None] = lambda finished: None  # noqa: ARG005 - a name for the reader
    stopped: Callable[[], bool] = lambda: False

    def run(self) -> None:
        """Run the race to its end under each of the record's budgets.

        Raises:
            RaceError: The record is of another race or cannot be written, or all configurations were rejected.
            ExperimentFailed: see `on_failure`.
            Stopped: see `stopped`.
        """
        told = 0
        for place, budget in enumerate(self.record.budgets):
            if budget != self.race.budget:
                self.race.extend(budget)
            while batch := self.race.ask():
                finished = self._finished(batch, told)
                told += len(batch)
                self.race.tell([float("inf") if one.score is None else self.cost(one.score) for one in finished])
            self._note_end(place, End(budget=budget, experiments=told, winner=self.race.best.configuration))
        if told != len(self.record.experiments):
            raise _another(f"{told} experiments in all", f"{len(self.record.experiments)}")

    def _finished(self, batch: Sequence[Experiment], first: int) -> list[Finished]:
        """What came of a batch's experiments, the first of them being of that number."""
        self._note_configurations(batch)
        known = self.record.experiments
        numbers = range(first, first + len(batch))
        replayed = []
        for number, (configuration, instance) in zip(numbers, batch, strict=True):
            if (one := known.get(number)) is None:
                continue
            if (one.configuration, one.instance, one.seed) != (configuration, instance, self.seed(instance)):
                raise _another(
                    f"experiment {number} of configuration {configuration} on instance {instance}",
                    f"configuration {one.configuration} on instance {one.instance}",
                )
            replayed.append(one)
        if replayed:
            self.watch(replayed)
        if len(replayed) < len(batch):
            self._run(batch, first, [number for number in numbers if number not in known])
        return [known[number] for number in numbers]

    def _run(self, batch: Sequence[Experiment], first: int, missing: Sequence[int]) -> None:
        failures: list[ExperimentFailed] = []

        def items() -> Iterator[T]:
            for number in missing:
                if failures or self.stopped():
                    return
                yield self.item(batch[number - first])

        count = 0
        for index, result in self.executor.run(self.function, items()):
            count += 1
            number = missing[index]
            configuration, instance = batch[number - first]
            score, outcome, failure = _read(result)
            one = Finished(
                experiment=number,
                iteration=self.race.iteration,
                configuration=configuration,
                instance=instance,
                seed=self.seed(instance),
                score=score,
                outcome=outcome,
                failure=failure,
            )
            if failure and self.on_failure == "stop":  # not noted: when the race is resumed it is tried again
                failures.append(ExperimentFailed(one, result.error if isinstance(result, Failed) else None))
                continue
            self.record.note_experiments([one])
            self.watch([one])
        if failures:
            raise min(failures, key=lambda error: error.finished.experiment)
        if count < len(missing):
            raise Stopped

    def _note_configurations(self, batch: Sequence[Experiment]) -> None:
        for number in dict.fromkeys(experiment.configuration for experiment in batch):
            values, parent = self.race.configurations[number], self.race.parents[number]
            if number not in self.record.configurations:
                event = {"event": "configuration", "configuration": number, "parent": parent, "values": values}
                self.record.note([event])
            elif self.record.configurations[number] != values:
                raise _another(f"configuration {number}: {values}", f"{self.record.configurations[number]}")
            self.record.configurations[number] = values  # once in memory is enough

    def _note_end(self, place: int, end: End) -> None:
        if place < len(self.record.ends):
            noted = self.record.ends[place]
            if (noted.budget, noted.experiments, noted.winner) != (end.budget, end.experiments, end.winner):
                raise _another(f"the end {end}", f"{noted}")
            return
        self.record.note_end(end)


def _read(result: Measured | Failed) -> tuple[float | None, str, str]:
    """Score, digest and failure; what is no finite number is a failure."""
    if isinstance(result, Failed):
        return None, "", result.reason
    if not abs(result.score) < float("inf"):
        return None, "", f"expected a finite score, found {result.score}"
    return result.score, result.outcome, ""


def _another(expected: str, found: str) -> RaceError:
    return RaceError(
        f"journal: expected {expected}, found {found}: it is of another race, or of another version of this program"
    )
