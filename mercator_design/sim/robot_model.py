"""The robot model: a robot's body, drive, sensors and noise in simulation, from a YAML file.

Shipped models lie in scenarios/robots/. A model also carries the constants of the reference model, so that a design
and its assessment may differ in either (pseudo-reality) without a line of code.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from mercator_design import shipped
from mercator_design.errors import MissionError
from mercator_design.fsm.modules import SENSES
from mercator_design.fsm.reference import ReferenceModel
from mercator_design.loading import Ascending, FieldError, Length, NonNegative, Range, is_name, read

Spread = Annotated[float, Range(0.0, 1000.0)]
Size = Annotated[float, Range(0.01, 10.0)]
Height = Annotated[float, Range(0.001, 100.0)]
Distance = Annotated[float, Range(0.0, 1000.0)]
Distances = Annotated[tuple[Distance, Distance], Ascending()]
Bounds = Annotated[tuple[float, float], Ascending()]
Place = Annotated[float, Range(-10.0, 10.0)]
Channel = Annotated[int, Range(0, 255)]
Angles = Annotated[tuple[float, ...], Length(1, 64)]
Amount = Annotated[float, Range(0.001, 1000.0)]
Friction = Annotated[float, Range(0.0, 10.0)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Gaussian:
    """Normally distributed noise."""

    distribution: Literal["gaussian"] = "gaussian"
    mean: Annotated[float, Range(-1000.0, 1000.0)] = 0.0
    sd: Spread


@dataclass(frozen=True, slots=True, kw_only=True)
class Uniform:
    """Noise uniform within `half_width` of its mean."""

    distribution: Literal["uniform"] = "uniform"
    mean: Annotated[float, Range(-1000.0, 1000.0)] = 0.0
    half_width: Spread


Noise = Gaussian | Uniform | None


@dataclass(frozen=True, slots=True, kw_only=True)
class BoxBody:
    """A box around the robot's centre."""

    shape: Literal["box"] = "box"
    length: Size  # [m] along the heading
    width: Size  # [m]
    height: Height = 0.114  # [m]
    mass: Amount  # [kg]
    friction: Friction = 0.7
    elasticity: Annotated[float, Range(0.0, 1.0)] = 0.0

    @property
    def inertia(self) -> float:
        """Moment of inertia [kg m2]."""
        return self.mass * (self.length**2 + self.width**2) / 12.0

    @property
    def corner(self) -> float:
        """Distance from the centre to the farthest point [m]."""
        return 0.5 * math.hypot(self.length, self.width)

    @property
    def half_size(self) -> tuple[float, float]:
        """Half the extent along and across the heading [m]."""
        return 0.5 * self.length, 0.5 * self.width

    @property
    def area(self) -> float:
        """Of the floor that it covers [m2]."""
        return self.length * self.width

    @property
    def measures(self) -> str:
        """Its size in words."""
        return f"{self.length:g} x {self.width:g} m"


@dataclass(frozen=True, slots=True, kw_only=True)
class DiscBody:
    """A cylinder around the robot's centre."""

    shape: Literal["disc"] = "disc"
    radius: Size  # [m]
    height: Height = 0.1  # [m]
    mass: Amount  # [kg]
    friction: Friction = 0.7
    elasticity: Annotated[float, Range(0.0, 1.0)] = 0.0

    @property
    def inertia(self) -> float:
        """Moment of inertia [kg m2]."""
        return 0.5 * self.mass * self.radius**2

    @property
    def corner(self) -> float:
        """Distance from the centre to the farthest point [m]."""
        return self.radius

    @property
    def half_size(self) -> tuple[float, float]:
        """Half the extent along and across the heading [m]."""
        return self.radius, self.radius

    @property
    def area(self) -> float:
        """Of the floor that it covers [m2]."""
        return math.pi * self.radius**2

    @property
    def measures(self) -> str:
        """Its size in words."""
        return f"{2.0 * self.radius:g} m across"


@dataclass(frozen=True, slots=True, kw_only=True)
class Drive:
    """Two treads, with a limited force to reach the commanded velocity."""

    tread_distance: Size  # [m]
    maximum_speed: Size  # [m/s] of a tread
    force: Amount  # [N]
    torque: Annotated[float, Range(1e-6, 1000.0)]  # [N m]
    noise: Noise = None  # as a fraction of a tread's speed


@dataclass(frozen=True, slots=True, kw_only=True)
class Proximity:
    """A ring of distance sensors; from where on they count, and how much, is in the reference model."""

    ring_radius: Annotated[float, Range(0.0, 10.0)]  # [m] where the rays start
    angles: Angles  # [rad] in the order of the device's numbering
    reported: Angles | None = None  # [rad] that the readings are taken for, if not where the rays go
    range: Distances = (0.05, 2.0)  # [m] nearer reads minus infinity, farther plus infinity
    noise: Noise = None  # [m] on distances
    weight_noise: Noise = None  # on what a sensor counts, 0 to 1, even if it sees nothing

    def __post_init__(self) -> None:
        if self.reported is not None and len(self.reported) != len(self.angles):
            raise FieldError("reported", f"expected {len(self.angles)} angles, as many as rays")


@dataclass(frozen=True, slots=True, kw_only=True)
class Ground:
    """Colour sensors that look at the floor; the mean of several counts, unless the reference model lets them vote."""

    positions: Annotated[tuple[tuple[Place, Place], ...], Length(1, 16)]  # [m] from the centre: forwards, to the left
    gray: bool = False  # whether they see no colours, only how bright the floor is
    noise: Noise = None  # a channel of 0 to 255, or the brightness of the same range


@dataclass(frozen=True, slots=True, kw_only=True)
class Neighbours:
    """How robots perceive each other: by a camera or radio, which tells where each robot is."""

    device: Literal["camera"] = "camera"
    range: Distance = 13.57  # [m] what counts as near is in the reference model
    occlusion: bool = False  # whether robots, obstacles and walls hide robots from the camera
    loss: Annotated[float, Range(0.0, 1.0)] = 0.0  # chance that the camera misses a robot in a cycle
    noise: Noise = None  # a vector of this fraction of the distance, in any direction


@dataclass(frozen=True, slots=True, kw_only=True)
class LidarNeighbours:
    """Robots perceive each other as clusters of readings of the lidar."""

    device: Literal["lidar"] = "lidar"


@dataclass(frozen=True, slots=True, kw_only=True)
class LightRing:
    """Light sensors around the robot, each with its direction.

    A light reads exp(-decay x) at x = distance / intensity, up to reach, less linearly the farther from a sensor's
    direction it is, nothing from 90 degrees on; readings of lights add up to 1 at most.
    """

    device: Literal["ring"] = "ring"
    angles: Angles  # [rad]
    decay: NonNegative = 2.0
    reach: NonNegative = 2.5
    height: Height  # [m]
    range: Distance = 1000.0  # [m] of lights that are sensed
    occlusion: bool = True
    noise: Noise = None  # a reading of 0 to 1


@dataclass(frozen=True, slots=True, kw_only=True)
class LightCamera:
    """A camera that sees where lights are: their direction is that of the vectors to them, added up."""

    device: Literal["camera"] = "camera"
    height: Height  # [m]
    range: Distance  # [m] of lights that are seen
    highest: Distance = 1000.0  # [m] lights higher than this are out of its view
    occlusion: bool = False
    noise: Noise = None  # a vector of this fraction of the distance, in any direction


@dataclass(frozen=True, slots=True, kw_only=True)
class Lidar:
    """A turning distance sensor, on a head that other lidars see."""

    beams: Annotated[int, Range(8, 10_000)] = 719
    first_angle: float = -math.pi  # [rad]
    height: Height  # [m] what is lower is not in its way
    ring_radius: Annotated[float, Range(0.0, 10.0)] = 0.0  # [m] from where distances count
    head_radius: Annotated[float, Range(0.0, 10.0)] = 0.035  # [m] 0: there is nothing to be seen
    range: Distances = (0.10, 12.0)  # [m] nearer and farther read 0
    noise: Noise = None  # [m]


@dataclass(frozen=True, slots=True, kw_only=True)
class AmbientLight:
    """One sensor of brightness; a light adds `base + exp(-decay x)` lux at x = distance / intensity, up to `reach`.

    Walls, boxes and robots hide lights, as high as they are. The defaults are argos3-rvr's.
    """

    position: tuple[Place, Place] = (0.0, 0.0)  # [m] from the centre
    height: Height  # [m]
    base: NonNegative = 138.9171  # [lux]
    decay: NonNegative = 9.145603
    reach: NonNegative = 2.5
    range: Bounds = (0.0, 120_000.0)  # [lux]
    noise: Noise = None  # [lux]


@dataclass(frozen=True, slots=True, kw_only=True)
class Device:
    """A sensor of the robot's own motion."""

    range: Bounds  # in its own unit
    noise: Noise = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Leds:
    """Lamps that show the state."""

    positions: Annotated[tuple[tuple[Place, Place], ...], Length(1, 64)]  # [m] from the centre
    colors: Annotated[tuple[tuple[Channel, Channel, Channel], ...], Length(4, 4)] = (  # of the states
        (0, 114, 178),
        (230, 159, 0),
        (0, 158, 115),
        (204, 121, 167),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Physics:
    """How finely the motion is computed."""

    time_step: Annotated[float, Range(0.0, 0.1, exclusive_low=True)] = 0.01  # [s] at most; a cycle is divided evenly
    solver_iterations: Annotated[int, Range(1, 1000)] = 10
    collision_slop: Annotated[float, Range(0.0, 1.0)] = 0.001  # [m] overlap that is not pushed apart
    wall_overlap: Annotated[float, Range(0.0, 1.0)] | None = 0.002  # [m] allowed at the end of a cycle; None: any
    corner_radius: Annotated[float, Range(0.0, 0.004)] = 0.002  # [m] of boxes, in contacts: Chipmunk likes round ones
    wall_friction: Friction = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotModel:
    """A robot in simulation; what is left out, it does not have."""

    schema: Literal[1] = 1
    name: str  # by default the file's
    description: str = ""
    body: BoxBody | DiscBody
    drive: Drive
    proximity: Proximity | None = None
    ground: Ground | None = None
    neighbours: Neighbours | LidarNeighbours | None = None
    light: LightRing | LightCamera | None = None
    lidar: Lidar | None = None
    ambient_light: AmbientLight | None = None  # [lux]
    velocity: Device | None = None  # [m/s]
    accelerometer: Device | None = None  # [g]
    gyroscope: Device | None = None  # [rad/s]
    imu: Device | None = None  # [rad]
    locator: Device | None = None  # [m]
    quaternion: Device | None = None
    leds: Leds | None = None
    reference_model: ReferenceModel = ReferenceModel()
    physics: Physics = Physics()
    vary: Mapping[str, tuple[float, float]] | None = None  # key -> bounds of its value, drawn for each instance

    def __post_init__(self) -> None:
        for key, (low, high) in (self.vary or {}).items():
            if low > high:
                raise FieldError("vary", f"{key}: expected the lower bound first, found [{low:g}, {high:g}]")
            if not isinstance(_value_at(self, key), float):
                raise FieldError("vary", f"{key}: the robot model has no real number there that could vary")
        if isinstance(self.neighbours, LidarNeighbours):
            if self.lidar is None:
                raise FieldError("neighbours.device", "there is no lidar")
            if self.lidar.head_radius == 0.0 and self.lidar.height >= self.body.height:
                raise FieldError("neighbours.device", "the lidar sees no robots: lidar.head_radius is 0")

    @property
    def fastest(self) -> float:
        """The highest speed of a point of the body [m/s]: a corner, driving and spinning at full speed."""
        spin = 2.0 * self.drive.maximum_speed / self.drive.tread_distance
        return self.drive.maximum_speed + spin * self.body.corner

    def drawn(self, random: np.random.Generator) -> "RobotModel":
        """The robot model of one instance: what varies has values drawn uniformly between its bounds."""
        model: RobotModel = self
        for key, (low, high) in (self.vary or {}).items():
            model = _replaced(model, key.split("."), float(random.uniform(low, high)))
        return model

    @property
    def senses(self) -> frozenset[str]:
        """Which of the senses that modules read it has."""
        return frozenset(sense for sense in SENSES if getattr(self, sense) is not None)


def load_robot_model(name_or_path: str) -> RobotModel:
    """A robot model by the name of a shipped one, or by path.

    Raises:
        MissionError: if there is none, or it is not valid.
    """
    path = shipped.find(name_or_path, shipped.robot_models(), "robot model")
    model = _read(path)
    for key, bounds in (model.vary or {}).items():
        for value in bounds:  # whether each may be
            try:
                _read(path, overrides=(f"{key}={value!r}",))
            except MissionError as error:
                _, _, what = str(error).partition(": ")  # the place is that of the override
                raise MissionError(f"{path}: vary: {what}") from None
    return model


def _read(path: Path, overrides: Sequence[str] = ()) -> RobotModel:
    defaults = {"name": path.stem}
    return read(path, RobotModel, error=MissionError, overrides=overrides, defaults=defaults, find_base=_find_base)


def _find_base(name: str, folder: Path) -> Path:
    path = name if is_name(name) else str(folder / name)
    return shipped.find(path, shipped.robot_models(), "robot model")


def _value_at(record: object, key: str) -> object:
    """What a record has at the end of a way of fields, or None."""
    for field in key.split("."):
        record = getattr(record, field, None)
    return record


def _replaced(record: Any, way: Sequence[str], value: float) -> Any:  # noqa: ANN401 - dataclasses and NamedTuples
    """A record with another value at the end of a way of fields."""
    field, *rest = way
    new = _replaced(getattr(record, field), rest, value) if rest else value
    return record._replace(**{field: new}) if hasattr(record, "_replace") else replace(record, **{field: new})
