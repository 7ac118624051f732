"""What can be raced, whatever it is: a race over its configurations, and what one of its experiments is.

Of a mission it is a `designer.Designer`, of any program a `Tuner`. All else is the same for all of them: how a race is
run (runner.py), and the folder that it leaves behind (runs/folder.py).
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar, Generic, Self, TypeVar

from mercator_design.config.schema import Kind
from mercator_design.race.methods.optimizer import Optimizer
from mercator_design.race.racing.race import Experiment
from mercator_design.race.racing.summary import Scores
from mercator_design.race.running.events import ExperimentDone, Measurement, TestDone
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
    finished: tuple[ExperimentDone, ...] = field(repr=False)  # all experiments, in order of their numbers


class Problem(ABC, Generic[T]):
    """What a race needs to know of what is raced; T is what its experiments are given.

    Attributes:
        race: Over its configurations; has not begun.
        function: Runs one experiment, in this process or in another.
        evaluate: If there is one, `function` only runs an experiment, and this gives what came of it among
            configurations, which it may compare.
        speculates: Whether idle workers run experiments that the race has not asked for, and may never ask for.
    """

    race: Optimizer
    function: Callable[[T], Measurement]
    evaluate: Callable[[T, Sequence[int]], Measurement] | None = None
    speculates: bool = True

    @abstractmethod
    def item(self, experiment: Experiment, configuration: Configuration, *, test: bool = False) -> T:
        """What `function` is given for an experiment, whose configuration this is; of a test, its test instance."""

    def start(self) -> dict[str, Any]:
        """What makes this race: races of equal starts are equal."""
        return {"budget": self.race.budget, "seed": self.race.seed}

    def cost(self, score: float) -> float:
        """What a race minimises."""
        return score

    def score(self, cost: float) -> float:
        """The score that a cost stands for."""
        return cost

    def seed(self, instance: int) -> int:
        """Of an instance of the race."""
        return _seed(self.race.seed, "race", instance)

    def test_seed(self, instance: int) -> int:
        """Of a test instance."""
        return _seed(self.race.seed, "test", instance)


class Task(Problem[T]):
    """A problem whose race is kept in a folder and told of to people.

    Attributes:
        name: For people, and for the folder of its race.
        method: What decides which configurations run on which instances.
        maximise: Whether more is better.
    """

    WINNER: ClassVar[str]
    """The file that a winner is written to."""
    START: ClassVar[Mapping[str, Kind]]
    """What a start has of its own that `restore`, `about` and `columns` read."""

    name: str
    method: str
    maximise: bool = False

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

    @staticmethod
    def check(start: Start, configurations: Sequence[Configuration]) -> None:
        """Make sure that configurations that were read are of the space that a start names.

        Raises:
            RaceError: with the parameter of the first that is not.
        """


@lru_cache(maxsize=1 << 16)
def _seed(seed: int, purpose: str, instance: int) -> int:
    return instance_seed(seed, purpose, instance)
