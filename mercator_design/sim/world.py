"""Makes instances: the floor, starting poses and random streams of a seed.

staging.py makes the part that is equal in all instances of a mission.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from mercator_design.arrays import Floats, Keys, Numbers
from mercator_design.errors import MissionError
from mercator_design.jit import compiled
from mercator_design.missions.arena import WALL_THICKNESS
from mercator_design.missions.mission import Mission
from mercator_design.missions.placement import FixedPlacement, candidates
from mercator_design.missions.walls import WallTable, walls_above
from mercator_design.seeds import generator, stream_keys
from mercator_design.sim.kernels.scene import Scene
from mercator_design.sim.kernels.swarm import Swarm, new_swarm
from mercator_design.sim.placing import first_free
from mercator_design.sim.robot_model import RobotModel
from mercator_design.sim.staging import new_scene, wall_slabs

_MAX_TRIALS_OF_ROBOT = 1000  # poses tried for one robot before all are placed again, as in the original
_MAX_TRIALS = 300_000  # poses tried in all: half a second
_BATCH = 20  # poses tried at a time


_STARTS = 256
"""Instances whose starts are kept: a race runs all its configurations on the same ones."""


@dataclass(frozen=True, slots=True)
class Start:
    """What is drawn for an instance; nothing changes it."""

    scene: Scene
    poses: Floats  # (robots, 3)
    control_keys: Keys  # (robots,)
    noise_keys: Keys


@dataclass(frozen=True, slots=True)
class Instance:
    """An instance for one run. The run changes it: robots move, and the floor may change."""

    robot_model: RobotModel
    start: Scene  # with a floor that the run does not change
    scene: Scene
    swarm: Swarm
    zone_rows: dict[str, tuple[int, ...]]
    walls: WallTable  # higher than the lidars; none if there are no lidars


class World:
    """Makes the instances of a mission with a robot model.

    Raises:
        MissionError: if the robots do not fit.
    """

    def __init__(self, mission: Mission, robot_model: RobotModel) -> None:
        self.mission = mission
        self.robot_model = robot_model
        # Cycles are divided evenly.
        self._sub_steps = math.ceil(mission.control_period / robot_model.physics.time_step - 1e-9)
        self._scene = new_scene(mission, robot_model, self._sub_steps)
        self._waiting = _places_of(np.array(mission.placement.waiting[: mission.robots], dtype=float).reshape(-1, 3))
        self._zone_rows = mission.floor.zone_rows()
        self._walls = walls_above(mission.arena, math.inf if robot_model.lidar is None else robot_model.lidar.height)
        self._start = lru_cache(_STARTS)(self._draw_start)
        self._check_room()
        self._check_steps()
        self._check_walls()

    def _check_room(self) -> None:
        mission, body = self.mission, self.robot_model.body
        needed = mission.robots * body.area
        if needed > mission.arena.area:
            raise MissionError(
                f"{mission.where('robots')}: the robots do not fit: {mission.robots} of them need {needed:.2f} m2; "
                f"the arena has {mission.arena.area:.2f} m2"
            )

    def _check_steps(self) -> None:
        """Check the time step: Chipmunk separates bodies correctly only if they overlap by less than half."""
        model = self.robot_model
        travel = model.fastest * self.mission.control_period / self._sub_steps
        if travel > 0.5 * min(model.body.half_size):
            raise MissionError(
                f"{model.where('physics.time_step')}: a corner travels {travel:.3f} m in a step, too far to "
                "meet walls and robots reliably; expected a smaller step"
            )

    def _check_walls(self) -> None:
        """Check that no outer wall, with its thickness, extends into another part of the arena."""
        slabs = wall_slabs(self._scene.walls)
        just_within = 1e-6 * slabs.mean(axis=1, keepdims=True) + (1.0 - 1e-6) * slabs
        outer = just_within[:, 2:].reshape(-1, 2)
        for x, y in outer[self.mission.arena.contains(outer)][:1]:
            raise MissionError(
                f"{self.mission.where('arena.walls')}: the wall is less than {WALL_THICKNESS:g} m thick, or too sharp, "
                f"near [{x:.3g}, {y:.3g}]; use arena.obstacles for walls inside the arena"
            )

    def instance(self, seed: int) -> Instance:
        start = self._start(seed)
        floor = start.scene.floor.copy()
        scene = start.scene if floor is start.scene.floor else start.scene._replace(floor=floor)
        swarm = new_swarm(
            scene,
            self.robot_model.reference_model,
            start.poses,
            control_keys=start.control_keys,
            noise_keys=start.noise_keys,
        )
        return Instance(self.robot_model, start.scene, scene, swarm, self._zone_rows, self._walls)

    def _draw_start(self, seed: int) -> Start:
        n = self.mission.robots
        floor = self.mission.realise_floor(generator(seed, "floor"))
        return Start(
            scene=self._scene._replace(floor=floor, stops=self._stops(seed)),
            poses=self._places(generator(seed, "placement"), seed),
            control_keys=stream_keys(seed, "control", n),
            noise_keys=stream_keys(seed, "noise", n),
        )

    def _stops(self, seed: int) -> Numbers:
        """The first cycle in which each robot does not work; that after the last if it always does."""
        mission, failures = self.mission, self.robot_model.failures
        if failures is None:
            return self._scene.stops
        times = failures.times(generator(seed, "failures"), mission.robots, mission.cycles * mission.control_period)
        return np.minimum(times / mission.control_period + 1e-9, mission.cycles).astype(np.int64)

    def _places(self, random: np.random.Generator, seed: int) -> Floats:
        """Poses (robots, 3) where the robots touch neither a wall nor each other."""
        mission, body = self.mission, self.robot_model.body
        trials = best = 0
        while trials < _MAX_TRIALS:
            placed = np.empty((mission.robots, 5))
            for i in range(mission.robots):
                found, tried = self._place(random, placed, i)
                trials += tried
                if found is None or trials > _MAX_TRIALS:
                    break
                placed[i] = found
            else:
                return placed[:, [0, 1, 4]]
            best = max(best, i)
            if isinstance(mission.placement, FixedPlacement):
                raise MissionError(
                    f"{mission.where(f'placement.poses[{i}]')}: a robot there touches a wall, a box or another robot"
                )
        raise MissionError(
            f"{mission.where('placement')}: the robots do not fit: at seed {seed}, {best} of {mission.robots} found "
            f"a free place of {body.measures} within the placement; use fewer robots, or a larger arena or placement"
        )

    def _place(self, random: np.random.Generator, placed: Floats, i: int) -> tuple[Floats | None, int]:
        """A free place (5,) for robot i (x, y, cosine and sine of the heading, heading), and the number of trials."""
        scene, placement = self._scene, self.mission.placement
        batches = 1 if isinstance(placement, FixedPlacement) else _MAX_TRIALS_OF_ROBOT // _BATCH
        others = np.vstack([placed[:i], self._waiting[i + 1 :]])
        for batch in range(1, batches + 1):
            places = _places_of(candidates(placement, random, i, _BATCH))
            k = compiled(first_free)(
                places, others, scene.walls, scene.boxes, scene.half_length, scene.half_width, scene.round
            )
            if k >= 0:
                return places[k], batch * _BATCH
        return None, batches * _BATCH


def _places_of(poses: Floats) -> Floats:
    """Poses (n, 3) for the kernels (n, 5): x, y, cosine and sine of the heading, heading."""
    headings = poses[:, 2:]
    return np.hstack([poses[:, :2], np.cos(headings), np.sin(headings), headings])
