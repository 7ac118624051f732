"""Simulate, measure and design, in a call each: the functions of `import mercator_design`."""

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from mercator_design.designer import Designer
from mercator_design.fsm.pfsm import Pfsm
from mercator_design.missions.mission import Mission
from mercator_design.missions.trace import Trace
from mercator_design.race.racing.summary import Scores
from mercator_design.race.running.evaluation import Testing
from mercator_design.race.running.events import Event
from mercator_design.race.running.executors import Executor, ThreadExecutor, available_jobs, in_order
from mercator_design.race.running.outcome import OnFailure
from mercator_design.race.running.runner import RaceRun
from mercator_design.seeds import instance_seed
from mercator_design.sim.robot_model import RobotModel
from mercator_design.sim.simulate import Simulator

_log = logging.getLogger(__name__)


def simulate(
    mission: Mission, pfsm: Pfsm, *, seed: int = 1, robot_model: RobotModel | None = None, record: bool = False
) -> Trace:
    """Run one experiment; `mission.objective(trace)` is its score.

    Args:
        mission: What the robots have to do.
        pfsm: The control software of every robot.
        seed: Of the instance: floor, starting poses and all random numbers.
        robot_model: The robots. [default: the mission's]
        record: Whether to keep what the robots perceived and did, which `Trace.measure` needs for some devices.

    Raises:
        FsmError: The PFSM needs a sensor that the robot lacks.
        MissionError: The robots do not fit, or the objective has no score for what they did.
    """
    return Simulator(mission, robot_model).run(pfsm, seed, record=record).trace


@dataclass(frozen=True, slots=True, kw_only=True)
class Evaluation:
    """Scores of a PFSM, and the seeds of the instances."""

    scores: Scores
    seeds: tuple[int, ...]


def fresh_instances(seed: int = 1, runs: int = 100) -> list[int]:
    """Seeds of instances that have nothing to do with those of a race; a longer series begins alike."""
    return [instance_seed(seed, "evaluation", instance) for instance in range(runs)]


def evaluate(
    mission: Mission,
    pfsm: Pfsm,
    *,
    seeds: Sequence[int] | None = None,
    robot_model: RobotModel | None = None,
    jobs: int | None = None,
    watch: Callable[[int], None] = lambda done: None,  # noqa: ARG005 - a name for the reader
) -> Evaluation:
    """Run a PFSM on several instances.

    Args:
        mission: What the robots have to do.
        pfsm: What to measure.
        seeds: Of the instances. [default: `fresh_instances()`, as `mdesign evaluate`]
        robot_model: The robots. [default: the mission's]
        jobs: Experiments run at once. [default: the cores of this machine]
        watch: Called with the number of experiments done.

    Raises:
        FsmError: The PFSM needs a sensor that the robot lacks.
        MissionError: The robots do not fit, or the objective has no score for what they did.
    """
    simulator = Simulator(mission, robot_model)
    simulator.check(pfsm)
    seeds = fresh_instances() if seeds is None else seeds

    def measured(seed: int) -> float:
        return simulator.run(pfsm, seed).score

    with ThreadExecutor(jobs or available_jobs()) as executor:
        scores = in_order(executor, measured, seeds, watch)
    return Evaluation(scores=Scores(tuple(scores)), seeds=tuple(seeds))


class DesignRun(RaceRun[tuple[Pfsm, int]]):
    """A race for control software on its way to its end: an iterator of its events, with `result` and `pfsm`.

    Args:
        designer: What is raced.
        executor: Runs experiments; entered at the first event, and left after the last.
        on_failure: As `RaceRun`.
        testing: As `RaceRun`.
    """

    def __init__(
        self, designer: Designer, executor: Executor, *, on_failure: OnFailure = "stop", testing: Testing | None = None
    ) -> None:
        super().__init__(designer, executor, on_failure=on_failure, testing=testing)
        self.designer = designer

    def _run(self) -> Iterator[Event]:
        self.designer.prepare(_log.info)
        with self._executor:
            yield from super()._run()

    @property
    def pfsm(self) -> Pfsm:
        """The winner.

        Raises:
            RaceError: The race has not come to its end yet.
        """
        return self.designer.pfsm(self.result.configuration)


def design(
    mission: Mission,
    *,
    budget: int,
    seed: int = 1,
    flavour: str = "watermelon",
    method: str = "surrogate",
    robot_model: RobotModel | None = None,
    jobs: int | None = None,
    on_failure: OnFailure = "stop",
    test_runs: int = 0,
) -> DesignRun:
    """Design control software for a mission, by a race; nothing runs before the first event is asked for.

    Args:
        mission: What the robots have to do.
        budget: Experiments to run at most.
        seed: Of all that is random.
        flavour: Modules to design with.
        method: What proposes configurations and decides which of them run on; a name of `race.methods.table.METHODS`.
        robot_model: The robots. [default: the mission's]
        jobs: Experiments run at once; the result does not depend on it. [default: the cores of this machine]
        on_failure: Whether an experiment that fails stops the race ("stop"), or rejects its configuration ("reject").
        test_runs: Fresh instances to test the winner on, beyond the budget.

    Raises:
        FsmError: The robot lacks a sensor that a module of the flavour needs.
        MissionError: The mission is impossible.
        RaceError: The budget is too small.
    """
    designer = Designer(Simulator(mission, robot_model), budget=budget, seed=seed, flavour=flavour, method=method)
    testing = Testing(runs=test_runs) if test_runs else None
    return DesignRun(designer, ThreadExecutor(jobs or available_jobs()), on_failure=on_failure, testing=testing)
