"""What happened in one experiment; all that an objective may look at."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mercator_design.errors import MissionError
from mercator_design.missions.arena import Array
from mercator_design.missions.floor import FloorTable
from mercator_design.missions.floor_kernels import in_zones


def not_measured(device: str, every: int) -> Array:  # noqa: ARG001 - nobody to ask
    """What a device measured, (cycles, robots, ...), in every so many-th cycle: not known of tracked robots.

    Raises:
        MissionError: always.
    """
    raise MissionError(f"this objective needs what the robots' {device} measured, and that was not recorded")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trace:
    """Where the robots were, from the simulator or from a tracking camera.

    Raises:
        ValueError: if the arrays do not fit together.
    """

    poses: Array  # (cycles + 1, robots, 3) x [m], y [m], heading [rad]; row 0 is the start
    states: NDArray[np.int8]  # (cycles, robots) state of each robot's PFSM after each cycle
    floor: FloorTable
    zone_rows: Mapping[str, tuple[int, ...]]  # name of a zone -> its rows in floor.zones
    control_period: float  # [s]
    measure: Callable[[str, int], Array] = not_measured

    def __post_init__(self) -> None:
        cycles, robots = self.states.shape
        if self.poses.shape != (cycles + 1, robots, 3):
            raise ValueError(f"expected poses ({cycles + 1}, {robots}, 3), found {self.poses.shape}")

    @property
    def cycles(self) -> int:
        return len(self.states)

    @property
    def robots(self) -> int:
        return int(self.states.shape[1])

    @property
    def positions(self) -> Array:
        """After each cycle (cycles, robots, 2); the start does not count."""
        return self.poses[1:, :, :2]

    @property
    def final_positions(self) -> Array:
        """After the last cycle (robots, 2)."""
        return self.poses[-1, :, :2]

    def inside(self, zones: tuple[str, ...], positions: Array) -> NDArray[np.bool_]:
        """Whether each of the positions (..., 2) lies in one of the named zones."""
        rows = tuple(row for zone in zones for row in self.zone_rows[zone])
        return in_zones(self.floor.zones, rows, positions)
