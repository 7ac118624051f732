"""The state of a race: its leader, the number of alive configurations, its progress, and its measurements.

Whatever shows or follows a race asks its `RaceView`: the terminal, reports, lists, services. It takes the events of the
race in their order, whether they come from the race itself, from its journal or from a service. A `Record` has one,
which is always as far as the record.

An event takes constant time, so a race does not slow down while it grows; only the end of an iteration copies the
scores of the best configuration. Questions about one configuration take time in proportion to its experiments.
"""

import math
from collections.abc import Callable, Mapping
from statistics import fmean, stdev
from typing import NamedTuple

from mercator_design.race.elimination.race import Experiment
from mercator_design.race.elimination.summary import Elite, Headline, Progress, Scores
from mercator_design.race.session.events import (
    BudgetExtended,
    ConfigurationAdded,
    Event,
    ExperimentDone,
    IterationEnded,
    RaceEnded,
    ScoreRevised,
    TestDone,
)
from mercator_design.race.session.experiments import Experiments, Results
from mercator_design.scores import ANY_SCORE, ScoreRange


class Incumbent(NamedTuple):
    """The best configuration of an iteration, with its scores at that time.

    scores: By instance; all that it has seen by the end of the iteration.
    before: The scores, at that time, of the best of the iteration before; None in the first iteration, or if the best
            is the same.
    """

    ended: IterationEnded
    scores: Mapping[int, float]
    before: Mapping[int, float] | None


class RaceView:
    """The state of a race after its events so far.

    Args:
        budget: That of the beginning of the race.

    Attributes:
        budget: The largest budget so far.
        is_complete: Whether the race has ended under the largest budget.
        winner: The number of the configuration that has won under the last budget under which the race has ended.
        experiments: Those that have run.
        incumbents: The best of each iteration that has ended, with the scores at that time.
        tests: All tests that have run.
        live: The progress that the optimizer knows, if the race runs in this process.
    """

    def __init__(self, budget: int = 0) -> None:
        self.budget = budget
        self.is_complete = False
        self.winner: int | None = None
        self.experiments = Experiments()
        self.incumbents: list[Incumbent] = []
        self.tests: dict[Experiment, TestDone] = {}
        self.live: Callable[[], Progress] | None = None
        self._iteration = 1
        self._new: set[int] = set()  # configurations of this iteration
        self._ran: dict[int, set[int]] = {}  # those that ran on each instance in this iteration

    def note(self, event: Event) -> None:
        """Take an event."""
        match event:
            case ExperimentDone():
                self.experiments[event.experiment] = event
                self._iteration = event.iteration
                self._ran.setdefault(event.instance, set()).add(event.configuration)
            case ConfigurationAdded():
                self._new.add(event.configuration)
            case ScoreRevised():
                self.experiments.revise(event)
            case TestDone():
                self.tests[Experiment(event.configuration, event.instance)] = event
            case IterationEnded():
                best, before = event.elites[0], self._last_best
                scores_before = None if before is None or before == best else self.scores(before)
                self.incumbents.append(Incumbent(event, self.scores(best), scores_before))
                self._new.clear()
                self._ran.clear()
            case BudgetExtended():
                self.budget, self.is_complete = event.budget, False
            case RaceEnded():
                self.winner, self.is_complete = event.winner, event.budget == self.budget

    @property
    def n_experiments(self) -> int:
        """Number of experiments that have run."""
        return len(self.experiments)

    @property
    def iterations(self) -> list[IterationEnded]:
        """The iterations that have ended."""
        return [one.ended for one in self.incumbents]

    @property
    def leader(self) -> int | None:
        """The winner, or the best configuration of the last iteration that has ended."""
        return self.winner if self.is_complete else self._last_best

    @property
    def _last_best(self) -> int | None:
        return self.incumbents[-1].ended.elites[0] if self.incumbents else None

    def scores(self, configuration: int) -> dict[int, float]:
        """The current scores of a configuration, by instance of the race, in the order of its experiments."""
        return self.experiments.scores_of(configuration)

    def results(self) -> Results:
        """The experiments in order of their numbers, with their current scores."""
        return Results(self.experiments, self.experiments.numbers)

    def headline(self, possible: ScoreRange = ANY_SCORE, *, fresh: bool = True) -> Headline | None:
        """The scores of the leader: on fresh instances, if it was tested there; None before there are any.

        Args:
            possible: The range of all scores of the task.
            fresh: Whether scores on fresh instances count; else those of the race.
        """
        if (leader := self.leader) is None:
            return None
        tested = self.test_scores().get(leader, ()) if fresh else ()
        found = tested or tuple(self.scores(leader).values())
        return Headline(Scores(found, possible), is_fresh=bool(tested)) if found else None

    def test_scores(self) -> dict[int, tuple[float, ...]]:
        """The scores of each configuration in the order of the test instances, without failed tests."""
        found: dict[int, list[float]] = {}
        for where in sorted(self.tests):
            if (score := self.tests[where].score) is not None:
                found.setdefault(where.configuration, []).append(score)
        return {configuration: tuple(scores) for configuration, scores in found.items()}

    def progress(self, cost: Callable[[float], float], plan: Progress) -> Progress:
        """The progress of the race.

        Events alone do not say which configurations were eliminated, or how the plan of iterations has changed. So if
        the race runs in another process, the number of alive configurations is that of the last instance on which all
        of them have run, and the plan is that of the beginning of the race.

        Args:
            cost: The cost of a score, which the race minimises.
            plan: The progress of its optimizer before it has begun; without iterations, their number is not known.
        """
        if self.live is not None:
            return self.live()
        return Progress(
            iteration=self._iteration,
            iterations=max(plan.iterations, self._iteration) if plan.iterations else 0,
            alive=self._n_alive(),
            used=self.n_experiments,
            budget=self.budget,
            best=self._best(cost),
        )

    def _n_alive(self) -> int:
        last = self.incumbents[-1].ended if self.incumbents else None
        elites = set[int]() if last is None else {*last.elites}
        if last is not None and not self._ran:
            return last.alive
        if len(self._ran) < 2:
            return len(elites | self._new.union(*self._ran.values()))
        instance = [*self._ran][-2]
        return len(self._ran[instance] | {elite for elite in elites if self._has_score(elite, instance)})

    def _has_score(self, configuration: int, instance: int) -> bool:
        return instance in self.scores(configuration)

    def _best(self, cost: Callable[[float], float]) -> Elite | None:
        """The best of the last iteration; in the first one, the best of those with the most results."""
        numbers = self.experiments.configurations if self._last_best is None else [self._last_best]
        costs = {number: [cost(score) for score in self.scores(number).values()] for number in numbers}
        known = {number: (-len(few), fmean(few)) for number, few in costs.items() if few}
        if not known:
            return None
        best = min(known, key=lambda one: known[one])
        few = costs[best]
        sd = stdev(few) if len(few) > 1 else math.nan
        return Elite(configuration=best, mean=fmean(few), sd=sd, n_results=len(few))
