"""What a robot perceives, from what its devices tell: bytes and clocks are others' business.

What measurements mean to a behaviour is said in fsm/, for simulation and robot alike.
"""

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from mercator_design.colours import COLOURS, RGB, ColourName
from mercator_design.errors import RobotError
from mercator_design.fsm.clustering import lidar_neighbours
from mercator_design.fsm.perception import perceive, proximity_weight
from mercator_design.fsm.reference import Readings
from mercator_design.robot.ports import DeviceName
from mercator_design.robot.samples import Sample, converted, heading
from mercator_design.robot.settings import Settings, nearest
from mercator_design.robot.sweep import BINS, STEP, Sweep
from mercator_design.robot.talk import Event
from mercator_design.robot.ydlidar import SAMPLE_RATE, Packet


class Stale(NamedTuple):
    """A sample that cannot be relied on.

    device: Which device should have told it.
    words: What is wrong with it.
    """

    device: DeviceName
    words: str


class Senses:
    """The senses of a robot.

    samples: The latest of each sensor, by name: those of `converted`, proximity as the settings correct it, `lidar`,
        without values: when a turn has ended.
    neighbours: Distances [m] and bearings [rad] of the robots that the latest readings have.
    sweep: What the lidar sees, in a frame that does not turn with the robot.
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
        limits = settings.limits
        sources: dict[str, tuple[str, float, DeviceName]] = {
            "proximity": ("proximity", limits.proximity, "proximity"),
            "neighbours": ("lidar", limits.lidar, "lidar"),
            "ground": ("ground", limits.rvr, "rvr"),
        }
        if lacking := sorted(set(reads) - set(sources)):
            raise RobotError(f"expected a PFSM that reads {', '.join(sources)}, found one that reads {lacking[0]}")
        sources["attitude"] = ("attitude", limits.rvr, "rvr")
        self._needed = [sources[sense] for sense in ("attitude", *sorted(reads))]
        self._settings, self._model, self._labels = settings, settings.reference_model, labels
        self._looks_x = [math.cos(angle) for angle in settings.proximity_angles]
        self._looks_y = [math.sin(angle) for angle in settings.proximity_angles]
        self._found = [0.0] * BINS, [0.0] * BINS, [0.0] * BINS
        self.samples: dict[str, Sample] = {}
        self.neighbours: list[tuple[float, float]] = []
        self.sweep = Sweep(settings.lidar_angle)

    def take(self, event: Event, now: float) -> bool:
        """Take in what was heard at a time [s]; whether a turn of the lidar has ended with it."""
        for name, sample in converted(event, now):
            values = self._settings.corrected(sample.values) if name == "proximity" else sample.values
            self.samples[name] = Sample(now, values)
        if not isinstance(event, Packet):
            return False
        began = now - (len(event.samples) - 1) / SAMPLE_RATE
        ends = self.sweep.add(event, heading(self.samples, began), heading(self.samples, now))
        if ends:
            self.samples["lidar"] = Sample(now, ())
        return ends

    def forget(self) -> None:
        """Forget all samples."""
        self.samples.clear()
        self.sweep = Sweep(self._settings.lidar_angle)

    def readings(self, now: float) -> Readings:
        """What the robot perceives at a time [s]; what no sensor tells any more is neutral."""
        limits, model = self._settings.limits, self._model
        distances, bearings_x, bearings_y = self._found
        proximity: tuple[float, ...] = (math.inf,) * len(self._looks_x)
        ground = COLOURS["white"]
        if self.age("proximity", now) <= limits.proximity:
            proximity = self.samples["proximity"].values
        if self.age("ground", now) <= limits.rvr:
            ground = COLOURS[self.label()]
        n = self._find_neighbours(now)
        weights = [proximity_weight(model, distance) for distance in proximity]
        return perceive(
            model,
            weights,
            self._looks_x,
            self._looks_y,
            distances,
            bearings_x,
            bearings_y,
            n,
            float(n),
            ground,
            (0.0, 0.0),
        )

    def _find_neighbours(self, now: float) -> int:
        """Find `neighbours` in the lidar's last turn, if it is not too old; how many they are."""
        n = 0
        if self.age("lidar", now) <= self._settings.limits.lidar:
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

    def stale(self, now: float) -> dict[str, Stale]:
        """The samples that are needed and too old at a time [s], by name."""
        stale = {}
        for name, limit, device in self._needed:
            if (age := self.age(name, now)) > limit:
                found = f"nothing for {age:.2f} s; the limit is {limit:g} s" if math.isfinite(age) else "nothing yet"
                stale[name] = Stale(device, found)
        return stale
