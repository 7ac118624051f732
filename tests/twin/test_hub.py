"""The twin's Multiflex: modes, sensors in use, acknowledgements, and how often it measures."""

import math

import pytest

from mercator_design.robot.protocols.multiflex import (
    BINARY_MODE,
    NOTHING,
    TEXT_MODE,
    Acknowledgement,
    Distances,
    HubCommand,
    decoder,
    use_sensors,
)
from mercator_design.twin.devices.hub import TwinHub

AROUND = [0.5, 1.2345, 2.0, 2.1, math.inf, -math.inf, 0.05, 0.04]
MILLIMETRES = (500, 1234, 2000, NOTHING, NOTHING, 0, 50, 40)


class Talk:
    def __init__(self):
        self.hub, self.decoder, self.now = TwinHub(lambda: AROUND), decoder(), 0.0
        self.wait(0.01)

    def send(self, *commands):
        data = b"".join(command.encode() for command in commands)
        return self.decoder.receive(self.hub.receive(data, self.now))

    def wait(self, seconds):
        said = b""
        for _ in range(round(seconds / 0.01)):
            self.now = round(self.now + 0.01, 6)
            said += self.hub.advance(self.now)
        self.said = said
        return self.decoder.receive(said)


@pytest.fixture
def talk():
    return Talk()


def test_it_measures_from_the_start_six_times_a_second(talk):
    frames = talk.wait(10.0)
    assert len(frames) == 62
    assert set(frames) == {Distances(MILLIMETRES)}
    assert frames[0].metres() == [0.5, 1.234, 2.0, math.inf, math.inf, -math.inf, 0.05, -math.inf]


def test_fewer_sensors_are_quicker(talk):
    assert talk.send(use_sensors(0x0F)) == [Acknowledgement(0x52, ok=True)]
    frames = talk.wait(1.2)[1:]
    assert len(frames) == pytest.approx(12, abs=1)
    assert set(frames) == {Distances((*MILLIMETRES[:4], *4 * [NOTHING]), 0x0F)}
    talk.hub.plugged_in = 0xF6
    assert set(talk.wait(0.5)[1:]) == {Distances((NOTHING, *MILLIMETRES[1:3], *5 * [NOTHING]), 0x06)}
    talk.send(use_sensors(0))
    assert set(talk.wait(0.2)) == {Distances((NOTHING,) * 8, 0)}


def test_text(talk):
    assert talk.send(TEXT_MODE) == [Acknowledgement(0x11, ok=True)]
    frames = talk.wait(1.0)
    assert talk.said.startswith(b"MF\t500\t1234\t2000\t-1\t-1\t0\t50\t40\r\n")
    assert set(frames) == {Distances(MILLIMETRES)}
    assert talk.send(BINARY_MODE) == [Acknowledgement(0x11, ok=True)]
    talk.wait(1.0)
    assert talk.said[:2] == b"MF"
    assert len(talk.said) % 20 == 0


@pytest.mark.parametrize(
    "command", [HubCommand(0x11, b"\x03"), HubCommand(0x52, b"\x04\xff"), HubCommand(0x21, b"\x01")]
)
def test_what_it_does_not_do_it_refuses(talk, command):
    assert talk.send(command) == [Acknowledgement(command.code, ok=False)]
    assert set(talk.wait(1.0)) == {Distances(MILLIMETRES)}


def test_the_makers_driver_starts_it():
    """Both commands at once, without waiting for the first answer."""
    talk = Talk()
    assert talk.send(BINARY_MODE, use_sensors(0xFF)) == [
        Acknowledgement(0x11, ok=True),
        Acknowledgement(0x52, ok=True),
    ]
    assert len(talk.wait(1.0)) == 6
