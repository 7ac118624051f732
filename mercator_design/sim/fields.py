"""Values in frozen records (dataclasses and NamedTuples) by the path of their fields, as `drive.maximum_speed`."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from mercator_design.config import spelling
from mercator_design.config.schema import Kind, fields_of, is_record


def found_at(record: object, way: str) -> tuple[str, object]:
    """A path in the spelling of the fields, and the value there; None if there is none."""
    names: list[str] = []
    for word in way.split("."):
        kind: Kind = type(record)
        known = fields_of(kind) if is_record(record) else ()
        names.append(spelling.find(word, known) or word)
        record = getattr(record, names[-1], None)
    return ".".join(names), record


def mistakes_in(bounds: Mapping[str, tuple[float, float]], record: object) -> Iterator[str]:
    """The mistakes in bounds of values; keys are paths."""
    ways: set[str] = set()
    for key, (low, high) in bounds.items():
        way, value = found_at(record, key)
        if low > high:
            yield f"{key}: expected the lower bound first, found [{low:g}, {high:g}]"
        if not isinstance(value, float):
            yield f"{key}: the robot model has no real number there that could vary"
        if way in ways:
            yield f"{key}: is there in another spelling; give one of the two"
        ways.add(way)


def replaced(record: Any, way: Sequence[str], value: float) -> Any:  # noqa: ANN401 - any record
    """A record with another value at a path, which must exist."""
    name, *rest = way
    new = replaced(getattr(record, name), rest, value) if rest else value
    return record._replace(**{name: new}) if hasattr(record, "_replace") else replace(record, **{name: new})
