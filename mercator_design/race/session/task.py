"""Problems and tasks: the subject of a race.

A `Designer` (designer.py) is the task of a mission, a `Tuner` that of any program. The runner (runner.py) and the run
folder (results/folder.py) are the same for all tasks.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar, Generic, Self, TypeVar

from mercator_design.config.schema import Kind
from mercator_design.errors import RaceError
from mercator_design.race.elimination.race import Cost, Experiment
from mercator_design.race.elimination.summary import Headline, Scores
from mercator_design.race.methods.optimizer import Optimizer
from mercator_design.race.session.events import ExperimentDone, Measurement, TestDone
from mercator_design.race.space.parameter import Configuration
from mercator_design.scores import ANY_SCORE, ScoreRange
from mercator_design.seeds import instance_seed

T = TypeVar("T")
_seed = lru_cache(maxsize=1 << 16)(instance_seed)
Start = Mapping[str, Any]
"""The start of a race, which determines it: task ("mission", ...), name, budget, seed, and keys of the task."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RaceResult:
    """The result of a race."""

    configuration: int  # the winner's number
    scores: Scores  # of the winner, on the instances of the race
    tests: dict[int, Scores]  # of the configurations that were tested, the winner first
    finished: Sequence[ExperimentDone]  # all experiments, in order of their numbers

    def __repr__(self) -> str:
        return f"<RaceResult: configuration {self.configuration}, {self.summary}>"

    @property
    def headline(self) -> Headline:
        """The score of the winner: on fresh instances, if it was tested."""
        tested = self.tests.get(self.configuration)
        return Headline(self.scores, is_fresh=False) if tested is None else Headline(tested, is_fresh=True)

    @property
    def summary(self) -> str:
        """The winner's score with its interval, and where it was measured."""
        return f"{self.headline.scores.summary.rpartition(', ')[0]} {self.headline.where}"


class Problem(ABC, Generic[T]):
    """A problem to race on; its experiments take an item of type T.

    Attributes:
        optimizer: Asks for experiments and takes their costs; not begun.
        function: Runs one experiment, in this process or in another. If it also has the method `in_steps`
            (`executors.threads.Stepped`), threads run short experiments in groups by that.
        evaluate: None, or computes the cost of an experiment that `function` has run; it may compare the given
            configurations.
        speculates: Whether idle workers run speculative experiments.
        predicts: Whether they may also run those of configurations that have no numbers yet, by predicted numbers.
        possible_scores: The range of its scores.
        n_objectives: By how many costs of an experiment it ranks configurations.
    """

    optimizer: Optimizer
    function: Callable[[T], Measurement]
    evaluate: Callable[[T, Sequence[int]], Measurement] | None = None
    speculates: bool = True
    predicts: bool = True
    possible_scores: ScoreRange = ANY_SCORE
    n_objectives: int = 1

    @abstractmethod
    def item(self, experiment: Experiment, configuration: Configuration, *, test: bool = False) -> T:
        """The item of an experiment, for `function`; for a test, that of its test instance.

        A configuration that is given with a predicted number may not get it: then another one is given with it.
        """

    def start(self) -> dict[str, Any]:
        """The start of this race; races with equal starts are equal."""
        return {"budget": self.optimizer.budget, "seed": self.optimizer.seed}

    def cost(self, score: float) -> float:
        """The cost of a score: what a race minimises."""
        return score

    def costs(self, scores: Sequence[float]) -> tuple[float, ...]:
        """The costs of the scores by each of several objectives."""
        return tuple(scores)

    def cost_of(self, one: ExperimentDone) -> Cost:
        """The cost of an experiment, infinite if it failed; of several objectives a cost by each.

        Raises:
            RaceError: It has scores by other objectives.
        """
        if one.score is None:
            return float("inf")
        if self.n_objectives == 1:
            return self.cost(one.score)
        if len(one.scores) != self.n_objectives:
            expected = f"expected {self.n_objectives} scores of experiment {one.experiment}"
            raise RaceError(f"journal: {expected}, found {len(one.scores)}: it is of another race")
        return self.costs(one.scores)

    def score(self, cost: float) -> float:
        """The score of a cost."""
        return cost

    def seed(self, instance: int) -> int:
        """The seed of an instance."""
        return _seed(self.optimizer.seed, "race", instance)

    def test_seed(self, instance: int) -> int:
        """The seed of a test instance."""
        return _seed(self.optimizer.seed, "test", instance)


class Task(Problem[T]):
    """A problem whose race has a run folder and reports.

    Attributes:
        name: Its name in reports and in the name of the run folder.
        method: The method of the race, see `METHODS`.
        maximise: Whether higher scores are better.
    """

    WINNER: ClassVar[str]
    """Name of the file of the winner."""
    START: ClassVar[Mapping[str, Kind]]
    """The keys of a start that `restore`, `about` and `columns` of this task read."""

    name: str
    method: str
    maximise: bool = False

    @classmethod
    @abstractmethod
    def restore(cls, folder: Path, start: Start) -> Self:
        """Restore the task of a start from its files in a folder.

        Raises:
            MercatorError: A file has changed.
        """

    def start(self) -> dict[str, Any]:
        """As `Problem.start`, with the method and its options; each task adds keys of its own."""
        options = asdict(self.optimizer.options)
        if not options.get("stop_when_stagnant", True):  # as in races from before there was this option
            del options["stop_when_stagnant"]
        return {**super().start(), "method": self.method, "options": options}

    @abstractmethod
    def files(self) -> dict[str, bytes]:
        """The files that `restore` needs, by path in the folder."""

    @abstractmethod
    def winner_text(self, result: RaceResult, header: Mapping[str, str]) -> str:
        """The contents of the winner's file."""

    @abstractmethod
    def is_winner(self, file: Path, configuration: Configuration) -> bool:
        """Whether a winner's file has this configuration.

        Raises:
            MercatorError: The file cannot be read.
        """

    @abstractmethod
    def command_of_failed(self, one: ExperimentDone | TestDone, folder: Path, header: Mapping[str, str]) -> str:
        """The command that runs a failed experiment alone; writes the files that it needs to a folder.

        Raises:
            OSError: A file cannot be written.
        """

    def need_one_cost(self, what: str) -> None:
        """Refuse what needs one cost of an experiment.

        Raises:
            RaceError: The race is by several objectives.
        """
        if self.n_objectives > 1:
            raise RaceError(f"{what} needs one cost, and {self.name} has several objectives: give them weights")

    def header(self) -> dict[str, str]:
        """The entries of this task in the header of the winner's file."""
        return {}

    def runs(self, experiments: int, tests: int) -> list[str]:  # noqa: ARG002
        """Lines of the summary on the runs of this process, headed as in `about`."""
        return []

    def stop(self) -> None:
        """Stop running experiments, if waiting for them would take long."""

    def prepare(self, announce: Callable[[str], None]) -> None:
        """Prepare to run experiments; calls `announce` with a message if that takes long."""

    @staticmethod
    @abstractmethod
    def command(start: Start, folder: Path) -> str:
        """The command that starts the race of a start again, from its files in a folder."""

    @staticmethod
    @abstractmethod
    def about(start: Start) -> list[str]:
        """Lines on a start for reports, each with a heading of 11 characters."""

    @staticmethod
    @abstractmethod
    def columns(start: Start, configurations: Sequence[Configuration]) -> dict[str, list[Any]]:
        """Configurations as columns of a table."""

    @staticmethod
    def recall(folder: Path, start: Start) -> None:
        """Load what `check` and `columns` need of the files in a folder, without running any.

        Raises:
            MercatorError: It cannot be loaded.
        """

    @staticmethod
    def check(start: Start, configurations: Sequence[Configuration]) -> None:
        """Make sure that configurations that were read are of the space that a start names.

        Raises:
            RaceError: with the parameter of the first that is not.
        """
