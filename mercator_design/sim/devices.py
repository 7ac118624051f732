"""Measurements of the robot's devices in an experiment, computed afterwards from the robots' poses.

No module reads these raw values, so an experiment does not keep them; they are computed on demand. Noise is a function
of device, cycle and value (noise.py), so a value computed later equals the value at that time. Values that modules read
in another form come from the kernels of the experiment.
Sources: the Mercator paper, sections 4.2 and 4.3; where it is silent or differs, the plugin argos3-rvr.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from mercator_design.arrays import Floats, Keys, Numbers
from mercator_design.errors import SimulationError
from mercator_design.jit import compiled
from mercator_design.missions.trace import every_nth
from mercator_design.modules.reference import LED_COLOURS, Readings
from mercator_design.sim.kernels.measuring import (
    add_noise,
    fill_clusters,
    fill_directions,
    fill_drift,
    fill_ground,
    fill_lidar,
    fill_lux,
    fill_places,
    fill_proximity,
    fill_ring,
)
from mercator_design.sim.kernels.noise import (
    ACCELEROMETER_DRAWS,
    AMBIENT_LIGHT_DRAWS,
    GYROSCOPE_DRAWS,
    IMU_DRAWS,
    LOCATOR_DRAWS,
    NO_NOISE,
    PROXIMITY_DRAWS,
    QUATERNION_DRAWS,
    VELOCITY_DRAWS,
)
from mercator_design.sim.kernels.scene import Scene
from mercator_design.sim.kernels.swarm import History, Swarm, new_swarm
from mercator_design.sim.robot_model import RobotModel
from mercator_design.sim.robot_parts import (
    AmbientLight,
    DeviceWithAxes,
    Drive,
    Ground,
    Leds,
    Lidar,
    LidarNeighbours,
    LightCamera,
    LightRing,
    MotionSensor,
    Neighbours,
    Proximity,
)
from mercator_design.sim.staging import noise_row

MAX_SIZE = 2048
"""[MiB] of a recording: a larger one could fill the memory."""

_GRAVITY = 9.81  # [m/s2] the paper's value, by which it converts accelerations to g


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """One experiment, with the values of its devices: `recording.measure("imu")`."""

    robot_model: RobotModel  # with the constants of the flavour
    scene: Scene  # with the floor of the start
    history: History
    noise_keys: Keys  # (robots,)
    control_period: float  # [s]
    sets: frozenset[str] = frozenset()  # the outputs that modules of the control software set
    part_colours: tuple[int, ...] = ()  # of the control software: of each part the number of its colour; -1: dark

    def __repr__(self) -> str:
        cycles, robots = self.history.states.shape
        return f"<Recording of {robots} {self.robot_model.name} in {cycles} cycles of {self.control_period:g} s>"

    def measure(self, name: str, every: int = 1) -> Floats:
        """The values of a device at the end of every n-th cycle, and of the last.

        Args:
            name: One of DEVICES.
            every: The n; 1 for all cycles.

        Returns:
            (cycles, robots, ...) as documented at the device's function in this file.

        Raises:
            SimulationError: if the robot has no such device, or the device needs an experiment that was recorded, or
                `every` is below 1, or the result would be larger than MAX_SIZE.
        """
        return self.measure_at(name, every_nth(len(self.history.states), every))

    def measure_at(self, name: str, cycles: Numbers) -> Floats:
        """The values of a device in some cycles, by their numbers from 0; errors are those of `measure`."""
        check_size(name, len(cycles) * self.values(name))
        return self._measured(name, cycles)

    def values(self, name: str) -> int:
        """The number of values of a device in one cycle; errors are those of `measure`."""
        return self._measured(name, every_nth(len(self.history.states), 1)[:1]).size

    def _measured(self, name: str, cycles: Numbers) -> Floats:
        if name not in DEVICES:
            raise SimulationError(f"expected a device: {', '.join(DEVICES)}, found '{name}'")
        sensor = getattr(self.robot_model, PARTS[name])
        if sensor is None or (name == "light_sensors" and isinstance(sensor, LightCamera)):
            raise SimulationError(f"robot {self.robot_model.name} has no {name.replace('_', ' ')}")
        with np.errstate(over="ignore"):  # plain Python warns where a draw's arithmetic wraps around, as it should
            return DEVICES[name](self, sensor, cycles)

    @property
    def headings(self) -> Floats:
        """(cycles + 1, robots) [rad], not limited to one turn; row 0 is the start."""
        return self.history.poses[..., 2]

    def recorded(self, name: str) -> Floats:
        """A part of the history that exists only if the experiment was recorded."""
        found: Floats = getattr(self.history, name)
        if len(found) < len(self.history.states):
            raise SimulationError("this device can only be read of an experiment that was recorded (record=True)")
        return found


def check_size(what: str, values: int) -> None:
    """Check that a recording of this number of values is not too large.

    Raises:
        SimulationError: with the size, and what to change.
    """
    size = math.ceil(values * 8 / 2**20)
    if size > MAX_SIZE:
        raise SimulationError(
            f"{what}: a recording of {size} MiB, expected at most {MAX_SIZE} MiB; "
            "record fewer devices, fewer of the cycles (every), fewer robots or a shorter duration"
        )


DEVICES: dict[str, Callable[[Recording, Any, Numbers], Floats]] = {}
"""The devices that can be read, by name."""

PARTS: dict[str, str] = {}
"""For each device, the key of the robot model that it belongs to."""

_D = TypeVar("_D", bound=Callable[..., Floats])


def _device(part: str = "") -> Callable[[_D], _D]:
    """Enter a function in DEVICES, and in PARTS with a key of the robot model; by default the function's name."""

    def enter(function: _D) -> _D:
        DEVICES[function.__name__] = function
        PARTS[function.__name__] = part or function.__name__
        return function

    return enter


@_device("drive")
def wheels(recording: Recording, _drive: Drive, cycles: Numbers) -> Floats:
    """Speed of the left and right tread [m/s], with the drive's noise, as set at the end of each cycle."""
    return recording.recorded("commands")[cycles]


@_device()
def leds(recording: Recording, lamps: Leds, cycles: Numbers) -> Floats:
    """Red, green, blue of each lamp (cycles, robots, lamps, 3), 0 to 255.

    The lamps show what modules set, off at first; if none of the control software sets them, the state.
    """
    history, colours = recording.history, [(*lamps.colors, (0, 0, 0))[k] for k in (*recording.part_colours, -1)]
    numbers = np.where(history.led_colours == 0, -1, history.states)  # where no module sets them, failed robots have 0
    if "led_colour" in recording.sets:
        numbers, colours = np.maximum(history.led_colours, 0), [*LED_COLOURS.values()]
    return np.repeat(np.array(colours, dtype=float)[numbers[cycles], np.newaxis], len(lamps.positions), axis=2)


@_device()
def ground(recording: Recording, _sensors: Ground, cycles: Numbers) -> Floats:
    """Red, green, blue of the ground, 0 to 255: the mean of the sensors, its label, or the result of their vote."""
    return recording.recorded("readings")[cycles][..., _columns("ground_red", "ground_green", "ground_blue")]


@_device("ground")
def ground_sensors(recording: Recording, sensors: Ground, cycles: Numbers) -> Floats:
    """Red, green, blue of each sensor (cycles, robots, sensors, 3), 0 to 255; all equal if the sensor is `gray`."""
    found = np.zeros((len(cycles), len(recording.noise_keys), len(sensors.positions), 3))
    scene = recording.scene._replace(floor=recording.scene.floor.copy())
    poses = _placed(recording, np.arange(cycles.max(initial=-1) + 1))  # all, because the floor may change in each
    compiled(fill_ground)(scene, _scratch(recording), poses, cycles, found)
    return found


@_device()
def neighbours(recording: Recording, _sensor: object, cycles: Numbers) -> Floats:
    """The number of neighbours, and the vector to them, forwards and to the left, as controllers read them."""
    return recording.recorded("readings")[cycles][..., _columns("neighbours", "neighbours_x", "neighbours_y")]


@_device("neighbours")
def neighbour_places(recording: Recording, sensor: Neighbours | LidarNeighbours, cycles: Numbers) -> Floats:
    """Distance [m] and bearing [rad] of each neighbour perceived in a cycle; NaN where there is none.

    With a camera (cycles, robots, robots, 2): robot j is in row j. With the lidar (cycles, robots, clusters, 2): the
    clusters are in the order of their beams, and the rows after the last one are NaN.
    """
    scene, model, robots = recording.scene, recording.robot_model.reference_model, len(recording.noise_keys)
    if isinstance(sensor, LidarNeighbours):
        scans = lidar(recording, None, cycles)
        found = np.full((len(cycles), robots, int(scans.shape[2] / max(1.0, model.cluster_points)), 2), np.nan)
        compiled(fill_clusters)(scene, model, _scratch(recording), scans, found)
        return found
    found = np.full((len(cycles), robots, robots, 2), np.nan)
    # With a memory of one cycle, sense_robots writes where each robot is.
    scratch = _scratch(recording)._replace(heard=np.zeros((robots, robots, 1, 3)))
    compiled(fill_places)(scene, model, scratch, _placed(recording, cycles), cycles, found)
    return found


@_device()
def light(recording: Recording, _sensor: object, cycles: Numbers) -> Floats:
    """The vector to the light, forwards and to the left, as controllers read it."""
    return recording.recorded("readings")[cycles][..., _columns("light_x", "light_y")]


@_device("light")
def light_sensors(recording: Recording, ring: LightRing, cycles: Numbers) -> Floats:
    """The reading of each sensor of the ring (cycles, robots, sensors), 0 to 1."""
    return _ring(recording, len(ring.angles), cycles, of_light=True)


@_device()
def proximity(recording: Recording, sensors: Proximity, cycles: Numbers) -> Floats:
    """Distances (cycles, robots, sensors) [m]; minus infinity if too near, infinity if nothing is in range (4.2.9)."""
    nearest, furthest = sensors.range
    found = np.zeros((len(cycles), len(recording.noise_keys), len(sensors.angles)))
    compiled(fill_proximity)(recording.scene, _placed(recording, cycles), furthest, found)
    hit = (found >= nearest) & (found <= furthest)
    disturbed = _disturbed(recording, noise_row(sensors.noise), PROXIMITY_DRAWS, cycles, found)
    return np.where(hit, np.clip(disturbed, 0.0, None), np.where(found < nearest, -np.inf, np.inf))


@_device("proximity")
def proximity_weights(recording: Recording, sensors: Proximity, cycles: Numbers) -> Floats:
    """The weight of each sensor's reading (cycles, robots, sensors): the value of an infra-red sensor."""
    return _ring(recording, len(sensors.angles), cycles, of_light=False)


@_device()
def lidar(recording: Recording, _sensor: object, cycles: Numbers) -> Floats:
    """Distances (cycles, robots, beams) [m]; 0 where nothing is in range (4.2.10)."""
    found = np.zeros((len(cycles), len(recording.noise_keys), len(recording.scene.lidar.beams_x)))
    compiled(fill_lidar)(recording.scene, _scratch(recording), _placed(recording, cycles), cycles, found)
    return found


@_device("lidar")
def lidar_points(recording: Recording, sensor: Lidar, cycles: Numbers) -> Floats:
    """The end of each beam in the world (cycles, robots, beams, 2) [m]; NaN where nothing is in range."""
    distances = lidar(recording, sensor, cycles)[..., np.newaxis]
    beams = np.stack([recording.scene.lidar.beams_x, recording.scene.lidar.beams_y], axis=1)
    poses = _placed(recording, cycles)[:, :, np.newaxis]
    c, s = poses[..., 3], poses[..., 4]
    directions = np.stack([c * beams[:, 0] - s * beams[:, 1], s * beams[:, 0] + c * beams[:, 1]], axis=-1)
    ends = poses[..., :2] + (sensor.ring_radius + distances) * directions
    return np.where(distances > 0.0, ends, np.nan)


@_device()
def ambient_light(recording: Recording, sensor: AmbientLight, cycles: Numbers) -> Floats:
    """Brightness (cycles, robots, 1) [lux], the sum over visible lights; it depends on distance and intensity."""
    found = np.zeros((len(cycles), len(recording.noise_keys), 1))
    law = (sensor.height, sensor.base, sensor.decay, sensor.reach)
    compiled(fill_lux)(recording.scene, _placed(recording, cycles), *sensor.position, law, found)
    return _finished(recording, sensor, AMBIENT_LIGHT_DRAWS, cycles, found)


@_device()
def velocity(recording: Recording, sensor: DeviceWithAxes, cycles: Numbers) -> Floats:
    """Commanded velocity in the frame of the starting pose (eqs. 3-5) [m/s]; one axis points forwards."""
    return _finished(recording, sensor, VELOCITY_DRAWS, cycles, _velocities(recording, sensor)[cycles])


@_device()
def accelerometer(recording: Recording, sensor: DeviceWithAxes, cycles: Numbers) -> Floats:
    """Change of that velocity over a cycle along x and y, and gravity along z (eqs. 6-9) [g]."""
    moved = _velocities(recording, sensor)
    changes = np.diff(moved, axis=0, prepend=0.0) / (recording.control_period * _GRAVITY)
    upright = np.concatenate([changes, np.ones((*changes.shape[:2], 1))], axis=2)
    return _finished(recording, sensor, ACCELEROMETER_DRAWS, cycles, upright[cycles])


@_device()
def gyroscope(recording: Recording, sensor: MotionSensor, cycles: Numbers) -> Floats:
    """Angular velocity about x, y and z over a cycle (eqs. 10-11) [rad/s]; the floor is level."""
    turns = np.diff(recording.headings, axis=0) / recording.control_period
    return _finished(recording, sensor, GYROSCOPE_DRAWS, cycles, _about_z(turns)[cycles])


@_device()
def imu(recording: Recording, sensor: MotionSensor, cycles: Numbers) -> Floats:
    """Pitch, roll and yaw in the world's frame [rad], yaw from -pi to pi."""
    headings = measured_poses(recording)[1:, :, 2]
    yaws = np.arctan2(np.sin(headings), np.cos(headings))
    return _finished(recording, sensor, IMU_DRAWS, cycles, _about_z(yaws)[cycles])


@_device()
def locator(recording: Recording, sensor: MotionSensor, cycles: Numbers) -> Floats:
    """Position relative to the start, along the world's axes (eq. 12) [m]."""
    measured = measured_poses(recording)[..., :2]
    places = measured[1:] - measured[0]
    return _finished(recording, sensor, LOCATOR_DRAWS, cycles, places[cycles])


@_device()
def quaternion(recording: Recording, sensor: MotionSensor, cycles: Numbers) -> Floats:
    """Orientation relative to that at the start (eq. 13): w, x, y, z."""
    headings = measured_poses(recording)[..., 2]
    half = 0.5 * (headings[1:] - headings[0])
    none = np.zeros_like(half)
    values = np.stack([np.cos(half), none, none, np.sin(half)], axis=2)
    return _finished(recording, sensor, QUATERNION_DRAWS, cycles, values[cycles])


def measured_poses(recording: Recording) -> Floats:
    """Poses (cycles + 1, robots, 3) by locator and imu, without noise: the true ones, unless they drift."""
    poses, found = np.ascontiguousarray(recording.history.poses), np.zeros(recording.history.poses.shape)
    if not recording.scene.motion.drifts:
        return poses
    compiled(fill_drift)(recording.scene, poses, recording.noise_keys, found)
    return np.dstack([poses[0, :, :2] + found[..., :2], poses[..., 2] + found[..., 2]])


def _ring(recording: Recording, sensors: int, cycles: Numbers, *, of_light: bool) -> Floats:
    """Readings of the sensors of a ring (cycles, robots, sensors)."""
    found = np.zeros((len(cycles), len(recording.noise_keys), sensors))
    model, poses = recording.robot_model.reference_model, _placed(recording, cycles)
    compiled(fill_ring)(recording.scene, model, _scratch(recording), poses, cycles, of_light, found)
    return found


def _columns(*names: str) -> list[int]:
    return [Readings._fields.index(name) for name in names]


def _velocities(recording: Recording, sensor: DeviceWithAxes) -> Floats:
    """Commanded velocities (cycles, robots, 2) along the sensor's axes [m/s]."""
    executed = np.zeros_like(recording.recorded("commands"))
    executed[1:] = recording.recorded("commands")[:-1]  # a command moves the treads one cycle later
    speeds = executed.mean(axis=2)
    quarter = 0.5 * math.pi if sensor.forward == "y" else 0.0
    angles = recording.headings[1:] - recording.headings[0] + quarter
    return np.stack([speeds * np.cos(angles), speeds * np.sin(angles)], axis=2)


def _about_z(values: Floats) -> Floats:
    none = np.zeros_like(values)
    return np.stack([none, none, values], axis=2)


def _placed(recording: Recording, cycles: Numbers) -> Floats:
    """Poses (cycles, robots, 5) for the kernels: with cosine and sine of the heading."""
    poses = recording.history.poses[1:][cycles]
    placed = np.concatenate([poses, np.zeros((*poses.shape[:2], 2))], axis=2)
    compiled(fill_directions)(placed)
    return placed


def _scratch(recording: Recording) -> Swarm:
    """A swarm for kernels that sense; they move it to the recorded poses."""
    keys, model = recording.noise_keys, recording.robot_model.reference_model
    return new_swarm(recording.scene, model, np.zeros((len(keys), 3)), control_keys=keys, noise_keys=keys)


def _finished(
    recording: Recording,
    sensor: MotionSensor | AmbientLight,
    number: int,
    cycles: Numbers,
    values: Floats,
) -> Floats:
    """Values with the device's noise, within its range."""
    return np.clip(_disturbed(recording, noise_row(sensor.noise), number, cycles, values), *sensor.range)


def _disturbed(recording: Recording, row: Floats, number: int, cycles: Numbers, values: Floats) -> Floats:
    """Values (cycles, robots, n) with noise."""
    if row[0] == NO_NOISE:
        return values
    disturbed = values.copy()
    compiled(add_noise)(row, recording.noise_keys, number, cycles, disturbed)
    return disturbed
