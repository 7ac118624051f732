"""What can be raced, whatever it is: a race over its configurations, and what one of its experiments is.

Of a mission it is a `design.Designer`, of any program a `race.tuner.Tuner`. All else is the same for all of them: how a
race is run (here), and the folder that it leaves behind (runs/folder.py).
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar, Generic, Self, TypeVar

from mercator_design.config.schema import Kind
from mercator_design.race.methods.optimizer import Optimizer
from mercator_design.race.racing.race import Experiment
from mercator_design.race.racing.summary import Scores
from mercator_design.race.running.evaluation import Testing, run_tests
from mercator_design.race.running.events import ExperimentDone, IterationEnded, Measurement, TestDone
from mercator_design.race.running.executors import Executor
from mercator_design.race.running.record import Record
from mercator_design.race.running.runner import OnFailure, Runner
from mercator_design.race.space.parameter import Configuration
from mercator_design.seeds import instance_seed

T = TypeVar("T")
Start = Mapping[str, Any]
"""What makes a race, and nothing else: its task ("mission", ...), name, budget, seed, and what else the task has."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RaceResult:
    """What a race came to."""

    configuration: int  # the winner's number
    scores: Scores  # of the winner, on the instances of the race
    tests: dict[int, Scores]  # of the configurations that were tested, the winner first
    finished: tuple[ExperimentDone, ...]  # all experiments, in order of their numbers


class Task(ABC, Generic[T]):
    """What is raced; T is what its experiments are given.

    Attributes:
        name: For people, and for the folder of its race.
        method: What decides which configurations run on which instances.
        race: Over its configurations; has not begun.
        maximise: Whether more is better.
        function: Runs one experiment, in this process or in another.
        evaluate: If there is one, `function` only runs an experiment, and this gives what came of it among
            configurations, which it may compare.
        speculates: Whether idle workers run experiments that the race has not asked for, and may never ask for.
    """

    WINNER: ClassVar[str]
    """The file that a winner is written to."""
    START: ClassVar[Mapping[str, Kind]]
    """What a start has of its own that `restore`, `about` and `columns` read."""

    name: str
    method: str
    race: Optimizer
    maximise: bool = False
    function: Callable[[T], Measurement]
    evaluate: Callable[[T, Sequence[int]], Measurement] | None = None
    speculates: bool = True

    @classmethod
    @abstractmethod
    def restore(cls, folder: Path, start: Start) -> Self:
        """The task of a start, from the files that it has in a folder.

        Raises:
            MercatorError: They are not what they were.
        """

    @abstractmethod
    def start(self) -> dict[str, Any]:
        """What makes this race: races of equal starts are equal."""

    @abstractmethod
    def files(self) -> dict[str, bytes]:
        """What `restore` needs, by path in a folder."""

    @abstractmethod
    def item(self, experiment: Experiment, configuration: Configuration, *, test: bool = False) -> T:
        """What `function` is given for an experiment, whose configuration this is; of a test, its test instance."""

    @abstractmethod
    def test_seed(self, instance: int) -> int:
        """Of a test instance."""

    @abstractmethod
    def winner_text(self, result: RaceResult, header: Mapping[str, str]) -> str:
        """The file of the winner."""

    @abstractmethod
    def is_winner(self, file: Path, configuration: Configuration) -> bool:
        """Whether the file of a winner has this configuration.

        Raises:
            MercatorError: It cannot be read.
        """

    @abstractmethod
    def command_of_failed(self, one: ExperimentDone | TestDone, folder: Path, header: Mapping[str, str]) -> str:
        """The command that runs an experiment that failed by itself; what it needs is written to a folder.

        Raises:
            OSError: It cannot be written.
        """

    def header(self) -> dict[str, str]:
        """What the file of a winner says of where it comes from, beside what all say."""
        return {}

    def runs(self, experiments: int, tests: int) -> list[str]:  # noqa: ARG002
        """What a summary tells of this process's runs, for so many experiments and tests; headed as in `about`."""
        return []

    def stop(self) -> None:
        """End what is under way, if that is worth more than waiting for it."""

    def prepare(self, announce: Callable[[str], None]) -> None:
        """Get ready to run experiments; `announce` is told if that takes a while."""

    @staticmethod
    @abstractmethod
    def command(start: Start, folder: Path) -> str:
        """The command that begins the race of a start anew, from the files that it has in a folder."""

    @staticmethod
    @abstractmethod
    def about(start: Start) -> list[str]:
        """What people should know of a start, a line each, with its heading in 11 characters."""

    @staticmethod
    @abstractmethod
    def columns(start: Start, configurations: Sequence[Configuration]) -> dict[str, list[Any]]:
        """Configurations as columns of a table."""

    def cost(self, score: float) -> float:
        """What a race minimises."""
        return score

    def score(self, cost: float) -> float:
        """The score that a cost stands for."""
        return cost

    def seed(self, instance: int) -> int:
        """Of an instance of the race."""
        return _seed(self.race.seed, instance)

    @property
    def _evaluation(self) -> Callable[[Experiment, Sequence[int]], Measurement] | None:
        evaluate = self.evaluate
        if evaluate is None:
            return None
        return lambda one, alive: evaluate(self.item(one, self.race.configurations[one.configuration]), alive)

    def run(
        self,
        executor: Executor,
        record: Record | None = None,
        *,
        on_failure: OnFailure = "stop",
        watch: Callable[[Sequence[ExperimentDone]], None] = lambda finished: None,  # noqa: ARG005 - a name for the reader
        watch_iterations: Callable[[IterationEnded], None] = lambda iteration: None,  # noqa: ARG005
        testing: Testing | None = None,
        watch_tests: Callable[[int, int], None] = lambda done, of: None,  # noqa: ARG005
        stopped: Callable[[], bool] = lambda: False,
    ) -> RaceResult:
        """Run the race to its end, and then the tests.

        Args:
            executor: Runs its experiments; what comes of them does not depend on it.
            record: Of this race so far; what happens is noted in it.
            on_failure: Whether an experiment that fails stops the race, or rejects its configuration.
            watch: Called with the experiments that have finished since.
            watch_iterations: Called with an iteration that has ended.
            testing: What to test when the race has ended.
            watch_tests: Called with the number of tests done, and of all.
            stopped: Asked before each experiment whether to stop.

        Raises:
            ExperimentFailed: see `on_failure`.
            Stopped: see `stopped`; what was under way has been waited for and noted.
            RaceError: if the record is of another race.
        """
        if record is None:
            record = Record()
            record.begin(self.start())
        race = self.race
        Runner(
            race=race,
            record=record,
            executor=executor,
            function=self.function,
            item=lambda experiment: self.item(experiment, race.configurations[experiment.configuration]),
            seed=self.seed,
            cost=self.cost,
            on_failure=on_failure,
            watch=watch,
            watch_iterations=watch_iterations,
            stopped=stopped,
            evaluate=self._evaluation,
            speculate=self.speculates,
        ).run()
        tests: dict[int, Scores] = {}
        if testing is not None:
            run_tests(
                testing.experiments(race),
                record=record,
                executor=executor,
                function=self.function,
                item=lambda test: self.item(test, race.configurations[test.configuration], test=True),
                seed=self.test_seed,
                evaluate=self.evaluate,
                on_failure=on_failure,
                watch=watch_tests,
                stopped=stopped,
            )
            known = record.test_scores()
            tests = {number: Scores(known[number]) for number in testing.configurations(race) if number in known}
        best = race.best.configuration
        finished = tuple(record.results())
        scores = tuple(f.score for f in finished if f.configuration == best and f.score is not None)
        return RaceResult(configuration=best, scores=Scores(scores), tests=tests, finished=finished)


@lru_cache(maxsize=1 << 16)
def _seed(seed: int, instance: int) -> int:
    return instance_seed(seed, "race", instance)
