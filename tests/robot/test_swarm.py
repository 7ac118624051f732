"""Heartbeats that count, and those that do not: forged, recorded, delayed, of another key or run."""

import random

import pytest

from mercator_design.robot.devices.settings import Settings, SwarmSettings
from mercator_design.robot.run.network import ASK, HEARTBEAT, SIGN, SIGNED, STOP, Heartbeats, signature

KEY, LASTS = "a key that nobody guesses", 2.0


@pytest.fixture
def robot():
    return Heartbeats(KEY, LASTS)


def signed(robot, now, key=KEY):
    """What a holder of a key says to what the robot seals at a time."""
    answer = robot.take(ASK, now)
    assert answer.startswith(SIGN)
    sealed = answer.removeprefix(SIGN)
    return SIGNED + sealed + b" " + signature(key, sealed)


def test_who_has_the_key_is_heard_as_of_when_it_was_asked(robot):
    """By the robot's clock alone, whatever that says; the sender has none."""
    for start in (0.0, 5.0, 1e8):
        fresh = Heartbeats(KEY, LASTS)
        beat = signed(fresh, start)
        assert fresh.heard is None
        assert fresh.take(beat, start + 0.3) is None
        assert (fresh.heard, fresh.refused) == (start, 0)


def test_without_a_key_all_heartbeats_count():
    robot = Heartbeats(None, LASTS)
    assert robot.take(HEARTBEAT, 1.0) is None
    assert robot.heard == 1.0
    assert robot.take(ASK, 2.0) is None
    assert (robot.heard, robot.refused) == (2.0, 0)


@pytest.mark.parametrize(
    ("make", "why"),
    [
        (lambda _: HEARTBEAT, "it is not signed"),
        (lambda robot: signed(robot, 10.0, "another key that was guessed"), "its signature is wrong"),
        (lambda _: signed(Heartbeats(KEY, LASTS), 10.0), "it is of another run"),
        (lambda robot: signed(robot, 10.0 - LASTS - 0.1), "it is too old"),
        (lambda _: SIGNED, "its signature is wrong"),
        (lambda robot: signed(robot, 10.0)[:-1], "its signature is wrong"),
        (lambda robot: signed(robot, 10.0) + b"\n", "its signature is wrong"),
        (lambda robot: signed(robot, 10.0).replace(b" 10.", b" 99."), "its signature is wrong"),
    ],
)
def test_what_does_not_count_is_counted(robot, make, why):
    message = make(robot)
    assert robot.take(message, 10.1) is None
    assert (robot.heard, robot.refused, robot.why) == (None, 1, why)


def test_what_is_said_again_does_not_count_again(robot):
    """Nor does it if the robot hears it later than others, or what was kept from it for a while first."""
    first, second, third = (signed(robot, now) for now in (10.0, 10.1, 10.2))
    robot.take(second, 10.2)
    robot.take(first, 10.3)
    assert (robot.heard, robot.refused) == (10.1, 0)
    for message in (first, second):
        robot.take(message, 10.4)
    assert (robot.heard, robot.refused, robot.why) == (10.1, 2, "it came before")
    robot.take(third, 12.1)  # held back, it tells of then, not of now
    assert robot.heard == 10.2
    for message in (first, second, third):
        robot.take(message, 13.0)
    assert (robot.heard, robot.refused, robot.why) == (10.2, 5, "it is too old")


def test_nobody_has_anything_signed_for_later(robot):
    """Who makes a holder of the key sign what no robot has sealed has nothing of it."""
    sealed = robot.take(ASK, 10.0).removeprefix(SIGN)
    later = b"7 3600.000000 " + sealed.rpartition(b" ")[2]
    robot.take(SIGNED + later + b" " + signature(KEY, later), 3600.0)
    assert (robot.heard, robot.why) == (None, "it is of another run")


def test_any_bytes_are_taken(robot):
    draws, beat = random.Random(3), signed(robot, 10.0)
    for _ in range(3000):
        message = bytearray(beat[: draws.randrange(len(beat) + 1)])
        for _ in range(draws.randrange(1, 4)):
            place = draws.randrange(len(message) + 1)
            message[place : place + 1] = draws.randbytes(draws.randrange(3))
        if message != beat:
            robot.take(bytes(message), 10.1)
    robot.take(STOP, 10.1)
    assert robot.heard is None


def test_what_is_kept_is_not_much(robot):
    for k in range(1000):
        robot.take(signed(robot, 0.1 * k), 0.1 * k)
    assert len(robot._used) <= LASTS / 0.1 + 2


def test_a_key_is_not_shown_by_accident():
    assert KEY not in repr(Settings(swarm=SwarmSettings(key=KEY)))
