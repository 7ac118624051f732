"""Questions and their answers, which may come late."""

import socket
import threading
import time

import pytest

from mercator_design.errors import RobotError
from mercator_design.robot.devices import link as link_module
from mercator_design.robot.devices import start
from mercator_design.robot.devices.link import Link
from mercator_design.robot.devices.start import wake_rvr
from mercator_design.robot.protocols.rvr import Host, RvrEnd
from mercator_design.robot.protocols.rvr_messages import Error
from tests.processes import LIMIT


class Line:
    """To an RVR that has all commands, and answers as a test says."""

    device, port = "rvr", "/dev/serial0"

    def __init__(self):
        self._here, self._there = socket.socketpair()
        self.say = self._there.send
        self.robot, self.commands = RvrEnd(), []
        self.answer = lambda _commands: b""

    def fileno(self):
        return self._here.fileno()

    def read(self):
        return self._here.recv(4096)

    def write(self, data):
        self.commands += self.robot.receive(data)
        self.say(self.answer(self.commands))

    def close(self):
        self._here.close()
        self._there.close()


@pytest.fixture
def line(monkeypatch):
    monkeypatch.setattr(link_module, "ANSWER_WAIT", 0.02)
    line = Line()
    yield line
    line.close()


@pytest.fixture
def link(line):
    return Link([line])


def test_an_rvr_that_takes_time_to_wake_up(link, line, monkeypatch):
    """Asleep it refuses what it is asked."""
    monkeypatch.setattr(start, "WAKE_WAIT", LIMIT)
    facts = {
        "get_main_application_version": {"major": 9, "minor": 1, "revision": 462},
        "get_battery_voltage_state": {"state": 1},
        "get_battery_percentage": {"percentage": 87},
    }
    awake = threading.Event()

    def wake():
        awake.set()
        line.say(line.robot.notify("did_wake"))

    waking = threading.Timer(0.1, wake)

    def answer(commands):
        asked = commands[-1]
        if asked.name == "wake":
            waking.start()
        if not awake.is_set():
            return line.robot.answer(asked.frame, Error.RESTRICTED)
        return line.robot.answer(asked.frame, **facts.get(asked.name, {}))

    line.answer = answer
    assert wake_rvr(link).words() == {"firmware_nordic": "9.1.462", "firmware_st": "9.1.462", "battery": "87 %"}
    waking.join()


def test_an_answer_to_an_earlier_try_is_one(link, line):
    line.answer = lambda commands: line.robot.answer(commands[0].frame, percentage=87) if len(commands) == 2 else b""
    assert link.ask("get_battery_percentage") == {"percentage": 87}


def test_an_answer_to_an_earlier_question_is_none(link, line):
    """Such as of another slot, of which it comes when nobody waits for it any more."""
    with pytest.raises(RobotError, match="rvr: no answer"):
        link.ask("enable_color_detection", is_enabled=True)
    first = line.commands[-1].frame
    late = line.robot.answer(first, Error.RESTRICTED)
    line.answer = lambda commands: late + line.robot.answer(commands[-1].frame)
    assert link.ask("enable_color_detection", is_enabled=False) == {}


@pytest.mark.parametrize("error", [Error.BAD_DATA_LENGTH, Error.BAD_DATA_VALUE])
def test_a_question_that_was_damaged_on_its_way_is_asked_again(link, line, error):
    answers = [error, error, Error.SUCCESS]
    line.answer = lambda commands: line.robot.answer(commands[-1].frame, answers[len(commands) - 1])
    assert link.ask("enable_color_detection", is_enabled=True) == {}
    assert len(line.commands) == 3


def test_one_that_is_refused_is_not(link, line):
    line.answer = lambda commands: line.robot.answer(commands[-1].frame, Error.RESTRICTED)
    with pytest.raises(RobotError, match="enable_color_detection was refused: restricted"):
        link.ask("enable_color_detection", is_enabled=True)
    assert len(line.commands) == 1


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (
            Error.BAD_COMMAND,
            "was refused: bad command; its firmware does not know this: update it with the app Sphero Edu",
        ),
        (
            Error.BAD_DEVICE,
            "was refused: bad device; its firmware does not know this: update it with the app Sphero Edu",
        ),
        (Error.RESTRICTED, "was refused: restricted; switch it off and on"),
    ],
)
def test_what_to_do_about_a_refusal(link, line, error, words):
    line.answer = lambda commands: line.robot.answer(commands[-1].frame, error)
    with pytest.raises(RobotError, match=words):
        link.ask("enable_color_detection", is_enabled=True)


def test_one_that_never_arrives_whole_is_given_up(link, line):
    line.answer = lambda commands: line.robot.answer(commands[-1].frame, Error.BAD_DATA_LENGTH)
    with pytest.raises(RobotError, match="enable_color_detection was refused: bad data length"):
        link.ask("enable_color_detection", is_enabled=True)
    assert len(line.commands) == 5


def test_commands_that_are_counted_are_answered_or_lost(link, line):
    errors = iter([Error.SUCCESS, Error.BAD_DATA_LENGTH, Error.RESTRICTED])
    line.answer = lambda commands: line.robot.answer(commands[-1].frame, next(errors)) if len(commands) < 4 else b""
    began = time.monotonic()
    for _ in range(4):
        link.send("rvr", link.encode_counted("drive_tank_si_units", left_velocity=0.1, right_velocity=0.1))
        link.discard()
    link.answers.check(began)
    assert (link.answers.all, link.answers.lost) == (3, 1)
    link.answers.check(time.monotonic() + 1.0)
    assert (link.answers.all, link.answers.lost) == (4, 2)


def test_only_what_was_sent_comes_back_from_a_line_that_is_joined(link, line):
    stranger = Host(seq=77).send("wake")
    line.answer = lambda _commands: stranger
    with pytest.raises(RobotError, match="no answer; is it switched on"):
        link.ask("get_battery_percentage")
    line.answer = lambda commands: commands[-1].frame.encode()
    with pytest.raises(RobotError, match="no answer; what is sent comes back"):
        link.ask("get_battery_percentage")


def test_a_line_that_is_joined_is_noticed_whatever_else_is_sent(link, line):
    """Several commands at once, and bytes to another device."""
    other = Line()
    other.device, other.answer = "lidar", lambda _commands: b""
    both = Link([line, other])
    line.answer = lambda commands: b"".join(command.frame.encode() for command in commands)
    both.send("rvr", 2 * both.encode("drive_stop"))
    both.send("lidar", b"\xa5\x65")
    both.discard()
    assert "what is sent comes back" in both.remedy("rvr")
    other.close()


def test_what_cannot_be_of_one_that_was_heard_is_not_said_of_it(link, line):
    line.answer = lambda commands: line.robot.answer(commands[-1].frame, percentage=87)
    link.ask("get_battery_percentage")
    line.answer = lambda _commands: b""
    with pytest.raises(
        RobotError, match=r"^rvr: no answer; it was heard before: has it still power, [^(]*\? \(rvr on /dev/serial0\)$"
    ):
        link.ask("get_battery_percentage")


def test_the_remedy_of_a_damaged_line_names_its_port(link):
    assert link.damage_remedy("rvr") == (
        "is its cable loose, too long, or beside one of a motor, and is this computer's UART at 115200 baud whatever "
        "its clock (enable_uart=1)? (rvr on /dev/serial0)"
    )


def test_a_few_bytes_that_make_no_sense_matter_only_where_none_does(link, line):
    noise = b"\x00\xf8\x1c"
    line.answer = lambda _commands: noise
    with pytest.raises(
        RobotError, match=r"\(15 bytes from it make no sense: another device, or another baud rate\) \(rvr on "
    ):
        link.ask("get_battery_percentage")
    line.answer = lambda commands: noise + line.robot.answer(commands[-1].frame, percentage=87)
    link.ask("get_battery_percentage")
    assert "make no sense" not in link.remedy("rvr")
    line.say(400 * noise)
    link.discard()
    assert "make no sense" in link.remedy("rvr")


def test_events_that_come_while_a_question_waits_are_not_lost(link, line):
    """They come with the next poll, in their order, the answer among them; each once."""
    line.answer = lambda commands: (
        line.robot.notify("did_wake") + line.robot.answer(commands[-1].frame) + line.robot.notify("robot_has_stopped")
    )
    began = time.monotonic()
    link.ask("enable_color_detection", is_enabled=True)
    heard = [*link.poll()]
    assert [event.name for event, _ in heard] == ["did_wake", "enable_color_detection", "robot_has_stopped"]
    assert all(began <= each.time <= time.monotonic() for each in heard)
    assert [*link.poll()] == []


def test_who_stops_polling_finds_the_rest_later(link, line):
    line.say(line.robot.notify("did_wake") + line.robot.notify("robot_has_stopped"))
    assert next(link.poll()).event.name == "did_wake"
    assert [event.name for event, _ in link.poll()] == ["robot_has_stopped"]


def test_what_was_heard_before_a_port_is_lost_is_not_lost_with_it(link, line):
    """In one look at all ports."""
    other = Line()
    other.device, other.read = "lidar", lambda: (_ for _ in ()).throw(RobotError("lidar: the port is lost"))
    both = Link([line, other])
    line.say(line.robot.notify("did_wake"))
    other.say(b"x")
    with pytest.raises(RobotError, match="lidar: the port is lost"):
        next(both.poll())
    assert [event.name for event, _ in both.poll()] == ["did_wake"]
    other.close()


def test_events_that_wait_are_yielded_before_poll_waits_for_others(link, line, monkeypatch):
    line.answer = lambda commands: line.robot.answer(commands[-1].frame)
    link.ask("enable_color_detection", is_enabled=True)
    timeouts, select = [], link_module.select.select

    def noted(reading, writing, failing, timeout):
        timeouts.append(timeout)
        return select(reading, writing, failing, 0.0)

    monkeypatch.setattr(link_module.select, "select", noted)
    assert next(link.poll(time.monotonic() + 60.0)).event.name == "enable_color_detection"
    assert timeouts == [0.0]
