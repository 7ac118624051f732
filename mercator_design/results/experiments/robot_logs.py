"""Logs of robots as one experiment: the robots side by side, at the poses of their odometry."""

import math
from collections.abc import Callable, Sequence
from contextlib import closing
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mercator_design.arrays import Floats
from mercator_design.errors import RobotError
from mercator_design.fsm.pfsm import Pfsm
from mercator_design.missions.floor import Floor
from mercator_design.missions.trace import Trace
from mercator_design.modules.architecture import Software
from mercator_design.modules.flavour import flavour_of
from mercator_design.results.experiments.experiment import (
    ShownExperiment,
    activities,
    activity_of,
    check_extent,
    number_fired,
    perceived_of,
    robots_at,
)
from mercator_design.robot.logs.events import CycleDone, LogEnded, RunStarted
from mercator_design.robot.logs.log import NO_END, controller_of, read, understanding
from mercator_design.sim.robot_model import RobotModel
from mercator_design.sim.simulate import Simulator
from mercator_design.software.architectures import part_names

Pose: TypeAlias = tuple[float, float, float]
"""x, y [m] and heading [rad]."""

_NEAR = 0.4  # [m] from where a robot measures a neighbour to where its odometry says that it is
_ASIDE = 1.5  # [m] between robots whose starting poses are not known

Warn: TypeAlias = Callable[[str], None]


class _Cycle(NamedTuple):
    """A control cycle of a robot."""

    clock: float  # [s since 1970]
    pose: Pose  # by odometry
    state: int
    fired: int
    led_colour: int
    signal: int
    readings: tuple[float, ...]
    places: tuple[tuple[float, float], ...]


class _RobotLog(NamedTuple):
    """The part of a robot's log that is shown."""

    robot: str
    pfsm: Software
    period: float  # [s]
    cycles: list[_Cycle]
    activity: NDArray[np.uint8] | None  # (cycles, nodes) see `activity_of`


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
        robot_model: The model of the robots.
        simulator: The simulator of the mission in which they ran; None: they are shown without an arena.
        seed: Seed of the mission's instance, for its floor, and for starting poses if none are given.
        starts: The poses at which the robots began, in the order of the logs [m, m, rad].
        warn: Called with a warning of a possible mistake.

    Raises:
        RobotError: A file is not the log of a run, or has no positions.
    """
    if starts and len(starts) != len(paths):
        raise RobotError(f"expected a starting pose for each of {len(paths)} logs, found {len(starts)}")
    logs = [_read_log(path, warn, robots=len(paths)) for path in paths]
    period = logs[0].period
    begin = min(log.cycles[0].clock for log in logs)
    title = " ".join(path.name for path in paths)
    n = 1 + round((max(log.cycles[-1].clock for log in logs) - begin) / period)
    check_extent(title, n, len(logs), period)
    instance = None if simulator is None else simulator.instance(seed)
    if not starts and instance is not None:
        starts = [(x, y, heading) for x, y, heading in instance.swarm.poses[:, :3].tolist()]
        warn(f"the robots are shown as if they had started at the poses of the mission's instance {seed}; see --start")
    elif not starts:
        starts = [(_ASIDE * k, 0.0, 0.0) for k in range(len(logs))]
        warn("starting poses are not known: each robot is shown at a place of its own; see --start and --mission")
    if len(starts) < len(logs):
        raise RobotError(f"expected at most {len(starts)} logs, as the mission has robots, found {len(logs)}")
    rows = [_rows(log, begin, period, n) for log in logs]
    poses = np.stack([_moved(start, log, row) for start, log, row in zip(starts, logs, rows, strict=False)], axis=1)
    pfsms = list(dict.fromkeys(log.pfsm for log in logs))
    latest = [[log.cycles[k] for k in row] for log, row in zip(logs, rows, strict=True)]
    places = _places(latest)
    floor = Floor(background="white").realise(np.random.default_rng(0)) if instance is None else instance.scene.floor
    return ShownExperiment(
        title=title,
        trace=Trace(
            poses=poses,
            states=np.array([[cycle.state for cycle in row] for row in latest], dtype=np.int8).T,
            led_colours=np.array([[cycle.led_colour for cycle in row] for row in latest], dtype=np.int8).T,
            signals=np.array([[cycle.signal for cycle in row] for row in latest], dtype=np.int8).T,
            floor=floor,
            zone_rows={} if instance is None else instance.zone_rows,
            walls=None if instance is None else instance.walls,
            control_period=period,
        ),
        robot_model=robot_model,
        mission=None if simulator is None else simulator.mission,
        pfsms=tuple(pfsms),
        pfsm_of=tuple(pfsms.index(log.pfsm) for log in logs),
        names=tuple(log.robot for log in logs),
        fired=_fired(latest, rows),
        activity=activities(
            [None if log.activity is None else log.activity[row] for log, row in zip(logs, rows, strict=True)],
            len(poses) - 1,
        ),
        perceived=perceived_of(
            np.array([[cycle.readings for cycle in row] for row in latest]).swapaxes(0, 1),
            seen=robots_at(poses[1:], places, _NEAR),
        ),
    )


def _read_log(path: Path, warn: Warn, *, robots: int) -> _RobotLog:
    with closing(read(path)) as events, understanding(path):
        start = next(events)
        assert isinstance(start, RunStarted)  # noqa: S101 - `read` has checked it
        controller = controller_of(start)
        software = controller.software
        n = len(part_names(software))
        clock = start.clock
        if clock is None:
            warn(f"{path}: its clock was not compared with those of other robots")
        began = datetime.fromisoformat(start.time).timestamp() - (0.0 if clock is None else clock.ahead)
        cycles: list[_Cycle] = []
        draws: list[tuple[float, ...]] = []
        event = None
        for event in events:
            if isinstance(event, CycleDone):
                if event.next_state >= n:
                    wrong = f"expected a state below {n}, found {event.next_state}"
                    raise RobotError(f"{path}: cycle {event.cycle}: {wrong}")
                fired = 0
                if event.next_state != event.state and isinstance(software, Pfsm):
                    model = flavour_of(software.flavour).reference_model(start.reference_model)
                    fired = number_fired(software, model, event.state, event.readings, event.draws)
                pose = _odometry(event, cycles)
                cycle = _Cycle(
                    began + event.time,
                    pose,
                    event.next_state,
                    fired,
                    -1 if event.led_colour is None else event.led_colour,
                    event.signal or 0,
                    event.readings,
                    event.neighbours,
                )
                cycles.append(cycle)
                draws.append(event.draws)
        if not isinstance(event, LogEnded):
            warn(f"{path}: {NO_END}")
        readings, states = [cycle.readings for cycle in cycles], [cycle.state for cycle in cycles]
        activity = activity_of(software, start.reference_model, readings, draws, states, robots=robots)
    if not cycles:
        raise RobotError(f"{path}: expected control cycles, found none")
    check_extent(path.name, len(cycles), 1, start.control_period)
    return _RobotLog(start.robot, software, start.control_period, cycles, activity)


def _odometry(event: CycleDone, before: Sequence[_Cycle]) -> Pose:
    """The robot's pose by its odometry; without a sample, the one before."""
    position, attitude = event.sensed.get("position"), event.sensed.get("attitude")
    if position is None or attitude is None:
        return before[-1].pose if before else (0.0, 0.0, 0.0)
    values = [value if value is not None else 0.0 for value in (*position[1:], attitude[-1])]
    return values[0], values[1], values[2]


def _rows(log: _RobotLog, begin: float, period: float, n: int) -> NDArray[Any]:
    """The robot's latest cycle, by its number in the log, at the end of each cycle of all (n,)."""
    clocks = np.array([cycle.clock for cycle in log.cycles])
    times = begin + period * (np.arange(n) + 0.5)
    return np.clip(np.searchsorted(clocks, times, side="right") - 1, 0, None)


def _moved(start: Pose, log: _RobotLog, row: NDArray[Any]) -> Floats:
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
    n_places = max((len(cycle.places) for row in latest for cycle in row), default=0)
    places = np.full((len(latest[0]), len(latest), n_places, 2), np.nan)
    for robot, row in enumerate(latest):
        for k, cycle in enumerate(row):
            if cycle.places:
                places[k, robot, : len(cycle.places)] = cycle.places
    return places


def _fired(latest: Sequence[Sequence[_Cycle]], rows: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """The transitions taken, each shown once (cycles, robots)."""
    fired = np.array([[cycle.fired for cycle in row] for row in latest], dtype=np.uint8).T
    for robot, row in enumerate(rows):
        fired[1:, robot][np.diff(row) == 0] = 0
    return fired


def is_log(path: Path) -> bool:
    """Whether a file begins as the log of a robot."""
    try:
        if not path.is_file():  # opening a pipe would wait
            return False
        with path.open("rb") as file:
            return file.read(1) == b"{"
    except (OSError, ValueError):  # a NUL in the path
        return False
