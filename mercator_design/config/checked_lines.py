"""Events as lines of a file that is appended to: JSON with a checksum, by which an incomplete line is found."""

import json
import zlib
from collections.abc import Mapping
from typing import Any, TypeAlias

Event: TypeAlias = dict[str, Any]

_CRC = ',"crc":"'
_TAIL = len(_CRC) + 8 + len('"}')

_to_json = json.JSONEncoder(separators=(",", ":"), allow_nan=False).encode


def to_line(event: Mapping[str, Any]) -> str:
    """An event as a line with its checksum."""
    text = _to_json(event)
    return f'{text[:-1]}{_CRC}{zlib.crc32(text.encode()):08x}"}}\n'


def checksum(line: str | bytes) -> str:
    """The checksum of a line from `to_line`."""
    end = line[-11:-3]
    return end if isinstance(end, str) else end.decode()


def from_line(line: bytes) -> Event:
    """The event of a line.

    Raises:
        ValueError: if it is not such a line, with what was expected.
    """
    text = checked_text(line)
    try:
        event = json.loads(text)
    except RecursionError:
        event = None
    if not isinstance(event, dict):
        raise ValueError("expected an event")  # noqa: TRY004 - it is the line's fault
    return event


def checked_text(line: bytes) -> bytes:
    """The JSON of a line without its checksum, which is verified.

    Raises:
        ValueError: as `from_line`.
    """
    if not line.endswith(b'"}\n') or line[-_TAIL - 1 : -11] != _CRC.encode():
        raise ValueError('expected an event that ends in its checksum ("crc") and a newline')
    text, crc = line[: -_TAIL - 1] + b"}", line[-11:-3].decode("ascii", "replace")
    if f"{zlib.crc32(text):08x}" != crc:
        raise ValueError(f"expected the checksum {zlib.crc32(text):08x}, found {crc}")
    return text
