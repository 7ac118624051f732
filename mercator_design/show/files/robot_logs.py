"""Logs of runs and recordings for other programs: rows of tables (robot_log_table.py), and MCAP for Foxglove.

Logs are read event by event, so a log may be larger than memory. docs/reference/robot-logs.md describes each column and
channel.
"""

import json
import math
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from datetime import datetime
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias

from mercator_design import __version__
from mercator_design.fsm import Readings
from mercator_design.fsm.pfsm import Pfsm
from mercator_design.robot.devices.samples import FIELDS
from mercator_design.robot.devices.sweep import BINS, STEP
from mercator_design.robot.logs.events import (
    LINES,
    CycleDone,
    LogEnded,
    LogEvent,
    LogStart,
    NoteTaken,
    RunStarted,
    SampleTaken,
    TurnTaken,
    WheelsDriven,
    to_json,
)
from mercator_design.robot.logs.log import NO_END, condition_met, controller_of, read, understanding
from mercator_design.robot.logs.turns import readings_of
from mercator_design.software.architectures import part_names

Message: TypeAlias = tuple[str, Mapping[str, Any]]
"""A topic and its message."""
Row: TypeAlias = dict[str, object]
"""Cells by column; missing ones are empty."""

_SENSED: Mapping[str, tuple[str, ...]] = {**FIELDS, "lidar": ()}
"""The names of the values in samples of each sensor."""

_INFO = 2
"""The level of foxglove.Log."""
_TREADS = ("left", "right")
_OUTPUTS = ("led_colour", "signal")
_CYCLE = ("cycle", "state", "next_state", "behaviour", "condition", "cpu")
"""Columns of a cycle that are also keys of the message."""

_NUMBER, _INTEGER, _STRING = ({"type": kind} for kind in ("number", "integer", "string"))


def _object(**properties: Mapping[str, Any]) -> dict[str, Any]:
    return {"type": "object", "properties": properties}


def _array(items: Mapping[str, Any]) -> dict[str, Any]:
    return {"type": "array", "items": items}


def _numbers(names: Iterable[str]) -> dict[str, Any]:
    return _object(**dict.fromkeys(names, _NUMBER))


_TIME = _object(sec=_INTEGER, nsec=_INTEGER) | {"title": "time"}
_POSE = _object(position=_numbers("xyz"), orientation=_numbers("xyzw"))
_SCHEMAS: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "/state": (
        "mercator.State",
        _object(cycle=_INTEGER, state=_INTEGER, next_state=_INTEGER, behaviour=_STRING, condition=_STRING, cpu=_NUMBER),
    ),
    "/readings": ("mercator.Readings", _numbers(Readings._fields)),
    "/draws": ("mercator.Draws", _object(draws=_array(_NUMBER))),
    "/wheels": ("mercator.Wheels", _numbers(_TREADS)),
    "/outputs": ("mercator.Outputs", _object(**dict.fromkeys(_OUTPUTS, _INTEGER))),
    "/treads": ("mercator.Treads", _numbers(_TREADS)),
    "/neighbours": ("mercator.Neighbours", _object(places=_array(_numbers(("distance", "bearing"))))),
    "/odometry": (
        "foxglove.PoseInFrame",
        _object(timestamp=_TIME, frame_id=_STRING, pose=_POSE),
    ),
    "/tf": (
        "foxglove.FrameTransform",
        _object(
            timestamp=_TIME,
            parent_frame_id=_STRING,
            child_frame_id=_STRING,
            translation=_numbers("xyz"),
            rotation=_numbers("xyzw"),
        ),
    ),
    "/lidar": (
        "foxglove.LaserScan",
        _object(
            timestamp=_TIME,
            frame_id=_STRING,
            pose=_POSE,
            start_angle=_NUMBER,
            end_angle=_NUMBER,
            ranges=_array(_NUMBER),
            intensities=_array(_NUMBER),
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
    **{f"/lines/{name}": (f"mercator.{name.title()}Line", _numbers(values)) for name, values in LINES.items()},
}
"""For each topic the name of its schema, and the JSON Schema, in which every value has one type."""


class ExportedLog:
    """A log, read event by event.

    columns: The columns of its table.
    counted, unit: The classes of events that are counted, and their name.
    time: Time of the latest event [s since 1970], by the reference's clock if the offset was measured, else by the
        robot's.
    reference: The owner of the reference clock; empty if it is the robot's own clock.
    """

    columns: Sequence[str]
    counted: tuple[type[LogEvent], ...]
    unit: str

    def __init__(self, start: LogStart, events: Generator[LogEvent, None, None]) -> None:
        self.start, self._events = start, events
        self.robot = start.robot
        clock = start.clock if isinstance(start, RunStarted) else None
        self.reference = "" if clock is None else clock.reference
        ahead = 0.0 if clock is None else clock.ahead
        self.time = self._began = datetime.fromisoformat(start.time).timestamp() - ahead
        self._count, self._why = 0, NO_END

    def events(self) -> Iterator[LogEvent]:
        """The events after the start."""
        for event in self._events:
            if isinstance(event, LogEnded):
                self._why = event.why
            elif not isinstance(event, LogStart):
                self.time = self._began + event.time
            if isinstance(event, self.counted):
                self._count += 1
            yield event

    def close(self) -> None:
        """Close the file of the log."""
        self._events.close()

    def rows(self, event: LogEvent) -> Iterator[Row]:
        """The rows of an event in the table."""
        raise NotImplementedError

    def messages(self, event: LogEvent) -> Iterator[Message]:
        """The messages of an event."""
        if isinstance(event, NoteTaken | LogEnded):
            text = event.text if isinstance(event, NoteTaken) else f"The end: {event.why}"
            stamp = _stamp(self.time)
            note = {"timestamp": stamp, "level": _INFO, "message": text, "name": self.robot, "file": "", "line": 0}
            yield "/notes", note

    def summary(self) -> str:
        """The number of counted events, and the reason of the end."""
        return f"{self._count} {self.unit}; {self._why}"


class _Run(ExportedLog):
    columns = (
        *("robot", "clock", "time", *_CYCLE),
        *Readings._fields,
        "draws",
        *_TREADS,
        *_OUTPUTS,
        "neighbour_places",
        *(f"sensed_{name}_{value}" for name, values in _SENSED.items() for value in ("age", *values)),
        *(f"line_{name}_{value}" for name, values in LINES.items() for value in values),
    )
    counted = (CycleDone,)
    unit = "cycles"

    def __init__(self, start: LogStart, events: Generator[LogEvent, None, None]) -> None:
        super().__init__(start, events)
        self._controller, self._front = controller_of(start), getattr(start, "lidar_angle", 0.0)
        software = self._controller.software
        usual = part_names(software)
        self._names = [one.behaviour for one in software.states] if isinstance(software, Pfsm) else usual

    def _state(self, event: CycleDone) -> dict[str, object]:
        """The values of _CYCLE."""
        found = {
            "behaviour": self._names[event.state],
            "condition": condition_met(self._controller, event),
        }
        return {name: found[name] if name in found else getattr(event, name) for name in _CYCLE}

    def rows(self, event: LogEvent) -> Iterator[Row]:
        if isinstance(event, CycleDone):
            yield {
                "robot": self.robot,
                "clock": round(self.time, 6),
                "time": event.time,
                **self._state(event),
                **Readings(*event.readings)._asdict(),
                "draws": json.dumps(event.draws, separators=(",", ":")),
                **dict(zip(_TREADS, event.wheels, strict=True)),
                **_outputs(event),
                "neighbour_places": json.dumps(event.neighbours, separators=(",", ":")),
                **{
                    f"{kind}_{name}_{key}": _cell(value)
                    for kind, found in (("sensed", _sensed(event)), ("line", _lines(event)))
                    for name, values in found.items()
                    for key, value in values.items()
                },
            }

    def messages(self, event: LogEvent) -> Iterator[Message]:
        yield from super().messages(event)
        if isinstance(event, TurnTaken):
            yield _scan(self.time, readings_of(event, self._front))
        if isinstance(event, CycleDone):
            yield "/state", self._state(event)
            yield "/readings", Readings(*event.readings)._asdict()
            yield "/draws", {"draws": event.draws}
            yield "/wheels", _present(dict(zip(_TREADS, event.wheels, strict=True)))
            yield "/outputs", _present(_outputs(event))
            places = [{"distance": distance, "bearing": bearing} for distance, bearing in event.neighbours]
            yield "/neighbours", {"places": places}
            sensed = {name: _present(values) for name, values in _sensed(event).items()}
            for name, present in sensed.items():
                yield f"/sensors/{name}", present
            for name, values in _lines(event).items():
                yield f"/lines/{name}", values
            if {"position", "attitude"} <= sensed.keys():
                position, yaw = sensed["position"], sensed["attitude"]["yaw"]
                yield from _stands(self.time - position["age"], position["x"], position["y"], yaw)


class _Recording(ExportedLog):
    columns = ("robot", "clock", "time", "sensor", *(f"value_{k}" for k in range(max(map(len, _SENSED.values())))))
    counted = (SampleTaken, TurnTaken)
    unit = "samples and turns"
    _yaw: float | None = None  # the latest

    def rows(self, event: LogEvent) -> Iterator[Row]:
        rows: Iterable[Sequence[float | None]]
        match event:
            case SampleTaken():
                sensor, rows = event.sensor, [event.values]
            case TurnTaken():
                sensor, rows = "lidar", event.readings
            case WheelsDriven():
                sensor, rows = "wheels", [(event.left, event.right)]
            case _:
                return
        cells = {"robot": self.robot, "clock": round(self.time, 6), "time": event.time, "sensor": sensor}
        for values in rows:
            yield cells | {f"value_{k}": _cell(value) for k, value in enumerate(values)}

    def messages(self, event: LogEvent) -> Iterator[Message]:
        yield from super().messages(event)
        match event:
            case SampleTaken():
                present = _present(_named(event.sensor, event.values))
                yield f"/sensors/{event.sensor}", present
                if event.sensor == "attitude":
                    self._yaw = present["yaw"]
                if event.sensor == "position" and self._yaw is not None:
                    yield from _stands(self.time, present["x"], present["y"], self._yaw)
            case TurnTaken():
                yield _scan(self.time, event.readings)
            case WheelsDriven():
                yield "/treads", {"left": event.left, "right": event.right}


def _scan(time: float, readings: Sequence[tuple[float, float]]) -> Message:
    """A turn of the lidar."""
    message = {"timestamp": _stamp(time), "frame_id": "robot", "pose": _pose(0.0, 0.0, 0.0), "start_angle": 0.0}
    return "/lidar", message | {"end_angle": (BINS - 1) * STEP, "ranges": _even(readings), "intensities": []}


_KINDS: Mapping[str, type[ExportedLog]] = {"run": _Run, "recording": _Recording}


def write_mcap(path: Path, file: BinaryIO) -> str:
    """Write a log as MCAP, with messages at the times of cycles or samples; return its summary.

    Raises:
        RobotError: if it is not a log of these kinds, or is damaged before its end.
    """
    from mcap.writer import Writer

    writer = Writer(file, enable_data_crcs=True)
    channels: dict[str, int] = {}
    with understanding(path), closing(open_log(path)) as log:
        writer.start(library=f"mercator-design {__version__}")
        start = {name: value for name, value in to_json(log.start).items() if name != "event"}
        writer.add_metadata(
            "start", {name: value if isinstance(value, str) else json.dumps(value) for name, value in start.items()}
        )
        for event in log.events():
            for topic, message in log.messages(event):
                if topic not in channels:
                    name, schema = _SCHEMAS[topic]
                    number = writer.register_schema(name, "jsonschema", json.dumps({"title": name, **schema}).encode())
                    channels[topic] = writer.register_channel(topic, "json", number)
                data, at = json.dumps(message, allow_nan=False).encode(), _nanoseconds(log.time)
                writer.add_message(channels[topic], log_time=at, data=data, publish_time=at)
    writer.finish()  # type: ignore[no-untyped-call]
    return log.summary()


def open_log(path: Path) -> ExportedLog:
    """A log of any kind, to be closed; errors are those of `read`."""
    events = read(path, None)
    start = next(events)
    assert isinstance(start, LogStart)  # noqa: S101 - as `read` has seen
    return _KINDS[start.kind](start, events)


def _outputs(event: CycleDone) -> dict[str, float | None]:
    """What modules set beside the wheels."""
    return {name: getattr(event, name) for name in _OUTPUTS}


def _sensed(event: CycleDone) -> dict[str, dict[str, float | None]]:
    """Age and values of the latest sample of each sensor, by name."""
    return {name: {"age": age, **_named(name, values)} for name, (age, *values) in event.sensed.items()}


def _lines(event: CycleDone) -> dict[str, dict[str, float]]:
    """The numbers of each device's line, by name."""
    return {name: dict(zip(LINES[name], each, strict=True)) for name, each in event.lines.items()}


def _named(sensor: str, values: Sequence[float | None]) -> dict[str, float | None]:
    return dict(zip(_SENSED[sensor], values, strict=True))


def _cell(value: float | None) -> float:
    """The value of a cell: infinity where nothing is in sight."""
    return math.inf if value is None else value


def _present(values: Mapping[str, float | None]) -> dict[str, float]:
    """The values of a message: None is omitted."""
    return {name: value for name, value in values.items() if value is not None}


def _stands(time: float, x: float, y: float, heading: float) -> Iterator[Message]:
    """The robot's own estimate of its pose, as a pose and as a transform, so that scans are shown there."""
    stamp, pose = _stamp(time), _pose(x, y, heading)
    yield "/odometry", {"timestamp": stamp, "frame_id": "start", "pose": pose}
    yield (
        "/tf",
        {
            "timestamp": stamp,
            "parent_frame_id": "start",
            "child_frame_id": "robot",
            "translation": pose["position"],
            "rotation": pose["orientation"],
        },
    )


def _pose(x: float, y: float, heading: float) -> dict[str, Any]:
    """A foxglove.Pose on the floor."""
    orientation = {"x": 0.0, "y": 0.0, "z": math.sin(0.5 * heading), "w": math.cos(0.5 * heading)}
    return {"position": {"x": x, "y": y, "z": 0.0}, "orientation": orientation}


def _even(readings: Iterable[tuple[float, float]]) -> list[float]:
    """Ranges of a turn at the uniform angles of a foxglove.LaserScan: the nearest one, or 0 if there is none."""
    ranges = [0.0] * BINS
    for angle, distance in readings:
        k = round(angle / STEP) % BINS
        if distance > 0.0 and not 0.0 < ranges[k] < distance:
            ranges[k] = distance
    return ranges


def _stamp(time: float) -> dict[str, int]:
    seconds, nanoseconds = divmod(_nanoseconds(time), 10**9)
    return {"sec": seconds, "nsec": nanoseconds}


def _nanoseconds(time: float) -> int:
    """A time [s since 1970] in nanoseconds, rounded to microseconds."""
    return round(1e6 * time) * 1000
