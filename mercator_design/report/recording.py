"""One experiment as a file: where the robots were, their states, and what devices measured, with time stamps."""

from collections.abc import Sequence
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from mercator_design.missions.trace import every_nth
from mercator_design.sim import devices as sim_devices
from mercator_design.sim.devices import Recording

FORMATS = (".csv", ".npz")

_POSE_AND_STATE = 4
"""Numbers of each robot at each time."""


def check_size(rehearsal: Recording, devices: Sequence[str], *, cycles: int, every: int) -> None:
    """Make sure that an experiment of so many cycles can be recorded, by a recording of one cycle of it.

    Raises:
        SimulationError: if the robot lacks a device, or it would be too large to keep in memory and in one file.
    """
    kept = sum(array[:1].size for array in rehearsal.history)
    written = rehearsal.history.states[0].size * _POSE_AND_STATE + sum(map(rehearsal.values, devices))
    sim_devices.check_size(", ".join(["poses", "states", *devices]), cycles * kept + -(-cycles // every) * written)


def write_recording(file: BinaryIO, recording: Recording, devices: Sequence[str], *, every: int, suffix: str) -> None:
    """Write a recorded experiment.

    `.npz` has an array for each of time (cycles,), pose (cycles, robots, 3), state (cycles, robots) and each device;
    `.csv` has a line for each time and robot, and a column for each number.

    Args:
        file: To write to.
        recording: Of an experiment run with `record=True`.
        devices: Names of sim.devices.DEVICES.
        every: Which cycles: every so many-th, and the last.
        suffix: Of FORMATS.

    Raises:
        SimulationError: as `Recording.measure`.
    """
    cycles = every_nth(len(recording.history.states), every)
    arrays: dict[str, NDArray[np.generic]] = {
        "pose": recording.history.poses[1:][cycles],
        "state": recording.history.states[cycles],
    }
    arrays |= {name: recording.measure(name, every) for name in devices}
    if suffix == ".npz":
        np.savez_compressed(file, time=recording.times(every), **arrays)  # type: ignore[arg-type]
    else:
        _write_table(file, recording.times(every), arrays)


def _write_table(file: BinaryIO, times: NDArray[np.float64], arrays: dict[str, NDArray[np.generic]]) -> None:
    import pandas as pd

    cycles, robots = arrays["state"].shape
    columns: dict[str, NDArray[np.generic]] = {
        "time": np.repeat(times, robots).round(9),
        "robot": np.tile(np.arange(robots), cycles),
    }
    for name, array in arrays.items():
        flat = array.reshape(cycles * robots, -1)
        labels = {"pose": ["x", "y", "heading"], "state": ["state"]}.get(name)
        labels = labels or [f"{name}_{k}" for k in range(flat.shape[1])]
        columns |= {label: flat[:, k] for k, label in enumerate(labels)}
    pd.DataFrame(columns).to_csv(file, index=False)
