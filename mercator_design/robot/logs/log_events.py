"""What the events of logs and recordings must be: whoever reads them relies on it, whoever wrote them.

What they mean: log.py, recording.py.
"""

import json
from collections.abc import Callable, Mapping
from datetime import datetime, timedelta
from functools import partial
from typing import Any, Literal, NamedTuple, TypeAlias

from mercator_design.config import schema
from mercator_design.config.checked_lines import Event
from mercator_design.errors import excerpt
from mercator_design.fsm import Readings, ReferenceModel
from mercator_design.fsm.control import DRAWS
from mercator_design.robot.devices.samples import FIELDS

Kind: TypeAlias = Literal["run", "recording"]

FORMAT = 2
_LARGEST = 1e9  # number, of any unit
_LONGEST = 1e6  # [s], eleven days
_YEARS = range(1970, 2100)
_FURTHEST = 1e10  # [s] between two clocks
_FEWEST_OF_RVR = 4  # numbers of its line


class _Form(NamedTuple):
    """What a value of an event must be, in words, and whether it is."""

    words: str
    fits: Callable[[Any], bool]


def _is_number(value: Any) -> bool:  # noqa: ANN401 - what JSON can hold, here and below
    return type(value) in {int, float} and -_LARGEST <= value <= _LARGEST


def _is_number_or_null(value: Any) -> bool:  # noqa: ANN401
    return value is None or _is_number(value)


def _is_count(value: Any) -> bool:  # noqa: ANN401
    return type(value) is int and 0 <= value <= _LARGEST


def _is_draw(value: Any) -> bool:  # noqa: ANN401
    return _is_number(value) and 0.0 <= value < 1.0


def _is_time(value: Any) -> bool:  # noqa: ANN401
    return _is_number(value) and 0.0 <= value <= _LONGEST


def _is_text(value: Any) -> bool:  # noqa: ANN401
    return isinstance(value, str) and value.encode(errors="replace").decode() == value


def _is_moment(value: Any) -> bool:  # noqa: ANN401
    try:
        moment = datetime.fromisoformat(value) if isinstance(value, str) else None
    except ValueError:
        return False
    return moment is not None and moment.utcoffset() == timedelta(0) and moment.year in _YEARS


def _is_model(value: Any) -> bool:  # noqa: ANN401
    constants = schema.fields_of(ReferenceModel)
    return isinstance(value, dict) and all(
        name in constants
        and _is_number(number)
        and all(rule.allows(number) for rule in schema.unwrapped(constants[name][0])[1])
        for name, number in value.items()
    )


def _is_clock(value: Any) -> bool:  # noqa: ANN401
    """Only robots that were started together know of another clock."""
    return value is None or (
        isinstance(value, dict)
        and _is_text(value.get("reference"))
        and all(
            type(value.get(key)) in {int, float} and abs(value[key]) <= _FURTHEST for key in ("ahead", "uncertainty")
        )
    )


def _list(words: str, fits: Callable[[Any], bool], length: int | None = None) -> _Form:
    """A list of so many, or of however many, each of which fits."""
    return _Form(
        f"a list of {words}",
        lambda value: isinstance(value, list) and length in (None, len(value)) and all(map(fits, value)),
    )


def _is_sensor(value: Any) -> bool:  # noqa: ANN401
    return isinstance(value, str) and value in FIELDS


def _is_sensed(value: Any) -> bool:  # noqa: ANN401
    return isinstance(value, dict) and all(_is_aged_sample(*item) for item in value.items())


def _is_lines(value: Any) -> bool:  # noqa: ANN401
    """Logs of older versions tell nothing of lines."""
    return value is None or (
        isinstance(value, dict) and all(name in LINES and _LINES[name].fits(each) for name, each in value.items())
    )


def _is_line(name: str, value: Any) -> bool:  # noqa: ANN401
    """Logs of older versions do not tell how the RVR answered."""
    lengths = {len(LINES[name]), _FEWEST_OF_RVR if name == "rvr" else len(LINES[name])}
    return isinstance(value, list) and len(value) in lengths and all(map(_is_number, value))


def _is_aged_sample(sensor: str, value: Any) -> bool:  # noqa: ANN401
    return (
        sensor in _SENSED
        and isinstance(value, list)
        and value != []
        and _is_number(value[0])
        and _SENSED[sensor].fits(value[1:])
    )


_COUNT = _Form("a whole number from 0 on", _is_count)
_NUMBER = _Form("a number", _is_number)
_TEXT = _Form("text", _is_text)
_TIME = _Form(f"seconds from 0 to {_LONGEST:g}", _is_time)
_PAIRS = _list("pairs of numbers", _list("", _is_number, 2).fits)

_SAMPLES: Mapping[str, _Form] = {
    name: _list(f"{len(fields)} numbers", _is_number_or_null if name == "proximity" else _is_number, len(fields))
    for name, fields in FIELDS.items()
}
"""The values of a sample by sensor; nothing in sight is null."""
_SENSED = {**_SAMPLES, "lidar": _list("nothing", _is_number, 0)}

LINES: Mapping[str, tuple[str, ...]] = {
    "rvr": ("whole", "received", "lost", "refused", "answered", "commands", "unanswered", "repeated"),
    "lidar": ("whole", "received", "lost", "refused", "readings"),
    "proximity": ("whole", "received", "lost", "refused"),
}
"""What is told of the line of each device: the share that arrived whole in the last seconds, all bytes so far, those of
no sound frame, beginnings of frames among these; readings of the last turn. Of the RVR the share of commands that it
answered in the last seconds, all commands so far, those without an answer, and those that were repeated."""
_LINES = {name: _Form(f"{len(values)} numbers", partial(_is_line, name)) for name, values in LINES.items()}

_START = {"robot": _TEXT, "time": _Form(f"a date and time of UTC from {_YEARS[0]} to {_YEARS[-1]}", _is_moment)}
_STARTS: Mapping[Kind, Mapping[str, _Form]] = {
    "run": {
        "fsm": _TEXT,
        "flavour": _TEXT,
        "reference_model": _Form("a reference model's constants", _is_model),
        "clock": _Form("how far the clock is ahead of a reference, and how well that is known [s]", _is_clock),
    },
    "recording": {"lidar_angle": _NUMBER},
}
_EVENTS: Mapping[Kind, Mapping[str, Mapping[str, _Form]]] = {
    "run": {
        "cycle": {
            "cycle": _COUNT,
            "time": _TIME,
            "state": _COUNT,
            "next_state": _COUNT,
            "readings": _list(f"{len(Readings._fields)} numbers", _is_number, len(Readings._fields)),
            "draws": _list(f"{DRAWS} numbers from 0 to below 1", _is_draw, DRAWS),
            "wheels": _list("two numbers or null", _is_number_or_null, 2),
            "cpu": _NUMBER,
            "neighbours": _PAIRS,
            "sensed": _Form("the age and values of samples by sensor", _is_sensed),
            "lines": _Form("numbers by line", _is_lines),
        }
    },
    "recording": {
        "sample": {"time": _TIME, "sensor": _Form(schema.one_of([*FIELDS]), _is_sensor)},
        "turn": {"time": _TIME, "readings": _PAIRS},
        "wheels": {"time": _TIME, "left": _NUMBER, "right": _NUMBER},
    },
}
_ENDS = {
    "note": {"time": _TIME, "text": _TEXT},
    "end": {"why": _TEXT},
}
"""By kind of log and event, the values that are relied on."""


class Checker:
    """Checks the events of a log one after the other."""

    def __init__(self, kind: Kind | None) -> None:
        """Of a log of this kind; None: of any."""
        self._kind = kind
        self._events: Mapping[str, Mapping[str, _Form]] = {}  # that may come
        self._lines = 0
        self._latest: dict[str, float] = {}  # time of each event: only those of a name come in their order

    def check(self, event: Event) -> None:
        """Make sure that a log begins or goes on with an event.

        Raises:
            ValueError: saying what was expected, and what was found.
        """
        name = event.get("event")
        self._lines += 1
        if not self._events:
            self._begin(event)
        elif event.get("line") != self._lines:
            found = f"line {_found(event.get('line'))}"
            raise ValueError(f"expected line {self._lines}, found {found}: lines are missing, or not in their order")
        elif not isinstance(name, str) or name not in self._events:
            raise ValueError(f"event: expected {schema.one_of([*self._events])}, found {_found(name)}")
        else:
            _check_values(event, self._events[name])
            if "time" in self._events[name]:
                latest, self._latest[name] = self._latest.get(name, 0.0), event["time"]
                if event["time"] < latest:
                    raise ValueError(f"{name}.time: expected at least {latest}, found {event['time']}")
        if name == "sample":
            _check_values(event, {"values": _SAMPLES[event["sensor"]]})

    def _begin(self, event: Event) -> None:
        if (event.get("event"), event.get("format")) != ("start", FORMAT):
            found = f"{_found(event.get('event'))} of format {_found(event.get('format'))}"
            raise ValueError(f"expected the start of a robot's log, of format {FORMAT}, found {found}")
        kinds = [*_EVENTS] if self._kind is None else [self._kind]
        kind = event.get("kind")
        if kind not in kinds:
            found = f"that of a {kind}" if kind in [*_EVENTS] else "one of another program"
            raise ValueError(f"expected the log of a {' or '.join(kinds)}, found {found}")
        _check_values(event, {**_START, **_STARTS[kind]})
        self._events = {**_EVENTS[kind], **_ENDS}


def _check_values(event: Event, forms: Mapping[str, _Form]) -> None:
    for key, form in forms.items():
        if not form.fits(event.get(key)):
            raise ValueError(f"{event['event']}.{key}: expected {form.words}, found {_found(event.get(key))}")


def _found(value: Any) -> str:  # noqa: ANN401
    if isinstance(value, list | dict):
        return "another list" if isinstance(value, list) else "another mapping"
    return "none" if value is None else excerpt(json.dumps(value))
