"""Bytes handed to a decoder in every way in which they may arrive: the events must be the same."""

import random
from collections.abc import Callable, Iterator
from typing import Any, TypeAlias

from mercator_design.robot.protocols.framing import Decoder

Make: TypeAlias = Callable[[], Decoder[Any]]
NOISE = 60
"""Bytes of garbage before and behind."""


def received(make: Make, *chunks: bytes) -> list[Any]:
    """The events of a new decoder."""
    decoder = make()
    return [event for chunk in chunks for event in decoder.receive(chunk)]


def difference_in_pieces(make: Make, data: bytes, begins: bytes) -> str:
    """The first way of delivering that changes what is received; empty if none does.

    Args:
        make: A new decoder.
        data: What is delivered whole, byte by byte, split at every point, and in the middle of garbage.
        begins: What a frame begins with: the worst garbage.
    """
    expected = received(make, data)
    for way, chunks in _ways(data, begins):
        if (found := received(make, *chunks)) != expected:
            return f"{way}: expected {expected!r:.200}, found {found!r:.200}"
    return ""


def _ways(data: bytes, begins: bytes) -> Iterator[tuple[str, list[bytes]]]:
    yield "byte by byte", [bytes([byte]) for byte in data]
    for at in range(1, len(data)):
        yield f"split at {at}", [data[:at], data[at:]]
    noise = random.Random(data).randbytes(NOISE)
    yield "in garbage", [noise + data + noise]
    yield "byte by byte in garbage", [bytes([byte]) for byte in noise + data + noise]
    yield "behind beginnings", [begins * 3 + data]
