"""Recorded runs, replayed: motion by the recorded commands, perception and behaviours at the recorded poses."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pymunk

from benchmarks.argos.recordings import RecordingError, mission_and_robot
from benchmarks.argos.repeat import set_scene, twisters
from mercator_design.fsm import Readings, parse
from mercator_design.fsm.behaviours import TURN_CYCLES, TURN_SIDE
from mercator_design.fsm.control import MEMORY
from mercator_design.jit import compiled
from mercator_design.missions.floor import Tiles
from mercator_design.sim.kernel import EVERYTHING
from mercator_design.sim.sensing import sense
from mercator_design.sim.sight import cast
from mercator_design.sim.simulate import referee_motion
from mercator_design.sim.world import Instance, World

NEAR, BEYOND = -9.0, 9.0  # how a trace writes minus and plus infinity
SENSORS = 8  # of proximity


class Trace:
    """One recorded run as arrays: (cycles, robots, ...).

    Raises:
        RecordingError, FsmError, MissionError: if the run cannot be read, or replayed here.
    """

    def __init__(self, run: dict[str, Any]) -> None:
        self.name = run["name"]
        self.fsm = parse(run["fsm"], tolerate=lambda _: None)
        try:
            robots = list(run["robots"].values())
            self.poses = _table([np.column_stack([r["x"], r["y"], r["yaw"]]) for r in robots])
            self.commands = _table([np.column_stack([r["vl"], r["vr"]]) for r in robots]) / 100.0
            self.states = _table([r["s0"] for r in robots]).astype(int)
            self.neighbours = _table([r["nn"] for r in robots])
            self.ground = _table([r["ground"] for r in robots])
            self.proximity = _table([[[BEYOND if d is None else d for d in row] for row in r["prox"]] for r in robots])
        except (AttributeError, KeyError, OverflowError, TypeError, ValueError) as error:
            raise RecordingError(f"run '{self.name}': robots: no table of a trace: {error!r}") from None
        n = self.poses.shape[:2]
        for column, found, shape in (
            ("vl, vr", self.commands, (*n, 2)),
            ("s0", self.states, n),
            ("nn", self.neighbours, n),
            ("ground", self.ground, (*n, 3)),
            ("prox", self.proximity, (*n, SENSORS)),
        ):
            if found.shape != shape:
                expected, given = (" x ".join(map(str, each)) for each in (shape, found.shape))
                raise RecordingError(
                    f"run '{self.name}': {column}: expected cycles x robots ... = {expected}, found {given}"
                )
        if not self.poses.size or self.states.min() < 0 or self.states.max() >= len(self.fsm.states):
            raise RecordingError(f"run '{self.name}': s0: expected states of the FSM, 0 to {len(self.fsm.states) - 1}")
        settings = {"n": len(robots), "velocity": 30.0, **run["settings"], "n_robots": len(robots), "length": 1}
        self._mission, model = mission_and_robot(run["mission"], settings)
        self.range = model.reference_model.proximity_range if settings.get("prox_range", 1.0) else 0.0
        self._world = World(self._mission, model)
        self.model = model.reference_model
        self.top_speed = model.drive.maximum_speed
        self._zones = self._floor(run.get("seed"))
        self.knows_floor = self._zones is not None

    def _floor(self, seed: object) -> np.ndarray | None:
        """The zones of the floor. Colours of tiles are not recorded, but follow from the seed as the starts do."""
        instance = self._world.instance(0)
        zones = instance.scene.floor.zones.copy()
        if not any(isinstance(zone, Tiles) for zone in self._mission.floor.zones):
            return zones
        if not isinstance(seed, int) or not 0 < seed < 2**32:
            return None
        _, loop = twisters(seed, self.robots)
        set_scene(self._mission, instance.scene, instance.swarm, loop)
        found, _ = apart(instance.swarm.poses[:, :3], self.poses[0])
        return instance.scene.floor.zones if found.max() < 1e-4 else None

    @property
    def cycles(self) -> int:
        return len(self.poses)

    @property
    def robots(self) -> int:
        return int(self.poses.shape[1])

    def instance(self, shift: np.ndarray | float = 0.0) -> Instance:
        """The recorded start, moved by `shift` (robots, 3)."""
        instance = self._world.instance(0)
        if self._zones is not None:
            instance.scene.floor.zones[:] = self._zones
        put(instance, self.poses[0] + shift)
        return instance


def _table(columns: list[Any]) -> np.ndarray:
    """A column of each robot as finite numbers (cycles, robots, ...)."""
    table = np.stack([np.array(column, dtype=float) for column in columns], axis=1)
    if not np.isfinite(table).all():
        raise ValueError("not all are finite numbers")
    return table


def put(instance: Instance, poses: np.ndarray) -> None:
    """Put the robots at poses (robots, 3)."""
    instance.swarm.poses[:, :3] = poses
    instance.swarm.poses[:, 3] = np.cos(poses[:, 2])
    instance.swarm.poses[:, 4] = np.sin(poses[:, 2])


def drive(trace: Trace, shift: np.ndarray | float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Let the recorded commands drive our robots from the recorded start, moved by `shift` (robots, 3).

    Returns:
        Poses (cycles, robots, 3), and the cycles (2,) in which a robot first touched a wall, and another robot; the
        number of cycles where none ever did.
    """
    instance = trace.instance(shift)
    swarm = instance.swarm
    first = np.full(2, trace.cycles)
    cycle = 0

    def note(arbiter: pymunk.Arbiter, *_: object) -> None:
        kind = int(all(shape.body and shape.body.body_type == pymunk.Body.DYNAMIC for shape in arbiter.shapes))
        first[kind] = min(first[kind], cycle)

    instance.space.on_collision(begin=note)
    found = [swarm.poses[:, :3].copy()]
    for cycle, commands in enumerate(trace.commands[:-1], start=1):  # noqa: B007 - read by `note`
        swarm.commands[:] = commands
        referee_motion(instance)
        put(instance, swarm.poses[:, :3].copy())
        found.append(swarm.poses[:, :3].copy())
    return np.array(found), first


def apart(some: np.ndarray, others: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance [m] and difference of heading [rad] of poses (..., 3)."""
    difference = some - others
    turns = np.abs((difference[..., 2] + math.pi) % (2 * math.pi) - math.pi)
    return np.hypot(difference[..., 0], difference[..., 1]), turns


def copies_apart(trace: Trace, distance: float, copies: int = 8, seed: int = 1) -> np.ndarray:
    """How far apart [m] (copies, cycles, robots) our own robots get if each starts up to `distance` [m] elsewhere."""
    random = np.random.default_rng(seed)
    ours, _ = drive(trace)
    shifts = random.uniform(-distance, distance, (copies, *ours[0].shape)) * (1.0, 1.0, 0.0)
    return np.array([apart(drive(trace, shift)[0], ours)[0] for shift in shifts])


def replay_perception(trace: Trace) -> Iterator[tuple[int, int, Readings, np.ndarray]]:
    """For each recorded robot and cycle our readings there, and our eight distances."""
    instance = trace.instance()
    swarm = instance.swarm
    for cycle in range(len(trace.poses)):
        put(instance, trace.poses[cycle])
        for i in range(len(swarm.poses)):
            readings = compiled(sense)(instance.scene, trace.model, swarm, cycle, i, EVERYTHING)
            distances = np.empty(len(swarm.proximity))
            compiled(cast)(instance.scene, swarm.poses, i, trace.model.proximity_range, distances)
            yield cycle, i, readings, distances


def same_distance(recorded: float, ours: float, furthest: float) -> bool:
    """Whether a proximity reading agrees; poses are recorded to 1e-5, readings to 1e-4."""
    close = 2e-3
    if recorded == BEYOND:
        return ours > furthest - close
    if recorded == NEAR:
        return ours < 0.05 + close
    return abs(ours - recorded) < close or (math.isinf(ours) and recorded > furthest - close)


def agreements(trace: Trace) -> dict[str, tuple[int, int]]:
    """Agreed and all robot-cycles by kind of reading, and of wheel commands of the behaviours."""
    counts = {name: [0, 0] for name in ("proximity", "neighbours", "ground", "wheels")}

    def count(name: str, agreed: bool) -> None:
        counts[name][0] += agreed
        counts[name][1] += 1

    memory = [[0.0] * MEMORY for _ in range(trace.robots)]
    for cycle, i, readings, distances in replay_perception(trace):
        recorded = trace.proximity[cycle, i]
        if trace.range > 0:
            pairs = zip(recorded, distances, strict=True)
            count("proximity", all(same_distance(a, b, trace.range) for a, b in pairs))
        count("neighbours", readings.neighbours == trace.neighbours[cycle, i])
        if trace.knows_floor:
            count(
                "ground",
                (readings.ground_red, readings.ground_green, readings.ground_blue) == tuple(trace.ground[cycle, i]),
            )
        count("wheels", same_wheels(trace, cycle, i, readings, memory[i]))
    return {name: (agreed, total) for name, (agreed, total) in counts.items() if total}


def same_wheels(trace: Trace, cycle: int, i: int, readings: Readings, memory: list[float]) -> bool:
    """Whether the active behaviour, given our readings, commands what was recorded.

    Exploration draws how long it turns: it is given the draw that gives the recorded length.
    """
    number = trace.states[cycle, i]
    if cycle == 0 or number != trace.states[cycle - 1, i]:
        memory[TURN_CYCLES] = memory[TURN_SIDE] = 0.0
    state = trace.fsm.states[number]
    u = 0.0
    if state.behaviour == "exploration":
        turning = 0
        while (
            cycle + 1 + turning < len(trace.commands)
            and trace.states[cycle + 1 + turning, i] == number
            and trace.commands[cycle + 1 + turning, i].min() < 0
        ):
            turning += 1
        u = min(0.999999, (turning + 0.5) / max(1.0, state.parameters[0]))
    wheels = state.module.function(trace.model, readings, (*state.parameters, 0.0), memory, u)
    return bool(np.abs(np.array(wheels) * trace.top_speed - trace.commands[cycle, i]).max() < 2e-3)
