"""Traces of `mdesign record --turns`: logs of simulated robots, with their true poses."""

import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mercator_design.arrays import Floats
from mercator_design.errors import MercatorError, excerpt
from mercator_design.mapping.logs import RobotLog, Turn

SUFFIX = ".npz"

_MAX_UNPACKED = 2**30  # bytes of the arrays that are read: 20 robots for 20 minutes have half of it
_DIMENSIONS = {
    "time": 1,
    "pose": 3,
    "turn_start": 2,
    "turn_time": 1,
    "turn_angle": 1,
    "turn": 3,
    "odometry_time": 2,
    "odometry": 3,
}
_WALLS = "wall"  # (walls, 4), which traces of earlier versions lack


def read_trace_logs(path: Path, lidar_pose: Floats | None = None) -> list[RobotLog]:
    """The logs of all robots in a trace, named `robot 0` and so on.

    Args:
        path: Of an `.npz` file.
        lidar_pose: (3,) of the lidar on the robot; None: at its centre.

    Raises:
        MercatorError: It cannot be read, has no turns, or its arrays do not fit together.
    """
    found = _checked(path, _arrays(path))
    mounted = np.zeros(3) if lidar_pose is None else np.asarray(lidar_pose, float)
    since, angles = found["turn_time"], found["turn_angle"]
    return [
        RobotLog(
            name=f"robot {i}",
            turns=[
                Turn(start + since, angles, ranges)
                for start, ranges in zip(found["turn_start"][:, i], found["turn"][:, i].astype(float), strict=True)
            ],
            odometry_times=found["odometry_time"][:, i],
            odometry=found["odometry"][:, i],
            lidar_pose=mounted,
            truth_times=found["time"],
            truth=found["pose"][:, i],
            walls=found.get("wall"),
        )
        for i in range(found["pose"].shape[1])
    ]


def _arrays(path: Path) -> dict[str, NDArray[Any]]:
    try:
        with zipfile.ZipFile(path) as archive:
            names = {f"{name}.npy" for name in (*_DIMENSIONS, _WALLS)}
            size = sum(entry.file_size for entry in archive.infolist() if entry.filename in names)
        if size > _MAX_UNPACKED:
            most = f"at most {_MAX_UNPACKED // 2**20} MiB"
            raise ValueError(f"{size // 2**20} MiB of arrays, {most} are read")  # noqa: TRY301 - as the other mistakes
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in (*_DIMENSIONS, _WALLS) if name in file}
    except Exception as error:  # noqa: BLE001 - damaged archives raise errors of many kinds
        what = f"{type(error).__name__}: {excerpt(str(error))}"
        raise MercatorError(f"{path}: expected a trace of `mdesign record --turns`, found {what}") from None


def _checked(path: Path, found: Mapping[str, NDArray[Any]]) -> Mapping[str, NDArray[Any]]:
    """The arrays, if they fit together."""
    if missing := [name for name in _DIMENSIONS if name not in found]:
        hint = "record it with --turns" if "turn" in missing else "is it damaged?"
        raise MercatorError(
            f"{path}: expected the arrays {', '.join(_DIMENSIONS)}; missing: {', '.join(missing)}; {hint}"
        )
    of_walls = {_WALLS: 2} if _WALLS in found else {}
    for name, dimensions in (_DIMENSIONS | of_walls).items():
        array = found[name]
        if array.ndim != dimensions or array.dtype.kind not in "fiu" or not np.isfinite(array).all():
            what = f"{array.ndim} of {array.dtype}"
            raise MercatorError(f"{path}: {name}: expected finite numbers in {dimensions} dimensions, found {what}")
    cycles, robots, _ = found["pose"].shape
    turns, _, beams = found["turn"].shape
    samples = len(found["odometry"])
    expected = {
        "time": (cycles,),
        "pose": (cycles, robots, 3),
        "turn_start": (turns, robots),
        "turn_time": (beams,),
        "turn_angle": (beams,),
        "turn": (turns, robots, beams),
        "odometry_time": (samples, robots),
        "odometry": (samples, robots, 3),
    }
    if of_walls and found[_WALLS].shape[1] != 4:
        raise MercatorError(f"{path}: {_WALLS}: expected numbers (walls, 4), found {found[_WALLS].shape}")
    for name, shape in expected.items():
        if found[name].shape != shape or 0 in shape:
            raise MercatorError(f"{path}: {name}: expected numbers {shape}, none of these 0, found {found[name].shape}")
    for name in ("time", "turn_start", "turn_time", "odometry_time"):
        if not (np.diff(found[name], axis=0) > 0.0).all():
            raise MercatorError(f"{path}: {name}: expected times that rise, found others")
    return found
