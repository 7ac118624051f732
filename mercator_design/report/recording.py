"""One experiment as a file: where the robots were, their states, and what devices measured, with time stamps."""

import io
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mercator_design.errors import SimulationError
from mercator_design.sim.devices import Recording

FORMATS = (".csv", ".npz")

_MOST_VALUES = 200_000_000
"""Of a recording: 1.6 GB."""


def recording_bytes(recording: Recording, devices: Sequence[str], *, every: int, suffix: str) -> bytes:
    """A recorded experiment as the contents of a file.

    `.npz` has an array for each of time (cycles,), pose (cycles, robots, 3), state (cycles, robots) and each device;
    `.csv` has a line for each time and robot, and a column for each number.

    Args:
        recording: Of an experiment run with `record=True`.
        devices: Names of sim.devices.DEVICES.
        every: Which cycles: every so many-th, from the first on.
        suffix: Of FORMATS.

    Raises:
        SimulationError: if the robot lacks a device, or the file would be too large.
    """
    arrays: dict[str, NDArray[np.generic]] = {
        "pose": recording.history.poses[1::every],
        "state": recording.history.states[::every],
    }
    for name in devices:
        arrays[name] = recording.measure(name, every)
        values = sum(array.size for array in arrays.values())
        if values > _MOST_VALUES:
            raise SimulationError(f"{values} values are too many for one file; record fewer cycles or devices")
    stream = io.BytesIO()
    if suffix == ".npz":
        np.savez_compressed(stream, time=recording.times(every), **arrays)  # type: ignore[arg-type]
    else:
        _write_table(stream, recording.times(every), arrays)
    return stream.getvalue()


def _write_table(stream: io.BytesIO, times: NDArray[np.float64], arrays: dict[str, NDArray[np.generic]]) -> None:
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
    pd.DataFrame(columns).to_csv(stream, index=False)
