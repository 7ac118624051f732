"""Runs one experiment: from a PFSM, a mission and a seed to a score and a trace."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from mercator_design.errors import FsmError, MissionError, SimulationError
from mercator_design.fsm.pfsm import Pfsm, Program, State
from mercator_design.jit import announced, compiled, compiling, jit_wanted
from mercator_design.missions.mission import Mission
from mercator_design.missions.plugins import reporting_kernels
from mercator_design.missions.trace import Trace
from mercator_design.modules.module import Module
from mercator_design.modules.reference import ReferenceModel
from mercator_design.seeds import generator
from mercator_design.sim.checks.impossible import MissionWarning, mission_warnings
from mercator_design.sim.devices import Recording
from mercator_design.sim.kernels import kernel
from mercator_design.sim.kernels.chipmunk import SPACE, new_bridge, take_down
from mercator_design.sim.kernels.scene import Scene
from mercator_design.sim.kernels.swarm import History, Swarm, new_history
from mercator_design.sim.referee import referee_experiment
from mercator_design.sim.robot_model import RobotModel, load_robot_model
from mercator_design.sim.world import Instance, World

_DRAWN_WORLDS = 64
_PROGRAMS = 1024
"""Numbers of what is kept, because a race asks for it again and again."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """The result of an experiment."""

    score: float  # in the mission's direction
    trace: Trace
    recording: Recording  # with readings, draws and wheels if all was recorded

    @property
    def history(self) -> History:
        return self.recording.history


@dataclass(frozen=True, slots=True)
class PreparedExperiment:
    """An experiment before its loop: `run` and `outcome` follow, once each."""

    mission: Mission
    seed: int
    instance: Instance
    program: Program
    history: History

    def run(self, *, referee: bool = False) -> None:
        """Run the loop; arguments and errors are those of `Simulator.run`."""
        instance = self.instance
        loop = referee_experiment if referee or not jit_wanted() else _compiled
        with reporting_kernels([each.name for each in self.mission.floor.dynamics]):
            loop(instance.scene, instance.robot_model.reference_model, self.program, instance.swarm, self.history)

    def outcome(self) -> Outcome:
        """The outcome, after the loop; errors are those of `Simulator.run`."""
        mission, instance, history = self.mission, self.instance, self.history
        if not np.isfinite(history.poses[-1]).all():
            raise SimulationError(f"{mission.name}: seed {self.seed}: the simulation lost track of a robot")
        recording = Recording(
            instance.robot_model, instance.start, history, instance.swarm.noise_keys, mission.control_period
        )
        trace = Trace(
            poses=history.poses,
            states=history.states,
            floor=instance.start.floor.copy(),  # an objective of a plugin might run the dynamics on it
            zone_rows=instance.zone_rows,
            control_period=mission.control_period,
            measure=recording.measure,
        )
        return Outcome(score=mission.objective(trace), trace=trace, recording=recording)


class Simulator:
    """Runs experiments of one mission with one robot model; may be used by several threads at once."""

    def __init__(self, mission: Mission, robot_model: RobotModel | None = None) -> None:
        self.mission = mission
        self.robot_model = robot_model or robot_model_of(mission)
        self._senses = self.robot_model.senses
        self._world = World(mission, self.robot_model)
        self._drawn_world = lru_cache(_DRAWN_WORLDS)(self._draw_world)

    @cached_property
    def warnings(self) -> tuple[MissionWarning, ...]:
        """Warnings of impossible parts and probable mistakes in the mission, for these robots."""
        return tuple(mission_warnings(self.mission, self.robot_model))

    def refuse_impossible(self) -> None:
        """Refuse an impossible mission; called before races and by validation.

        Raises:
            MissionError: with a message for each of `warnings` that is impossible.
        """
        if impossible := [warning.message for warning in self.warnings if warning.is_impossible]:
            raise MissionError(*impossible)

    def instance(self, seed: int) -> Instance:
        """The instance of a seed, with its robot model."""
        return (self._drawn_world(seed) if self.robot_model.vary else self._world).instance(seed)

    def _draw_world(self, seed: int) -> World:
        return World(self.mission, self.robot_model.drawn(generator(seed, "robot model")))

    def run(self, pfsm: Pfsm, seed: int, *, record: bool = False, referee: bool = False) -> Outcome:
        """Run one experiment.

        Args:
            pfsm: The control software of every robot.
            seed: The seed of the instance: floor, starting poses and all draws depend on it.
            record: Whether to keep the readings, draws and wheel commands of the robots.
            referee: Whether to step through pymunk's public functions from Python instead of in one compiled call;
                the outcome is the same to the last bit. Plain Python (NUMBA_DISABLE_JIT=1) always does.

        Raises:
            FsmError: if the PFSM needs a sensor that the robot lacks.
            MissionError: if the robots do not fit, or the objective fails.
            SimulationError: if a robot's final pose is not finite.
        """
        prepared = self.prepare(pfsm, seed, record=record)
        prepared.run(referee=referee)
        return prepared.outcome()

    def prepare(self, pfsm: Pfsm, seed: int, *, record: bool = False) -> PreparedExperiment:
        """All that comes before the compiled loop of `run`; arguments and errors are those of `run`."""
        program, reads = _tables(pfsm)
        if not reads <= self._senses:
            self.check(pfsm)
        return self._prepared(seed, program, self.mission.cycles, everything=record)

    def _prepared(self, seed: int, program: Program, cycles: int, *, everything: bool) -> PreparedExperiment:
        history = new_history(cycles, self.mission.robots, everything=everything)
        return PreparedExperiment(self.mission, seed, self.instance(seed), program, history)

    def rehearse(self, announce: Callable[[str], None], cycles: int = 1) -> Recording:
        """Run the first cycles of an experiment: check that the robots fit, and compile what is not compiled yet.

        Args:
            announce: Called with a message if there is something to compile.
            cycles: How many.

        Returns:
            The recording of these cycles.

        Raises:
            MissionError: if the robots do not fit, a plugin's kernel is not of the subset that can be compiled, or the
                objective has no score for these cycles.
        """
        with announced(lambda: announce(compiling("the simulator"))):
            self.check_placement()
            prepared = self._prepared(0, program_arrays(Pfsm((State("stop"),))), cycles, everything=True)
            prepared.run()
            return prepared.outcome().recording

    def check_placement(self) -> None:
        """Check in ten instances that the robots find places to start from.

        Raises:
            MissionError: if they do not, in one of them.
        """
        for seed in range(10):
            self.instance(seed)

    def check(self, pfsm: Pfsm) -> None:
        """Check that the robot has the senses that a PFSM needs.

        Raises:
            FsmError: naming the module and the sense.
        """
        for place, one in pfsm.nodes:
            self.check_module(one.module, place)

    def check_module(self, module: Module, place: str) -> None:
        """Check that the robot has the senses that a module reads.

        Raises:
            FsmError: naming the module and the sense.
        """
        missing = sorted(module.reads - self._senses)
        if missing:
            needed = " and ".join(missing)
            raise FsmError(
                f"{place}: {module.name} needs {needed}, which robot {self.robot_model.name} does not perceive"
            )


def robot_model_of(mission: Mission) -> RobotModel:
    """The robot model that a mission names.

    Raises:
        MissionError: naming the place in the mission, if the robot model does not exist or is not valid.
    """
    try:
        return load_robot_model(mission.robot_model)
    except MissionError as error:
        place = mission.where("robot_model")
        raise MissionError(*(f"{place}: {message}" for message in error.messages)) from None


@lru_cache(_PROGRAMS)
def _tables(pfsm: Pfsm) -> tuple[Program, frozenset[str]]:
    """The tables of a PFSM, and the senses that it reads."""
    return program_arrays(pfsm), pfsm.reads


def program_arrays(pfsm: Pfsm) -> Program:
    """The tables of a PFSM as arrays, for compiled code, which does not change them."""
    kinds = {"behaviour_parameters": np.float64, "condition_parameters": np.float64}
    arrays = [
        np.array(table, dtype=kinds.get(name, np.int64))
        for name, table in zip(Program._fields, pfsm.program(), strict=True)
    ]
    return Program(*arrays)


def _compiled(scene: Scene, model: ReferenceModel, program: Program, swarm: Swarm, history: History) -> None:
    """The whole experiment in one compiled call."""
    bridge = new_bridge(scene.physics, len(swarm.poses))
    try:
        compiled(kernel.experiment)(bridge, scene, model, program, swarm, history)
    finally:
        if bridge.arena[SPACE]:  # a plugin's dynamic failed
            compiled(take_down)(bridge)
