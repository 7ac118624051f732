"""Frames of the Teraranger Hub Multiflex: commands, acknowledgements, distances in binary and text, damaged streams."""

from collections.abc import Callable, Iterator
from typing import Any

from benchmarks.vectors.checks import Check, difference, each
from benchmarks.vectors.pieces import difference_in_pieces, received
from mercator_design.robot.protocols import multiflex
from mercator_design.robot.protocols.multiflex import BINARY_MODE, NOTHING, TEXT_MODE, Acknowledgement, Distances, crc8

SINGLE = 1e-6
"""Relative rounding of what the driver publishes."""


def recognises(document: Any) -> bool:
    return isinstance(document, dict) and "text_lines" in document


def checks(document: dict[str, Any]) -> Iterator[Check]:
    for kind, cases in document.items():
        if kind in _KINDS:
            yield from each(kind, cases, _KINDS[kind])
        elif kind != "meta":
            yield Check(kind, "all", "unknown kind of vectors")


def _command(_: str, vector: dict[str, Any]) -> Iterator[Check]:
    modes = {"text_mode": TEXT_MODE, "binary_mode": BINARY_MODE}
    name = vector["name"]
    command = multiflex.use_sensors(vector["mask"]) if "mask" in vector else modes[name]
    yield Check("commands", name, difference(vector["hex"], command.encode().hex()))
    start = bytes.fromhex(vector.get("driver_startup_bytes", vector["hex"]))
    heard = received(multiflex.command_decoder, start)
    yield Check("commands, heard by the hub", name, difference([BINARY_MODE, command][-len(heard) :], heard))
    yield Check("commands, in pieces", name, difference_in_pieces(multiflex.command_decoder, start, b"\0"))


def _acknowledgement(_: str, vector: dict[str, Any]) -> Iterator[Check]:
    expected = Acknowledgement(vector["command_echo"], ok=vector["ok"])
    yield from _event("acks", vector, [expected], expected.encode)


def _frame(_: str, vector: dict[str, Any]) -> Iterator[Check]:
    distances = Distances(tuple(vector["raw_mm_u16"]), vector["mask"])
    yield from _event("frames", vector, [distances] if vector["crc_ok"] else [], distances.encode)
    if vector["driver_ranges_m"]:
        published = [float(metres) for metres in vector["driver_ranges_m"]]
        yield Check("frames, metres", vector["name"], difference(published, distances.metres(), digits=SINGLE))


def _text_line(case: str, vector: dict[str, Any]) -> Iterator[Check]:
    distances = Distances(tuple(NOTHING if mm < 0 else mm for mm in vector["mm"]))
    yield from _event("text_lines", {"name": case, **vector}, [distances], distances.encode_text)


def _event(kind: str, vector: dict[str, Any], expected: list[Any], encode: Callable[[], bytes]) -> Iterator[Check]:
    whole, name = bytes.fromhex(vector["hex"]), vector["name"]
    yield Check(kind, name, difference(expected, received(multiflex.decoder, whole)))
    yield Check(f"{kind}, in pieces", name, difference_in_pieces(multiflex.decoder, whole, b"M"))
    if expected:
        yield Check(f"{kind}, sent by the hub", name, difference(vector["hex"], encode().hex()))


def _stream(_: str, vector: dict[str, Any]) -> Iterator[Check]:
    chunks = [bytes.fromhex(chunk) for chunk in vector["chunks_hex"]]
    events = received(multiflex.decoder, *chunks)
    found = [[*event.millimetres] for event in events if isinstance(event, Distances)]
    yield Check("streams", vector["name"], difference(vector["ideal_frames_raw_mm"], found))
    pieces = difference_in_pieces(multiflex.decoder, b"".join(chunks), b"M")
    yield Check("streams, in pieces", vector["name"], pieces)


def _published(_: str, vector: dict[str, Any]) -> Iterator[Check]:
    """Whether the maker's printed examples have the right CRC: with it, that of the whole is 0."""
    is_right = crc8(bytes.fromhex(vector["hex"])) == 0
    yield Check("published_examples", vector["name"], difference(vector["crc_ok_poly07_init00"], is_right))


_KINDS = {
    "commands": _command,
    "acks": _acknowledgement,
    "frames": _frame,
    "streams": _stream,
    "text_lines": _text_line,
    "published_examples": _published,
}
