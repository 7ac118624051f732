"""What a robot perceives from the events of its devices, without ports and clocks.

What measurements mean to a behaviour is said in fsm/, for simulation and robot alike.
"""

import math
from collections.abc import Collection, Iterable, Mapping
from typing import NamedTuple

from mercator_design.config.colours import COLOURS, RGB, ColourName
from mercator_design.errors import RobotError
from mercator_design.fsm.clustering import lidar_neighbours
from mercator_design.fsm.perception import perceive, proximity_weight
from mercator_design.fsm.reference import Readings, ReferenceModel
from mercator_design.robot.devices.health import LineHealth, percent
from mercator_design.robot.devices.link import Event
from mercator_design.robot.devices.ports import DeviceName
from mercator_design.robot.devices.samples import Sample, converted, heading
from mercator_design.robot.devices.settings import Settings, nearest
from mercator_design.robot.devices.sweep import BINS, STEP, Sweep
from mercator_design.robot.protocols.ydlidar import SAMPLE_RATE, Packet

_STRAIGHT = 0.01
"""[rad] since distances came, below which a robot has not turned: what its sensors to the side see is in front by the
cosine of 90 degrees, 6e-17, as in simulation, and rounding of the RVR's yaw must not decide that."""


class Stale(NamedTuple):
    """A sample that cannot be relied on: it is too old, or too little of its line arrives whole.

    device: Which device should have told it.
    words: What is wrong with it.
    is_damaged: Whether too little of the line arrives whole.
    """

    device: DeviceName
    words: str
    is_damaged: bool = False


DEVICE_OF: Mapping[str, DeviceName] = {"proximity": "proximity", "neighbours": "lidar", "ground": "rvr"}
"""Which device each of the senses is of that modules read."""


def why_needed(reads: Collection[str], model: ReferenceModel) -> dict[str, str]:
    """The senses that a PFSM needs which reads some of modules.SENSES, and why."""
    needed = {sense: f"the PFSM reads {sense}" for sense in sorted(reads)}
    if model.neighbour_obstacle_range > 0.0 and "proximity" in needed:
        constant = f"neighbour_obstacle_range is {model.neighbour_obstacle_range:g} m"
        needed.setdefault("neighbours", f"the PFSM reads proximity, with neighbours as obstacles ({constant})")
    return needed


def why_device_is_needed(device: str, reads: Collection[str], model: ReferenceModel) -> str:
    """Why a PFSM needs a device; empty if it does not."""
    for sense, why in why_needed(reads, model).items():
        if DEVICE_OF.get(sense) == device:
            return f"{why}, which the {device} tells"
    return ""


class Senses:
    """The senses of a robot.

    samples: The latest of each sensor, by name: those of `converted`, proximity as the settings correct it, `lidar`,
        without values: when a turn has ended.
    neighbours: Distances [m] and bearings [rad] of the robots that the latest readings have.
    sweep: What the lidar sees, in a frame that does not turn with the robot.
    sight: Readings of its last turn.
    lines: How much of what each device sends arrives whole: of the lidar, of its turns; of the others, of their bytes.
    """

    def __init__(self, settings: Settings, reads: Iterable[str], labels: Mapping[ColourName, RGB]) -> None:
        """Begin without a sample.

        Args:
            settings: What is particular to the robot.
            reads: The senses that are needed, of modules.SENSES.
            labels: What the ground sensor reads on each colour of the floor.

        Raises:
            RobotError: if the robot lacks a sense.
        """
        limits, model = settings.limits, settings.reference_model
        needed = why_needed(set(reads), model)
        if lacking := sorted(needed.keys() - DEVICE_OF.keys()):
            raise RobotError(f"expected a PFSM that reads {', '.join(DEVICE_OF)}, found one that reads {lacking[0]}")
        sources: dict[str, tuple[str, float, DeviceName]] = {
            "proximity": ("proximity", limits.proximity, "proximity"),
            "neighbours": ("lidar", limits.lidar, "lidar"),
            "ground": ("ground", limits.rvr, "rvr"),
            "attitude": ("attitude", limits.rvr, "rvr"),
        }
        self._needed = [sources[sense] for sense in ("attitude", *sorted(needed))]
        self._settings, self._model, self._labels = settings, model, labels
        self._faced = 0.0  # heading [rad] when the latest distances came
        self._found = [0.0] * BINS, [0.0] * BINS, [0.0] * BINS
        self.neighbours: list[tuple[float, float]] = []
        min_shares: dict[DeviceName, float] = {
            "rvr": limits.rvr_whole,
            "lidar": limits.lidar_whole,
            "proximity": limits.proximity_whole,
        }
        self.lines = {device: LineHealth(share) for device, share in min_shares.items()}
        self.forget()

    def take(self, event: Event, now: float) -> bool:
        """Take in what was heard at a time [s]; whether a turn of the lidar has ended with it."""
        for name, sample in converted(event, now):
            values = self._settings.corrected(sample.values) if name == "proximity" else sample.values
            self.samples[name] = Sample(now, values)
            if name == "proximity":
                self._faced = heading(self.samples, now)
        if not isinstance(event, Packet):
            return False
        began = now - (len(event.samples) - 1) / SAMPLE_RATE
        ends = self.sweep.add(event, heading(self.samples, began), heading(self.samples, now))
        if ends:
            self.samples["lidar"] = Sample(now, ())
            self.sight = sum(map(bool, self.sweep.ranges()))
        return ends

    def forget(self) -> None:
        """Begin anew, without a sample."""
        self.samples: dict[str, Sample] = {}
        self.sweep = Sweep(self._settings.lidar_angle)
        self.sight = 0
        for line in self.lines.values():
            line.forget()

    def readings(self, now: float) -> Readings:
        """What the robot perceives at a time [s]; what no sensor tells any more is neutral."""
        limits, model = self._settings.limits, self._model
        distances, bearings_x, bearings_y = self._found
        looks = self._settings.proximity_angles
        proximity: tuple[float, ...] = (math.inf,) * len(looks)
        ground = COLOURS["white"]
        if self._is_told("proximity", now, limits.proximity, "proximity"):
            proximity = self.samples["proximity"].values
        if self._is_told("ground", now, limits.rvr, "rvr"):
            ground = COLOURS[self.label()]
        n = self._find_neighbours(now)
        weights = [proximity_weight(model, distance) for distance in proximity]
        # What was seen up to 0.16 s ago stays where it was, though the robot may have turned by half a radian since.
        turned = math.remainder(heading(self.samples, now) - self._faced, math.tau)
        if abs(turned) < _STRAIGHT:
            turned = 0.0
        return perceive(
            model,
            weights,
            [math.cos(angle - turned) for angle in looks],
            [math.sin(angle - turned) for angle in looks],
            distances,
            bearings_x,
            bearings_y,
            n,
            float(n),
            ground,
            (0.0, 0.0),
        )

    def _find_neighbours(self, now: float) -> int:
        """Find `neighbours` in the lidar's last turn, if it can be relied on; how many they are."""
        n = 0
        if self._is_told("lidar", now, self._settings.limits.lidar, "lidar"):
            front = -heading(self.samples, now)
            n = lidar_neighbours(self._model, self.sweep.ranges(), front, STEP, *self._found)
        distances, x, y = self._found
        self.neighbours = [(distances[k], math.atan2(y[k], x[k])) for k in range(n)]
        return n

    def label(self) -> ColourName:
        """Of the floor: the one whose colour is nearest to the ground's."""
        red, green, blue = self.samples["ground"].values
        return nearest(self._labels, (red, green, blue))

    def age(self, name: str, now: float) -> float:
        """Of a sample at a time [s]; infinite if there is none."""
        return now - self.samples[name].time if name in self.samples else math.inf

    def _is_told(self, name: str, now: float, limit: float, device: DeviceName) -> bool:
        """Whether a sample is not too old, and enough of its device's line arrives whole."""
        return self.age(name, now) <= limit and not self.lines[device].is_broken

    def stale(self, now: float) -> dict[str, Stale]:
        """The samples that are needed and cannot be relied on at a time [s], by name."""
        stale = {}
        for name, limit, device in self._needed:
            age, line = self.age(name, now), self.lines[device]
            if age == math.inf:
                stale[name] = Stale(device, "nothing yet")
            elif age > limit:
                stale[name] = Stale(device, f"nothing for {age:.2f} s; the limit is {limit:g} s")
            elif line.is_broken:
                found = f"only {percent(line.share)} of what the {device} sends arrives whole"
                stale[name] = Stale(device, f"{found}; the limit is {percent(line.min_share)}", is_damaged=True)
        return stale
