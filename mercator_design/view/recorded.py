"""Experiments from files: traces that `mdesign record` wrote or a tracking camera saw, and the logs of robots."""

import math
import zipfile
from collections.abc import Callable, Sequence
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mercator_design.arrays import Floats
from mercator_design.errors import MissionError, RobotError, excerpt
from mercator_design.fsm.pfsm import Pfsm
from mercator_design.missions.floor import Floor
from mercator_design.missions.trace import Trace
from mercator_design.robot.logs.events import CycleDone, LogEnded, RunStarted
from mercator_design.robot.logs.log import NO_END, controller_of, read, understanding
from mercator_design.sim.robot_model import RobotModel
from mercator_design.sim.simulate import Simulator
from mercator_design.view.experiment import ShownExperiment, number_fired, perceived_of, robots_at

TABLES = (".csv", ".npz")

_COLUMNS = ("time", "robot", "x", "y", "heading")
_SAME_TIME = 1e-6  # [s]
_PERIOD = 0.1  # [s] of the control cycle in logs of older versions
_MAX_CELLS = 50_000_000  # rows of robots and cycles
_NEAR = 0.4  # [m] from where a robot measures a neighbour to where its odometry says that it is
_ASIDE = 1.5  # [m] between robots whose starting poses are not known

Warn = Callable[[str], None]
Pose = tuple[float, float, float]


def read_trace(
    path: Path, simulator: Simulator, seed: int, pfsm: Pfsm | None, *, names: tuple[str, ...] = ()
) -> ShownExperiment:
    """An experiment from a table of poses.

    Args:
        path: `.npz` as `Trace.arrays`, or `.csv` as `Trace.to_frame`; the column state may be missing.
        simulator: Of the mission in which it took place.
        seed: Of the instance: its floor, and its starting poses if the table begins after the first cycle.
        pfsm: The control software of the robots, if it is known.
        names: Of its states; by default those of their behaviours.

    Raises:
        MissionError: The file is not such a table, or its states are not those of the PFSM.
    """
    times, poses, states = _read_npz(path) if path.suffix == ".npz" else _read_csv(path)
    period = _period(path, times)
    instance = simulator.instance(seed)
    start = instance.swarm.poses[:, :3]
    if times[0] > 0.5 * period:
        same = len(start) == poses.shape[1] and math.isclose(period, simulator.mission.control_period)
        poses = np.concatenate([start[np.newaxis] if same else poses[:1], poses])
    else:
        states = states[1:]
    if not len(states):
        raise MissionError(f"{path}: expected at least two times, found one")
    if pfsm is not None and states.max(initial=0) >= len(pfsm.states):
        raise MissionError(f"{path}: expected states of the PFSM, below {len(pfsm.states)}, found {states.max()}")
    return ShownExperiment(
        title=path.name,
        trace=Trace(
            poses=poses,
            states=states,
            floor=instance.scene.floor,
            zone_rows=instance.zone_rows,
            control_period=period,
        ),
        robot_model=instance.robot_model,
        mission=simulator.mission,
        pfsms=() if pfsm is None else (pfsm,),
        pfsm_of=() if pfsm is None else (0,) * poses.shape[1],
        named_states=(names,) if names else (),
    )


def _read_npz(path: Path) -> tuple[Floats, Floats, np.ndarray]:
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            found = {name: file[name] for name in ("time", "pose", "state") if name in file}
    except (OSError, ValueError, zipfile.BadZipFile, EOFError) as error:
        raise MissionError(f"{path}: expected a trace that `mdesign record` wrote, found: {error}") from None
    return _checked(path, found.get("time"), found.get("pose"), found.get("state"))


def _read_csv(path: Path) -> tuple[Floats, Floats, np.ndarray]:
    import pandas as pd

    try:
        table = pd.read_csv(path)
    except (OSError, ValueError) as error:  # pandas' errors are ValueErrors
        raise MissionError(f"{path}: expected a table as `mdesign record` writes it, found: {error}") from None
    if missing := [name for name in _COLUMNS if name not in table]:
        raise MissionError(f"{path}: expected the columns {', '.join(_COLUMNS)}; {', '.join(missing)} is missing")
    table = table.sort_values(["time", "robot"], kind="stable")
    shape = n, robots = table["time"].nunique(), table["robot"].nunique()
    if table.empty or len(table) != n * robots or table.duplicated(["time", "robot"]).any():
        raise MissionError(f"{path}: expected one row for each time and robot")
    times = table["time"].to_numpy()[::robots]
    poses = table[["x", "y", "heading"]].to_numpy().reshape(*shape, 3)
    states = table["state"].to_numpy().reshape(shape) if "state" in table else None
    return _checked(path, times, poses, states)


def _checked(
    path: Path, times: np.ndarray | None, poses: np.ndarray | None, states: np.ndarray | None
) -> tuple[Floats, Floats, np.ndarray]:
    """The arrays of a trace, if they fit together."""
    if times is None or poses is None:
        raise MissionError(f"{path}: expected the arrays time, pose and state of a trace")
    if poses.ndim != 3 or poses.shape != (len(times), poses.shape[1], 3) or not poses.size:
        raise MissionError(f"{path}: expected poses (times, robots, 3), found {poses.shape}")
    if states is None:
        states = np.zeros(poses.shape[:2])
    if states.shape != poses.shape[:2]:
        raise MissionError(f"{path}: expected states {poses.shape[:2]}, found {states.shape}")
    arrays = [
        array for array in (times, poses, states) if array.dtype.kind not in "fiu" or not np.isfinite(array).all()
    ]
    if arrays or (states < 0).any() or (states > 127).any():
        raise MissionError(f"{path}: expected finite numbers, and states from 0 to 127")
    return times.astype(np.float64), poses.astype(np.float64), states.astype(np.int8)


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


class _Cycle(NamedTuple):
    """A control cycle of a robot."""

    clock: float  # [s since 1970]
    pose: Pose  # by odometry
    state: int
    fired: int
    readings: tuple[float, ...]
    places: tuple[tuple[float, float], ...]


class _RobotLog(NamedTuple):
    """What is shown of a robot's log."""

    robot: str
    pfsm: Pfsm
    period: float  # [s]
    cycles: list[_Cycle]


def read_logs(
    paths: Sequence[Path],
    robot_model: RobotModel,
    *,
    simulator: Simulator | None,
    seed: int,
    starts: Sequence[Pose],
    warn: Warn,
) -> ShownExperiment:
    """The robots of several logs side by side, at the poses of their odometry.

    Args:
        paths: The logs of runs.
        robot_model: Of the robots.
        simulator: Of the mission in which they ran; None: they are shown without an arena.
        seed: Of the mission's instance: its floor, and starting poses if none are given.
        starts: The poses at which the robots began, in the order of the logs [m, m, rad].
        warn: Called with what may be wrong.

    Raises:
        RobotError: A file is not the log of a run, or has no positions.
    """
    logs = [_read_log(path, warn) for path in paths]
    period = logs[0].period
    begin = min(log.cycles[0].clock for log in logs)
    n = 1 + round((max(log.cycles[-1].clock for log in logs) - begin) / period)
    if n * len(logs) > _MAX_CELLS:
        hours = n * period / 3600.0
        raise RobotError(
            f"{paths[0]}: expected logs of one experiment, found {hours:.0f} hours from first to last cycle"
        )
    instance = None if simulator is None else simulator.instance(seed)
    if not starts and instance is not None:
        starts = [(x, y, heading) for x, y, heading in instance.swarm.poses[:, :3].tolist()]
        warn(f"the robots are shown as if they had started at the poses of the mission's instance {seed}; see --start")
    elif not starts:
        starts = [(_ASIDE * k, 0.0, 0.0) for k in range(len(logs))]
        warn("starting poses are not known: each robot is shown at a place of its own; see --start and --mission")
    if len(starts) < len(logs):
        raise RobotError(f"expected a starting pose for each of {len(logs)} logs, found {len(starts)}")
    rows = [_rows(log, begin, period, n) for log in logs]
    poses = np.stack([_moved(start, log, row) for start, log, row in zip(starts, logs, rows, strict=False)], axis=1)
    pfsms = list(dict.fromkeys(log.pfsm for log in logs))
    latest = [[log.cycles[k] for k in row] for log, row in zip(logs, rows, strict=True)]
    places = _places(latest)
    floor = Floor(background="white").realise(np.random.default_rng(0)) if instance is None else instance.scene.floor
    return ShownExperiment(
        title=" ".join(path.name for path in paths),
        trace=Trace(
            poses=poses,
            states=np.array([[cycle.state for cycle in row] for row in latest], dtype=np.int8).T,
            floor=floor,
            zone_rows={} if instance is None else instance.zone_rows,
            control_period=period,
        ),
        robot_model=robot_model,
        mission=None if simulator is None else simulator.mission,
        pfsms=tuple(pfsms),
        pfsm_of=tuple(pfsms.index(log.pfsm) for log in logs),
        names=tuple(log.robot for log in logs),
        fired=_fired(latest, rows),
        perceived=perceived_of(
            np.array([[cycle.readings for cycle in row] for row in latest]).swapaxes(0, 1),
            seen=robots_at(poses[1:], places, _NEAR),
        ),
    )


def _read_log(path: Path, warn: Warn) -> _RobotLog:
    events = read(path)
    with understanding(path):
        start = next(events)
        assert isinstance(start, RunStarted)  # noqa: S101 - `read` has checked it
        pfsm, controller = controller_of(start)
        clock = start.clock
        if clock is None:
            warn(f"{path}: its clock was not compared with those of other robots")
        began = datetime.fromisoformat(start.time).timestamp() - (0.0 if clock is None else clock.ahead)
        cycles: list[_Cycle] = []
        event = None
        for event in events:
            if isinstance(event, CycleDone):
                fired = 0
                if event.next_state != event.state:
                    fired = number_fired(controller, event.state, event.readings, event.draws)
                pose = _odometry(event, cycles)
                cycle = _Cycle(began + event.time, pose, event.next_state, fired, event.readings, event.neighbours)
                cycles.append(cycle)
        if not isinstance(event, LogEnded):
            warn(f"{path}: {NO_END}")
    if not cycles:
        raise RobotError(f"{path}: expected control cycles, found none")
    return _RobotLog(start.robot, pfsm, start.control_period or _PERIOD, cycles)


def _odometry(event: CycleDone, before: Sequence[_Cycle]) -> Pose:
    """The robot's pose by its odometry; without a sample, the one before."""
    position, attitude = event.sensed.get("position"), event.sensed.get("attitude")
    if position is None or attitude is None:
        return before[-1].pose if before else (0.0, 0.0, 0.0)
    values = [value if value is not None else 0.0 for value in (*position[1:], attitude[-1])]
    return values[0], values[1], values[2]


def _rows(log: _RobotLog, begin: float, period: float, n: int) -> np.ndarray:
    """The robot's latest cycle, by its number in the log, at the end of each cycle of all (n,)."""
    clocks = np.array([cycle.clock for cycle in log.cycles])
    times = begin + period * (np.arange(n) + 0.5)
    return np.clip(np.searchsorted(clocks, times, side="right") - 1, 0, None)


def _moved(start: Pose, log: _RobotLog, row: np.ndarray) -> Floats:
    """The poses (n + 1, 3) of a robot that started at a pose."""
    own = np.array([log.cycles[k].pose for k in row])
    own[:, 2] = np.unwrap(own[:, 2])
    c, s = math.cos(start[2]), math.sin(start[2])
    moved = np.stack(
        [start[0] + c * own[:, 0] - s * own[:, 1], start[1] + s * own[:, 0] + c * own[:, 1], start[2] + own[:, 2]],
        axis=1,
    )
    return np.vstack([[start], moved])


def _places(latest: Sequence[Sequence[_Cycle]]) -> Floats:
    """The neighbours that robots measured (cycles, robots, n, 2); NaN where there is none."""
    most = max((len(cycle.places) for row in latest for cycle in row), default=0)
    places = np.full((len(latest[0]), len(latest), most, 2), np.nan)
    for robot, row in enumerate(latest):
        for k, cycle in enumerate(row):
            if cycle.places:
                places[k, robot, : len(cycle.places)] = cycle.places
    return places


def _fired(latest: Sequence[Sequence[_Cycle]], rows: Sequence[np.ndarray]) -> np.ndarray:
    """The transitions taken, each shown once (cycles, robots)."""
    fired = np.array([[cycle.fired for cycle in row] for row in latest], dtype=np.uint8).T
    for robot, row in enumerate(rows):
        fired[1:, robot][np.diff(row) == 0] = 0
    return fired


def is_log(path: Path) -> bool:
    """Whether a file begins as the log of a robot."""
    try:
        with path.open("rb") as file:
            return file.read(1) == b"{"
    except OSError:
        return False
