"""The twin's arena: that of a mission. The treads move the robots, and the simulator's devices measure.

A tick is a step of the physics. Devices that compare two times, such as the gyroscope, compare the ends of a control
cycle of the mission, as in the simulator.
"""

import dataclasses
import functools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from mercator_design.arrays import Floats, Keys
from mercator_design.errors import MissionError
from mercator_design.jit import compiled, jit_wanted
from mercator_design.missions.dynamics import change_floor
from mercator_design.missions.mission import Mission
from mercator_design.missions.plugins import changes_of
from mercator_design.plugins.places import reporting_kernels
from mercator_design.robot.devices.settings import Limits
from mercator_design.robot.protocols.multiflex import SENSORS
from mercator_design.robot.protocols.ydlidar import encode_command
from mercator_design.sim.devices import PARTS, Recording
from mercator_design.sim.kernels.chipmunk import Space
from mercator_design.sim.kernels.kernel import move, note_poses
from mercator_design.sim.kernels.lidar import scan
from mercator_design.sim.kernels.noise import NO_NOISE, WHEELS_DRAWS, noise
from mercator_design.sim.kernels.scene import Scene
from mercator_design.sim.kernels.sensing import drift
from mercator_design.sim.kernels.swarm import Swarm, new_history
from mercator_design.sim.referee import Referee
from mercator_design.sim.robot_model import RobotModel
from mercator_design.sim.simulate import Simulator
from mercator_design.twin.devices.drive import Treads
from mercator_design.twin.devices.lidar import FINE, TwinLidar

MEASURED = (
    "ground_sensors",
    "ambient_light",
    "velocity",
    "accelerometer",
    "gyroscope",
    "imu",
    "locator",
    "quaternion",
    "proximity",
)
"""Devices of the simulator that the twin uses, beside the lidar."""
_DRIFTING = ("imu", "locator", "quaternion")
TREADS = "treads"
"""Name of a measurement: the distance that each tread has gone [m]."""
_LOOKS_BACK = 2  # cycles
_PER_SECOND = 1000  # numbers of noise of the lidar, more than it sends packets


class TwinArena:
    """The arena of an instance of a mission, with robots at rest.

    period: Duration of a tick [s].
    ticks: Ticks since the start.
    cycle: Ticks in a control cycle.
    samples: Samples in a turn of a lidar.
    """

    def __init__(self, mission: Mission, robot_model: RobotModel, seed: int) -> None:
        """Place the robots.

        Raises:
            MissionError: if they do not fit, or lack a device of a Mercator.
        """
        missing = [part for part in ("lidar", *MEASURED) if getattr(robot_model, PARTS[part]) is None]
        if robot_model.lidar is None or missing:
            lacking = ", ".join(PARTS[part] for part in missing)
            raise MissionError(f"robot model {robot_model.name}: a twin needs all devices; missing: {lacking}")
        if robot_model.proximity is not None and len(robot_model.proximity.angles) != SENSORS:
            found = len(robot_model.proximity.angles)
            raise MissionError(f"robot model {robot_model.name}: a hub has {SENSORS} proximity sensors, found {found}")
        fine = dataclasses.replace(robot_model.lidar, beams=FINE * robot_model.lidar.beams, first_angle=0.0)
        instance = Simulator(mission, dataclasses.replace(robot_model, lidar=fine)).instance(seed)
        scene = instance.scene._replace(sub_steps=1)
        cycle, n = instance.scene.sub_steps, mission.robots
        self.robot_model = instance.robot_model
        self.samples, self.robots = robot_model.lidar.beams, n
        self.period, self.ticks = scene.time_step, 0
        self.cycle, self._scene, self._swarm = cycle, scene, instance.swarm
        still = scene.floor._replace(changes=scene.floor.changes[:0])
        self._still = scene._replace(floor=still, motion=scene.motion._replace(drifts=False))
        self._space = Space(scene.physics, n) if jit_wanted() else None  # lives as long as the bridge to it
        self._move: Callable[[], None] = (
            Referee(scene, self._swarm).move
            if self._space is None
            else functools.partial(compiled(move), self._space.bridge, scene, self._swarm)
        )
        self._dynamics = [each.name for each in mission.floor.dynamics]
        self._start = self._swarm.poses[:, :3].copy()
        self._latest = new_history(_LOOKS_BACK * cycle, n, everything=False)  # a ring buffer
        self._latest.poses[:] = self._start
        self._by_odometry = self._latest.poses.copy()  # the same by locator and imu, which may drift
        self._drifted = np.zeros((n, 3))
        self._driven = np.zeros((len(self._latest.poses), n, 2))
        self._ways = np.zeros((n, 2))
        self._placed, self._scanned = np.zeros((n, 5)), np.zeros(fine.beams)
        self._measured: dict[str, Floats] = {TREADS: self._ways}
        compiled(note_poses)(self._swarm, self._latest, 0)

    @property
    def poses(self) -> Floats:
        """The poses of the robots (robots, 3): x, y [m], heading [rad]."""
        poses: Floats = self._swarm.poses[:, :3]
        return poses

    def rehearse(self) -> None:
        """Run a control cycle with all devices: it compiles what is not compiled yet, so no later cycle is late."""
        for _ in range(self.cycle):
            self.step([(0.0, 0.0)] * self.robots)
        for device in MEASURED:
            self.measure(0, device)
        lidar = TwinLidar(functools.partial(self.scan, 0), samples=self.samples)
        lidar.set_motor(on=True, now=-1.0)
        lidar.receive(encode_command("scan"), now=0.0)
        lidar.advance(1.0 / self.samples)

    def step(self, treads: Sequence[Treads]) -> None:
        """Run one tick with these speeds of the robots' treads."""
        swarm, row = self._swarm, (self.ticks + 1) % len(self._latest.poses)
        swarm.commands[:] = treads
        if self._scene.wheel_noise[0] != NO_NOISE:
            compiled(_disturb)(self._scene, swarm, self.ticks // self.cycle)
        self._driven[row] = swarm.commands
        before = swarm.poses.copy()
        self._move()
        compiled(note_poses)(swarm, self._latest, row)
        self._by_odometry[row] = self._measured_poses(before)
        moved = swarm.poses - before
        ahead = before[:, 3] * moved[:, 0] + before[:, 4] * moved[:, 1]
        aside = 0.5 * self._scene.tread_distance * moved[:, 2]
        self._ways += np.column_stack([ahead - aside, ahead + aside])
        self.ticks += 1
        if self.ticks % self.cycle == 0:
            with reporting_kernels(changes_of(self._dynamics)):
                compiled(change_floor)(self._scene.floor, self._latest.poses[row], self.ticks * self.period)
        self._measured = {TREADS: self._ways}

    def measure(self, robot: int, device: str) -> Sequence[float]:
        """The measurement of a robot's device, TREADS or one of MEASURED, in its units, with y forwards."""
        if device not in self._measured:
            self._measured[device] = self._measure(device)
        values: list[float] = self._measured[device][robot].tolist()
        return values

    def scan(self, robot: int, time: float) -> tuple[Floats, float]:
        """FINE ranges [m] around a robot for each sample of its lidar, at a time [s] in the last control cycles.

        Returns:
            The ranges, 0 if nothing is in range, which the next call changes; how fast the robot turns [rad/s].
        """
        rows = len(self._latest.poses)
        tick = max(self.ticks - rows + 1.0, min(float(self.ticks), time / self.period))
        before = max(min(math.floor(tick), self.ticks - 1), self.ticks - rows + 1)
        poses, later = self._latest.poses[before % rows], self._latest.poses[(before + 1) % rows]
        self._placed[:, :3] = poses + (tick - before) * (later - poses)
        number = round(_PER_SECOND * time)
        compiled(_scan)(self._scene, self._swarm, self._placed, robot, number, self._scanned)
        return self._scanned, float(later[robot, 2] - poses[robot, 2]) / self.period

    def _measured_poses(self, before: Floats) -> Floats:
        """The poses by locator and imu, given the poses before the tick."""
        poses: Floats = self._swarm.poses[:, :3]
        if not self._scene.motion.drifts:
            return poses
        scene = self._scene._replace(control_period=self.period)
        compiled(_drift)(scene, before, self._swarm.poses, self._swarm.noise_keys, self.ticks, self._drifted)
        return np.column_stack([self._start[:, :2] + self._drifted[:, :2], poses[:, 2] + self._drifted[:, 2]])

    def _measure(self, device: str) -> Floats:
        rows = [(self.ticks - age * self.cycle) % len(self._latest.poses) for age in range(_LOOKS_BACK, -1, -1)]
        history = new_history(len(rows), self.robots, everything=True)
        history.poses[0] = self._start
        history.poses[1:] = (self._by_odometry if device in _DRIFTING else self._latest.poses)[rows]
        history.commands[:-1] = self._driven[rows[1:]]  # a command moves the treads one cycle later
        keys = self._swarm.noise_keys + np.uint64(self.ticks)  # other noise in each tick
        recording = Recording(self.robot_model, self._still, history, keys, self.cycle * self.period)
        (measured,) = recording.measure(device, every=len(rows))
        if getattr(getattr(self.robot_model, device, None), "forward", "y") == "x":
            measured[:, :2] = np.column_stack([-measured[:, 1], measured[:, 0]])
        rows_of_robots: Floats = measured.reshape(self.robots, -1)
        return rows_of_robots


def dark_limit(robot_model: RobotModel) -> float | None:
    """`limits.dark` of its robots: without noise, black floors read 0, 0, 0 all the time, as with the lamp off."""
    return Limits().dark if robot_model.ground is not None and robot_model.ground.noise is not None else None


def without_noise(part: Any) -> Any:  # noqa: ANN401 - a robot model, or whatever is in one
    """A robot model without noise and losses."""
    if not dataclasses.is_dataclass(part) or isinstance(part, type):
        return part
    quiet = {"noise": None, "weight_noise": None, "loss": 0.0}
    values = {field.name: getattr(part, field.name) for field in dataclasses.fields(part)}
    return dataclasses.replace(part, **{name: quiet.get(name, without_noise(value)) for name, value in values.items()})


def _disturb(scene: Scene, swarm: Swarm, cycle: int) -> None:
    """Add the drive's noise to the commands of a cycle."""
    for i in range(len(swarm.commands)):
        for side in range(2):
            part = noise(scene.wheel_noise, swarm.noise_keys[i], WHEELS_DRAWS, 2 * cycle + side)
            swarm.commands[i, side] += swarm.commands[i, side] * part


def _drift(scene: Scene, before: Floats, after: Floats, keys: Keys, cycle: int, odometry: Floats) -> None:
    for i in range(len(odometry)):
        drift(scene, before, after, keys[i], cycle, i, odometry)


def _scan(scene: Scene, swarm: Swarm, poses: Floats, i: int, number: int, found: Floats) -> None:
    """A turn of robot i at poses (robots, 5), whose cosines and sines are computed here; with noise of a number."""
    for j in range(len(poses)):
        poses[j, 3], poses[j, 4] = math.cos(poses[j, 2]), math.sin(poses[j, 2])
    scan(scene, poses, i, swarm.noise_keys[i], number, found, swarm.hits, swarm.covered)
