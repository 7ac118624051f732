"""The events of logs and recordings: their fields and how they are read. log.py and recording.py explain them."""

import base64
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias

from mercator_design import __version__
from mercator_design.config import checked_lines, schema
from mercator_design.config.json_data import from_json
from mercator_design.config.schema import Length, OneOf, Range
from mercator_design.errors import RobotError, excerpt
from mercator_design.fsm import Readings, ReferenceModel
from mercator_design.modules.reference import LED_COLOURS, MAX_SIGNAL, N_READINGS, first_reading
from mercator_design.robot.devices.samples import FIELDS
from mercator_design.robot.protocols.ydlidar import MAX_SAMPLES

LogKind: TypeAlias = Literal["run", "recording"]

FORMAT: Literal[2] = 2
LINES: Mapping[str, tuple[str, ...]] = {
    "rvr": ("whole", "received", "lost", "refused", "answered", "commands", "unanswered", "repeated"),
    "lidar": ("whole", "received", "lost", "refused", "readings"),
    "proximity": ("whole", "received", "lost", "refused"),
}
"""The numbers of each device's line: the share that arrived whole in the last seconds, all bytes so far, those outside
of valid frames, frame starts among these; of the lidar, readings of the last turn; of the RVR, the share of commands
that it answered in the last seconds, all commands so far, those without an answer, and those that were repeated."""
_YEARS = range(1970, 2100)
_MIN_READINGS = first_reading("heading")
"""Readings of the senses that every program had that wrote logs of this format."""


@dataclass(frozen=True, slots=True)
class _Rule:
    """A restriction of values, and its words, in which `{noun}` stands for what they are."""

    allows: Callable[[Any], bool]
    words: str

    def says(self, noun: str) -> str:
        return self.words.format(noun=noun)


def _is_date_time(text: str) -> bool:
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        return False
    return moment.utcoffset() == timedelta(0) and moment.year in _YEARS


def _lengths(lengths: Mapping[str, Sequence[int]], may_have_null: Sequence[str] = ()) -> _Rule:
    """Each list of a mapping has one of the lengths for its name; some may have null, but not first."""

    def allows(lists: Mapping[str, Sequence[float | None]]) -> bool:
        return all(
            len(values) in lengths.get(name, ()) and None not in (values[:1] if name in may_have_null else values)
            for name, values in lists.items()
        )

    words = ", ".join(f"{name}: {' or '.join(map(str, each))}" for name, each in lengths.items())
    return _Rule(allows, f"{{noun}} with lists of numbers ({words})")


def _fits_its_sensor(sample: "SampleTaken") -> bool:
    fits = len(sample.values) == len(FIELDS[sample.sensor])
    return fits and (sample.sensor == "proximity" or None not in sample.values)


def _has_a_range_of_each_sample(turn: "TurnTaken") -> bool:
    try:
        found = base64.b64decode(turn.ranges, validate=True)
    except ValueError:
        return False
    return not found or len(found) == 2 * sum(packet[-1] for packet in turn.packets)


Number = Annotated[float, Range(-1e9, 1e9)]
Amount = Annotated[float, Range(-1e15, 1e15)]
"""A number that may grow during a whole run, as that of received bytes."""
Count = Annotated[int, Range(0, 1e9)]
Angle = Annotated[int, Range(0, 2**15 - 1)]
"""Angle of a lidar's sample [degrees / 64, clockwise]."""
Samples = Annotated[int, Range(1, MAX_SAMPLES)]
Seconds = Annotated[float, Range(0.0, 1e6)]
"""Time since the start of the log [s], up to eleven days."""
Draw = Annotated[float, _Rule(lambda value: 0.0 <= value < 1.0, "{noun} from 0 to below 1")]
DateTime = Annotated[str, _Rule(_is_date_time, f"a date and time in UTC from {_YEARS[0]} to {_YEARS[-1]}")]
Pairs: TypeAlias = tuple[tuple[Number, Number], ...]
Values: TypeAlias = tuple[Number | None, ...]
SensedValues = Annotated[
    Mapping[str, Values],
    _lengths({**{name: [1 + len(each)] for name, each in FIELDS.items()}, "lidar": [1]}, ["proximity"]),
]
"""The age of the latest sample [s], then its values, by sensor."""
LineValues = Annotated[
    Mapping[str, tuple[Amount, ...]],
    _lengths({name: [len(each)] for name, each in LINES.items()}),
]
"""The numbers of LINES, by device."""


def now() -> str:
    """The date and time in UTC."""
    return datetime.now(UTC).isoformat(timespec="microseconds")


class ClockOffset(NamedTuple):
    """How far this computer's time of day was ahead of another's [s]."""

    reference: str  # the host with the other clock
    ahead: Annotated[float, Range(-1e10, 1e10)]
    uncertainty: Annotated[float, Range(-1e10, 1e10)]


@dataclass(frozen=True, slots=True, kw_only=True)
class RunStarted:
    """The start of a run's log."""

    kind: Literal["run"] = "run"
    format: Literal[2] = FORMAT
    version: str = field(default_factory=lambda: __version__)  # of mercator_design
    time: DateTime = field(default_factory=now)
    robot: str
    clock: ClockOffset | None = None  # None: not measured
    fsm: str
    flavour: str
    header: Mapping[str, str] | None = None
    seed: int | None = None
    duration: float | None = None  # [s]
    dry_run: bool = False
    without: tuple[str, ...] = ()  # devices
    control_period: Number  # [s]
    control_software: str = ""  # its digest
    reference_model: ReferenceModel
    lidar_angle: Number = 0.0  # [rad]
    facts: Mapping[str, object] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingStarted:
    """The start of a recording."""

    kind: Literal["recording"] = "recording"
    format: Literal[2] = FORMAT
    version: str = field(default_factory=lambda: __version__)  # of mercator_design
    time: DateTime = field(default_factory=now)
    robot: str
    facts: Mapping[str, object] | None = None
    proximity_angles: tuple[Number, ...] = ()  # [rad]
    proximity_offsets: tuple[Number, ...] = ()  # [m]
    lidar_angle: Number  # [rad]


@dataclass(frozen=True, slots=True, kw_only=True)
class CycleDone:
    """A control cycle of a run."""

    cycle: Count
    time: Seconds
    state: Count
    next_state: Count
    readings: Annotated[tuple[Number, ...], Length(_MIN_READINGS, N_READINGS)]
    draws: Annotated[tuple[Draw, ...], Length(1)]
    wheels: tuple[Number | None, Number | None]  # None: not finite
    led_colour: Annotated[int, Range(-1, len(LED_COLOURS) - 1)] | None  # -1: none was set; None: a wrong number
    signal: Annotated[int, Range(0, MAX_SIGNAL)] | None  # None: a wrong number
    cpu: Number  # [s]
    program_cpu: Number  # [s]
    neighbours: Pairs  # distance [m], bearing [rad]
    sensed: SensedValues
    lines: LineValues

    def __post_init__(self) -> None:
        # A program without the latest senses recorded no readings of them.
        object.__setattr__(self, "readings", (*self.readings, *Readings()[len(self.readings) :]))


@dataclass(frozen=True, slots=True, kw_only=True)
class SampleTaken:
    """A sample of a sensor, in a recording."""

    time: Seconds
    sensor: Annotated[str, OneOf(tuple(FIELDS))]
    values: Values


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnTaken:
    """A turn of the lidar: in a recording with readings, in a run with samples and what else maps need (turns.py)."""

    time: Seconds  # at which its last packet had come
    readings: Pairs = ()  # angle [rad], range [m]
    packets: tuple[
        tuple[Count, Angle, Angle, Samples], ...
    ] = ()  # how long before `time` [0.1 ms], first, last, samples
    ranges: str = ""  # of all samples [mm / 4]: 16-bit numbers, the low byte first, in base64
    yaws: Pairs = ()  # time [s], yaw [rad]: those that came since the turn before
    places: tuple[tuple[Number, Number, Number], ...] = ()  # time [s], x, y [m]


@dataclass(frozen=True, slots=True, kw_only=True)
class WheelsDriven:
    """A command to the wheels, in a recording [m/s]."""

    time: Seconds
    left: Number
    right: Number


@dataclass(frozen=True, slots=True, kw_only=True)
class NoteTaken:
    """A note on a device or the program."""

    time: Seconds
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class LogEnded:
    """The end of a log."""

    why: str
    time: str | None = None  # date and time


LogStart: TypeAlias = RunStarted | RecordingStarted
LogEvent: TypeAlias = LogStart | CycleDone | SampleTaken | TurnTaken | WheelsDriven | NoteTaken | LogEnded

_STARTS: Mapping[str, schema.Kind] = {"run": RunStarted, "recording": RecordingStarted}
_ENDS: Mapping[str, schema.Kind] = {"note": NoteTaken, "end": LogEnded}
_TURN = Annotated[TurnTaken, _Rule(_has_a_range_of_each_sample, "ranges in base64, one of each sample of its packets")]
_EVENTS: Mapping[str, Mapping[str, schema.Kind]] = {
    "run": {"cycle": CycleDone, "turn": _TURN, **_ENDS},
    "recording": {
        "sample": Annotated[SampleTaken, _Rule(_fits_its_sensor, "as many values as the sensor has")],
        "turn": _TURN,
        "wheels": WheelsDriven,
        **_ENDS,
    },
}
_WORDS: Mapping[schema.Kind, str] = {
    **dict.fromkeys(_STARTS.values(), "start"),
    **{schema.unwrapped(kind)[0]: word for events in _EVENTS.values() for word, kind in events.items()},
}


def to_json(event: LogEvent) -> dict[str, Any]:
    kind = type(event)
    values = {name: getattr(event, name) for name in kind.__slots__}
    for name, value in values.items():
        if isinstance(value, ReferenceModel | ClockOffset):
            values[name] = value._asdict()
    return {"event": _WORDS[kind], **values}


class EventReader:
    """Reads the events of a log one after the other."""

    def __init__(self, kind: LogKind | None) -> None:
        """Make a reader of logs of a kind; None: of any kind."""
        self._kind = kind
        self._events: Mapping[str, schema.Kind] = {}  # expected from now on
        self._lines = 0
        self._latest: dict[str, float] = {}  # time of the latest event of each name; only these are in order

    def read(self, data: checked_lines.Event) -> LogEvent:
        """The event of a line.

        Raises:
            RobotError: naming the key, what was expected and what was found.
        """
        self._lines += 1
        word, line = data.pop("event", None), data.pop("line", None)
        if not self._events:
            return self._start(word, data)
        if line != self._lines:
            found = f"line {_found(line)}"
            raise RobotError(f"expected line {self._lines}, found {found}: lines are missing or out of order")
        if not isinstance(word, str) or word not in self._events:
            raise RobotError(f"event: expected {schema.one_of([*self._events])}, found {_found(word)}")
        event: LogEvent = from_json(data, self._events[word], error=RobotError, path=word)
        if not isinstance(event, LogStart | LogEnded):
            latest, self._latest[word] = self._latest.get(word, 0.0), event.time
            if event.time < latest:
                raise RobotError(f"{word}.time: expected at least {latest}, found {event.time}")
        return event

    def _start(self, word: object, data: checked_lines.Event) -> LogStart:
        if (word, data.get("format")) != ("start", FORMAT):
            found = f"{_found(word)} of format {_found(data.get('format'))}"
            raise RobotError(f"expected the start of a robot's log, of format {FORMAT}, found {found}")
        kinds = [*_STARTS] if self._kind is None else [self._kind]
        kind = str(data.get("kind"))
        if kind not in kinds:
            found = f"that of a {kind}" if kind in _STARTS else "one of another program"
            raise RobotError(f"expected the log of a {' or '.join(kinds)}, found {found}")
        start: LogStart = from_json(data, _STARTS[kind], error=RobotError, path="start")
        self._events = _EVENTS[kind]
        return start


def _found(value: object) -> str:
    if isinstance(value, list | dict):
        return "another list" if isinstance(value, list) else "another mapping"
    return "none" if value is None else excerpt(f'"{value}"' if isinstance(value, str) else str(value))
