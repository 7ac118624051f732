"""The pieces put together: design control software for a mission, and measure it.

A `Designer` lets a race propose configurations and simulates them; `evaluate` runs one PFSM on fresh instances. Both
take their randomness from one master seed: the same mission, budget and seed give the same result, whatever the number
of jobs.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mercator_design.fsm.behaviours import BEHAVIOURS
from mercator_design.fsm.conditions import CONDITIONS
from mercator_design.fsm.grammar import parameters_text, to_pfsm
from mercator_design.fsm.modules import numbered
from mercator_design.fsm.pfsm import Pfsm
from mercator_design.race import Experiment, IteratedRace, Space
from mercator_design.race.executors import ThreadExecutor
from mercator_design.seeds import instance_seed
from mercator_design.sim.simulate import Simulator

CONFIDENCE = 0.95
"""Of the intervals reported around means."""


@dataclass(frozen=True, slots=True)
class Scores:
    """The scores of a PFSM, in the mission's own sense, and the figures that sum them up."""

    values: tuple[float, ...]

    @property
    def mean(self) -> float:
        """Arithmetic mean."""
        return float(np.mean(self.values))

    @property
    def standard_deviation(self) -> float | None:
        """Of the sample, with n - 1; None for a single score."""
        return float(np.std(self.values, ddof=1)) if len(self.values) > 1 else None

    @property
    def quartiles(self) -> tuple[float, float, float]:
        """Lower quartile, median, upper quartile."""
        low, middle, high = np.percentile(self.values, [25, 50, 75])
        return float(low), float(middle), float(high)

    @property
    def confidence_interval(self) -> tuple[float, float] | None:
        """Of the mean, at 95 %, by Student's t; None for a single score."""
        from scipy.special import stdtrit

        if self.standard_deviation is None:
            return None
        n = len(self.values)
        half = float(stdtrit(n - 1, 0.5 + CONFIDENCE / 2)) * self.standard_deviation / math.sqrt(n)
        return self.mean - half, self.mean + half


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
    scores: Scores  # of the winner, on the instances of the race
    finished: tuple[Finished, ...]


class Designer:
    """Designs control software for the mission of a simulator, by a race over all PFSMs of a flavour.

    Raises:
        FsmError: if the robot lacks a sensor that a module of the flavour needs.
        RaceError: if the budget is too small.
    """

    def __init__(self, simulator: Simulator, *, budget: int, seed: int, flavour: str = "watermelon") -> None:
        for table in (BEHAVIOURS, CONDITIONS):
            for module in numbered(table, flavour).values():
                simulator.check_module(module, flavour)
        self.simulator = simulator
        self.flavour = flavour
        self.race = IteratedRace(Space.from_text(parameters_text(flavour), "grammar"), budget=budget, seed=seed)
        self._pfsms: dict[int, Pfsm] = {}
        self._seeds: dict[int, int] = {}

    def run(
        self,
        *,
        jobs: int,
        watch: Callable[[Sequence[Finished]], None] = lambda finished: None,  # noqa: ARG005 - a name for the reader
    ) -> Design:
        """Run the race to its end.

        Args:
            jobs: Experiments run at once.
            watch: Called with the experiments that have finished since, several times a batch.
        """
        finished: list[Finished] = []
        with ThreadExecutor(jobs) as executor:
            while batch := self.race.ask():
                for experiment in batch:
                    self._prepare(experiment)
                iteration = self.race.iteration
                told = len(finished)
                for scores in executor.run(self._score, batch):
                    new = [
                        Finished(
                            experiment=k,
                            iteration=iteration,
                            configuration=batch[k - told].configuration,
                            instance=batch[k - told].instance,
                            seed=self._seeds[batch[k - told].instance],
                            score=score,
                        )
                        for k, score in enumerate(scores, start=len(finished))
                    ]
                    finished += new
                    watch(new)
                self.race.tell([self.simulator.mission.cost(one.score) for one in finished[told:]])
        best = self.race.best.configuration
        return Design(
            winner=self.pfsm(best),
            configuration=best,
            scores=Scores(tuple(f.score for f in finished if f.configuration == best)),
            finished=tuple(finished),
        )

    def pfsm(self, configuration: int) -> Pfsm:
        """The PFSM of a configuration that was raced."""
        return self._pfsms[configuration]

    def _prepare(self, experiment: Experiment) -> None:
        configuration, instance = experiment
        if configuration not in self._pfsms:
            self._pfsms[configuration] = to_pfsm(self.race.configurations[configuration], self.flavour)
        if instance not in self._seeds:
            self._seeds[instance] = instance_seed(self.race.seed, "race", instance)

    def _score(self, experiment: Experiment) -> float:
        pfsm, seed = self._pfsms[experiment.configuration], self._seeds[experiment.instance]
        return self.simulator.run(pfsm, seed).score


@dataclass(frozen=True, slots=True, kw_only=True)
class Evaluation:
    """Scores of a PFSM on fresh instances, and the instances' seeds."""

    scores: Scores
    seeds: tuple[int, ...]


def evaluate(
    simulator: Simulator,
    pfsm: Pfsm,
    *,
    runs: int,
    seed: int,
    jobs: int,
    watch: Callable[[int], None] = lambda done: None,  # noqa: ARG005 - a name for the reader
) -> Evaluation:
    """Run a PFSM on fresh instances, which have nothing to do with those of a race.

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

    def measured(instance: int) -> tuple[float, int]:
        own_seed = instance_seed(seed, "evaluation", instance)
        return simulator.run(pfsm, own_seed).score, own_seed

    found: list[tuple[float, int]] = []
    with ThreadExecutor(jobs) as executor:
        for some in executor.run(measured, range(runs)):
            found += some
            watch(len(found))
    scores, seeds = zip(*found, strict=True)
    return Evaluation(scores=Scores(scores), seeds=seeds)
