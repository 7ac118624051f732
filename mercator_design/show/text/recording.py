"""One experiment as a file: poses, states and readings of devices, with time stamps."""

from collections.abc import Sequence
from typing import BinaryIO

import numpy as np

from mercator_design.missions.trace import Trace
from mercator_design.sim import devices as sim_devices
from mercator_design.sim.devices import Recording

FORMATS = (".csv", ".npz")

_WRITTEN = 6
"""Numbers of each robot at each time: pose, state, outputs."""


def check_size(rehearsal: Recording, devices: Sequence[str], *, cycles: int, every: int) -> None:
    """Check by a recording of one cycle that an experiment of so many cycles can be recorded.

    Raises:
        SimulationError: if the robot lacks a device, or the recording would be too large.
    """
    kept = sum(array[:1].size for array in rehearsal.history)
    written = rehearsal.history.states[0].size * _WRITTEN + sum(map(rehearsal.values, devices))
    sim_devices.check_size(", ".join(["poses", "states", *devices]), cycles * kept + -(-cycles // every) * written)


def write_recording(file: BinaryIO, trace: Trace, devices: Sequence[str], *, every: int, suffix: str) -> None:
    """Write a recorded experiment.

    Args:
        file: The output file: `.npz` has `Trace.arrays`, `.csv` has `Trace.to_frame`.
        trace: The trace of an experiment run with `record=True`.
        devices: Names of sim.devices.DEVICES.
        every: Record every n-th cycle, and the last.
        suffix: One of FORMATS.

    Raises:
        SimulationError: as `Recording.measure`.
    """
    if suffix == ".npz":
        np.savez_compressed(file, **trace.arrays(devices, every))  # type: ignore[arg-type]
    else:
        trace.to_frame(devices, every).to_csv(file, index=False)
