"""Recorded runs, replayed: motion by the recorded commands, perception and behaviours at the recorded poses."""

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pymunk

from benchmarks.argos.recordings import RecordingError, mission_and_robot, shipped_with_original
from benchmarks.argos.repeat import set_scene, twisters
from mercator_design.config.colours import rgb
from mercator_design.fsm import Readings, parse
from mercator_design.jit import compiled
from mercator_design.missions.floor import Tiles
from mercator_design.modules.behaviours import TURN_CYCLES, TURN_SIDE
from mercator_design.modules.reference import EVERYTHING, senses_bits
from mercator_design.sim.kernels.sensing import sense
from mercator_design.sim.kernels.sight import cast
from mercator_design.sim.referee import Referee
from mercator_design.sim.robot_model import RobotModel
from mercator_design.sim.simulate import Simulator
from mercator_design.sim.world import Instance

NEAR, BEYOND = -9.0, 9.0  # how a trace writes minus and plus infinity
SAME_START = 1e-4  # [m]
FAR = 1e3  # [m] beyond all robots that a camera sees


class Trace:
    """One recorded run as arrays: (cycles, robots, ...).

    Args:
        run: As it was recorded.
        files: By name the missions that stand for those of the recording.
        flavour: Of the run's FSM.

    Raises:
        RecordingError, FsmError, MissionError: if the run cannot be read, or replayed here.
    """

    def __init__(
        self, run: dict[str, Any], files: Mapping[str, Path] = MappingProxyType({}), flavour: str = "watermelon"
    ) -> None:
        self.name = run["name"]
        self.fsm = parse(run["fsm"], flavour, tolerate=lambda _: None)
        try:
            robots = list(run["robots"].values())
            self.poses = _table([np.column_stack([r["x"], r["y"], r["yaw"]]) for r in robots])
            self.commands = _table([np.column_stack([r["vl"], r["vr"]]) for r in robots]) / 100.0
            self.states = _table([r["s0"] for r in robots]).astype(int)
            self.neighbours = _table([r["nn"] for r in robots])
            self.ground = _table([r["ground"] for r in robots])
            self.proximity = _table([[[BEYOND if d is None else d for d in row] for row in r["prox"]] for r in robots])
            # Not all recordings have these.
            self.vector = self.blobs = None
            if any({"pv", "pa"} & set(r) for r in robots):
                self.vector = _table([np.column_stack([r["pv"], r["pa"]]) for r in robots])
            if any("blobs" in r for r in robots):
                self.blobs = [[_pairs(row) for row in r["blobs"]] for r in robots]
        except (AttributeError, KeyError, OverflowError, TypeError, ValueError) as error:
            raise RecordingError(f"run '{self.name}': robots: no table of a trace: {error!r}") from None
        settings = {**run["settings"], "n_robots": len(robots)}
        self._original = shipped_with_original(run["mission"], settings, files)
        if self._original:
            settings = {"n": len(robots), "velocity": 30.0, **settings, "length": 1}
        self._mission, model = mission_and_robot(run["mission"], settings, files)
        if drawn := _what_is_drawn(model):
            raise RecordingError(
                f"run '{self.name}': robot model {model.name}: {drawn}: what is drawn is not what was recorded; "
                "expected a robot model without"
            )
        self._simulator = Simulator(self._mission, model)
        self._simulator.check(self.fsm)
        self.model = model.reference_model
        self.range = self.model.proximity_range if settings.get("prox_range", 1.0) else 0.0
        self.nearest = model.proximity.range[0] if model.proximity else 0.0
        self.sensors = model.ground.positions if model.ground else ()
        self.top_speed = model.drive.maximum_speed
        n = self.poses.shape[:2]
        for column, found, shape in (
            ("vl, vr", self.commands.shape, (*n, 2)),
            ("s0", self.states.shape, n),
            ("nn", self.neighbours.shape, n),
            ("ground", self.ground.shape, (*n, 3)),
            ("prox", self.proximity.shape, (*n, len(model.proximity.angles) if model.proximity else 0)),
            ("pv, pa", (*n, 2) if self.vector is None else self.vector.shape, (*n, 2)),
            *(("blobs", (len(rows),), n[:1]) for rows in self.blobs or ()),
        ):
            if found != shape:
                expected, given = (" x ".join(map(str, each)) for each in (shape, found))
                raise RecordingError(
                    f"run '{self.name}': {column}: expected cycles x robots ... = {expected}, found {given}"
                )
        if not self.poses.size or self.states.min() < 0 or self.states.max() >= len(self.fsm.states):
            raise RecordingError(f"run '{self.name}': s0: expected states of the FSM, 0 to {len(self.fsm.states) - 1}")
        self._zones: np.ndarray | None = None
        self.unknown_floor = ""  # why its colours are not known
        try:
            self._zones = self._floor(run.get("seed"))
        except RecordingError as error:
            self.unknown_floor = str(error)

    def _floor(self, seed: object) -> np.ndarray:
        """The zones of the floor.

        Colours of tiles are not recorded. They follow from the seed as the starts do; where these are not the seed's,
        they are what the sensors on a tile have read.

        Raises:
            RecordingError: if they are not known.
        """
        floor = self._mission.floor
        instance = self._simulator.instance(0)
        if floor.dynamics:
            raise RecordingError("the floor changes during the run")
        if not any(isinstance(zone, Tiles) for zone in floor.zones):
            return instance.scene.floor.zones
        if self._original and isinstance(seed, int) and 0 < seed < 2**32:
            _, loop = twisters(seed, self.robots)
            set_scene(self._mission, instance.scene, instance.swarm, loop)
            found, _ = apart(instance.swarm.poses[:, None, :3], self.poses[0])
            if found.min(axis=0).max() < SAME_START and found.min(axis=1).max() < SAME_START:
                return instance.scene.floor.zones
        zones = self._simulator.instance(0).scene.floor.zones
        first = 0
        for zone in floor.zones:
            rows = zones[first : first + (len(zone.centers) if isinstance(zone, Tiles) else 1)]
            if isinstance(zone, Tiles):
                self._colour(rows, zone)
            first += len(rows)
        return zones

    def _colour(self, rows: np.ndarray, tiles: Tiles) -> None:
        """Give tiles the colours that were read on them; those on which no sensor was are left as they are.

        Raises:
            RecordingError: if these are not the colours of such tiles.
        """
        if len(self.sensors) != 1:
            raise RecordingError("tiles of unknown colours, and a robot with more than one ground sensor")
        (ahead, aside), (x, y, heading) = self.sensors[0], np.moveaxis(self.poses, -1, 0)
        places = np.stack(
            [
                x + np.cos(heading) * ahead - np.sin(heading) * aside,
                y + np.sin(heading) * ahead + np.cos(heading) * aside,
            ],
            axis=-1,
        )
        left = Counter({rgb(colour): count for colour, count in tiles.colors.items()})
        for row, center in zip(rows, tiles.centers, strict=True):
            inside = np.abs(places - center).max(axis=-1) < tiles.size / 2.0 - SAME_START
            read = np.unique(self.ground[inside], axis=0)
            if len(read) > 1:
                raise RecordingError(f"{len(read)} colours were read on the tile at ({center[0]:g}, {center[1]:g})")
            if len(read):
                left[tuple(read[0])] -= 1
                row[6:9] = read[0]
        for colour, count in left.items():
            if count < 0:
                read_as = ", ".join(f"{channel:g}" for channel in colour)
                raise RecordingError(f"{-count} tiles more than have that colour were read as ({read_as})")

    @property
    def cycles(self) -> int:
        return len(self.poses)

    @property
    def robots(self) -> int:
        return int(self.poses.shape[1])

    def instance(self, shift: np.ndarray | float = 0.0) -> Instance:
        """The recorded start, moved by `shift` (robots, 3)."""
        instance = self._simulator.instance(0)
        if self._zones is not None:
            instance.scene.floor.zones[:] = self._zones
        put(instance, self.poses[0] + shift)
        return instance


def _what_is_drawn(model: RobotModel) -> str:
    """What of a robot's motion and perception is left to chance; nothing if all follows from its commands and place."""
    chances = ("noise", "weight_noise", "loss")
    parts = ("drive", "proximity", "ground", "neighbours", "light")
    drawn = [f"{part}.{key}" for part in parts for key in chances if getattr(getattr(model, part), key, None)]
    return ", ".join([*drawn, "vary"] if model.vary else drawn)


def _table(columns: list[Any]) -> np.ndarray:
    """A column of each robot as finite numbers (cycles, robots, ...)."""
    return _finite(np.stack([np.array(column, dtype=float) for column in columns], axis=1))


def _pairs(rows: list[list[float]]) -> np.ndarray:
    """Finite numbers (rows, 2)."""
    return _finite(np.array(rows, dtype=float).reshape(len(rows), 2))


def _finite(table: np.ndarray) -> np.ndarray:
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

    referee = Referee(instance.scene, swarm)
    referee.space.on_collision(begin=note)
    found = [swarm.poses[:, :3].copy()]
    for cycle, commands in enumerate(trace.commands[:-1], start=1):  # noqa: B007 - read by `note`
        swarm.commands[:] = commands
        referee.move()
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


@dataclass(frozen=True, slots=True)
class Perceived:
    """What a robot perceives here, at a recorded place."""

    readings: Readings
    distances: np.ndarray  # (sensors,) of proximity [m]
    blobs: np.ndarray  # (robots seen, 2) distance [m] and bearing [rad]


def replay_perception(trace: Trace) -> Iterator[tuple[int, int, Perceived]]:
    """For each recorded cycle and robot what it perceives here."""
    instance = trace.instance()
    swarm = instance.swarm
    all_count = trace.model._replace(neighbour_range=FAR)
    for cycle in range(len(trace.poses)):
        put(instance, trace.poses[cycle])
        for i in range(len(swarm.poses)):
            seen = compiled(sense)(instance.scene, all_count, swarm, cycle, i, senses_bits({"neighbours"}))
            n = int(seen.neighbours)
            bearings = np.arctan2(swarm.bearings_y[:n], swarm.bearings_x[:n])
            blobs = np.column_stack([swarm.distances[:n], bearings])
            readings = compiled(sense)(instance.scene, trace.model, swarm, cycle, i, EVERYTHING)
            distances = np.empty(len(swarm.proximity))
            compiled(cast)(instance.scene, swarm.poses, i, trace.model.proximity_range, distances)
            yield cycle, i, Perceived(readings, distances, blobs)


def same_distance(recorded: float, ours: float, nearest: float, furthest: float) -> bool:
    """Whether a proximity reading agrees; poses are recorded to 1e-5, readings to 1e-4."""
    close = 2e-3
    if recorded == BEYOND:
        return ours > furthest - close
    if recorded == NEAR:
        return ours < nearest + close
    return abs(ours - recorded) < close or (math.isinf(ours) and recorded > furthest - close)


def same_vector(recorded: np.ndarray, readings: Readings) -> bool:
    """Whether length and angle (2,) of a proximity vector agree; both are recorded to 1e-4.

    Rays that graze something magnify the rounding of poses, to some 5e-4.
    """
    length, angle = recorded
    off = (readings.proximity_x - length * math.cos(angle), readings.proximity_y - length * math.sin(angle))
    return math.hypot(*off) < 1e-3


def same_blobs(recorded: np.ndarray, ours: np.ndarray) -> bool:
    """Whether the robots seen (robots, 2) are the same, in any order.

    Args:
        recorded: Distances [cm], to 1e-2, and bearings [rad], to 1e-4, of poses to 1e-5.
        ours: Distances [m] and bearings [rad].
    """
    if recorded.shape != ours.shape:
        return False
    distances = np.abs(recorded[:, None, 0] / 100.0 - ours[:, 0])
    bearings = np.abs((recorded[:, None, 1] - ours[:, 1] + math.pi) % (2 * math.pi) - math.pi)
    same = (distances < 1e-4) & (bearings < 1e-4 + 2e-5 / ours[:, 0])
    return bool(same.any(axis=0).all() and same.any(axis=1).all())


READINGS = ("proximity", "vector", "neighbours", "blobs", "ground", "wheels")


def agreements(trace: Trace) -> dict[str, tuple[int, int]]:
    """Agreed and all robot-cycles by kind of READINGS, the last of which are wheel commands of the behaviours.

    Proximity vectors and blobs count where there, or here, an obstacle or a robot is seen.
    """
    counts = {name: [0, 0] for name in READINGS}

    def count(name: str, agreed: bool) -> None:
        counts[name][0] += agreed
        counts[name][1] += 1

    memory = [[0.0] * 2 for _ in range(trace.robots)]
    for cycle, i, perceived in replay_perception(trace):
        readings = perceived.readings
        recorded = trace.proximity[cycle, i]
        if trace.range > 0:
            pairs = zip(recorded, perceived.distances, strict=True)
            count("proximity", all(same_distance(a, b, trace.nearest, trace.range) for a, b in pairs))
            if trace.vector is not None and (trace.vector[cycle, i, 0] or readings.proximity_x or readings.proximity_y):
                count("vector", same_vector(trace.vector[cycle, i], readings))
        count("neighbours", readings.neighbours == trace.neighbours[cycle, i])
        if trace.blobs is not None and (len(trace.blobs[i][cycle]) or len(perceived.blobs)):
            count("blobs", same_blobs(trace.blobs[i][cycle], perceived.blobs))
        if not trace.unknown_floor:
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
    wheels = state.module.function(trace.model, readings, memory, u, *state.parameters)
    return bool(np.abs(np.array(wheels[:2]) * trace.top_speed - trace.commands[cycle, i]).max() < 2e-3)
