"""The Teraranger Hub Multiflex: distances in binary and text, commands and acknowledgements."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mercator_design.robot.protocols import multiflex
from mercator_design.robot.protocols.multiflex import BINARY_MODE, NOTHING, TEXT_MODE, Acknowledgement, Distances, crc8

FIXED = settings(derandomize=True)
MILLIMETRES = st.lists(st.integers(0, 0xFFFF), min_size=8, max_size=8).map(tuple)


def received(*sent):
    return multiflex.decoder().receive(b"".join(sent))


def test_the_check_value_of_the_crc():
    assert crc8(b"123456789") == 0xF4


@FIXED
@given(MILLIMETRES, st.integers(0, 0xFF))
def test_distances_arrive_as_they_were_sent(millimetres, mask):
    distances = Distances(millimetres, mask)
    assert received(distances.encode()) == [distances]
    assert received(distances.encode_text()) == [Distances(millimetres)]


@pytest.mark.parametrize("ok", [True, False])
def test_acknowledgements_arrive_as_they_were_sent(ok):
    acknowledgement = Acknowledgement(0x52, ok)
    assert received(acknowledgement.encode()) == [acknowledgement]


@pytest.mark.parametrize("command", [TEXT_MODE, BINARY_MODE, *map(multiflex.use_sensors, (0, 1, 0x52, 0xFF))])
def test_commands_arrive_as_they_were_sent(command):
    assert multiflex.command_decoder().receive(b"\0" + command.encode()) == [command]


def test_what_a_distance_means():
    distances = Distances((0, 49, 50, 2000, 2001, 0x7FFF, 0x8000, NOTHING))
    near, far = -math.inf, math.inf
    assert distances.metres() == [near, near, 0.05, 2.0, far, far, near, far]
    used = Distances((100,) * 8, 0b00000101).metres()
    assert [i for i, metres in enumerate(used) if not math.isnan(metres)] == [0, 2]


def test_one_wrong_bit_is_noticed():
    for sent in (Distances(tuple(range(100, 900, 100))).encode(), Acknowledgement(0x11, ok=True).encode()):
        for bit in range(8 * len(sent)):
            wrong = bytearray(sent)
            wrong[bit // 8] ^= 1 << bit % 8
            assert received(bytes(wrong)) == [], bit


def test_every_line_of_text_is_read_as_text():
    """One in 256 begins with what would be a binary frame with the right CRC."""
    lines = [Distances((mm, 1000 + mm, 77, 5, 640, 1999, NOTHING, 8)) for mm in range(100, 2000)]
    assert any(crc8(line.encode_text()[:20]) == 0 for line in lines)
    assert received(*(line.encode_text() for line in lines)) == lines


@pytest.mark.parametrize("number", [b"65536", b"-2", b"123456", b"", b"1.5"])
def test_a_text_with_another_number_is_not_taken(number):
    good = Distances(tuple(range(100, 900, 100)))
    line = good.encode_text()
    assert received(line.replace(b"\t300", b"\t" + number)) == []
    assert received(line.replace(b"\t300", b"\t" + number), line) == [good]


def test_an_acknowledgement_is_yes_or_no():
    body = b"RE\x11\x01"
    assert received(body + bytes([crc8(body)])) == []
