"""Runs one experiment: from a PFSM, a mission and a seed to a score and a trace."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple, TypeVar

import numpy as np

from mercator_design.config import shipped
from mercator_design.errors import FsmError, MissionError, SimulationError
from mercator_design.jit import announced, compiled, compiling, jit_wanted
from mercator_design.missions.mission import Mission
from mercator_design.missions.objectives.scoring import Scored
from mercator_design.missions.plugins import changes_of
from mercator_design.missions.trace import Trace
from mercator_design.modules.architecture import ControlProgram, Software, outputs_of
from mercator_design.modules.flavour import DEFAULT_FLAVOUR, Flavour, flavour_of
from mercator_design.modules.module import Module
from mercator_design.modules.reference import LED_COLOURS, MAX_SIGNAL, WRONG, ReferenceModel
from mercator_design.plugins.places import reporting_kernels
from mercator_design.plugins.registries import by_entries
from mercator_design.seeds import generator
from mercator_design.sim.checks.impossible import MissionWarning, mission_warnings
from mercator_design.sim.devices import Recording
from mercator_design.sim.kernels import kernel
from mercator_design.sim.kernels.chipmunk import SPACE, new_bridge, take_down
from mercator_design.sim.kernels.scene import Scene
from mercator_design.sim.kernels.swarm import History, Swarm, controlled, new_history
from mercator_design.sim.referee import referee_experiment
from mercator_design.sim.robot_model import RobotModel, load_robot_model
from mercator_design.sim.world import Instance, World
from mercator_design.software.architectures import architecture_of, part_colours

T = TypeVar("T", bound=Any)

_DRAWN_WORLDS = 64
_PROGRAMS = 1024
"""Numbers of what is kept, because a race asks for it again and again."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """The result of an experiment."""

    scored: Scored  # in the mission's direction, and by each objective
    trace: Trace
    recording: Recording  # with readings, draws and wheels if all was recorded

    @property
    def score(self) -> float:
        """In the mission's direction."""
        return self.scored.score

    @property
    def history(self) -> History:
        return self.recording.history


class Tables(NamedTuple):
    """What an experiment needs of control software."""

    program: Any  # a named tuple of arrays, as the architecture's kernel takes
    memory: int  # numbers that it keeps for each robot
    draws: int  # that it makes in a cycle
    reads: frozenset[str]  # the senses
    sets: frozenset[str]  # the outputs
    part_colours: tuple[int, ...]
    flavour: Flavour
    kernels: Mapping[Callable[..., Any], str]  # of its modules, each with what it is


@dataclass(frozen=True, slots=True)
class PreparedExperiment:
    """An experiment before its loop: `run` and `outcome` follow, once each."""

    mission: Mission
    seed: int
    instance: Instance
    tables: Tables
    history: History

    def run(self, *, referee: bool = False) -> None:
        """Run the loop; arguments and errors are those of `Simulator.run`."""
        instance, tables = self.instance, self.tables
        loop = referee_experiment if referee or not jit_wanted() else _compiled
        model = tables.flavour.reference_model(instance.robot_model.reference_model)
        swarm = controlled(instance.swarm, memory=tables.memory, draws=tables.draws)
        kernels: dict[Callable[..., Any], str] = {**changes_of(each.name for each in self.mission.floor.dynamics)}
        kernels |= tables.kernels
        with reporting_kernels(kernels):
            loop(instance.scene, model, tables.program, swarm, self.history)

    def outcome(self) -> Outcome:
        """The outcome, after the loop; errors are those of `Simulator.run`."""
        mission, instance, history = self.mission, self.instance, self.history
        if not np.isfinite(history.poses[-1]).all():
            raise SimulationError(f"{mission.name}: seed {self.seed}: the simulation lost track of a robot")
        self._check_outputs()
        recording = Recording(
            robot_model=instance.robot_model.with_flavour(self.tables.flavour.name),
            scene=instance.start,
            history=history,
            noise_keys=instance.swarm.noise_keys,
            control_period=mission.control_period,
            sets=self.tables.sets,
            part_colours=self.tables.part_colours,
        )
        trace = Trace(
            poses=history.poses,
            states=history.states,
            led_colours=history.led_colours,
            signals=history.signals,
            stops=instance.start.stops if len(instance.start.stops) else None,
            floor=instance.start.floor.copy(),  # an objective of a plugin might run the dynamics on it
            zone_rows=instance.zone_rows,
            walls=instance.walls,
            control_period=mission.control_period,
            measure=recording.measure,
        )
        return Outcome(scored=mission.scored(trace), trace=trace, recording=recording)

    def _check_outputs(self) -> None:
        """Check that modules set what robots can show and send; wheels out of range show in the poses."""
        for name, expected, values in (
            ("led_colour", f"-1 to {len(LED_COLOURS) - 1}", self.history.led_colours),
            ("signal", f"0 to {MAX_SIGNAL}", self.history.signals),
        ):
            if name in self.tables.sets and (values == WRONG).any():
                cycle, robot = np.argwhere(values == WRONG)[0]
                found = f"another one of robot {robot} in cycle {cycle}; correct the module that sets it"
                where = f"{self.mission.name}: seed {self.seed}: {name}"
                raise SimulationError(f"{where}: expected a whole number from {expected}, found {found}")


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

    def run(self, software: Software, seed: int, *, record: bool = False, referee: bool = False) -> Outcome:
        """Run one experiment.

        Args:
            software: The control software of every robot.
            seed: The seed of the instance: floor, starting poses and all draws depend on it.
            record: Whether to keep the readings, draws and wheel commands of the robots.
            referee: Whether to step through pymunk's public functions from Python instead of in one compiled call;
                the outcome is the same to the last bit. Plain Python (NUMBA_DISABLE_JIT=1) always does.

        Raises:
            FsmError: if it needs a sensor that the robot lacks.
            MissionError: if the robots do not fit, or the objective fails.
            SimulationError: if a robot's final pose is not finite.
        """
        prepared = self.prepare(software, seed, record=record)
        prepared.run(referee=referee)
        return prepared.outcome()

    def prepare(self, software: Software, seed: int, *, record: bool = False) -> PreparedExperiment:
        """All that comes before the compiled loop of `run`; arguments and errors are those of `run`."""
        tables = tables_of(software)
        if not tables.reads <= self._senses:
            self.check(software)
        return self._prepared(seed, tables, self.mission.cycles, everything=record)

    def _prepared(self, seed: int, tables: Tables, cycles: int, *, everything: bool) -> PreparedExperiment:
        history = new_history(cycles, self.mission.robots, everything=everything, draws=tables.draws)
        return PreparedExperiment(self.mission, seed, self.instance(seed), tables, history)

    def rehearse(self, announce: Callable[[str], None], cycles: int = 1, flavour: str = DEFAULT_FLAVOUR) -> Recording:
        """Run the first cycles of an experiment: check that the robots fit, and compile what is not compiled yet.

        Args:
            announce: Called with a message if there is something to compile.
            cycles: How many.
            flavour: The flavour of the control software that will run.

        Returns:
            The recording of these cycles.

        Raises:
            MissionError: if the robots do not fit, a plugin's kernel is not of the subset that can be compiled, or the
                objective has no score for these cycles.
        """
        with announced(lambda: announce(compiling("the simulator"))):
            self.check_placement()
            prepared = self._prepared(0, tables_of(architecture_of(flavour).simplest(flavour)), cycles, everything=True)
            prepared.run()
            return prepared.outcome().recording

    def check_placement(self) -> None:
        """Check in ten instances that the robots find places to start from.

        Raises:
            MissionError: if they do not, in one of them.
        """
        for seed in range(10):
            self.instance(seed)

    def check(self, software: Software) -> None:
        """Check that the robot has the senses that control software needs.

        Raises:
            FsmError: naming the module and the sense.
        """
        for place, one in software.nodes:
            self.check_module(one.module, place)
        self._check_senses(software.reads, software.flavour)

    def check_module(self, module: Module, place: str) -> None:
        """Check that the robot has the senses that a module reads.

        Raises:
            FsmError: naming the module and the sense.
        """
        self._check_senses(module.reads, f"{place}: {module.name}")

    def _check_senses(self, reads: frozenset[str], what: str) -> None:
        if missing := sorted(reads - self._senses):
            needed = " and ".join(missing)
            able = [name for name in shipped.robot_models() if load_robot_model(name).senses >= reads]
            hint = f"; the robot_model of a mission that does: {', '.join(able)}" if able else ""
            raise FsmError(f"{what} needs {needed}, which robot {self.robot_model.name} does not perceive{hint}")


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


@by_entries
@lru_cache(_PROGRAMS)
def tables_of(software: Software) -> Tables:
    """The tables of control software, for compiled code, which does not change them."""
    program, flavour = software.program(), flavour_of(software.flavour)
    kernels = {one.module.call: f"{one.module.kind} {one.module.name}" for _, one in software.nodes}
    sets = outputs_of(software)
    return Tables(
        program=_arrays(program),
        memory=program.memory,
        draws=software.draws,
        reads=software.reads,
        sets=sets,
        part_colours=part_colours(software),
        flavour=flavour,
        kernels=kernels,
    )


def _arrays(table: T) -> T:
    """A named tuple of rows, with arrays instead."""
    arrays = [
        _arrays(row)
        if hasattr(row, "_fields")
        else np.array(row, dtype=np.float64 if name == "parameters" else np.int64)
        for name, row in zip(table._fields, table, strict=True)
    ]
    made: T = type(table)(*arrays)
    return made


def _compiled(scene: Scene, model: ReferenceModel, program: ControlProgram, swarm: Swarm, history: History) -> None:
    """The whole experiment in one compiled call."""
    bridge = new_bridge(scene.physics, len(swarm.poses))
    try:
        compiled(kernel.experiment)(bridge, scene, model, program, swarm, history)
    finally:
        if bridge.arena[SPACE]:  # a plugin's dynamic failed
            compiled(take_down)(bridge)
