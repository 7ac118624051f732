"""The YDLIDAR X4: packets both ways, where points are, what a turn is, answers and commands."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mercator_design.robot.protocols import ydlidar
from mercator_design.robot.protocols.ydlidar import (
    MAX_TURN_SAMPLES,
    TURN,
    DeviceInfo,
    Health,
    Packet,
    ScanStarted,
    Turns,
    correction,
)

FIXED = settings(derandomize=True)
ANGLE = st.integers(0, 360 * 64 - 1)
PACKETS = st.builds(
    Packet,
    first=ANGLE,
    last=ANGLE,
    samples=st.lists(st.integers(0, 0xFFFF), min_size=1, max_size=80).map(tuple),
    is_ring_start=st.booleans(),
    frequency=st.integers(0, 127),
)


def received(*sent):
    return ydlidar.decoder().receive(b"".join(sent))


@FIXED
@given(PACKETS)
def test_packets_arrive_as_they_were_sent(packet):
    assert received(packet.encode()) == [packet]
    points = packet.points()
    assert [range_m for _, range_m in points] == [sample / 4000 for sample in packet.samples]
    assert all(0.0 <= angle < math.tau for angle, _ in points)


@pytest.mark.parametrize(
    "answer", [DeviceInfo(6, (1, 5), 1, "0123456789012345"), Health(0), Health(2, 0xABCD), ScanStarted()]
)
def test_answers_arrive_as_they_were_sent(answer):
    assert received(answer.encode()) == [answer]


@pytest.mark.parametrize("name", ydlidar.COMMANDS)
def test_commands_arrive_as_they_were_sent(name):
    sent = ydlidar.encode_command(name)
    assert (len(sent), sent[0]) == (2, 0xA5)
    assert ydlidar.command_decoder().receive(b"\xa5" + sent) == [name]


def test_health_is_asked_for_in_two_ways():
    assert ydlidar.command_decoder().receive(bytes.fromhex("a592a591")) == ["health", "health"]


def test_the_worked_example_of_the_manual():
    """Angles 223.78 and 243.47 degrees, clockwise; corrections -6.7622 degrees at 1000 mm, -7.8374 at 8000 mm."""
    packet = Packet(0x6FE5 >> 1, 0x79BD >> 1, (4000, 32000))
    assert packet.encode()[4:8] == bytes.fromhex("e56fbd79")
    assert correction(1.0) == pytest.approx(math.radians(6.7622), abs=1e-6)
    assert correction(8.0) == pytest.approx(math.radians(7.8374), abs=1e-6)
    assert correction(0.1553) == pytest.approx(0.0, abs=1e-12)
    assert correction(0.1) < 0.0
    assert correction(0.0) == 0.0
    clockwise = [-math.degrees(angle) % 360 for angle, _ in packet.points()]
    assert clockwise == pytest.approx([223.78 - 6.7622, 243.47 - 7.8374], abs=0.01)


def test_angles_are_interpolated_through_north():
    packet = Packet(355 * 64, 5 * 64, (0,) * 3)
    assert [math.degrees(angle) for angle, _ in packet.points()] == pytest.approx([5, 0, 355])
    assert not packet.is_suspect
    assert Packet(0, 0, (0,) * 3).points() == [(0.0, 0.0)] * 3


def test_angles_that_go_back_elsewhere_are_suspect_and_in_no_turn():
    back = Packet(100 * 64, 90 * 64, (4000, 4000))
    assert back.is_suspect
    start, other = Packet(0, 0, (4000,), is_ring_start=True), Packet(64, 128, (4000, 4000))
    turns = Turns()
    assert [turns.receive(packet) for packet in (start, back, other)] == [None] * 3
    assert turns.receive(start) == start.points() + other.points()


def test_a_turn_begins_with_a_ring_start():
    start, other = Packet(0, 0, (4000,), is_ring_start=True), Packet(64, 128, (4000, 4000))
    turns = Turns()
    assert [turns.receive(packet) for packet in (other, start, other, other)] == [None] * 4
    assert turns.receive(start) == [*start.points(), *other.points(), *other.points()]
    assert turns.receive(start) == start.points()


def packets_of_turns(n, offset=0, angles=720):
    """Packets of whole turns with two samples in a degree, of which the first has the ring start at an angle."""
    for _ in range(n):
        yield Packet(offset % TURN, offset % TURN, (4000,), is_ring_start=True)
        for k in range(1, angles, 40):
            first, last = (round(offset + TURN * at / angles) for at in (k, min(k + 40, angles) - 1))
            yield Packet(first % TURN, last % TURN, (4000,) * (min(k + 40, angles) - k))


@pytest.mark.parametrize("offset", [0, 3 * 64, -3 * 64])
@pytest.mark.parametrize("lost", [[], [57], [57, 58], [56, 57], [57, 76], [65, 66]])
def test_a_turn_whose_ring_start_is_lost_ends_at_north(offset, lost):
    """The others end at their ring starts, which may be a little before or behind north."""
    turns = Turns()
    found = [turns.receive(packet) for at, packet in enumerate(packets_of_turns(6, offset)) if at not in lost]
    sizes = [len(turn) for turn in found if turn is not None]
    assert len(sizes) == 5
    assert sizes == pytest.approx([720] * 5, abs=40 + 40 * len(lost))


def test_samples_without_a_ring_start_are_no_turn():
    start, other = Packet(0, 0, (4000,), is_ring_start=True), Packet(64, 128, (4000,) * 40)
    turns = Turns()
    turns.receive(start)
    for _ in range(MAX_TURN_SAMPLES // 40 + 1):
        turns.receive(other)
    assert turns.receive(start) is None
    assert turns.receive(start) == start.points()


def test_what_no_device_says_is_not_taken():
    good = Packet(0, 64, (4000, 4000)).encode()
    for at in range(len(good)):
        assert received(good[:at] + bytes([good[at] ^ 0x10]) + good[at + 1 :]) == [], at
    for first_or_last in (4, 6):
        cleared = bytearray(good)
        cleared[first_or_last] ^= 1  # and the checksum with it
        cleared[8] ^= 1
        assert received(bytes(cleared)) == []
    assert received(Packet(0, 64, (0,) * 81).encode()) == []
    assert received(Health(3).encode()) == []
    assert received(DeviceInfo(6, (1, 5), 1, "0" * 15).encode() + b"\x0a") == []


def test_packets_among_what_is_not_expected_are_found():
    packet = Packet(0, 64, (4000, 4000))
    sent = packet.encode()
    time_stamp = bytes.fromhex("aa66f311aa550028")
    cut_answer = DeviceInfo(6, (1, 5), 1, "0" * 16).encode()[:9]
    for other in (time_stamp, cut_answer, b"\xaa", b"\xaa\x55", sent[:-1]):
        decoder = ydlidar.decoder()
        assert decoder.receive(sent + other + sent) == [packet, packet]
        assert decoder.counts.lost == len(other)
