"""The pieces put together: design control software for a mission, and measure it.

`design` lets a race propose configurations and simulates them; `evaluate` runs one PFSM on fresh instances. Both take
their randomness from one master seed: the same mission, budget and seed give the same result, whatever the number of
jobs.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mercator_design.fsm.behaviours import BEHAVIOURS
from mercator_design.fsm.grammar import parameters_text, to_pfsm
from mercator_design.fsm.modules import numbered
from mercator_design.fsm.pfsm import Pfsm
from mercator_design.race import Experiment, IteratedRace, Space
from mercator_design.race.executors import ThreadExecutor
from mercator_design.seeds import instance_seeds
from mercator_design.sim.simulate import Simulator

CONFIDENCE = 0.95
"""Of the intervals reported around means."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finished:
    """An experiment of a race that has run."""

    experiment: int  # its number, from 0
    iteration: int
    configuration: int
    instance: int
    seed: int
    score: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Design:
    """What a race came to."""

    winner: Pfsm
    configuration: int  # the winner's number
    scores: tuple[float, ...]  # of the winner, on the instances of the race
    race: IteratedRace
    finished: tuple[Finished, ...]


def new_race(simulator: Simulator, *, budget: int, seed: int, flavour: str = "watermelon") -> IteratedRace:
    """A race over all PFSMs of a flavour, ready to run.

    Raises:
        FsmError: if the robot lacks a sensor that a module of the flavour needs.
        RaceError: if the budget is too small.
    """
    for module in numbered(BEHAVIOURS, flavour).values():
        simulator.check_needs(f"{flavour}'s {module.name}", module.needs)
    return IteratedRace(Space.from_text(parameters_text(flavour), "grammar"), budget=budget, seed=seed)


def design(
    simulator: Simulator,
    race: IteratedRace,
    *,
    jobs: int,
    flavour: str = "watermelon",
    watch: Callable[[Sequence[Finished]], None] = lambda finished: None,  # noqa: ARG005 - a name for the reader
) -> Design:
    """Design control software for a mission: run a race to its end.

    Args:
        simulator: Of the mission.
        race: A new race.
        jobs: Experiments run at once.
        flavour: Whose modules the race is over.
        watch: Called after each batch with the experiments that it finished.
    """
    mission = simulator.mission
    seeds = instance_seeds(race.seed, "race instances", race.budget)
    pfsms: dict[int, Pfsm] = {}
    finished: list[Finished] = []

    def cost(experiment: Experiment) -> float:
        pfsm = pfsms[experiment.configuration]
        return mission.cost(simulator.run(pfsm, seeds[experiment.instance]).score)

    with ThreadExecutor(cost, jobs) as executor:
        while batch := race.ask():
            for experiment in batch:
                if experiment.configuration not in pfsms:
                    pfsms[experiment.configuration] = to_pfsm(race.configurations[experiment.configuration], flavour)
            costs = executor.run(batch)
            iteration = race.iteration
            race.tell(costs)
            batch_finished = [
                Finished(
                    experiment=len(finished) + k,
                    iteration=iteration,
                    configuration=experiment.configuration,
                    instance=experiment.instance,
                    seed=seeds[experiment.instance],
                    score=mission.cost(cost),  # the sign, once more, is the score's own
                )
                for k, (experiment, cost) in enumerate(zip(batch, costs, strict=True))
            ]
            finished += batch_finished
            watch(batch_finished)
    best = race.best.configuration
    return Design(
        winner=pfsms[best],
        configuration=best,
        scores=tuple(f.score for f in finished if f.configuration == best),
        race=race,
        finished=tuple(finished),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Evaluation:
    """Scores of a PFSM on fresh instances."""

    scores: tuple[float, ...]
    seeds: tuple[int, ...]

    @property
    def mean(self) -> float:
        """Arithmetic mean."""
        return float(np.mean(self.scores))

    @property
    def standard_deviation(self) -> float | None:
        """Of the sample, with n - 1; None for a single score."""
        return float(np.std(self.scores, ddof=1)) if len(self.scores) > 1 else None

    @property
    def quartiles(self) -> tuple[float, float, float]:
        """Lower quartile, median, upper quartile."""
        low, middle, high = np.percentile(self.scores, [25, 50, 75])
        return float(low), float(middle), float(high)

    @property
    def confidence_interval(self) -> tuple[float, float] | None:
        """Of the mean, at 95 %, by Student's t; None for a single score."""
        from scipy.special import stdtrit

        if self.standard_deviation is None:
            return None
        n = len(self.scores)
        half = float(stdtrit(n - 1, 0.5 + CONFIDENCE / 2)) * self.standard_deviation / math.sqrt(n)
        return self.mean - half, self.mean + half


def evaluate(
    simulator: Simulator,
    pfsm: Pfsm,
    *,
    runs: int,
    seed: int,
    jobs: int,
    watch: Callable[[int], None] = lambda done: None,  # noqa: ARG005 - a name for the reader
) -> Evaluation:
    """Run a PFSM on `runs` instances that no race has seen.

    Args:
        simulator: Of the mission.
        pfsm: What to measure.
        runs: How many experiments.
        seed: Master seed of the instances.
        jobs: Experiments run at once.
        watch: Called now and then with the number of experiments done.

    Raises:
        FsmError: if the PFSM needs a sensor that the robot lacks.
    """
    simulator.check(pfsm)
    seeds = instance_seeds(seed, "evaluation instances", runs)
    scores: list[float] = []
    with ThreadExecutor(lambda experiment: simulator.run(pfsm, seeds[experiment.instance]).score, jobs) as executor:
        chunk = 10 * jobs  # often enough to see progress, seldom enough to keep all jobs busy
        for start in range(0, runs, chunk):
            scores += executor.run([Experiment(0, k) for k in range(start, min(start + chunk, runs))])
            watch(len(scores))
    return Evaluation(scores=tuple(scores), seeds=tuple(seeds))
