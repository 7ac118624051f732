"""Traces as experiments: tables of poses that `mdesign record` wrote, or a tracking camera saw."""

import io
import math
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mercator_design.arrays import Floats
from mercator_design.errors import MissionError, excerpt
from mercator_design.missions.trace import Trace
from mercator_design.modules.architecture import Software
from mercator_design.modules.reference import LED_COLOURS, MAX_SIGNAL
from mercator_design.results.experiments.experiment import MAX_CELLS, ShownExperiment, check_extent
from mercator_design.sim.simulate import Simulator
from mercator_design.software.architectures import part_names
from mercator_design.system.files import contents_of

SUFFIXES = (".csv", ".npz")

_MAX_SIZE = 256 * 1024 * 1024  # of a file
MAX_UNPACKED = 8 * 16 * MAX_CELLS  # bytes of an .npz
_COLUMNS = ("time", "robot", "x", "y", "heading")
_WHOLE = {"state": (0, 127), "led_colour": (-1, len(LED_COLOURS) - 1), "signal": (0, MAX_SIGNAL), "failed": (0, 1)}
"""Columns of whole numbers, which may be missing, and their lowest and highest values."""
_ARRAYS = ("time", "pose", *_WHOLE)
_SAME_TIME = 1e-6  # [s]
_MAX_TIME = 1e9  # [s]

_Array: TypeAlias = NDArray[Any]


class _Table(NamedTuple):
    """The arrays of a file."""

    times: Floats
    poses: Floats
    states: _Array
    outputs: dict[str, _Array]  # by the name of the output, as far as they are known


def read_trace(
    path: Path, simulator: Simulator, seed: int, pfsm: Software | None, *, names: tuple[str, ...] = ()
) -> ShownExperiment:
    """An experiment from a table of poses.

    Args:
        path: `.npz` as `Trace.arrays`, or `.csv` as `Trace.to_frame`; state, led_colour, signal and failed may
            be missing.
        simulator: The simulator of the mission in which it took place.
        seed: Seed of the instance, for its floor, and for its starting poses if the table begins after the first cycle.
        pfsm: The control software of the robots, if it is known.
        names: Names of its states; by default those of their behaviours.

    Raises:
        MissionError: The file is not such a table, or its states are not those of the PFSM.
    """
    data = io.BytesIO(contents_of(path, _MAX_SIZE, MissionError))
    times, poses, states, outputs = (_read_npz if path.suffix.lower() == ".npz" else _read_csv)(path, data)
    period = _period(path, times)
    check_extent(path.name, len(times), states.shape[1], period)
    instance = simulator.instance(seed)
    failed = outputs.pop("failed", None)
    start = instance.swarm.poses[:, :3]
    if times[0] > 0.5 * period:
        same = len(start) == poses.shape[1] and math.isclose(period, simulator.mission.control_period)
        poses = np.concatenate([start[np.newaxis] if same else poses[:1], poses])
    else:
        states = states[1:]
        outputs = {name: values[1:] for name, values in outputs.items()}
    if pfsm is not None and states.max(initial=0) >= (n := len(part_names(pfsm))):
        raise MissionError(f"{path}: expected states of the control software, below {n}, found {states.max()}")
    return ShownExperiment(
        title=path.name,
        trace=Trace(
            poses=poses,
            states=states,
            floor=instance.scene.floor,
            zone_rows=instance.zone_rows,
            walls=instance.walls,
            control_period=period,
            led_colours=outputs.get("led_colour"),
            signals=outputs.get("signal"),
            stops=None if failed is None else (failed[-len(states) :] == 0).sum(axis=0),
        ),
        robot_model=instance.robot_model,
        mission=simulator.mission,
        pfsms=() if pfsm is None else (pfsm,),
        pfsm_of=() if pfsm is None else (0,) * poses.shape[1],
        named_states=(names,) if names else (),
    )


def _read_npz(path: Path, data: io.BytesIO) -> _Table:
    try:
        with zipfile.ZipFile(data) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
        if size > MAX_UNPACKED:
            raise ValueError(f"{size // 2**20} MiB of arrays")  # noqa: TRY301 - said as the other mistakes
        data.seek(0)
        with np.load(data, allow_pickle=False) as file:
            found = {name: file[name] for name in _ARRAYS if name in file}
    except Exception as error:  # noqa: BLE001 - damaged archives raise errors of many kinds
        what = f"{type(error).__name__}: {excerpt(str(error))}"
        raise MissionError(f"{path}: expected a trace that `mdesign record` wrote, found {what}") from None
    return _checked(path, found)


def _read_csv(path: Path, data: io.BytesIO) -> _Table:
    import pandas as pd

    try:
        table = pd.read_csv(data)
    except ValueError as error:  # pandas' errors are ValueErrors
        what = excerpt(str(error))
        raise MissionError(f"{path}: expected a table as `mdesign record` writes it, found {what}") from None
    if missing := [name for name in _COLUMNS if name not in table]:
        raise MissionError(f"{path}: expected the columns {', '.join(_COLUMNS)}; {', '.join(missing)} is missing")
    table = table.sort_values(["time", "robot"], kind="stable")
    shape = n, robots = table["time"].nunique(), table["robot"].nunique()
    if table.empty or len(table) != n * robots or table.duplicated(["time", "robot"]).any():
        raise MissionError(f"{path}: expected one row for each time and robot")
    arrays = {name: table[name].to_numpy().reshape(shape) for name in _WHOLE if name in table}
    poses = table[["x", "y", "heading"]].to_numpy().reshape(*shape, 3)
    return _checked(path, {"time": table["time"].to_numpy()[::robots], "pose": poses, **arrays})


def _checked(path: Path, found: Mapping[str, _Array]) -> _Table:
    """The arrays of a trace, if they fit together."""
    times, poses = found.get("time"), found.get("pose")
    if times is None or poses is None:
        raise MissionError(f"{path}: expected the arrays time, pose and state of a trace")
    if times.ndim != 1 or poses.ndim != 3 or poses.shape != (len(times), poses.shape[1], 3) or not poses.size:
        raise MissionError(f"{path}: expected times (n,) and poses (n, robots, 3), found {times.shape}, {poses.shape}")
    for name, array in found.items():
        if array.dtype.kind not in "fiu" or not np.isfinite(array).all():
            raise MissionError(f"{path}: {name}: expected finite numbers")
    whole = {name: array for name, array in found.items() if name in _WHOLE}
    for name, array in whole.items():
        low, high = _WHOLE[name]
        if array.shape != poses.shape[:2]:
            raise MissionError(f"{path}: {name}: expected numbers {poses.shape[:2]}, found {array.shape}")
        if (array < low).any() or (array > high).any():
            raise MissionError(f"{path}: {name}: expected numbers from {low} to {high}")
    if np.abs(times).max() > _MAX_TIME:
        raise MissionError(f"{path}: time: expected at most {_MAX_TIME:g} s")
    outputs = {name: array.astype(np.int8) for name, array in whole.items()}
    states = outputs.pop("state", np.zeros(poses.shape[:2], dtype=np.int8))
    return _Table(times.astype(np.float64), poses.astype(np.float64), states, outputs)


def _period(path: Path, times: Floats) -> float:
    """The time [s] between two rows of a trace, which is always the same but at its end."""
    if len(times) < 2:
        raise MissionError(f"{path}: expected at least two times, found {len(times)}")
    steps = np.diff(times)
    period = float(steps[0])
    even = np.isclose(steps[:-1], period, atol=_SAME_TIME, rtol=1e-4).all()
    if period <= 0.0 or not even or not 0.0 < steps[-1] <= period * 1.001:
        raise MissionError(f"{path}: expected times in equal steps, found {excerpt(str(steps[:5]))}")
    return period
