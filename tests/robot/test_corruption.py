"""Decoders of damaged and split bytes: the same events however they are split, and never long without."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mercator_design.robot.protocols import rvr
from tests.robot.lines import LINES
from tests.tiers import cases

FIXED = settings(derandomize=True)
BEFORE, AFTER, LOST = 2, 4, 2
"""Frames of a stream that may be damaged; those behind; how many of these may be lost."""


def received(line, *chunks):
    decoder = line.decoder()
    return [event for chunk in chunks for event in decoder.receive(chunk)]


@st.composite
def streams(draw):
    """Frames, garbage and beginnings of frames, and where they are split."""
    line = LINES[draw(st.sampled_from(sorted(LINES)))]
    frame = st.sampled_from(line.frames)
    cut = st.tuples(frame, st.integers(0, 60)).map(lambda pair: pair[0][: pair[1]])
    data = b"".join(draw(st.lists(frame | cut | st.binary(max_size=20) | st.just(line.begins), max_size=8)))
    cuts = sorted(draw(st.lists(st.integers(0, len(data)), max_size=10)))
    return line, data, [data[a:b] for a, b in zip([0, *cuts], [*cuts, len(data)], strict=True)]


@FIXED
@given(streams())
def test_events_do_not_depend_on_how_bytes_are_split(stream):
    line, data, chunks = stream
    whole, split = line.decoder(), line.decoder()
    assert whole.receive(data) == [event for chunk in chunks for event in split.receive(chunk)]
    assert whole.counts == split.counts


@FIXED
@given(st.sampled_from(sorted(LINES)), st.binary(max_size=2000))
def test_any_bytes_are_taken(name, data):
    line = LINES[name]
    received(line, data, *line.frames)
    for end in (rvr.Host(), rvr.RvrEnd()):
        end.receive(data + line.begins + data)


@pytest.mark.parametrize("name", LINES)
def test_frames_arrive_as_they_were_sent(name):
    line = LINES[name]
    decoder = line.decoder()
    events = decoder.receive(b"".join(line.frames))
    assert len(events) == len(line.frames)
    assert [event for frame in line.frames for event in received(line, frame)] == events
    assert decoder.counts.lost == 0


@pytest.mark.parametrize("name", LINES)
@pytest.mark.parametrize("size", [1, 7, 4096])
def test_nothing_is_kept_for_ever(name, size):
    line, draws = LINES[name], random.Random(5)
    for data in (draws.randbytes(4096), line.begins * 1024, line.frames[-1][:-1] * 200):
        decoder = line.decoder()
        for i in range(0, len(data), size):
            decoder.receive(data[i : i + size])
            assert len(decoder._kept) < line.longest


@pytest.mark.parametrize("name", LINES)
def test_bytes_of_no_frame_are_counted(name):
    line = LINES[name]
    decoder = line.decoder()
    frame = line.frames[-1]
    assert decoder.receive(b"\x01\x02\x03" + frame + b"\x04\x05" + frame + b"\x06") != []
    assert decoder.counts.lost == 6
    assert decoder.counts == (6 + 2 * len(frame), 6, 0)


@pytest.mark.parametrize("name", [name for name in LINES if name.endswith("to the computer")])
def test_frames_that_are_refused_are_counted(name):
    """Each once, whose checksum is wrong; a frame of which the beginning is gone is lost bytes only."""
    line = LINES[name]
    decoder = line.decoder()
    frame = max((f for f in line.frames if b"MF" not in f[1:]), key=len)  # what begins as a frame counts as one
    wrong = frame[:-2] + bytes([frame[-2] ^ 1]) + frame[-1:]
    events = decoder.receive(frame + wrong + frame + frame[1:] + wrong + frame)
    assert len(events) == 3
    assert decoder.counts == (6 * len(frame) - 1, 3 * len(frame) - 1, 2)


def damaged(data, draws):
    """These bytes with a few flipped bits, or some lost, put in, doubled, or sent again."""
    at = draws.randrange(len(data))
    end = at + draws.choice((1, 1, 2, 3, draws.randrange(1, 80)))
    match draws.randrange(6):
        case 0:
            return data[:at] + bytes([data[at] ^ 1 << draws.randrange(8)]) + data[at + 1 :]
        case 1:
            return data[:at] + draws.randbytes(len(data[at:end])) + data[end:]
        case 2:
            return data[:at] + data[end:]
        case 3:
            return data[:at] + draws.randbytes(end - at) + data[at:]
        case 4:
            return data[:end] + data[at:]
        case _:
            return data[:at] + bytes(end - at) + data[end:]


def corrupt(name, n, seed):
    """Damage a stream of a line, half of them behind one that was cut, n times: no more than LOST frames are lost."""
    line, draws = LINES[name], random.Random(f"{seed} {name}")
    events = {frame: received(line, frame) for frame in line.frames}
    for number in range(n):
        frames = draws.choices(line.frames, k=BEFORE + AFTER)
        data = damaged(b"".join(frames[:BEFORE]), draws) + b"".join(frames[BEFORE:])
        safe = [event for frame in frames[BEFORE + LOST :] for event in events[frame]]
        cut = data[: draws.randrange(len(data))] if number % 2 else b""
        assert received(line, cut, data)[-len(safe) :] == safe, (cut.hex(), data.hex())


@pytest.mark.parametrize("name", LINES)
def test_two_frames_behind_any_damage_nothing_is_lost(name):
    corrupt(name, 5000 // len(LINES), seed=1)


@pytest.mark.thorough
@pytest.mark.parametrize("name", LINES)
def test_two_frames_behind_any_of_many_damages_nothing_is_lost(name):
    corrupt(name, len(cases(100_000)) // len(LINES), seed=2)
