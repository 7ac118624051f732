"""Questions and their answers, which may come late."""

import socket

import pytest

from mercator_design.errors import RobotError
from mercator_design.robot import talk as talk_module
from mercator_design.robot.rvr import Device
from mercator_design.robot.rvr_messages import Error
from mercator_design.robot.talk import Talk


class Line:
    """To an RVR that has all commands, and answers as a test says."""

    device = "rvr"

    def __init__(self):
        self._here, self._there = socket.socketpair()
        self.robot, self.commands = Device(), []
        self.answer = lambda _commands: b""

    def fileno(self):
        return self._here.fileno()

    def read(self):
        return self._here.recv(4096)

    def write(self, data):
        self.commands += self.robot.receive(data)
        self._there.send(self.answer(self.commands))

    def close(self):
        self._here.close()
        self._there.close()


@pytest.fixture
def line(monkeypatch):
    monkeypatch.setattr(talk_module, "_ANSWER", 0.02)
    line = Line()
    yield line
    line.close()


@pytest.fixture
def talk(line):
    return Talk([line], lambda _event, _now: None)


def test_an_answer_to_an_earlier_try_is_one(talk, line):
    line.answer = lambda commands: line.robot.answer(commands[0].frame, percentage=87) if len(commands) == 2 else b""
    assert talk.ask("get_battery_percentage") == {"percentage": 87}


def test_an_answer_to_an_earlier_question_is_none(talk, line):
    """Such as of another slot, of which it comes when nobody waits for it any more."""
    with pytest.raises(RobotError, match="rvr: no answer"):
        talk.ask("enable_color_detection", is_enabled=True)
    first = line.commands[-1].frame
    late = line.robot.answer(first, Error.RESTRICTED)
    line.answer = lambda commands: late + line.robot.answer(commands[-1].frame)
    assert talk.ask("enable_color_detection", is_enabled=False) == {}
