"""The log of a robot's run for other programs: a table as CSV, or MCAP, which Foxglove reads.

Event by event, so that a log may be longer than memory. What each column and channel is: docs/robot.md.
"""

import codecs
import csv
import json
import math
from collections.abc import Iterable, Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, TypeAlias

from mercator_design import __version__
from mercator_design.checked_lines import Event
from mercator_design.errors import RobotError
from mercator_design.fsm import Readings, Wheels
from mercator_design.fsm.control import DRAWS
from mercator_design.robot.log import condition_met, controller_of, read, understanding

Message: TypeAlias = tuple[str, Mapping[str, Any]]
"""A topic, and what is said there."""

_SENSED: Mapping[str, tuple[str, ...]] = {
    "acceleration": ("x", "y", "z"),
    "turning": ("x", "y", "z"),
    "attitude": ("roll", "pitch", "yaw"),
    "orientation": ("w", "x", "y", "z"),
    "position": ("x", "y"),
    "velocity": ("x", "y"),
    "ground": ("red", "green", "blue"),
    "ambient_light": ("lux",),
    "proximity": tuple(f"distance_{k}" for k in range(8)),
    "lidar": (),
}
"""The values of each sensor's samples in a log, by name."""

_INFO = 2
"""A level of foxglove.Log."""
_CYCLE = ("cycle", "state", "next_state", "behaviour", "condition", "cpu")
"""What is told of each cycle under the same names."""

_COLUMNS = (
    *("robot", "clock", "time", *_CYCLE),
    *Readings._fields,
    *(f"draw_{k}" for k in range(DRAWS)),
    *Wheels._fields,
    "neighbour_places",
    *(f"sensed_{name}_{value}" for name, values in _SENSED.items() for value in ("age", *values)),
)


_NUMBER, _INTEGER, _STRING = ({"type": kind} for kind in ("number", "integer", "string"))


def _object(**properties: Mapping[str, Any]) -> dict[str, Any]:
    return {"type": "object", "properties": properties}


def _array(items: Mapping[str, Any]) -> dict[str, Any]:
    return {"type": "array", "items": items}


def _numbers(names: Iterable[str]) -> dict[str, Any]:
    return _object(**dict.fromkeys(names, _NUMBER))


_TIME = _object(sec=_INTEGER, nsec=_INTEGER) | {"title": "time"}
_SCHEMAS: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "/state": (
        "mercator.State",
        _object(cycle=_INTEGER, state=_INTEGER, next_state=_INTEGER, behaviour=_STRING, condition=_STRING, cpu=_NUMBER),
    ),
    "/readings": ("mercator.Readings", _numbers(Readings._fields)),
    "/draws": ("mercator.Draws", _object(draws=_array(_NUMBER))),
    "/wheels": ("mercator.Wheels", _numbers(Wheels._fields)),
    "/neighbours": ("mercator.Neighbours", _object(places=_array(_numbers(("distance", "bearing"))))),
    "/odometry": (
        "foxglove.PoseInFrame",
        _object(
            timestamp=_TIME,
            frame_id=_STRING,
            pose=_object(position=_numbers("xyz"), orientation=_numbers("xyzw")),
        ),
    ),
    "/notes": (
        "foxglove.Log",
        _object(timestamp=_TIME, level=_INTEGER, message=_STRING, name=_STRING, file=_STRING, line=_INTEGER),
    ),
    **{
        f"/sensors/{name}": (f"mercator.{name.title().replace('_', '')}", _numbers(("age", *values)))
        for name, values in _SENSED.items()
    },
}
"""Of each topic, the name of its schema and the schema (JSON Schema, of which Foxglove knows no alternatives)."""


class Exported(NamedTuple):
    """How much there was of a log.

    why: The run ended; None if the log does not say, as it is still being written or the program was killed.
    """

    cycles: int
    why: str | None


class _Run:
    """What a log says, with what follows from its start."""

    def __init__(self, path: Path) -> None:
        self._events = read(path)
        self.start = next(self._events)
        if self.start.get("kind", "run") != "run":
            raise RobotError(f"{path}: expected the log of a run, found a {self.start['kind']}")
        self.robot: str = self.start["robot"]
        self.began = datetime.fromisoformat(self.start["time"]).timestamp()  # [s since 1970]
        self._pfsm, self._controller = controller_of(self.start)
        self.cycles, self.why = 0, None

    def events(self) -> Iterator[Event]:
        """Those after the start; cycles with `behaviour` and `condition`, and `sensed` by names."""
        for event in self._events:
            if event["event"] == "cycle":
                self.cycles += 1
                event["behaviour"] = self._pfsm.states[event["state"]].behaviour
                event["condition"] = condition_met(self._controller, event)
                event["sensed"] = {
                    name: dict(zip(("age", *_SENSED[name]), values, strict=True))
                    for name, values in event["sensed"].items()
                }
            elif event["event"] == "end":
                self.why = event["why"]
            yield event

    def exported(self) -> Exported:
        return Exported(self.cycles, self.why)


def write_csv(path: Path, file: BinaryIO) -> Exported:
    """Write a log as CSV: a row for each control cycle.

    Raises:
        RobotError: if it is no log of a run, or is damaged before its end.
    """
    table = csv.DictWriter(codecs.getwriter("utf-8")(file), _COLUMNS, lineterminator="\n")
    with understanding(path):
        run = _Run(path)
        table.writeheader()
        table.writerows(_row(run, event) for event in run.events() if event["event"] == "cycle")
    return run.exported()


def _row(run: _Run, event: Event) -> dict[str, object]:
    """The cells of a cycle; those of sensors that have told nothing yet are left out."""
    return {
        "robot": run.robot,
        "clock": round(run.began + event["time"], 6),
        "time": event["time"],
        **{name: event[name] for name in _CYCLE},
        **Readings(*event["readings"])._asdict(),
        **{f"draw_{k}": draw for k, draw in enumerate(event["draws"])},
        **Wheels(*event["wheels"])._asdict(),
        "neighbour_places": json.dumps(event["neighbours"], separators=(",", ":")),
        **{
            f"sensed_{name}_{key}": math.inf if value is None else value
            for name, values in event["sensed"].items()
            for key, value in values.items()
        },
    }


def write_mcap(path: Path, file: BinaryIO) -> Exported:
    """Write a log as MCAP: what a control cycle has, at the time of the cycle.

    Raises:
        RobotError: if it is no log of a run, or is damaged before its end.
    """
    from mcap.writer import Writer

    writer = Writer(file, enable_data_crcs=True)
    channels: dict[str, int] = {}
    with understanding(path):
        run = _Run(path)
        writer.start(library=f"mercator-design {__version__}")
        start = {name: value for name, value in run.start.items() if name != "event"}
        writer.add_metadata(
            "start", {name: value if isinstance(value, str) else json.dumps(value) for name, value in start.items()}
        )
        time = run.began
        for event in run.events():
            time = run.began + event["time"] if event["event"] == "cycle" else time
            for topic, message in _messages(run, event, time):
                if topic not in channels:
                    name, schema = _SCHEMAS[topic]
                    number = writer.register_schema(name, "jsonschema", json.dumps({"title": name, **schema}).encode())
                    channels[topic] = writer.register_channel(topic, "json", number)
                data, at = json.dumps(message, allow_nan=False).encode(), _nanoseconds(time)
                writer.add_message(channels[topic], log_time=at, data=data, publish_time=at, sequence=run.cycles)
    writer.finish()  # type: ignore[no-untyped-call]
    return run.exported()


def _messages(run: _Run, event: Event, time: float) -> Iterator[Message]:
    """What is said of an event at a time [s since 1970]."""
    match event["event"]:
        case "cycle":
            yield "/state", {name: event[name] for name in _CYCLE}
            yield "/readings", Readings(*event["readings"])._asdict()
            yield "/draws", {"draws": event["draws"]}
            yield "/wheels", _told(Wheels(*event["wheels"])._asdict())
            places = [{"distance": distance, "bearing": bearing} for distance, bearing in event["neighbours"]]
            yield "/neighbours", {"places": places}
            for name, values in event["sensed"].items():
                yield f"/sensors/{name}", _told(values)
            if {"position", "attitude"} <= event["sensed"].keys():
                yield "/odometry", _odometry(event["sensed"], time)
        case "note":
            yield "/notes", _note(run, time, event["text"])
        case "end":
            yield "/notes", _note(run, time, f"The run has ended: {event['why']}")


def _told(values: Mapping[str, float | None]) -> dict[str, float]:
    return {name: value for name, value in values.items() if value is not None}


def _odometry(sensed: Mapping[str, Mapping[str, float]], time: float) -> dict[str, Any]:
    position, yaw = sensed["position"], sensed["attitude"]["yaw"]
    return {
        "timestamp": _stamp(time - position["age"]),
        "frame_id": "start",
        "pose": {
            "position": {"x": position["x"], "y": position["y"], "z": 0.0},
            "orientation": {"x": 0.0, "y": 0.0, "z": math.sin(0.5 * yaw), "w": math.cos(0.5 * yaw)},
        },
    }


def _note(run: _Run, time: float, text: str) -> dict[str, Any]:
    return {"timestamp": _stamp(time), "level": _INFO, "message": text, "name": run.robot, "file": "", "line": 0}


def _stamp(time: float) -> dict[str, int]:
    seconds, nanoseconds = divmod(_nanoseconds(time), 10**9)
    return {"sec": seconds, "nsec": nanoseconds}


def _nanoseconds(time: float) -> int:
    """A time [s since 1970], of which microseconds are known."""
    return round(1e6 * time) * 1000
