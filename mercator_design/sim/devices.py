"""What the robot's devices measured and did in an experiment, computed afterwards from where the robots were.

No module reads these as they are, so an experiment does not keep them: whoever asks for one pays for it. Noise is a
function of device, cycle and value (noise.py), so that what is computed later is what would have been measured; or what
was, where modules read something made of it, which comes from the same kernels.
Sources: the Mercator paper, sections 4.2 and 4.3; where it is silent or differs, the plugin argos3-rvr.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from mercator_design.arrays import Floats, Keys, Numbers
from mercator_design.errors import SimulationError
from mercator_design.fsm.reference import Readings
from mercator_design.jit import compiled
from mercator_design.missions.trace import every_nth
from mercator_design.sim.kernels.measuring import (
    add_noise,
    fill_clusters,
    fill_directions,
    fill_ground,
    fill_lidar,
    fill_light_sensors,
    fill_lux,
    fill_places,
    fill_proximity,
    fill_weights,
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

"""Numbers of cycles, from 0."""

LARGEST = 2048
"""MiB of a recording: beyond, it could fill the memory."""

_GRAVITY = 9.81
"""[m/s2] The paper's, with which it tells accelerations in g."""


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """One experiment, of which devices can be read: `recording.measure("imu")`."""

    robot_model: RobotModel
    scene: Scene  # with the floor of the start
    history: History
    noise_keys: Keys  # (robots,)
    control_period: float  # [s]

    def measure(self, name: str, every: int = 1) -> Floats:
        """What a device measured or did at the end of every so many-th cycle, and of the last.

        Args:
            name: Of DEVICES.
            every: 1 for all cycles.

        Returns:
            (cycles, robots, ...) as the device's function in this file says.

        Raises:
            SimulationError: if the robot has no such device, or the experiment was not recorded and it needs that, or
                if `every` is below 1, or if it would be more than LARGEST.
        """
        cycles = self._cycles(every)
        check_size(name, len(cycles) * self.values(name))
        return self._measured(name, cycles)

    def values(self, name: str) -> int:
        """How many numbers a device gives at each cycle; errors are those of `measure`."""
        return self._measured(name, self._cycles(1)[:1]).size

    def _measured(self, name: str, cycles: Numbers) -> Floats:
        if name not in DEVICES:
            raise SimulationError(f"expected a device: {', '.join(DEVICES)}, found '{name}'")
        sensor = getattr(self.robot_model, PARTS.get(name, name))
        if sensor is None or (name == "light_sensors" and isinstance(sensor, LightCamera)):
            raise SimulationError(f"robot {self.robot_model.name} has no {name.replace('_', ' ')}")
        with np.errstate(over="ignore"):  # plain Python warns where a draw's arithmetic wraps around, as it should
            return DEVICES[name](self, sensor, cycles)

    def _cycles(self, every: int) -> Numbers:
        return every_nth(len(self.history.states), every)

    @property
    def headings(self) -> Floats:
        """(cycles + 1, robots) [rad], growing beyond a turn; row 0 is the start."""
        return self.history.poses[..., 2]

    def recorded(self, name: str) -> Floats:
        """A part of the history that only recorded experiments have."""
        found: Floats = getattr(self.history, name)
        if len(found) < len(self.history.states):
            raise SimulationError("this device can only be read of an experiment that was recorded (record=True)")
        return found


def check_size(what: str, values: int) -> None:
    """Make sure that so many numbers, which are to be computed, are not too large a recording.

    Raises:
        SimulationError: with their size, and what to change.
    """
    size = math.ceil(values * 8 / 2**20)
    if size > LARGEST:
        raise SimulationError(
            f"{what}: a recording of {size} MiB, expected at most {LARGEST} MiB; "
            "record fewer devices, fewer of the cycles (every), fewer robots or a shorter duration"
        )


def wheels(recording: Recording, _drive: Drive, cycles: Numbers) -> Floats:
    """Speed of the left and right tread [m/s], with the drive's noise, as set at the end of each cycle."""
    return recording.recorded("commands")[cycles]


def ground(recording: Recording, _sensors: Ground, cycles: Numbers) -> Floats:
    """Red, green, blue of the ground, 0 to 255: the mean of several sensors, its label, or what they voted for."""
    return recording.recorded("readings")[cycles][..., _columns("ground_red", "ground_green", "ground_blue")]


def ground_sensors(recording: Recording, sensors: Ground, cycles: Numbers) -> Floats:
    """Red, green, blue that each sensor measured (cycles, robots, sensors, 3), 0 to 255; equal if it is `gray`."""
    found = np.zeros((len(cycles), len(recording.noise_keys), len(sensors.positions), 3))
    scene = recording.scene._replace(floor=recording.scene.floor.copy())
    poses = _placed(recording, np.arange(cycles.max(initial=-1) + 1))  # all, for the floor may change in each
    compiled(fill_ground)(scene, _scratch(recording), poses, cycles, found)
    return found


def neighbours(recording: Recording, _sensor: object, cycles: Numbers) -> Floats:
    """How many neighbours counted, and the vector to them, forwards and to the left: what controllers read."""
    return recording.recorded("readings")[cycles][..., _columns("neighbours", "neighbours_x", "neighbours_y")]


def neighbour_places(recording: Recording, sensor: Neighbours | LidarNeighbours, cycles: Numbers) -> Floats:
    """Distance [m] and bearing [rad] of each neighbour perceived in a cycle; NaN where there is none.

    By a camera (cycles, robots, robots, 2): of robot j in row j. By the lidar (cycles, robots, most clusters, 2): of
    the clusters, in the order of their beams, which end where a row is NaN.
    """
    scene, model, robots = recording.scene, recording.robot_model.reference_model, len(recording.noise_keys)
    if isinstance(sensor, LidarNeighbours):
        scans = lidar(recording, None, cycles)
        found = np.full((len(cycles), robots, int(scans.shape[2] / max(1.0, model.cluster_points)), 2), np.nan)
        compiled(fill_clusters)(scene, model, _scratch(recording), scans, found)
        return found
    found = np.full((len(cycles), robots, robots, 2), np.nan)
    # A memory of one cycle, which says where each robot is.
    scratch = _scratch(recording)._replace(heard=np.zeros((robots, robots, 1, 3)))
    compiled(fill_places)(scene, model, scratch, _placed(recording, cycles), cycles, found)
    return found


def light(recording: Recording, _sensor: object, cycles: Numbers) -> Floats:
    """The vector to the light, forwards and to the left: what controllers read."""
    return recording.recorded("readings")[cycles][..., _columns("light_x", "light_y")]


def light_sensors(recording: Recording, ring: LightRing, cycles: Numbers) -> Floats:
    """What each sensor of the ring read (cycles, robots, sensors), 0 to 1."""
    found = np.zeros((len(cycles), len(recording.noise_keys), len(ring.angles)))
    model, poses = recording.robot_model.reference_model, _placed(recording, cycles)
    compiled(fill_light_sensors)(recording.scene, model, _scratch(recording), poses, cycles, found)
    return found


def velocity(recording: Recording, sensor: DeviceWithAxes, cycles: Numbers) -> Floats:
    """Commanded velocity in the start's frame (eqs. 3-5) [m/s], of which one axis points forwards."""
    return _finished(recording, sensor, VELOCITY_DRAWS, cycles, _velocities(recording, sensor)[cycles])


def accelerometer(recording: Recording, sensor: DeviceWithAxes, cycles: Numbers) -> Floats:
    """Change of that velocity over a cycle along x and y, and gravity along z (eqs. 6-9) [g]."""
    moved = _velocities(recording, sensor)
    changes = np.diff(moved, axis=0, prepend=0.0) / (recording.control_period * _GRAVITY)
    upright = np.concatenate([changes, np.ones((*changes.shape[:2], 1))], axis=2)
    return _finished(recording, sensor, ACCELEROMETER_DRAWS, cycles, upright[cycles])


def gyroscope(recording: Recording, sensor: MotionSensor, cycles: Numbers) -> Floats:
    """Turn about x, y and z over a cycle (eqs. 10-11) [rad/s]; the floor is level."""
    turns = np.diff(recording.headings, axis=0) / recording.control_period
    return _finished(recording, sensor, GYROSCOPE_DRAWS, cycles, _about_z(turns)[cycles])


def imu(recording: Recording, sensor: MotionSensor, cycles: Numbers) -> Floats:
    """Pitch, roll and yaw against the world [rad], yaw from -pi to pi."""
    yaws = np.arctan2(np.sin(recording.headings[1:]), np.cos(recording.headings[1:]))
    return _finished(recording, sensor, IMU_DRAWS, cycles, _about_z(yaws)[cycles])


def locator(recording: Recording, sensor: MotionSensor, cycles: Numbers) -> Floats:
    """Place from the start, along the world's axes (eq. 12) [m]."""
    places = recording.history.poses[1:, :, :2] - recording.history.poses[0, :, :2]
    return _finished(recording, sensor, LOCATOR_DRAWS, cycles, places[cycles])


def quaternion(recording: Recording, sensor: MotionSensor, cycles: Numbers) -> Floats:
    """Orientation against that at the start (eq. 13): w, x, y, z."""
    half = 0.5 * (recording.headings[1:] - recording.headings[0])
    none = np.zeros_like(half)
    values = np.stack([np.cos(half), none, none, np.sin(half)], axis=2)
    return _finished(recording, sensor, QUATERNION_DRAWS, cycles, values[cycles])


def ambient_light(recording: Recording, sensor: AmbientLight, cycles: Numbers) -> Floats:
    """Brightness (cycles, robots, 1) [lux]: of each light that nothing hides, by its distance and intensity."""
    found = np.zeros((len(cycles), len(recording.noise_keys), 1))
    law = (sensor.height, sensor.base, sensor.decay, sensor.reach)
    compiled(fill_lux)(recording.scene, _placed(recording, cycles), *sensor.position, law, found)
    return _finished(recording, sensor, AMBIENT_LIGHT_DRAWS, cycles, found)


def proximity(recording: Recording, sensors: Proximity, cycles: Numbers) -> Floats:
    """Distances (cycles, robots, sensors) [m]; minus infinity if too near, infinity if too far or none (4.2.9)."""
    nearest, furthest = sensors.range
    found = np.zeros((len(cycles), len(recording.noise_keys), len(sensors.angles)))
    scratch = np.zeros(len(sensors.angles))
    compiled(fill_proximity)(recording.scene, _placed(recording, cycles), furthest, scratch, found)
    hit = (found >= nearest) & (found <= furthest)
    disturbed = _disturbed(recording, noise_row(sensors.noise), PROXIMITY_DRAWS, cycles, found)
    return np.where(hit, np.clip(disturbed, 0.0, None), np.where(found < nearest, -np.inf, np.inf))


def proximity_weights(recording: Recording, sensors: Proximity, cycles: Numbers) -> Floats:
    """How much what each sensor saw counted (cycles, robots, sensors): what an infra-red sensor reads."""
    found = np.zeros((len(cycles), len(recording.noise_keys), len(sensors.angles)))
    model, poses = recording.robot_model.reference_model, _placed(recording, cycles)
    compiled(fill_weights)(recording.scene, model, _scratch(recording), poses, cycles, found)
    return found


def lidar(recording: Recording, _sensor: object, cycles: Numbers) -> Floats:
    """Distances (cycles, robots, beams) [m]; 0 where nothing is in range (4.2.10)."""
    beams = len(recording.scene.lidar.beams_x)
    found = np.zeros((len(cycles), len(recording.noise_keys), beams))
    poses = _placed(recording, cycles)
    compiled(fill_lidar)(recording.scene, poses, recording.noise_keys, cycles, np.zeros(beams), found)
    return found


def lidar_points(recording: Recording, sensor: Lidar, cycles: Numbers) -> Floats:
    """Where in the world each beam ended (cycles, robots, beams, 2) [m]; NaN where nothing is in range."""
    distances = lidar(recording, sensor, cycles)[..., np.newaxis]
    beams = np.stack([recording.scene.lidar.beams_x, recording.scene.lidar.beams_y], axis=1)
    poses = _placed(recording, cycles)[:, :, np.newaxis]
    c, s = poses[..., 3], poses[..., 4]
    directions = np.stack([c * beams[:, 0] - s * beams[:, 1], s * beams[:, 0] + c * beams[:, 1]], axis=-1)
    ends = poses[..., :2] + (sensor.ring_radius + distances) * directions
    return np.where(distances > 0.0, ends, np.nan)


def leds(recording: Recording, lamps: Leds, cycles: Numbers) -> Floats:
    """Red, green, blue of each lamp (cycles, robots, lamps, 3), 0 to 255: they show the state."""
    shown = np.array(lamps.colors, dtype=float)[recording.history.states[cycles]]
    return np.repeat(shown[:, :, np.newaxis], len(lamps.positions), axis=2)


DEVICES: Mapping[str, Callable[[Recording, Any, Numbers], Floats]] = MappingProxyType(
    {
        function.__name__: function
        for function in (
            wheels,
            leds,
            ground,
            ground_sensors,
            neighbours,
            neighbour_places,
            light,
            light_sensors,
            proximity,
            proximity_weights,
            lidar,
            lidar_points,
            ambient_light,
            velocity,
            accelerometer,
            gyroscope,
            imu,
            locator,
            quaternion,
        )
    }
)
"""What can be read, by name."""

PARTS: Mapping[str, str] = MappingProxyType(
    {
        "wheels": "drive",
        "ground_sensors": "ground",
        "neighbour_places": "neighbours",
        "light_sensors": "light",
        "proximity_weights": "proximity",
        "lidar_points": "lidar",
    }
)
"""Key of a robot model that a device belongs to, where it is not the device's name."""


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
    """Poses (cycles, robots, 5) as the kernels want them: with cosine and sine of the heading."""
    poses = recording.history.poses[1:][cycles]
    placed = np.concatenate([poses, np.zeros((*poses.shape[:2], 2))], axis=2)
    compiled(fill_directions)(placed)
    return placed


def _scratch(recording: Recording) -> Swarm:
    """A swarm for kernels that sense, to be put where the robots were."""
    keys, scene = recording.noise_keys, recording.scene
    return new_swarm(
        np.zeros((len(keys), 3)),
        control_keys=keys,
        noise_keys=keys,
        model=recording.robot_model.reference_model,
        sensors=len(scene.proximity.directions_x),
        light_sensors=len(scene.light.directions_x),
        beams=len(scene.lidar.beams_x),
    )


def _finished(
    recording: Recording,
    sensor: MotionSensor | DeviceWithAxes | AmbientLight,
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
