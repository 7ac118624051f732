"""A robot's perception from the events of its devices, without ports and clocks.

modules/perception.py makes readings of measurements, in simulation and on the robot.
"""

import math
from collections.abc import Collection, Iterable, Mapping
from typing import NamedTuple, cast

from mercator_design.config.colours import COLOURS, RGB, ColourName
from mercator_design.errors import RobotError
from mercator_design.modules.clustering import lidar_neighbours
from mercator_design.modules.perception import perceive, proximity_weight, ring_order
from mercator_design.modules.reference import SENSES, Readings, ReferenceModel, first_reading
from mercator_design.robot.devices.health import LineHealth, percent
from mercator_design.robot.devices.link import Event
from mercator_design.robot.devices.ports import DEVICES, DeviceName
from mercator_design.robot.devices.samples import SERVICE_OF, Sample, converted, heading, invalid
from mercator_design.robot.devices.settings import Settings, nearest
from mercator_design.robot.devices.sight import REMEDY, Sight
from mercator_design.robot.devices.sweep import BINS, STEP, Sweep
from mercator_design.robot.protocols.ydlidar import SAMPLE_RATE, Packet

_STRAIGHT = 0.01
"""[rad] since the latest distances, below which a robot counts as not turned. Sensors to the side see in front by the
cosine of 90 degrees, 6e-17, as in simulation; rounding of the RVR's yaw must not change its sign."""


class Stale(NamedTuple):
    """A sample that is too old, or of a line with too much damage."""

    device: DeviceName  # that sends it
    words: str  # the fault
    since: float = -math.inf  # [s] time of the latest sample
    is_damaged: bool = False  # whether too little of the line arrives whole
    remedy: str = ""  # what to check, if it is not the line


_HEADING, _ODOMETRY, _RANGES = map(first_reading, ("heading", "odometry", "ranges"))


def _device_of(sample: str) -> DeviceName:
    """The device that a sample is of."""
    return "rvr" if sample in SERVICE_OF else cast("DeviceName", sample)


DEVICE_OF: Mapping[str, DeviceName] = {name: _device_of(sense.sample) for name, sense in SENSES.items() if sense.sample}
"""The device of each sense that the robot has."""


def why_needed(reads: Collection[str], model: ReferenceModel) -> dict[str, str]:
    """The senses that a PFSM needs, with the reason; `reads` are those of modules.SENSES that it reads."""
    needed = {sense: f"the PFSM reads {sense}" for sense in sorted(reads)}
    if model.neighbour_obstacle_range > 0.0 and "proximity" in needed:
        constant = f"neighbour_obstacle_range is {model.neighbour_obstacle_range:g} m"
        needed.setdefault("neighbours", f"the PFSM reads proximity, with neighbours as obstacles ({constant})")
    return needed


def why_device_is_needed(device: str, reads: Collection[str], model: ReferenceModel) -> str:
    """Why a PFSM needs a device; empty if it does not."""
    for sense, why in why_needed(reads, model).items():
        if DEVICE_OF.get(sense) == device:
            return f"{why}, which needs the {device}"
    return ""


class Senses:
    """The senses of a robot.

    samples: The latest sample of each sensor, by name: those of `converted`, with corrected proximity, and `lidar`,
        without values, at the end of a turn.
    neighbours: Distances [m] and bearings [rad] of the robots in the latest readings.
    sweep: The lidar's ranges, in a frame that does not turn with the robot.
    sight: Judges what it sees.
    count_from_start: Whether what is needed depends on where heading and place began to count.
    lines: The share that arrives whole: of the lidar's turns, and of the other devices' bytes.
    """

    def __init__(self, settings: Settings, reads: Iterable[str], labels: Mapping[ColourName, RGB]) -> None:
        """Make senses without a sample.

        Args:
            settings: The robot's settings.
            reads: The senses that are needed, of modules.SENSES.
            labels: What the ground sensor reads on each colour of the floor.

        Raises:
            RobotError: if the robot lacks a sense.
        """
        model = settings.reference_model
        needed = why_needed(set(reads), model)
        if lacking := sorted(needed.keys() - DEVICE_OF.keys()):
            raise RobotError(f"expected a PFSM that reads {', '.join(DEVICE_OF)}, found one that reads {lacking[0]}")
        self._turns_matter = any(SENSES[sense].follows_turns for sense in needed)
        self.count_from_start = any(SENSES[sense].counts_from_start for sense in needed)
        self._needed = [*dict.fromkeys(["attitude", *(SENSES[sense].sample for sense in sorted(needed))])]
        self._settings, self._model, self._labels = settings, model, labels
        self._faced = 0.0  # heading [rad] when the latest distances came
        self._found = [0.0] * BINS, [0.0] * BINS, [0.0] * BINS
        self.neighbours: list[tuple[float, float]] = []
        self._interval: dict[str, float] = {}  # [s] between the two latest samples, by name
        self._dark: tuple[float, float] | None = None  # [s] times of the first and the latest sample that is 0, 0, 0
        self.lines = {device: LineHealth(getattr(settings.limits, f"{device}_whole")) for device in DEVICES}
        self.sight = Sight(settings.limits.lidar_blind, settings.lidar.blind, model.lidar_nearest)
        self.forget()

    def take(self, event: Event, now: float) -> None:
        """Take in an event that was read at a time [s]."""
        for name in invalid(event):
            self._invalid[name] = self._invalid.get(name, 0) + 1
        for name, values in converted(event):
            if name in self.samples:
                self._interval[name] = self.age(name, now)
            self._invalid.pop(name, None)
            if name == "ground":
                first = now if self._dark is None else self._dark[0]
                self._dark = None if any(values) else (first, now)
            self.samples[name] = Sample(now, self._settings.corrected(values) if name == "proximity" else values)
            if name == "proximity":
                self._faced = heading(self.samples, now)
        if not isinstance(event, Packet):
            return
        began = now - (len(event.samples) - 1) / SAMPLE_RATE
        faces = heading(self.samples, now)
        if self.sweep.add(event, heading(self.samples, began), faces, now):
            self.samples["lidar"] = Sample(now, ())
            self.sight.take(self.sweep.readings, self.sweep.ranges(), faces, now)

    @property
    def needed_of_rvr(self) -> list[str]:
        """The sensors of the RVR that are needed."""
        return [name for name in self._needed if name in SERVICE_OF]

    @property
    def wanted_of_rvr(self) -> list[str]:
        """The sensors of the RVR that make readings more exact: a robot that turns has turned since its attitude."""
        return ["turning"] if self._turns_matter else []

    @property
    def is_dark(self) -> bool:
        """Whether the ground sensor has read nothing but 0, 0, 0 for so long that it sees no floor, black or not."""
        limit = self._settings.limits.dark
        return limit is not None and self._dark is not None and self._dark[1] - self._dark[0] >= limit

    @property
    def may_be_dark(self) -> bool:
        """Whether that is not known yet of a ground sensor that is needed."""
        limit = self._settings.limits.dark
        return "ground" in self._needed and None not in {limit, self._dark} and not self.is_dark

    def forget(self, now: float = -math.inf) -> None:
        """Forget all samples at a time [s], and restart the counts of lines."""
        self.samples: dict[str, Sample] = {}
        self._forgot = now
        self._invalid: dict[str, int] = {}  # samples that the RVR marks as invalid since the latest valid one, by name
        self.sweep = Sweep(self._settings.lidar_angle, self._settings.lidar.blind, self._model.lidar_nearest)
        self.sight.forget()
        for line in self.lines.values():
            line.forget()

    def readings(self, now: float) -> Readings:
        """The readings at a time [s]; those of a silent sensor, or of a ground sensor that is dark, are neutral."""
        model, angles = self._model, self._settings.proximity_angles
        distances, bearings_x, bearings_y = self._found
        proximity: tuple[float, ...] = (math.inf,) * len(angles)
        ground = COLOURS["white"]
        if self._stale("proximity", now) is None:
            proximity = self.samples["proximity"].values
        if self._stale("ground", now) is None and not self.is_dark:
            ground = COLOURS[self.label()]
        row = [*Readings()]
        if self._stale("attitude", now) is None:
            row[_HEADING] = math.remainder(heading(self.samples, now), math.tau)
        if self._stale("position", now) is None:
            row[_ODOMETRY : _ODOMETRY + 2] = self.samples["position"].values
        n = self._find_neighbours(now)
        weights = [proximity_weight(model, distance) for distance in proximity]
        row[_RANGES : _RANGES + len(angles)] = [weights[k] for k in ring_order(angles)]
        # Distances may be 0.16 s old, and the robot may have turned by half a radian since.
        turned = math.remainder(heading(self.samples, now) - self._faced, math.tau)
        if abs(turned) < _STRAIGHT:
            turned = 0.0
        return perceive(
            model,
            weights,
            [math.cos(angle - turned) for angle in angles],
            [math.sin(angle - turned) for angle in angles],
            distances,
            bearings_x,
            bearings_y,
            n,
            float(n),
            ground,
            (0.0, 0.0),
            row,
        )

    def _find_neighbours(self, now: float) -> int:
        """Find `neighbours` in the lidar's last turn, if it is fresh; return their number."""
        n = 0
        if self._stale("lidar", now) is None:
            front = -heading(self.samples, now)
            n = lidar_neighbours(self._model, self.sweep.ranges(), front, STEP, *self._found)
        distances, x, y = self._found
        self.neighbours = [(distances[k], math.atan2(y[k], x[k])) for k in range(n)]
        return n

    def label(self) -> ColourName:
        """The label of the floor whose colour is nearest to the latest ground sample."""
        red, green, blue = self.samples["ground"].values
        return nearest(self._labels, (red, green, blue))

    def age(self, name: str, now: float) -> float:
        """The age of a sample at a time [s]; infinite if there is none."""
        return now - self.samples[name].time if name in self.samples else math.inf

    def stale(self, now: float) -> dict[str, Stale]:
        """The samples that are needed and not fresh at a time [s], by name."""
        return {name: stale for name in self._needed if (stale := self._stale(name, now)) is not None}

    def slow(self) -> dict[str, Stale]:
        """The samples of the RVR that are needed and come too seldom, by name: they would soon not be fresh."""
        limit, found = self._settings.limits.rvr, {}
        for name in self.needed_of_rvr:
            interval = self._interval.get(name, math.inf)
            if interval > limit:
                words = "one sample, and no other" if interval == math.inf else f"{interval:.2f} s between two samples"
                found[name] = Stale("rvr", f"{words}; the limit is {limit:g} s")
        return found

    def _stale(self, name: str, now: float) -> Stale | None:
        """Why a sample is not fresh; None if it is young enough, and enough of its device's line arrives whole."""
        device, age = _device_of(name), self.age(name, now)
        limit, line = getattr(self._settings.limits, device), self.lines[device]
        if age > limit:
            since = max(now - age, self._forgot)
            found = "nothing yet" if age == math.inf else f"nothing for {age:.2f} s"
            if name in self._invalid:
                found += f", as the RVR marks all samples as invalid ({self._invalid[name]})"
            elif self._interval.get(name, 0.0) > limit:
                found += f", and {self._interval[name]:.2f} s between the samples before"
            return Stale(device, found if age == math.inf else f"{found}; the limit is {limit:g} s", since)
        if line.is_broken:
            found = f"only {percent(line.share)} of what the {device} sends arrives whole"
            return Stale(device, f"{found}; the limit is {percent(line.min_share)}", is_damaged=True)
        if name == "lidar" and (why := self.sight.failure()):
            return Stale(device, why, remedy=REMEDY)
        return None
