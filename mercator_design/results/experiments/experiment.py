"""An experiment to be shown, whether it was simulated, read from a file or recorded by robots."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from mercator_design.arrays import Flags, Floats, Numbers
from mercator_design.config.colours import STATE_COLOURS
from mercator_design.errors import MissionError, SimulationError
from mercator_design.fsm.control import transition_taken
from mercator_design.fsm.pfsm import Pfsm
from mercator_design.missions.mission import Mission
from mercator_design.missions.trace import Trace
from mercator_design.modules.architecture import Software, outputs_of
from mercator_design.modules.reference import Readings, ReferenceModel
from mercator_design.sim.devices import Recording
from mercator_design.sim.robot_model import RobotModel
from mercator_design.sim.simulate import Simulator
from mercator_design.software.architectures import DARK, architecture_of, part_colours, part_names
from mercator_design.software.controller import Controller

MAX_READINGS = 3_000_000
"""Proximity readings, or what nodes did, that are shown; a longer experiment is shown without them."""

MAX_CELLS = 5_000_000
"""Cycles of all robots together: 20 robots for 7 hours. More would fill the memory."""

_MAX_ROBOTS = 2000
_MAX_PLACE = 1e4  # [m] from the origin
_MAX_TURN = 1e6  # [rad]
_PERIODS = (1e-3, 1e4)  # [s] of a cycle
_POINTS = 120  # of the curve of the score
_CHUNK = 500  # cycles whose neighbours are searched together: so they need little memory


class Perceived(NamedTuple):
    """What the robots perceived in each cycle; None is not known."""

    neighbours: NDArray[np.uint8] | None = None  # (cycles, robots) how many, at most 255
    ground: NDArray[np.uint8] | None = None  # (cycles, robots, 3) red, green, blue
    proximity: Floats | None = None  # (cycles, robots, sensors) [m], inf: nothing in sight, -inf: too near
    seen: Flags | None = None  # (cycles, robots, robots) whether a robot perceives another


class ScoreCurve(NamedTuple):
    """The score if the experiment had ended after some of its cycles."""

    cycles: Numbers
    scores: Floats


@dataclass(frozen=True, kw_only=True)
class ShownExperiment:
    """One experiment, with all that is known of it.

    Attributes:
        title: Title of the experiment, for people.
        trace: Poses and states.
        robot_model: The robot model of all robots.
        mission: None: the robots are shown without an arena, and there is no score.
        pfsms: Different PFSMs of the robots; empty: not known.
        pfsm_of: (robots,) the PFSM of each robot, by its place in `pfsms`.
        named_states: The names of each PFSM's states; empty: those of their behaviours.
        names: Names of the robots; if empty, their numbers are shown.
        fired: (cycles, robots) transition taken in a cycle, by its number in the state from 1, or 0; None: not known.
        activity: (cycles, robots, nodes) what each node of a tree or network did in a cycle, see
            `Architecture.activity`, with zeros behind those of the smaller ones; None: not known.
        perceived: What the robots perceived.
        recording: The recording, if the experiment was simulated.
    """

    title: str
    trace: Trace
    robot_model: RobotModel
    mission: Mission | None = None
    pfsms: tuple[Software, ...] = ()
    pfsm_of: tuple[int, ...] = ()
    named_states: tuple[tuple[str, ...], ...] = ()
    names: tuple[str, ...] = ()
    fired: NDArray[np.uint8] | None = None
    activity: NDArray[np.uint8] | None = None
    perceived: Perceived = field(default_factory=Perceived)
    recording: Recording | None = None

    def __post_init__(self) -> None:
        """Check that it can be shown.

        Raises:
            MissionError: It is too large, or its numbers cannot be those of robots.
        """
        trace = self.trace
        check_extent(self.title, trace.cycles, trace.robots, trace.control_period)
        furthest, turn = np.abs(trace.poses[..., :2]).max(), np.abs(trace.poses[..., 2]).max()
        if not (furthest <= _MAX_PLACE and turn <= _MAX_TURN):
            expected = f"places up to {_MAX_PLACE:g} m from the origin and headings up to {_MAX_TURN:g} rad"
            raise MissionError(f"{self.title}: expected {expected}, found {furthest:g} m and {turn:g} rad")

    @classmethod
    def simulated(
        cls, simulator: Simulator, pfsm: Software, seed: int, *, title: str | None = None, states: tuple[str, ...] = ()
    ) -> Self:
        """Run an experiment of a PFSM, perhaps with names of its states; errors are those of `Simulator.run`."""
        mission = simulator.mission
        title = title or f"{mission.name}, seed {seed}"
        check_extent(title, mission.cycles, mission.robots, mission.control_period)
        outcome = simulator.run(pfsm, seed, record=True)
        recording = outcome.recording
        return cls(
            title=title,
            trace=outcome.trace,
            robot_model=recording.robot_model,
            mission=mission,
            pfsms=(pfsm,),
            pfsm_of=(0,) * outcome.trace.robots,
            named_states=(states,) if states else (),
            fired=_fired(pfsm, recording),
            activity=_activity(pfsm, recording),
            perceived=_perceived(recording),
            recording=recording,
        )

    @property
    def subtitle(self) -> str:
        """Mission, robots and duration in a line."""
        robots = f"{self.trace.robots} robot{'s' * (self.trace.robots != 1)}"
        seconds = f"{self.trace.cycles * self.trace.control_period:g} s"
        return ", ".join([*([self.mission.name] if self.mission else []), robots, seconds])

    def state_names(self, pfsm: int) -> list[str]:
        """The names of the states of a PFSM, by its place in `pfsms`."""
        names = self.named_states[pfsm] if self.named_states else part_names(self.pfsms[pfsm])
        if not isinstance(self.pfsms[pfsm], Pfsm):  # their pictures have no numbers
            return [*names]
        return [f"{k} {name}" for k, name in enumerate(names)]

    @property
    def legend(self) -> list[tuple[int, str]]:
        """The names of the states that can be active, with their colours by number in STATE_COLOURS.

        That of a tree in which no node acts is DARK.
        The states of different PFSMs have only their numbers in common.
        """
        if len(self.pfsms) == 1:
            named = enumerate(zip(part_colours(self.pfsms[0]), self.state_names(0), strict=True))
            return [(colour, name) for part, (colour, name) in named if colour != DARK or part == 0]
        n = max((len(architecture_of(one.flavour).active(one)) for one in self.pfsms), default=0)
        return [(k % len(STATE_COLOURS), f"state {k}") for k in range(n)]

    def colours_at(self, cycle: int) -> NDArray[np.int8]:
        """The colour of each robot's state after a cycle, by number in STATE_COLOURS; DARK: none, or it has failed."""
        colours: NDArray[np.int8] = self._colours[cycle]
        return colours

    @cached_property
    def _colours(self) -> NDArray[np.int8]:
        """(cycles + 1, robots)."""
        states = np.vstack([np.zeros((1, self.trace.robots), dtype=np.int8), self.trace.states])
        colours = np.full(states.shape, DARK, dtype=np.int8)
        for robot, k in enumerate(self.pfsm_of):
            colours[:, robot] = np.array(part_colours(self.pfsms[k]))[states[:, robot]]
        colours[1:][self.trace.failed] = DARK
        return colours

    @cached_property
    def led_colours(self) -> NDArray[np.int8] | None:
        """Colours of the LEDs after each cycle (cycles + 1, robots), by number in LED_COLOURS; row 0 is the start.

        -1 of robots whose modules do not set them; None if none of the robots' do.
        """
        known = self.trace.led_colours
        sets = ["led_colour" in outputs_of(self.pfsms[k]) for k in self.pfsm_of]
        if known is None or not any(sets):
            return None
        shown = np.vstack([np.zeros((1, self.trace.robots), dtype=np.int8), np.maximum(known, 0)])
        shown[:, ~np.array(sets)] = -1
        return shown

    @cached_property
    def score(self) -> float | None:
        """The mission's score of the trace; None if there is no mission, or it scores what is not known."""
        return self._score(self.trace.cycles)

    @cached_property
    def curve(self) -> ScoreCurve:
        """The score so far; empty if there is no score."""
        found = []
        if self.score is not None:
            cycles = np.unique(np.linspace(1, self.trace.cycles, _POINTS).astype(np.int64))
            found = [(cycle, score) for cycle in cycles.tolist() if (score := self._score(cycle)) is not None]
        return ScoreCurve(
            np.array([cycle for cycle, _ in found], dtype=np.int64), np.array([score for _, score in found])
        )

    def _score(self, cycles: int) -> float | None:
        if self.mission is None:
            return None
        try:
            return self.mission.scored(_until(self.trace, self.recording, cycles)).score
        except (MissionError, SimulationError):
            return None


def check_extent(title: str, cycles: int, robots: int, period: float) -> None:
    """Check that an experiment is not too large, before its arrays are made.

    Raises:
        MissionError: It is.
    """
    if robots > _MAX_ROBOTS or cycles * robots > MAX_CELLS:
        raise MissionError(
            f"{title}: expected at most {_MAX_ROBOTS} robots and {MAX_CELLS:,} cycles of all robots together, found "
            f"{robots} robots and {cycles} cycles"
        )
    if not _PERIODS[0] <= period <= _PERIODS[1]:
        raise MissionError(f"{title}: expected cycles of {_PERIODS[0]:g} to {_PERIODS[1]:g} s, found {period:g} s")


def _until(trace: Trace, recording: Recording | None, cycles: int) -> Trace:
    """The trace of the first cycles."""
    part: dict[str, Any] = {
        "poses": trace.poses[: cycles + 1],
        "states": trace.states[:cycles],
        "led_colours": None if trace.led_colours is None else trace.led_colours[:cycles],
        "signals": None if trace.signals is None else trace.signals[:cycles],
    }
    if recording is None:
        return replace(trace, **part)
    history = recording.history._replace(**part)
    return replace(trace, **part, measure=replace(recording, history=history).measure)


def _fired(pfsm: Software, recording: Recording) -> NDArray[np.uint8]:
    """The transitions that the robots took; see `ShownExperiment`."""
    states, readings, draws = recording.history.states, recording.recorded("readings"), recording.recorded("draws")
    before = np.vstack([np.zeros((1, states.shape[1]), dtype=states.dtype), states[:-1]])
    fired = np.zeros(states.shape, dtype=np.uint8)
    if not isinstance(pfsm, Pfsm):  # others have no transitions
        return fired
    model = recording.robot_model.reference_model
    for cycle, robot in np.argwhere(states != before):
        state = int(before[cycle, robot])
        fired[cycle, robot] = number_fired(pfsm, model, state, readings[cycle, robot], draws[cycle, robot])
    return fired


def _activity(software: Software, recording: Recording) -> NDArray[np.uint8] | None:
    """Activity of the nodes; see `ShownExperiment`."""
    states, readings, draws = recording.history.states, recording.recorded("readings"), recording.recorded("draws")
    model, robots = recording.robot_model.reference_model, states.shape[1]
    stops = recording.scene.stops if len(recording.scene.stops) else [len(states)] * robots
    found = [
        activity_of(software, model, *(one[:until, k].tolist() for one in (readings, draws, states)), robots=robots)
        for k, until in enumerate(stops)
    ]
    return activities(found, len(states))


def activity_of(
    software: Software,
    model: ReferenceModel,
    readings: Sequence[Sequence[float]],
    draws: Sequence[Sequence[float]],
    states: Sequence[int],
    *,
    robots: int,
) -> NDArray[np.uint8] | None:
    """Activity of the nodes of a robot's control software (cycles, nodes), run again from its start.

    Args:
        software: The control software.
        model: The reference model of the robot.
        readings: Of each cycle, the fields of Readings.
        draws: Of each cycle.
        states: The active part after each cycle.
        robots: How many robots are shown.

    Returns:
        None if states say it all, if it would be too much for so many robots, or if other parts become active.
    """
    controller = Controller(software, model)
    n = len(controller.activity)
    if not 0 < n * len(states) * robots <= MAX_READINGS:
        return None
    found = np.zeros((len(states), n), dtype=np.uint8)
    for k, (row, drawn, state) in enumerate(zip(readings, draws, states, strict=True)):
        controller.step(Readings(*row), drawn)
        if controller.state != state:
            return None
        found[k] = controller.activity
    return found


def activities(found: Sequence[NDArray[np.uint8] | None], cycles: int) -> NDArray[np.uint8] | None:
    """Activity of the nodes of several robots, each (cycles or fewer, nodes), as `ShownExperiment.activity`."""
    known = [one for one in found if one is not None]
    n = max((one.shape[1] for one in known), default=0)
    if not known:
        return None
    joined = np.zeros((cycles, len(found), n), dtype=np.uint8)
    for robot, one in enumerate(found):
        if one is not None:
            joined[: len(one), robot, : one.shape[1]] = one
    return joined


def number_fired(
    pfsm: Pfsm, model: ReferenceModel, state: int, readings: Iterable[float], draws: Iterable[float]
) -> int:
    """The number of the transition that fires in a state, from 1; 0: none."""
    taken = transition_taken(pfsm, model, state, Readings(*readings), tuple(draws))
    return 0 if taken is None else 1 + pfsm.states[state].transitions.index(taken)


def _perceived(recording: Recording) -> Perceived:
    readings, model = recording.recorded("readings"), recording.robot_model
    sensors = len(model.proximity.angles) if model.proximity else 0
    shows_proximity = 0 < readings[..., 0].size * sensors <= MAX_READINGS
    return perceived_of(
        readings,
        proximity=recording.measure("proximity") if shows_proximity else None,
        seen=_seen(recording) if model.neighbours is not None else None,
    )


def perceived_of(readings: Floats, proximity: Floats | None = None, seen: Flags | None = None) -> Perceived:
    """What robots perceived, from their readings (cycles, robots, fields of Readings) and what devices measured."""
    first = Readings._fields.index("ground_red")
    return Perceived(
        neighbours=np.clip(readings[..., Readings._fields.index("neighbours")], 0, 255).astype(np.uint8),
        ground=np.clip(np.rint(readings[..., first : first + 3]), 0, 255).astype(np.uint8),
        proximity=proximity,
        seen=seen,
    )


def _seen(recording: Recording) -> Flags:
    """Which robots a robot perceives: those that stand where it measures a neighbour."""
    poses = recording.history.poses[1:]
    near = recording.robot_model.body.corner
    parts = [np.arange(first, min(first + _CHUNK, len(poses))) for first in range(0, len(poses), _CHUNK)]
    seen = [robots_at(poses[part], recording.measure_at("neighbour_places", part), near) for part in parts]
    return np.concatenate(seen)


def robots_at(poses: Floats, places: Floats, near: float) -> Flags:
    """Which robots stand at measured places.

    Args:
        poses: (cycles, robots, 3).
        places: (cycles, robots, n, 2) distance [m] and bearing [rad] from each robot; NaN: none.
        near: Distance [m] of a robot's centre from the place, at most.

    Returns:
        (cycles, robots, robots) whether the first perceives the second.
    """
    angles = poses[..., 2, None] + places[..., 1]
    points = poses[..., None, :2] + places[..., :1] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    cycles, robots = poses.shape[:2]
    seen = np.zeros((cycles, robots, robots), dtype=np.bool_)
    cycle, robot, row = np.nonzero(~np.isnan(places[..., 0]))
    away = np.linalg.norm(poses[cycle, :, :2] - points[cycle, robot, row, np.newaxis], axis=-1)
    away[np.arange(len(robot)), robot] = np.inf
    nearest = away.argmin(axis=1)
    is_there = away[np.arange(len(nearest)), nearest] < near
    seen[cycle[is_there], robot[is_there], nearest[is_there]] = True
    return seen
