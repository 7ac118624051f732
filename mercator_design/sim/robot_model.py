"""The robot model: a robot's body, drive, sensors and noise in simulation, from a YAML file.

Shipped models lie in scenarios/robots/. A model also carries the constants of the reference model, so that a design
and its assessment may differ in either (pseudo-reality) without a line of code.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from mercator_design import shipped
from mercator_design.errors import MissionError
from mercator_design.fsm.reference import ReferenceModel
from mercator_design.loading import Range, read

Spread = Annotated[float, Range(0.0, 1000.0)]
Size = Annotated[float, Range(0.01, 10.0)]
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
class Body:
    """A box around the robot's centre."""

    length: Size  # [m] along the heading
    width: Size  # [m]
    mass: Amount  # [kg]
    friction: Friction = 0.7
    elasticity: Annotated[float, Range(0.0, 1.0)] = 0.0

    @property
    def inertia(self) -> float:
        """Moment of inertia of the box [kg m2]."""
        return self.mass * (self.length**2 + self.width**2) / 12.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Drive:
    """Two treads, with a limited force to reach the commanded velocity."""

    tread_distance: Size  # [m]
    maximum_speed: Size  # [m/s] of a tread
    force: Amount  # [N]
    torque: Amount  # [N m]
    noise: Noise = None  # as a fraction of a tread's speed


@dataclass(frozen=True, slots=True, kw_only=True)
class Proximity:
    """A ring of distance sensors; their range and its meaning are in the reference model."""

    ring_radius: Annotated[float, Range(0.0, 10.0)]  # [m] where the rays start
    angles: tuple[float, ...]  # [rad] in the order of the device's numbering
    noise: Noise = None  # [m]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ground:
    """A colour sensor that looks at the floor."""

    position: tuple[float, float]  # [m] from the centre: forwards, to the left
    noise: Noise = None  # a channel of 0 to 255


@dataclass(frozen=True, slots=True, kw_only=True)
class Physics:
    """How finely the motion is computed."""

    time_step: Annotated[float, Range(0.0, 0.1, exclusive_low=True)] = 0.01  # [s] at most; a cycle is divided evenly
    solver_iterations: Annotated[int, Range(1, 1000)] = 10
    collision_slop: Annotated[float, Range(0.0, 1.0)] = 0.001  # [m] overlap that is not pushed apart
    wall_overlap: Annotated[float, Range(0.0, 1.0)] | None = 0.002  # [m] allowed at the end of a cycle; None: any
    wall_friction: Friction = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotModel:
    """A robot in simulation."""

    schema: Literal[1] = 1
    name: str  # by default the file's
    description: str = ""
    body: Body
    drive: Drive
    proximity: Proximity
    ground: Ground
    reference_model: ReferenceModel = ReferenceModel()
    physics: Physics = Physics()

    @property
    def fastest(self) -> float:
        """The highest speed of a point of the body [m/s]: a corner, driving and spinning at full speed."""
        spin = 2.0 * self.drive.maximum_speed / self.drive.tread_distance
        return self.drive.maximum_speed + spin * self.corner

    @property
    def corner(self) -> float:
        """Distance from the centre to a corner of the body [m]."""
        return 0.5 * math.hypot(self.body.length, self.body.width)


def load_robot_model(name_or_path: str) -> RobotModel:
    """A robot model by the name of a shipped one, or by path.

    Raises:
        MissionError: if there is none, or it is not valid.
    """
    path = shipped.find(name_or_path, shipped.robot_models(), "robot model")
    return read(path, RobotModel, error=MissionError, defaults={"name": path.stem})
