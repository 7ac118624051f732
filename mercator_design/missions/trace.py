"""The trace of one experiment: the input of objectives."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from mercator_design.arrays import Flags, Floats, Numbers
from mercator_design.errors import MissionError, SimulationError
from mercator_design.jit import compiled
from mercator_design.missions.dynamics import change_floor
from mercator_design.missions.floor import FloorTable
from mercator_design.missions.floor_kernels import any_contains, colour_at
from mercator_design.missions.plugins import When, Zones
from mercator_design.missions.walls import WallTable

if TYPE_CHECKING:
    import pandas as pd


def every_nth(cycles: int, n: int) -> Numbers:
    """The numbers, from 0, of every n-th cycle: the n-th, the 2n-th and so on, and always the last.

    Raises:
        SimulationError: `n` is below 1.
    """
    if n < 1:
        raise SimulationError(f"every: expected a whole number >= 1, found {n}")
    return np.append(np.arange(n - 1, cycles - 1, n), cycles - 1)


class Measure(Protocol):
    """The readings of a device, (cycles, robots, ...), in the cycles of `every_nth`."""

    def __call__(self, device: str, /, every: int = 1) -> Floats: ...


def not_measured(device: str, /, every: int = 1) -> Floats:  # noqa: ARG001 - nobody to ask
    """The `Measure` of tracked robots, which have no readings.

    Raises:
        MissionError: always.
    """
    raise MissionError(f"this objective needs what the robots' {device} measured, and that was not recorded")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trace:
    """The poses and states of robots, from the simulator or from a tracking camera.

    Only the initial floor is kept: its changes follow from the poses and are computed again on demand. In each cycle
    the floor is as the robots sensed it, after they had moved.

    Raises:
        ValueError: if the arrays do not fit together.
    """

    poses: Floats  # (cycles + 1, robots, 3) x [m], y [m], heading [rad]; row 0 is the start
    states: NDArray[np.int8]  # (cycles, robots) state of each robot's PFSM after each cycle
    floor: FloorTable  # at the start
    zone_rows: Mapping[str, tuple[int, ...]]  # name of a zone -> its rows in floor.zones
    control_period: float  # [s]
    measure: Measure = not_measured
    led_colours: NDArray[np.int8] | None = None  # (cycles, robots) of LED_COLOURS that modules have set; -1: none
    signals: NDArray[np.int8] | None = None  # (cycles, robots) that modules sent; 0: none
    stops: Numbers | None = None  # (robots,) first cycle in which each does not work; `cycles`: none; None: none can
    walls: WallTable | None = None  # that the robots' lidars see; None: not known

    def __post_init__(self) -> None:
        cycles, robots = self.states.shape
        if self.poses.shape != (cycles + 1, robots, 3):
            raise ValueError(f"expected poses ({cycles + 1}, {robots}, 3), found {self.poses.shape}")
        if self.stops is not None and self.stops.shape != (robots,):
            raise ValueError(f"expected stops ({robots},), found {self.stops.shape}")
        for name, outputs in self.outputs.items():
            if outputs.shape != (cycles, robots):
                raise ValueError(f"expected {name} ({cycles}, {robots}), found {outputs.shape}")

    def __repr__(self) -> str:
        return f"<Trace: {self.summary}>"

    @property
    def summary(self) -> str:
        """Its size in a line."""
        robots = f"{self.robots} robot{'s' * (self.robots != 1)}"
        return f"{robots}, {self.cycles} cycle{'s' * (self.cycles != 1)} of {self.control_period:g} s"

    @property
    def outputs(self) -> dict[str, NDArray[np.int8]]:
        """What modules set beside the wheels, by the name of the output, as far as it is known."""
        outputs = {"led_colour": self.led_colours, "signal": self.signals}
        return {name: values for name, values in outputs.items() if values is not None}

    @property
    def cycles(self) -> int:
        return len(self.states)

    @property
    def robots(self) -> int:
        return int(self.states.shape[1])

    @property
    def failed(self) -> Flags:
        """Whether each robot has stopped working (cycles, robots)."""
        stops = np.full(self.robots, self.cycles) if self.stops is None else self.stops
        return np.asarray(np.arange(self.cycles)[:, np.newaxis] >= stops, dtype=np.bool_)

    @property
    def failure_times(self) -> Floats:
        """When each robot stopped working (robots,) [s]; infinite: it did not."""
        stops = np.full(self.robots, self.cycles) if self.stops is None else self.stops
        return np.where(stops < self.cycles, self.control_period * (stops + 1.0), np.inf)

    @property
    def positions(self) -> Floats:
        """Positions after each cycle (cycles, robots, 2), without the start."""
        return self.poses[1:, :, :2]

    @property
    def final_positions(self) -> Floats:
        """Positions after the last cycle (robots, 2)."""
        return self.poses[-1, :, :2]

    def times(self, every: int = 1) -> Floats:
        """The times [s] at the end of every n-th cycle and of the last (cycles,)."""
        times: Floats = np.multiply(self.control_period, every_nth(self.cycles, every) + 1)
        return times

    def arrays(self, devices: Sequence[str] = (), every: int = 1) -> dict[str, NDArray[np.generic]]:
        """The trace at `times(every)`: time (cycles,), pose (cycles, robots, 3), state (cycles, robots), `outputs`;
        failed (cycles, robots) 0 or 1, if robots may fail.

        Then the values of each named device, as `measure`, with its errors.
        """
        cycles = every_nth(self.cycles, every)
        found: dict[str, NDArray[np.generic]] = {
            "time": self.times(every),
            "pose": self.poses[1:][cycles],
            "state": self.states[cycles],
            **{name: values[cycles] for name, values in self.outputs.items()},
            **({} if self.stops is None else {"failed": self.failed[cycles].astype(np.int8)}),
        }
        return found | {name: self.measure(name, every) for name in devices}

    def to_frame(self, devices: Sequence[str] = (), every: int = 1) -> "pd.DataFrame":
        """The same as a table, with a row for each time and robot.

        Columns: time [s], robot, x [m], y [m], heading [rad], state, led_colour, signal, failed if robots
        may fail; then DEVICE_0, DEVICE_1, ...
        of each device.
        """
        import pandas as pd

        arrays = self.arrays(devices, every)
        times = arrays.pop("time")
        columns: dict[str, NDArray[np.generic]] = {
            "time": np.repeat(times, self.robots).round(9),
            "robot": np.tile(np.arange(self.robots), len(times)),
        }
        for name, array in arrays.items():
            flat = array.reshape(len(times) * self.robots, -1)
            labels = ["x", "y", "heading"] if name == "pose" else [name]
            labels = labels if name not in devices else [f"{name}_{k}" for k in range(flat.shape[1])]
            columns |= {label: flat[:, k] for k, label in enumerate(labels)}
        return pd.DataFrame(columns)

    def counted(self, when: When) -> Floats:
        """The positions that count (cycles, robots, 2): of all cycles, or only of the last."""
        return self.positions if when == "always" else self.positions[-1:]

    def rows_of(self, zones: Zones) -> Numbers:
        """The rows of the named zones in `floor.zones`."""
        return np.array([row for zone in zones for row in self.zone_rows[zone]], dtype=np.int64)

    def inside(self, zones: Zones, when: When) -> Flags:
        """Whether each robot's centre lies in one of the named zones (cycles, robots); at the end: (1, robots)."""
        rows = self.rows_of(zones)
        inside = np.empty(self.counted(when).shape[:2], dtype=np.bool_)
        compiled(_mark_inside)(self.floor.copy(), self._poses, self.control_period, rows, inside)
        return inside

    def colors(self, when: When) -> Floats:
        """The floor's colours (cycles, robots, 3) under the robots' centres; at the end: (1, robots, 3)."""
        colors = np.zeros((*self.counted(when).shape[:2], 3))
        compiled(_fill_colors)(self.floor.copy(), self._poses, self.control_period, colors)
        return colors

    def zone_colors(self, zones: Zones) -> Floats:
        """The colours of the named zones (of each tile), after each cycle (cycles, n, 3)."""
        rows = self.rows_of(zones)
        colors = np.zeros((self.cycles, len(rows), 3))
        compiled(_fill_zone_colors)(self.floor.copy(), self._poses, self.control_period, rows, colors)
        return colors

    @property
    def _poses(self) -> Floats:
        return np.ascontiguousarray(self.poses)


def _mark_inside(floor: FloorTable, poses: Floats, period: float, rows: Numbers, inside: Flags) -> None:
    cycles = len(poses) - 1
    first = cycles - len(inside)
    for cycle in range(cycles):
        change_floor(floor, poses[cycle + 1], (cycle + 1) * period)
        if cycle < first:
            continue
        for i in range(poses.shape[1]):
            inside[cycle - first, i] = any_contains(floor, rows, poses[cycle + 1, i, 0], poses[cycle + 1, i, 1])


def _fill_colors(floor: FloorTable, poses: Floats, period: float, colors: Floats) -> None:
    cycles = len(poses) - 1
    first = cycles - len(colors)
    for cycle in range(cycles):
        change_floor(floor, poses[cycle + 1], (cycle + 1) * period)
        if cycle < first:
            continue
        for i in range(poses.shape[1]):
            red, green, blue = colour_at(floor, poses[cycle + 1, i, 0], poses[cycle + 1, i, 1])
            colors[cycle - first, i, 0] = red
            colors[cycle - first, i, 1] = green
            colors[cycle - first, i, 2] = blue


def _fill_zone_colors(floor: FloorTable, poses: Floats, period: float, rows: Numbers, colors: Floats) -> None:
    for cycle in range(len(poses) - 1):
        change_floor(floor, poses[cycle + 1], (cycle + 1) * period)
        for k in range(len(rows)):
            for channel in range(3):
                colors[cycle, k, channel] = floor.zones[rows[k], 6 + channel]
