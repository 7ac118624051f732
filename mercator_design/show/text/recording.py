"""One experiment as a file: poses, states and readings of devices, with time stamps."""

from collections.abc import Sequence
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from mercator_design.missions.trace import Trace
from mercator_design.missions.walls import WallTable, open_pieces
from mercator_design.sim import devices as sim_devices
from mercator_design.sim.devices import Recording
from mercator_design.sim.turns import number_of_turns, odometry_of, turns_of

FORMATS = (".csv", ".npz")

_WRITTEN = 6
"""Numbers of each robot at each time: pose, state, outputs."""


def check_size(
    rehearsal: Recording, devices: Sequence[str], *, cycles: int, every: int, with_turns: bool = False
) -> None:
    """Check by a recording of one cycle that an experiment of so many cycles can be recorded.

    Raises:
        SimulationError: if the robot lacks a device, or the recording would be too large.
    """
    kept = sum(array[:1].size for array in rehearsal.history)
    written = rehearsal.history.states[0].size * _WRITTEN + sum(map(rehearsal.values, devices))
    if with_turns:
        beams = len(rehearsal.noise_keys) * len(rehearsal.scene.lidar.beams_x)
        sim_devices.check_size("turns", number_of_turns(rehearsal, cycles) * beams)
    sim_devices.check_size(", ".join(["poses", "states", *devices]), cycles * kept + -(-cycles // every) * written)


def write_recording(
    file: BinaryIO,
    trace: Trace,
    devices: Sequence[str],
    *,
    every: int,
    suffix: str,
    turns: Recording | None = None,
) -> None:
    """Write a recorded experiment.

    Args:
        file: The output file: `.npz` has `Trace.arrays`, `.csv` has `Trace.to_frame`.
        trace: The trace of an experiment run with `record=True`.
        devices: Names of sim.devices.DEVICES.
        every: Record every n-th cycle, and the last.
        suffix: One of FORMATS.
        turns: The recording, if a `.npz` file also has the lidars' turns and the samples of odometry.

    Raises:
        SimulationError: as `Recording.measure` and `turns_of`.
    """
    if suffix == ".npz":
        arrays = trace.arrays(devices, every) | ({} if turns is None else _turns(turns, trace.walls))
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
    else:
        trace.to_frame(devices, every).to_csv(file, index=False)


def _turns(recording: Recording, walls: WallTable | None) -> dict[str, NDArray[np.generic]]:
    """The arrays of turns, odometry and true walls, by name."""
    turns, odometry = turns_of(recording), odometry_of(recording)
    found: dict[str, NDArray[np.generic]] = {
        "turn_start": turns.starts,
        "turn_time": turns.times,
        "turn_angle": turns.angles,
        "turn": turns.ranges.astype(np.float32),
        "odometry_time": odometry.times,
        "odometry": odometry.poses,
    }
    return found if walls is None else found | {"wall": open_pieces(walls)}
