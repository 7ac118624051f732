"""Where a race stands, from its events alone: for a program that reads the journal of a race that another one runs."""

import math
from collections.abc import Callable
from statistics import fmean, stdev

from mercator_design.race.elimination.summary import Elite, Progress
from mercator_design.race.session.events import ConfigurationAdded, Event, ExperimentDone, IterationEnded, ScoreRevised


class Standing:
    """The progress of a race after its events so far.

    The number of alive configurations is that of the last instance on which all of them have run, because a journal
    does not say who was eliminated. The plan of iterations is that of the beginning of the race.

    Args:
        cost: The cost of a score, which the race minimises.
        plan: The progress of its optimizer before it has begun; without iterations, their number is not known.
    """

    def __init__(self, cost: Callable[[float], float], plan: Progress) -> None:
        self._cost, self._plan = cost, plan
        self._costs: dict[int, dict[int, float]] = {}  # by configuration and instance
        self._ended: IterationEnded | None = None
        self._iteration = 1
        self._n_run = 0
        self._new: set[int] = set()  # configurations of this iteration
        self._ran: dict[int, set[int]] = {}  # those that ran on each instance in this iteration

    def note(self, event: Event) -> None:
        """Take an event."""
        match event:
            case ConfigurationAdded():
                self._new.add(event.configuration)
            case ExperimentDone():
                self._n_run += 1
                self._iteration = event.iteration
                self._ran.setdefault(event.instance, set()).add(event.configuration)
                self._score(event)
            case ScoreRevised():
                self._score(event)
            case IterationEnded():
                self._ended = event
                self._new.clear()
                self._ran.clear()

    @property
    def progress(self) -> Progress:
        """The progress; the budget is that of the beginning of the race."""
        planned = self._plan.iterations
        return Progress(
            iteration=self._iteration,
            iterations=max(planned, self._iteration) if planned else 0,
            alive=self._n_alive(),
            used=self._n_run,
            budget=self._plan.budget,
            best=self._best(),
        )

    def _score(self, one: ExperimentDone | ScoreRevised) -> None:
        costs = self._costs.setdefault(one.configuration, {})
        if one.score is None:
            costs.pop(one.instance, None)
        else:
            costs[one.instance] = self._cost(one.score)

    def _n_alive(self) -> int:
        elites = set() if self._ended is None else {*self._ended.elites}
        if self._ended is not None and not self._ran:
            return self._ended.alive
        if len(self._ran) < 2:
            return len(elites | self._new.union(*self._ran.values()))
        instance = [*self._ran][-2]
        return len(self._ran[instance] | {elite for elite in elites if instance in self._costs[elite]})

    def _best(self) -> Elite | None:
        """The best of the last iteration; in the first one, the best of those with the most results."""
        if self._ended is not None:
            number = self._ended.elites[0]
        elif known := {number: (-len(costs), fmean(costs.values())) for number, costs in self._costs.items() if costs}:
            number = min(known, key=lambda one: known[one])
        else:
            return None
        costs = list(self._costs[number].values())
        sd = stdev(costs) if len(costs) > 1 else math.nan
        return Elite(configuration=number, mean=fmean(costs), sd=sd, n_results=len(costs)) if costs else None
