"""The mapper's input from a robot: turns of its lidar, odometry, and the true poses where they are known."""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from mercator_design.arrays import Floats

MAX_RANGE = 12.0
"""[m] Of a lidar, if its log does not say: that of an X4."""
HEAD_RADIUS = 0.035
"""[m] Of what the lidars see of other robots: the lidar of a Mercator."""


class Turn(NamedTuple):
    """One turn of a lidar; its beams are in the order of time (those of an X4 go clockwise: the angles fall)."""

    times: Floats  # (n,) [s] of each beam, rising
    angles: Floats  # (n,) [rad], counter-clockwise, in the frame of the lidar
    ranges: Floats  # (n,) [m]; 0 where nothing returned

    @property
    def middle(self) -> float:
        """The reference time [s] of the turn: the middle between its first and last beam."""
        return 0.5 * float(self.times[0] + self.times[-1])


def _no_offset() -> Floats:
    return np.zeros(3)


@dataclass(frozen=True)
class RobotLog:
    """The log of one robot, on one clock."""

    name: str
    turns: list[Turn]  # in the order of time; none is empty
    odometry_times: Floats  # (m,) [s], rising
    odometry: Floats  # (m, 3) [m, m, rad]; the headings are unwrapped
    lidar_pose: Floats = field(default_factory=_no_offset)  # (3,) of the lidar on the robot
    start: Floats | None = None  # (3,) of the robot in the common frame at the odometry's first time; None: unknown
    truth_times: Floats | None = None  # (k,) [s], rising
    truth: Floats | None = None  # (k, 3) of the robot; the headings are unwrapped
    max_range: float = MAX_RANGE  # [m] of readings that count
    head_radius: float = HEAD_RADIUS  # [m] of other robots, at the height of the lidar
    notes: tuple[str, ...] = ()  # sentences on what is wrong with the log
    walls: Floats | None = None  # (w, 4) true walls that the lidar can see: x, y [m] of both ends

    def started(self, pose: Floats) -> "RobotLog":
        """The same log, of a robot that began at a pose (3,) in the common frame."""
        return replace(self, start=np.asarray(pose, float))

    @property
    def duration(self) -> float:
        """Seconds from the first to the last turn."""
        return self.turns[-1].middle - self.turns[0].middle if self.turns else 0.0
