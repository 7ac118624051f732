"""Scans of the YDLIDAR X4: packets, the points that the documented formula and the maker's SDK make of them, commands.

The SDK 1.2.7 cuts angles to 64ths of a degree and gives no range outside of limits. Its whole turns are compared, also
as its ROS node hands them out, but for those in which its faults show.
"""

import math
from collections.abc import Iterator
from typing import Any

from benchmarks.vectors.checks import Check, difference, each
from benchmarks.vectors.pieces import difference_in_pieces, received
from mercator_design.robot.protocols import ydlidar
from mercator_design.robot.protocols.ydlidar import DeviceInfo, Health, Packet, ScanStarted, Turns

FORMULA_DEG, FORMULA_M = 1e-4, 1e-6
SDK_DEG = 0.04
SDK_SCANS = {"sdk_1_2_7_scans": (0.12, 10.0), "sdk_1_2_7_scans_ros_x4_launch": (0.1, 12.0)}
"""Turns with their limits [m]; angles are clockwise in the first, counter-clockwise in the second."""
SDK_FAULTS = {"bad_checksum_middle", "truncated_then_good", "backwards_not_wrap"}
"""The SDK makes points of packets with a wrong checksum, and guesses at angles that go backwards."""
BEGINS = bytes.fromhex("aa55002801")


def recognises(document: Any) -> bool:
    return isinstance(document, dict) and "scan_cases" in document


def checks(document: dict[str, Any]) -> Iterator[Check]:
    yield from each("commands", document["commands"], _command)
    yield from each("scans", document["scan_cases"], _scan)
    for client, sent in document["sessions"].items():
        yield from each("sessions", [(client, sent)], _session)


def _command(_: str, vector: dict[str, Any]) -> Iterator[Check]:
    name = vector["name"]
    yield Check("commands", name, difference(vector["command_hex"], ydlidar.encode_command(name).hex()))
    heard = received(ydlidar.command_decoder, bytes.fromhex(vector["command_hex"]))
    yield Check("commands, heard by the device", name, difference([name], heard))
    if not vector["response_hex"]:
        return
    answer, expected = bytes.fromhex(vector["response_hex"]), vector.get("response")
    (event,) = received(ydlidar.decoder, answer)
    if isinstance(event, DeviceInfo):
        major, minor = event.firmware
        found = {
            "model": event.model,
            "firmware_as_sdk_reads": f"{major}.{minor} (high byte major)",
            "hardware": event.hardware,
            "serial_digits": event.serial,
        }
    elif isinstance(event, Health):
        found = {"status": event.status, "error_code": event.error_code}
    else:
        found = {"continuous": isinstance(event, ScanStarted)}
    yield Check("answers", name, difference({key: expected[key] for key in found} if expected else found, found))
    yield Check("answers, sent by the device", name, difference(answer.hex(), event.encode().hex()))
    yield Check("answers, in pieces", name, difference_in_pieces(ydlidar.decoder, answer, BEGINS))


def _scan(_: str, vector: dict[str, Any]) -> Iterator[Check]:
    name, chunks = vector["name"], [bytes.fromhex(chunk) for chunk in vector["chunks_hex"]]
    sound = [p for p in vector["packets"] if p["checksum_ok"] and p["fsa_raw"] & p["lsa_raw"] & 1]
    packets = received(ydlidar.decoder, *chunks)
    yield Check("packets", name, difference([_of_vector(packet) for packet in sound], [*map(_fields, packets)]))
    yield Check("packets, sent", name, difference([p["hex"] for p in sound], [p.encode().hex() for p in packets]))
    yield Check("packets, in pieces", name, difference_in_pieces(ydlidar.decoder, b"".join(chunks), BEGINS))
    points = [_as_told(point) for packet in packets for point in packet.points()]
    yield Check("points by the formula", name, _apart(vector["formula_points"], points, FORMULA_DEG, FORMULA_M))
    for kind, (least, most) in SDK_SCANS.items():
        if vector.get(kind) and name not in SDK_FAULTS:
            told = _as_told if kind == "sdk_1_2_7_scans" else _counter_clockwise
            turns = [[told((a, r if least <= r <= most else 0.0)) for a, r in turn] for turn in _turns(packets)]
            apart = [_apart(*pair, SDK_DEG, FORMULA_M) for pair in zip(vector[kind], turns, strict=True)]
            yield Check(kind, name, "; ".join(filter(None, apart)))


def _turns(packets: list[Packet]) -> list[Any]:
    """Whole turns, of which the last is ended by a ring start behind it."""
    turns = Turns()
    ended = map(turns.receive, [*packets, Packet(0, 0, (0,), is_ring_start=True)])
    return [turn for turn in ended if turn is not None]


def _session(_: str, session: tuple[str, list[tuple[float, str]]]) -> Iterator[Check]:
    """What a client sends is heard, write by write."""
    client, sent = session
    names = {ydlidar.encode_command(name).hex(): name for name in ydlidar.COMMANDS}
    heard = received(ydlidar.command_decoder, *(bytes.fromhex(written) for _, written in sent))
    yield Check("sessions", client, difference([names[written] for _, written in sent], heard))


def _of_vector(packet: dict[str, Any]) -> list[Any]:
    frequency = packet["scan_freq_hz"] or 0.0
    angles = [packet["fsa_deg"], packet["lsa_deg"]]
    return [packet["ring_start"], round(10 * frequency), *angles, packet["samples_raw"]]


def _fields(packet: Packet) -> list[Any]:
    frequency = packet.frequency if packet.is_ring_start else 0
    return [packet.is_ring_start, frequency, packet.first / 64, packet.last / 64, [*packet.samples]]


def _as_told(point: tuple[float, float]) -> list[float]:
    """Degrees, clockwise."""
    angle, range_m = point
    return [-math.degrees(angle) % 360.0, range_m]


def _counter_clockwise(point: tuple[float, float]) -> list[float]:
    """Degrees, as they are."""
    angle, range_m = point
    return [math.degrees(angle), range_m]


def _apart(expected: list[list[float]], found: list[list[float]], degrees: float, metres: float) -> str:
    if len(expected) != len(found):
        return f"expected {len(expected)} points, found {len(found)}"
    for number, (of, ours) in enumerate(zip(expected, found, strict=True), start=1):
        if abs((of[0] - ours[0] + 180) % 360 - 180) > degrees or abs(of[1] - ours[1]) > metres:
            return f"point {number}: expected {of}, found {ours}"
    return ""
