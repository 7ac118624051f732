"""The record of a race, in memory: the events that are known to be consistent; `view` tells how the race stands.

Its *digest* covers the start, configurations and experiments in the order of their numbers, and the ends. So it does
not depend on interruptions, executors or tests.
"""

import hashlib
import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, TypeVar, assert_never

from mercator_design.config.json_data import from_json
from mercator_design.config.schema import Range
from mercator_design.errors import RaceError
from mercator_design.race.elimination.race import Experiment
from mercator_design.race.session.events import (
    BudgetExtended,
    ConfigurationAdded,
    Event,
    ExperimentDone,
    IterationEnded,
    Measurement,
    RaceEnded,
    ScoreRevised,
    SessionStarted,
    SessionStopped,
    SpeculativeDone,
    TestDone,
)
from mercator_design.race.session.experiments import MAX_NUMBER, Experiments
from mercator_design.race.session.view import RaceView
from mercator_design.race.space.parameter import Configuration
from mercator_design.scores import EXPECTED, is_score

K = TypeVar("K")
V = TypeVar("V")

FORMAT = 2


class OtherVersion(RaceError):  # noqa: N818 - nothing is wrong with it
    """A journal or a run folder was written by another version of this program, in another format."""


@dataclass(slots=True)
class Record:
    """The record of a race, in memory."""

    start: dict[str, Any] = field(default_factory=dict)
    configurations: dict[int, Configuration] = field(default_factory=dict)
    parents: dict[int, int | None] = field(default_factory=dict)
    speculative: dict[Experiment, Measurement] = field(default_factory=dict)
    revised: dict[int, dict[Experiment, ScoreRevised]] = field(default_factory=dict)  # by number of an experiment
    tests: dict[Experiment, TestDone] = field(default_factory=dict)
    iterations: dict[int, IterationEnded] = field(default_factory=dict)
    budgets: list[int] = field(default_factory=list)  # in increasing order
    ends: list[RaceEnded] = field(default_factory=list)
    sessions: list[SessionStarted | SessionStopped] = field(default_factory=list)
    view: RaceView = field(default_factory=RaceView, repr=False, compare=False)
    """The state of the race after the events so far."""

    @property
    def record(self) -> "Record":
        """This record, as `Journal.record`; it is only in memory."""
        return self

    @property
    def experiments(self) -> Experiments:
        """The experiments that have run, as they ended."""
        return self.view.experiments

    @property
    def budget(self) -> int:
        """The largest budget so far."""
        return self.budgets[-1]

    @property
    def is_complete(self) -> bool:
        """Whether the race has ended under the largest budget."""
        return len(self.ends) == len(self.budgets)

    def scores_of(self, batch: Sequence[Experiment], first: int) -> dict[Experiment, float | None]:
        """The scores of those experiments of a batch that have run; the first of them has this number."""
        known = self.experiments
        return {one: known.score(number) for number, one in enumerate(batch, start=first) if number in known}

    def new_configurations(
        self, numbers: Iterable[int], values: Sequence[Configuration], parents: Sequence[int | None]
    ) -> list[ConfigurationAdded]:
        """The configurations that are not in the record yet.

        Args:
            numbers: Numbers of configurations.
            values: Values of all configurations.
            parents: Parents of all configurations.

        Raises:
            RaceError: The record has another configuration of the same number.
        """
        new = []
        for number in numbers:
            if number not in self.configurations:
                new.append(ConfigurationAdded(configuration=number, parent=parents[number], values=values[number]))
            elif (self.configurations[number], self.parents[number]) != (values[number], parents[number]):
                found = f"{self.configurations[number]} from {self.parents[number]}"
                raise another_race(f"configuration {number}: {values[number]} from {parents[number]}", found)
        return new

    def digest(self, n_ends: int | None = None) -> str:
        """The digest of the start and all events up to one of the ends (by default the last), as hexadecimal text."""
        ends = self.ends[:n_ends]
        n_counted = ends[-1].experiments if ends else len(self.experiments)
        counted = [number for number in self.experiments.numbers if number < n_counted]
        digest = hashlib.sha256(_text(self.start).encode())
        for number in sorted({self.experiments[number].configuration for number in counted}):
            digest.update(f"\n{number} {self.parents[number]} {_text(self.configurations[number])}".encode())
        for number in counted:
            e = self.experiments[number]
            words = f"\n{number} {e.iteration} {e.configuration} {e.instance} {e.seed} {e.score!r} {e.outcome}"
            digest.update(f"{words} {e.scores!r}".encode() if e.scores else words.encode())
        for number in sorted(number for number in self.revised if number < n_counted):
            for where, new in sorted(self.revised[number].items()):
                digest.update(f"\nrevised {number} {where.configuration} {where.instance} {new.score!r}".encode())
        for end in ends:
            digest.update(f"\nend {end.budget} {end.experiments} {end.winner}".encode())
        return digest.hexdigest()

    def begin(self, start: Mapping[str, Any]) -> None:
        """Set the start of the race.

        Raises:
            OtherVersion: The start has another format.
            RaceError: There is a start already, or it is not valid.
        """
        if self.start:
            raise RaceError("expected one start, found a second start")
        start = {"format": FORMAT, **start}
        if (found := from_json(start["format"], int, error=RaceError, path="start.format")) != FORMAT:
            raise OtherVersion(
                f"start.format: expected {FORMAT}, found {found}: use the version of this program that wrote it"
            )
        budget = from_json(start.get("budget"), Annotated[int, Range(1)], error=RaceError, path="start.budget")
        self.start = from_json(start, Mapping[str, object], error=RaceError, path="start")
        self.budgets = [budget]
        self.view = RaceView(budget)

    def note(self, *events: Event) -> None:
        """Add events.

        Raises:
            RaceError: An event is not consistent with those before.
        """
        if not self.start:
            raise RaceError("expected the start of a race first, found another event")
        for event in events:
            self._take(event)
            self.view.note(event)

    def with_digest(self, end: RaceEnded) -> RaceEnded:
        """An end of the race with the digest up to there."""
        self.ends.append(end)
        digest = self.digest()
        self.ends.pop()
        return replace(end, digest=digest)

    def _take(self, event: Event) -> None:
        match event:
            case ExperimentDone():
                self._take_experiment(event)
            case ConfigurationAdded():
                self._take_configuration(event)
            case SpeculativeDone():
                self._check_known(event.configuration, "ahead")
                where = Experiment(event.configuration, event.instance)
                self._enter(
                    self.speculative,
                    where,
                    Measurement(event.score, event.outcome, event.scores),
                    f"ahead: {_named(where)}",
                )
            case ScoreRevised():
                self._check_result(event)
                where = Experiment(event.configuration, event.instance)
                revised = self.revised.setdefault(event.experiment, {})
                self._enter(revised, where, event, f"revised before experiment {event.experiment}: {_named(where)}")
            case TestDone():
                self._check_result(event)
                if not self.ends:
                    raise RaceError("expected no test before the race has ended, found one")
                where = Experiment(event.configuration, event.instance)
                self._enter(self.tests, where, event, f"test: {_named(where)}")
            case IterationEnded():
                self._take_iteration(event)
            case BudgetExtended():
                if event.budget <= self.budget:
                    raise RaceError(f"expected a budget larger than {self.budget}, found {event.budget}")
                self.budgets.append(event.budget)
            case RaceEnded():
                self._take_end(event)
            case SessionStarted() | SessionStopped():
                self.sessions.append(event)
            case _:
                assert_never(event)

    @staticmethod
    def _enter(known: dict[K, V], key: K, value: V, what: str) -> None:
        """Add an entry that may exist only once.

        Raises:
            RaceError: It exists.
        """
        if key in known:
            raise RaceError(f"{what} is there twice")
        known[key] = value

    def _take_experiment(self, event: ExperimentDone) -> None:
        self._check_result(event)
        iteration = len(self.iterations) + 1
        if event.iteration != iteration:
            raise RaceError(
                f"experiment.iteration: expected {iteration}, as {iteration - 1} have ended before, found "
                f"{event.iteration}"
            )
        if (number := max(event.experiment, event.instance)) > MAX_NUMBER:
            raise RaceError(f"experiment: expected numbers of at most {MAX_NUMBER}, found {number}")
        if event.experiment in self.experiments:
            raise RaceError(f"experiment {event.experiment} is there twice")

    def _take_configuration(self, event: ConfigurationAdded) -> None:
        number = event.configuration
        if event.parent is not None:
            self._check_known(event.parent, f"configuration {number}: its parent")
        if number > len(self.configurations):
            raise RaceError(
                f"configuration: expected number {len(self.configurations)}, as so many are before it, found {number}"
            )
        # The keys are the same in all configurations: keep one copy in memory.
        values = {sys.intern(name): value for name, value in event.values.items()}
        self._enter(self.configurations, number, values, f"configuration {number}")
        self._enter(self.parents, number, event.parent, f"configuration {number}")

    def _take_iteration(self, event: IterationEnded) -> None:
        self._check_scored("an elite", *event.elites)
        number = len(self.iterations) + 1
        if event.iteration != number:
            raise RaceError(
                f"iteration: expected number {number}, as {number - 1} have ended before, found {event.iteration}"
            )
        if event.used != (used := self._count() - self._n_concluded):
            raise RaceError(f"iteration.used: expected {used}, as so many experiments are in it, found {event.used}")
        self._enter(self.iterations, event.iteration, event, f"iteration {event.iteration}")

    @property
    def _n_concluded(self) -> int:
        """Number of experiments of the iterations that have ended."""
        return sum(iteration.used for iteration in self.iterations.values())

    def _count(self) -> int:
        """Number of experiments.

        Raises:
            RaceError: Their numbers have gaps, which is allowed only during an iteration.
        """
        n = len(self.experiments)
        if self.experiments.has_gaps:
            raise RaceError(
                f"expected {n} experiments to have the numbers 0 to {n - 1} when an iteration or the race ends, found "
                f"number {self.experiments.numbers[-1]}"
            )
        return n

    def _take_end(self, event: RaceEnded) -> None:
        if self.is_complete:
            raise RaceError("expected no further end of the race, as there is no further budget, found one")
        if event.budget != self.budgets[len(self.ends)]:
            raise RaceError(f"end.budget: expected {self.budgets[len(self.ends)]}, found {event.budget}")
        if event.experiments != (n := self._count()):
            raise RaceError(f"end.experiments: expected {n}, as there are before it, found {event.experiments}")
        if n != self._n_concluded:
            raise RaceError(
                f"end: expected all {n} experiments to be of iterations that have ended, found {self._n_concluded}"
            )
        self._check_scored("the winner", event.winner)
        self.ends.append(event)

    def _check_result(self, event: ExperimentDone | ScoreRevised | TestDone) -> None:
        self._check_known(event.configuration, "experiment")
        if (event.score is None) != bool(event.failure):
            raise RaceError("experiment: expected either a score or why it failed, found both or neither")
        scores = () if isinstance(event, ScoreRevised) else event.scores
        for score in (event.score, *scores):
            if score is not None and not is_score(score):
                raise RaceError(f"experiment.score: {EXPECTED}, found {score}")

    def _check_known(self, configuration: int, what: str) -> None:
        if configuration not in self.configurations:
            raise RaceError(f"{what}: expected a configuration that is in the journal before, found {configuration}")

    def _check_scored(self, what: str, *configurations: int) -> None:
        known = self.experiments
        for number in configurations:
            if all(known.score(place) is None for place in known.numbers_of(number)):
                raise RaceError(f"{what}: expected a configuration that has a score, found {number}")


def _named(where: Experiment) -> str:
    return f"configuration {where.configuration} on instance {where.instance}"


def _text(value: Mapping[str, Any]) -> str:
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)


def another_race(expected: str, found: str) -> RaceError:
    """The error if a race differs from its record."""
    return RaceError(
        f"journal: expected {expected}, found {found}: it is of another race, or of another version of this program"
    )
