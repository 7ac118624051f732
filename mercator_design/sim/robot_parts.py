"""The parts of a robot model: bodies, drive, devices, and their noise."""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from mercator_design.arrays import Floats
from mercator_design.config.colours import STATE_COLOURS, ColourName, Levels
from mercator_design.config.schema import Ascending, FieldError, Length, NonNegative, Range
from mercator_design.missions.arena import Angle, Height

Spread = Annotated[float, Range(0.0, 1000.0)]
Extent = Annotated[float, Range(0.01, 10.0)]
Distance = Annotated[float, Range(0.0, 1000.0)]
Distances = Annotated[tuple[Distance, Distance], Ascending()]
Bounds = Annotated[tuple[float, float], Ascending()]
Part = Annotated[float, Range(0.0, 1.0)]
Fraction = Annotated[float, Range(0.0, 0.5)]
Offset = Annotated[float, Range(-10.0, 10.0)]
Angles = Annotated[tuple[Angle, ...], Length(1, 64)]
Amount = Annotated[float, Range(0.001, 1000.0)]
Inertia = Annotated[float, Range(1e-9, 1e6)]
Friction = Annotated[float, Range(0.0, 10.0)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Gaussian:
    """Normally distributed noise."""

    distribution: Literal["gaussian"] = "gaussian"
    mean: Annotated[float, Range(-1000.0, 1000.0)] = 0.0  # mean of the noise, in the unit of the value
    sd: Spread  # standard deviation, in the unit of the value


@dataclass(frozen=True, slots=True, kw_only=True)
class Uniform:
    """Noise uniform within `half_width` of its mean."""

    distribution: Literal["uniform"] = "uniform"
    mean: Annotated[float, Range(-1000.0, 1000.0)] = 0.0  # mean of the noise, in the unit of the value
    half_width: Spread  # half width of the interval around the mean, in the unit of the value


Noise = Gaussian | Uniform | None


@dataclass(frozen=True, slots=True, kw_only=True)
class BoxBody:
    """A box around the robot's centre."""

    shape: Literal["box"] = "box"
    length: Extent  # [m] along the heading
    width: Extent  # [m] across the heading
    height: Height = 0.114  # [m] of the body above the floor
    mass: Amount  # [kg] of the body
    inertia: Inertia | None = None  # [kg m2] about the vertical axis; null: of a body that is as heavy everywhere
    friction: Friction = 0.7  # coefficient, multiplied by that of the touched object; as in argos3-rvr
    elasticity: Annotated[float, Range(0.0, 1.0)] = 0.0  # of collisions: 0 loses all speed, 1 keeps it

    @property
    def moment_of_inertia(self) -> float:
        """About the vertical axis [kg m2]."""
        return self.mass * (self.length**2 + self.width**2) / 12.0 if self.inertia is None else self.inertia

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
        """The area of the floor that it covers [m2]."""
        return self.length * self.width

    @property
    def measures(self) -> str:
        """Its size in words."""
        return f"{self.length:g} x {self.width:g} m"

    def outline(self) -> Floats:
        """Its corners (4, 2) around the centre, counter-clockwise, the heading along x [m]."""
        return np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]) * self.half_size


@dataclass(frozen=True, slots=True, kw_only=True)
class DiscBody:
    """A cylinder around the robot's centre."""

    shape: Literal["disc"] = "disc"
    radius: Extent  # [m] of the body
    height: Height = 0.1  # [m] of the body above the floor
    mass: Amount  # [kg] of the body
    inertia: Inertia | None = None  # [kg m2] about the vertical axis; null: of a body that is as heavy everywhere
    friction: Friction = 0.7  # coefficient, multiplied by that of the touched object; as in argos3-rvr
    elasticity: Annotated[float, Range(0.0, 1.0)] = 0.0  # of collisions: 0 loses all speed, 1 keeps it

    @property
    def moment_of_inertia(self) -> float:
        """About the vertical axis [kg m2]."""
        return 0.5 * self.mass * self.radius**2 if self.inertia is None else self.inertia

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
        """The area of the floor that it covers [m2]."""
        return math.pi * self.radius**2

    @property
    def measures(self) -> str:
        """Its size in words."""
        return f"{2.0 * self.radius:g} m across"

    def outline(self) -> Floats:
        """Points (48, 2) of its border around the centre, counter-clockwise [m]."""
        angles = np.linspace(0.0, 2.0 * math.pi, 48, endpoint=False)
        return self.radius * np.column_stack([np.cos(angles), np.sin(angles)])


@dataclass(frozen=True, slots=True, kw_only=True)
class Drive:
    """Two treads, with a limited force to reach the commanded velocity."""

    tread_distance: Extent  # [m] from the middle of one tread to that of the other
    maximum_speed: Extent  # [m/s] of a tread
    force: Amount  # [N] at most, to reach the commanded speed
    torque: Annotated[float, Range(1e-6, 1000.0)]  # [N m] at most, to reach the commanded turn
    noise: Noise = None  # on each tread, as a fraction of its speed


@dataclass(frozen=True, slots=True, kw_only=True)
class Proximity:
    """A ring of distance sensors; from where on they count, and how much, is in the reference model."""

    ring_radius: Annotated[float, Range(0.0, 10.0)]  # [m] where the rays start
    angles: Angles  # [rad] of the rays, in the order of the device's numbering
    reported: Angles | None = None  # [rad] that the readings are taken for, if not where the rays go
    range: Distances = (0.05, 2.0)  # [m] nearer reads minus infinity, farther plus infinity
    noise: Noise = None  # [m] on distances
    weight_noise: Noise = None  # on the weight of a reading, 0 to 1, even if nothing is in range

    def __post_init__(self) -> None:
        if self.reported is not None and len(self.reported) != len(self.angles):
            raise FieldError("reported", f"expected {len(self.angles)} angles, as many as rays")


@dataclass(frozen=True, slots=True, kw_only=True)
class Ground:
    """Colour sensors of the floor; robots use their mean, unless the reference model has them vote."""

    positions: Annotated[tuple[tuple[Offset, Offset], ...], Length(1, 16)]  # [m] forwards, leftwards of the centre
    gray: bool = False  # whether they see no colours, only how bright the floor is
    labels: Literal["floor"] | tuple[ColourName, ...] | None = None  # colours a reading counts as; floor: the floor's
    noise: Noise = None  # on each channel, 0 to 255, which is then rounded; if gray, on the brightness, not rounded

    def __post_init__(self) -> None:
        if self.labels == ():
            raise FieldError("labels", "expected at least one colour, found []; null keeps readings as measured")


@dataclass(frozen=True, slots=True, kw_only=True)
class Neighbours:
    """How robots perceive each other: by a camera or radio, which measures where each robot is."""

    device: Literal["camera"] = "camera"
    range: Distance | None = None  # [m] that the device reaches; null: as far as robots count
    height: Distance = 0.0  # [m] of the camera, and of the visible part of a robot; lower objects hide nothing
    occlusion: bool = False  # whether robots, obstacles and walls hide robots from the camera
    loss: Annotated[float, Range(0.0, 1.0)] = 0.0  # chance that the camera misses a robot in a cycle
    noise: Noise = None  # adds a vector of this fraction of the distance, in any direction


@dataclass(frozen=True, slots=True, kw_only=True)
class LidarNeighbours:
    """Robots perceive each other as clusters of readings of the lidar."""

    device: Literal["lidar"] = "lidar"


@dataclass(frozen=True, slots=True, kw_only=True)
class LightRing:
    """Light sensors around the robot, each with its direction.

    A light reads exp(-decay x) at x = distance / intensity, up to reach, less linearly the farther from a sensor's
    direction it is, nothing from 90 degrees on; readings of lights add up to 1 at most. Defaults are argos3-epuck's.
    """

    device: Literal["ring"] = "ring"
    angles: Angles  # [rad] of the sensors' directions
    decay: NonNegative = 2.0  # [1/m] of a reading with the distance, for a light of intensity 1
    reach: NonNegative = 2.5  # [m] for a light of intensity 1; one that is farther reads 0
    height: Height  # [m] of the sensors above the floor
    range: Distance = 1000.0  # [m] of lights that are sensed
    occlusion: bool = True  # whether robots, obstacles and walls hide lights
    noise: Noise = None  # on a reading, 0 to 1


@dataclass(frozen=True, slots=True, kw_only=True)
class LightCamera:
    """A camera that sees where lights are: their direction is that of the vectors to them, added up."""

    device: Literal["camera"] = "camera"
    height: Height  # [m] of the camera above the floor
    range: Distance  # [m] of lights that are seen
    highest: Distance = 1000.0  # [m] above which a light is out of its view
    occlusion: bool = False  # whether robots, obstacles and walls hide lights
    noise: Noise = None  # adds a vector of this fraction of the distance, in any direction


@dataclass(frozen=True, slots=True, kw_only=True)
class Lidar:
    """A turning distance sensor, on a head that other lidars see."""

    beams: Annotated[int, Range(8, 10_000)] = 719  # readings of a turn
    first_angle: Angle = -math.pi  # [rad] of the first beam; the others follow counter-clockwise
    height: Height  # [m] of the beams above the floor; they pass over lower objects
    ring_radius: Annotated[float, Range(0.0, 10.0)] = 0.0  # [m] from where distances count
    head_radius: Annotated[float, Range(0.0, 10.0)] = 0.035  # [m] of what other lidars see; 0: they see nothing
    range: Distances = (0.10, 12.0)  # [m] nearer and farther read 0
    loss: Annotated[float, Range(0.0, 1.0)] = 0.0  # chance that a beam of a turn reads 0
    turn: Annotated[float, Range(0.01, 10.0)] = 0.1438  # [s] of a turn; the X4's 719 samples, 5000 a second
    noise: Noise = None  # [m] on distances


@dataclass(frozen=True, slots=True, kw_only=True)
class AmbientLight:
    """One sensor of brightness; a light adds `base + exp(-decay x)` lux at x = distance / intensity, up to `reach`.

    Walls, boxes and robots hide lights, depending on their height. The defaults are those of argos3-rvr.
    """

    position: tuple[Offset, Offset] = (0.0, 0.0)  # [m] forwards and to the left of the centre
    height: Height  # [m] of the sensor above the floor
    base: NonNegative = 138.9171  # [lux] of a light that reaches the sensor, however far it is
    decay: NonNegative = 9.145603  # [1/m] with the distance, for a light of intensity 1
    reach: NonNegative = 2.5  # [m] for a light of intensity 1; one that is farther adds nothing
    range: Bounds = (0.0, 120_000.0)  # [lux] between which readings are kept
    noise: Noise = None  # [lux] on readings


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionSensor:
    """A sensor of the robot's own motion."""

    range: Bounds  # between which readings are kept, in the device's unit
    noise: Noise = None  # on readings, in the device's unit


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceWithAxes(MotionSensor):
    """A sensor of the robot's own motion along the axes that it had at the start."""

    forward: Literal["x", "y"] = "y"  # axis that points forwards: the RVR's is y, the Mercator paper's x


@dataclass(frozen=True, slots=True, kw_only=True)
class Imu(MotionSensor):
    """The sensor of the robot's orientation, whose yaw may drift; the defaults are a yaw without drift."""

    bias: Annotated[float, Range(0.0, 10.0)] = 0.0  # [rad/s] sd of the yaw's constant drift, drawn for each robot
    walk_by_way: Annotated[float, Range(0.0, 10.0)] = 0.0  # [rad/sqrt(m)] sd of the yaw's drift in a metre
    walk_by_turn: Annotated[float, Range(0.0, 10.0)] = 0.0  # [rad/sqrt(rad)] sd of the yaw's drift in a radian turned


@dataclass(frozen=True, slots=True, kw_only=True)
class Locator(MotionSensor):
    """The sensor of the robot's place, which adds up ways along the drifting yaw of the `imu`."""

    scale_errors: tuple[Fraction, Fraction] = (0.0, 0.0)  # smallest, largest part by which a robot's ways are off

    def __post_init__(self) -> None:
        if self.scale_errors[0] > self.scale_errors[1]:
            raise FieldError("scale_errors", f"expected the smaller first, found {list(self.scale_errors)}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Leds:
    """Lamps that show the state, unless modules set them."""

    positions: Annotated[tuple[tuple[Offset, Offset], ...], Length(1, 64)]  # [m] forwards, leftwards of the centre
    colors: Annotated[tuple[Levels, ...], Length(4, 4)] = STATE_COLOURS  # red, green, blue in each state


@dataclass(frozen=True, slots=True, kw_only=True)
class Failures:
    """Robots that stop working for good, each at a time of its own, drawn for each instance.

    Motors and LEDs of such a robot are off and it sends nothing; it stands in the way, and is seen, as any other.
    """

    share: Part = 0.0  # chance that a robot stops in an experiment
    between: tuple[Part, Part] = (0.0, 1.0)  # parts of the duration, between which such a robot stops
    rate: Annotated[float, Range(0.0, 1000.0)] = 0.0  # [1/s] of robots that stop, of those that work; beside `share`

    def __post_init__(self) -> None:
        if self.between[0] > self.between[1]:
            raise FieldError("between", f"expected the smaller first, found {list(self.between)}")

    def times(self, random: np.random.Generator, robots: int, duration: float) -> Floats:
        """When each robot stops in an experiment of so many seconds (robots,) [s]; infinite: it does not.

        The draws of a robot depend neither on the number of robots nor on what is set here. So a larger share or rate
        stops the same robots, and others.
        """
        chance, part, life = random.random((robots, 3)).T
        first, last = self.between
        by_share = np.where(chance < self.share, duration * (first + part * (last - first)), np.inf)
        by_rate = -np.log1p(-life) / self.rate if self.rate else np.full(robots, np.inf)
        return np.asarray(np.minimum(by_share, by_rate), dtype=np.float64)


@dataclass(frozen=True, slots=True, kw_only=True)
class Physics:
    """How finely the motion is computed."""

    time_step: Annotated[float, Range(1e-4, 0.1)] = 0.01  # [s] at most; cycles are divided evenly
    solver_iterations: Annotated[int, Range(1, 1000)] = 5  # of Chipmunk, in each step
    collision_slop: Annotated[float, Range(0.0, 1.0)] = 0.001  # [m] of overlap that Chipmunk does not push apart
    wall_overlap: Annotated[float, Range(0.0, 1.0)] | None = 0.002  # [m] in walls, when a cycle ends; null: any
    # Less than half the smallest Extent, so that something is left of the box within.
    corner_radius: Annotated[float, Range(0.0, 0.004)] = 0.002  # [m] of boxes, where they touch; saves time
    wall_friction: Friction = 0.1  # coefficient of walls and obstacles; that of ARGoS's boxes
