"""The pieces put together: design control software for a mission, and measure it.

A `Designer` lets a race propose configurations and simulates them; `evaluate` runs one PFSM on given
instances. All randomness is from one master seed: the same mission, budget and seed give the same result, whatever runs
the experiments.
"""

import dataclasses
import hashlib
import math
import socket
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mercator_design import __version__
from mercator_design.errors import SimulationError
from mercator_design.fsm.behaviours import BEHAVIOURS
from mercator_design.fsm.conditions import CONDITIONS
from mercator_design.fsm.grammar import parameters_text, to_pfsm
from mercator_design.fsm.modules import numbered
from mercator_design.fsm.pfsm import Pfsm
from mercator_design.jit import kernels_digest
from mercator_design.loading import dump
from mercator_design.missions.mission import Mission
from mercator_design.missions.plugins import load_plugin, loaded_plugins, plugin_files
from mercator_design.race import Space
from mercator_design.race.executors import Executor, ThreadExecutor, in_order
from mercator_design.race.journal import Finished, Iteration, Measured, Record
from mercator_design.race.methods import METHODS
from mercator_design.race.runner import OnFailure, Runner
from mercator_design.race.testing import Testing, run_tests
from mercator_design.seeds import instance_seed
from mercator_design.sim.robot_model import RobotModel
from mercator_design.sim.simulate import Simulator

CONFIDENCE = 0.95
"""Of the intervals reported around means."""
TEST_SEED = 1
"""Of test instances, as `mdesign evaluate` has it unless told otherwise: so all races are tested on the same ones."""


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
class Design:
    """What a race came to."""

    winner: Pfsm
    configuration: int  # the winner's number
    scores: Scores  # of the winner, on the instances of the race
    tests: dict[int, Scores]  # of the configurations that were tested, the winner first
    finished: tuple[Finished, ...]  # all experiments, in order of their numbers


class Experimenter:
    """Runs one experiment, here or in another process: the simulator is built anew there."""

    def __init__(self, simulator: Simulator) -> None:
        self.simulator = simulator

    def __call__(self, item: tuple[Pfsm, int]) -> Measured:
        """Score, and digest of where all robots are and in what state at the end."""
        pfsm, seed = item
        outcome = self.simulator.run(pfsm, seed)
        trace = outcome.trace
        digest = hashlib.blake2b(trace.poses[-1].tobytes(), digest_size=8)
        digest.update(trace.states[-1].tobytes())
        digest.update(outcome.score.hex().encode())
        return Measured(outcome.score, digest.hexdigest())

    def __reduce__(self) -> tuple[Callable[..., "Experimenter"], tuple[object, ...]]:
        files = tuple(map(str, plugin_files()))
        return _elsewhere, (files, kernels_digest(), self.simulator.mission, self.simulator.robot_model)


def _elsewhere(plugins: tuple[str, ...], kernels: str, mission: Mission, robot_model: RobotModel) -> Experimenter:
    """An experimenter that came to this process."""
    for file in plugins:
        load_plugin(file)
    if kernels_digest() != kernels:
        raise SimulationError(f"worker on {socket.gethostname()}: its simulator is not that of the race")
    return Experimenter(Simulator(mission, robot_model))


class Designer:
    """Designs control software for the mission of a simulator, by a race over all PFSMs of a flavour.

    Args:
        simulator: Of the mission.
        budget: Experiments to run at most.
        seed: Of all that is random.
        flavour: What modules there are.
        method: Name of one of `METHODS`. On missions, the library's own has shown no gain over irace
            (docs/benchmarks.md), and costs time.

    Raises:
        FsmError: if the robot lacks a sensor that a module of the flavour needs.
        RaceError: if the budget is too small.
    """

    def __init__(
        self, simulator: Simulator, *, budget: int, seed: int, flavour: str = "watermelon", method: str = "irace"
    ) -> None:
        for table in (BEHAVIOURS, CONDITIONS):
            for module in numbered(table, flavour).values():
                simulator.check_module(module, flavour)
        self.simulator = simulator
        self.flavour = flavour
        self.method = method
        space = Space.from_text(parameters_text(flavour), "grammar")
        self.race = METHODS[method](space, budget=budget, seed=seed)
        self._pfsms: dict[int, Pfsm] = {}
        self._seeds: dict[int, int] = {}

    def start(self) -> dict[str, Any]:
        """What makes this race, and nothing else: races of equal starts are equal."""
        robot_model = dump(self.simulator.robot_model)
        return {
            "mercator_design": __version__,
            "kernels": kernels_digest(),
            "plugins": loaded_plugins(),
            "mission": self.simulator.mission.name,
            "mission_digest": self.simulator.mission.digest,
            "robot_model": self.simulator.robot_model.name,
            "robot_model_digest": hashlib.sha256(robot_model.encode()).hexdigest()[:16],
            "flavour": self.flavour,
            "space_digest": hashlib.sha256(parameters_text(self.flavour).encode()).hexdigest()[:16],
            "budget": self.race.budget,
            "seed": self.race.seed,
            "method": self.method,
            "options": dataclasses.asdict(self.race.options),
        }

    def run(
        self,
        executor: Executor,
        record: Record | None = None,
        *,
        on_failure: OnFailure = "stop",
        watch: Callable[[Sequence[Finished]], None] = lambda finished: None,  # noqa: ARG005 - a name for the reader
        watch_iterations: Callable[[Iteration], None] = lambda iteration: None,  # noqa: ARG005
        testing: Testing | None = None,
        watch_tests: Callable[[int, int], None] = lambda done, of: None,  # noqa: ARG005
        stopped: Callable[[], bool] = lambda: False,
    ) -> Design:
        """Run the race to its end, and then the tests.

        Args:
            executor: Runs its experiments; what comes of them does not depend on it.
            record: Of this race so far; what happens is noted in it.
            on_failure: Whether an experiment that fails stops the race, or rejects its configuration.
            watch: Called with the experiments that have finished since.
            watch_iterations: Called with an iteration that has ended.
            testing: What to test when the race has ended, on the instances of `fresh_instances(TEST_SEED, ...)`.
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
        function = Experimenter(self.simulator)
        Runner(
            race=self.race,
            record=record,
            executor=executor,
            function=function,
            item=lambda experiment: (self.pfsm(experiment.configuration), self._seed(experiment.instance)),
            seed=self._seed,
            cost=self.simulator.mission.cost,
            on_failure=on_failure,
            watch=watch,
            watch_iterations=watch_iterations,
            stopped=stopped,
        ).run()
        tests: dict[int, Scores] = {}
        if testing is not None:
            instances = fresh_instances(TEST_SEED, testing.runs)
            run_tests(
                testing.experiments(self.race),
                record=record,
                executor=executor,
                function=function,
                item=lambda test: (self.pfsm(test.configuration), instances[test.instance]),
                seed=instances.__getitem__,
                on_failure=on_failure,
                watch=watch_tests,
                stopped=stopped,
            )
            known = record.test_scores()
            tests = {c: Scores(known[c]) for c in testing.configurations(self.race) if c in known}
        best = self.race.best.configuration
        finished = tuple(record.experiments[number] for number in range(len(record.experiments)))
        scores = tuple(f.score for f in finished if f.configuration == best and f.score is not None)
        return Design(winner=self.pfsm(best), configuration=best, scores=Scores(scores), tests=tests, finished=finished)

    def pfsm(self, configuration: int) -> Pfsm:
        """The PFSM of a configuration that is raced."""
        if configuration not in self._pfsms:
            self._pfsms[configuration] = to_pfsm(self.race.configurations[configuration], self.flavour)
        return self._pfsms[configuration]

    def _seed(self, instance: int) -> int:
        if instance not in self._seeds:
            self._seeds[instance] = instance_seed(self.race.seed, "race", instance)
        return self._seeds[instance]


@dataclass(frozen=True, slots=True, kw_only=True)
class Evaluation:
    """Scores of a PFSM, and the seeds of the instances."""

    scores: Scores
    seeds: tuple[int, ...]


def fresh_instances(seed: int, runs: int) -> list[int]:
    """Seeds of instances that have nothing to do with those of a race; a longer series begins alike."""
    return [instance_seed(seed, "evaluation", instance) for instance in range(runs)]


def evaluate(
    simulator: Simulator,
    pfsm: Pfsm,
    *,
    seeds: Sequence[int],
    jobs: int,
    watch: Callable[[int], None] = lambda done: None,  # noqa: ARG005 - a name for the reader
) -> Evaluation:
    """Run a PFSM on some instances.

    Args:
        simulator: Of the mission.
        pfsm: What to measure.
        seeds: Of the instances, such as `fresh_instances`.
        jobs: Experiments run at once.
        watch: Called with the number of experiments done.

    Raises:
        FsmError: if the PFSM needs a sensor that the robot lacks.
    """
    simulator.check(pfsm)

    def measured(seed: int) -> float:
        return simulator.run(pfsm, seed).score

    with ThreadExecutor(jobs) as executor:
        scores = in_order(executor, measured, seeds, watch)
    return Evaluation(scores=Scores(tuple(scores)), seeds=tuple(seeds))
