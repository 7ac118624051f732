"""The robot model: a robot in simulation, from a YAML file; its parts are in robot_parts.py.

Shipped models lie in scenarios/robots/. A model also carries the constants of the reference model, so that a design
and its assessment may differ in either (pseudo-reality) without a line of code.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np

from mercator_design.config import shipped
from mercator_design.config.building import is_name
from mercator_design.config.loading import read
from mercator_design.config.schema import FieldError, Range, checked
from mercator_design.config.yaml_tree import FromFile
from mercator_design.errors import MissionError, excerpt
from mercator_design.modules.flavour import flavour_of
from mercator_design.modules.reference import SENSES, ReferenceModel, Sense, n_readings
from mercator_design.sim.fields import found_at, mistakes_in, replaced
from mercator_design.sim.robot_parts import (
    AmbientLight,
    BoxBody,
    DeviceWithAxes,
    DiscBody,
    Drive,
    Failures,
    Ground,
    Imu,
    Leds,
    Lidar,
    LidarNeighbours,
    LightCamera,
    LightRing,
    Locator,
    MotionSensor,
    Neighbours,
    Physics,
    Proximity,
)

Bound = Annotated[float, Range(-1e9, 1e9)]


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotModel(FromFile):
    """A robot in simulation; it lacks the devices that are null."""

    KIND: ClassVar = "robot model"
    UNWRITTEN: ClassVar = ("failures",)

    schema: Literal[1] = 1  # version of this format
    name: str  # by default the file's
    description: str = ""  # what the robot is, in a line
    body: BoxBody | DiscBody  # what moves and collides
    drive: Drive
    proximity: Proximity | None = None
    ground: Ground | None = None
    neighbours: Neighbours | LidarNeighbours | None = None  # how robots perceive each other
    light: LightRing | LightCamera | None = None  # how robots perceive the direction of lights
    lidar: Lidar | None = None
    ambient_light: AmbientLight | None = None
    velocity: DeviceWithAxes | None = None  # [m/s] along the start's axes
    accelerometer: DeviceWithAxes | None = None  # [g] along x, y and z
    gyroscope: MotionSensor | None = None  # [rad/s] about x, y and z
    imu: Imu | None = None  # [rad] of pitch, roll and yaw
    locator: Locator | None = None  # [m] from the start, along the world's axes
    quaternion: MotionSensor | None = None  # w, x, y, z of the orientation against that at the start
    leds: Leds | None = None
    reference_model: ReferenceModel = ReferenceModel()
    physics: Physics = Physics()
    failures: Failures | None = None  # of robots in mid-run; null: all work to the end
    vary: Mapping[str, tuple[Bound, Bound]] | None = None  # bounds of the value of each key, drawn for each instance

    def __post_init__(self) -> None:
        checked(self._mistakes())
        if self.vary:
            object.__setattr__(self, "vary", {found_at(self, way)[0]: bounds for way, bounds in self.vary.items()})

    def _mistakes(self) -> Iterator[FieldError]:
        yield from (FieldError("vary", what) for what in mistakes_in(self.vary or {}, self))
        if self.ground is not None and self.ground.labels is not None and not self.sees_colours:
            yield FieldError("ground.labels", "expected null, as its ground sensors see no colours")
        if isinstance(self.neighbours, LidarNeighbours):
            if self.lidar is None:
                yield FieldError("neighbours.device", "there is no lidar")
            elif self.lidar.head_radius == 0.0 and self.lidar.height >= self.body.height:
                yield FieldError("neighbours.device", "the lidar sees no robots: lidar.head_radius is 0")

    def __repr__(self) -> str:
        return f"<RobotModel {self.name}: {', '.join(sorted(self.senses)) or 'no senses'}>"

    @property
    def fastest(self) -> float:
        """The highest speed of a point of the body [m/s]: a corner, driving and spinning at full speed."""
        spin = 2.0 * self.drive.maximum_speed / self.drive.tread_distance
        return self.drive.maximum_speed + spin * self.body.corner

    def drawn(self, random: np.random.Generator) -> "RobotModel":
        """The robot model of one instance; the values of `vary` are drawn uniformly between their bounds."""
        model: RobotModel = self
        for key, (low, high) in (self.vary or {}).items():
            model = replaced(model, key.split("."), float(random.uniform(low, high)))
        return model

    def with_flavour(self, flavour: str) -> "RobotModel":
        """This robot with the constants of a flavour."""
        constants = flavour_of(flavour).reference_model(self.reference_model)
        return self if constants == self.reference_model else replace(self, reference_model=constants)

    @property
    def sees_colours(self) -> bool:
        """Whether the robot perceives the colour of the ground, not only the brightness."""
        return self.ground is not None and not self.ground.gray and self.reference_model.ground_vote_cycles == 0.0

    @property
    def senses(self) -> frozenset[str]:
        """The senses of modules that the robot has."""
        return frozenset(name for name, sense in SENSES.items() if self._has(name, sense))

    def _has(self, name: str, sense: Sense) -> bool:
        device = getattr(self, sense.device)
        return device is not None and (not sense.each or len(getattr(device, sense.each, ())) == n_readings(name))


def load_robot_model(name_or_path: str) -> RobotModel:
    """A robot model by path, or a shipped one by its name.

    Raises:
        MissionError: if there is none, or it is not valid.
    """
    path = shipped.find(name_or_path, shipped.robot_models(), "robot model")
    model = _read(path)
    for key, bounds in (model.vary or {}).items():
        for value in bounds:  # check that each is valid
            override = f"{key}={value!r}"
            try:
                _read(path, overrides=(override,))
            except MissionError as error:
                messages = [message.removeprefix(f"--set {excerpt(override)}: ") for message in error.messages]
                raise MissionError(*(f"{model.where('vary')}: {what}" for what in messages)) from None
    return model


def _read(path: Path, overrides: Sequence[str] = ()) -> RobotModel:
    defaults = {"name": path.stem}
    return read(path, RobotModel, error=MissionError, overrides=overrides, defaults=defaults, find_base=_find_base)


def _find_base(name: str, folder: Path) -> Path:
    path = name if is_name(name) else str(folder / name)
    return shipped.find(path, shipped.robot_models(), "robot model")
