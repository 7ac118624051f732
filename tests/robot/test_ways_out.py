"""Every way out of a run, from the fault to wheels at rest, as the robot hears it over its serial line.

`mercator-robot run` runs in this process, in simulated time. test_ways_out_live.py has a process and real time for each
mechanism: a silent device, a lost port, a signal, a stall, the death of the process, the network, the disk.
"""

import math
import os
import signal
import sys
import time

import pytest

from mercator_design.fsm import ReferenceModel, drive
from mercator_design.robot.devices.health import ANSWER_LIMIT, ANSWERS_WINDOW, WINDOW
from mercator_design.robot.devices.settings import COMMANDS_END, Limits
from mercator_design.robot.run.mercator import QUERY_EVERY, Mercator
from mercator_design.robot.run.safety import SIGNALS, STALL
from mercator_design.software import Controller
from mercator_design.software.digest import control_digest
from tests.robot.log_events import read
from tests.robot.ways import ALL, GO, LAST, LATEST, asked, check

CYCLE = 0.1
"""[s]"""


def silence(*names):
    return lambda robot: robot.devices.silent.update(names)


def tells(name, **values):
    return lambda robot: robot.devices.tell(name, **values)


def noise(line):
    return lambda robot: robot.devices.noisy.add(line)


def refuses(robot):
    robot.devices.instead["drive_tank_si_units"] = {"error": 4}


def unplugs(line):
    return lambda robot: robot.devices.unplugged.add(line)


def is_deaf(robot):
    robot.devices.deaf.add("rvr")


DEVICE_FAULTS = {
    # what happens: how, seconds that it may go on, what is said
    "ground silent": (silence("color_detection"), 0.25, "ground: nothing for"),
    "attitude silent": (silence("imu"), 0.25, "attitude: nothing for"),
    "rvr silent": (silence("rvr"), 0.25, "nothing for"),
    "hub silent": (silence("proximity"), 0.5, "proximity: nothing for"),
    "lidar silent": (silence("lidar"), 0.6, "lidar: nothing for"),
    "hub's sensor off": (lambda robot: setattr(robot.devices.hub, "plugged_in", 0x7F), 0.5, "proximity: nothing for"),
    "lidar blind": (
        lambda robot: setattr(robot.devices, "wall", 0.0),
        Limits().lidar_blind + CYCLE,
        "lidar: it saw nothing in 5.0 of the last 10 s; the limit is 5 s; is there nothing at its height",
    ),
    "lidar stuck": (lambda robot: setattr(robot.devices, "is_stuck", True), 0.6, "lidar: nothing for"),
    "lidar damaged": (lambda robot: robot.devices.torn.add("lidar"), WINDOW, "% of what the lidar sends arrives whole"),
    "rvr noisy": (noise("rvr"), WINDOW, "% of what the rvr sends arrives whole; the limit is 80 %"),
    "hub noisy": (noise("proximity"), WINDOW, "% of what the proximity sends arrives whole; the limit is 50 %"),
    "hub lost": (unplugs("proximity"), 0.0, "/proximity is lost: "),
    "lidar lost": (unplugs("lidar"), 0.0, "/lidar is lost: "),
    "battery critical": (lambda robot: setattr(robot.devices.rvr, "level", 5.0), 0.0, "rvr: the battery is critical"),
    "battery below the limit": (
        lambda robot: robot.devices.instead.update(get_battery_percentage={"percentage": 4}),
        QUERY_EVERY + CYCLE,
        "rvr: the battery is critical (4 %); charge it",
    ),
    "tread stuck": (
        tells("motor_stall", motor_index=1, is_triggered=True),
        Limits().stall + CYCLE,
        "rvr: the right tread is stuck for 3.",
    ),
    "motor too hot": (lambda robot: robot.devices.rvr.heat({0: 75.0}), 0.0, "rvr: the left motor is too hot (75 deg"),
    "asleep": (tells("did_sleep"), 0.0, "rvr: it fell asleep"),
    "motor fault": (lambda robot: robot.devices.rvr.set_motor_fault(is_fault=True), 0.0, "rvr: a motor has a fault"),
    "motor fault whose notification is lost": (
        lambda robot: robot.devices.instead.update(get_motor_fault_state={"is_fault": True}),
        QUERY_EVERY + CYCLE,
        "rvr: a motor has a fault",
    ),
    "drive refused": (refuses, 0.1, "rvr: it does not drive: restricted"),
}


@pytest.mark.parametrize("what", DEVICE_FAULTS)
def test_devices_that_fail(what, robot):
    act, allowed, words = DEVICE_FAULTS[what]
    robot.act(act)
    robot.run(ALL)
    check(robot, 4, words)
    assert robot.late() - allowed <= LATEST


@pytest.mark.parametrize("what", ["hub silent", "rvr noisy", "tread stuck"])
def test_a_run_without_a_device_is_stopped_as_any_other(what, robot):
    act, allowed, words = DEVICE_FAULTS[what]
    robot.act(act)
    robot.run(GO, "--without", "lidar")
    check(robot, 4, words)
    assert robot.late() - allowed <= LATEST


@pytest.mark.parametrize("options", [(), ("--without", "lidar")])
def test_an_rvr_that_hears_badly(options, robot):
    """A command stops it, or it stops by itself if it has not heard the last three."""
    robot.act(lambda robot: robot.devices.misheard.add("rvr"))
    robot.run(GO, *options)
    check(robot, 4, "% of the commands to it are answered; the limit is 80 %; is its cable loose")
    assert robot.devices.rests_since() - robot.began <= ANSWERS_WINDOW + ANSWER_LIMIT + LATEST


def test_an_rvr_that_hears_nothing_has_stopped_by_itself_and_ends_the_run(robot):
    robot.act(is_deaf)
    robot.run()
    check(robot, 4, "of the commands to it are answered; the limit is 80 %; is its cable loose,", zeros=False)
    assert robot.devices.rests_since() - robot.began <= COMMANDS_END
    *_, last, _, _ = cycles(robot)
    assert last["time"] - (robot.began - robot.devices.wheels[1][0]) < 1.6


def cycles(robot):
    return [event for event in read(robot.folder / "log.jsonl") if event["event"] == "cycle"]


def notes(robot):
    return [event["text"] for event in read(robot.folder / "log.jsonl") if event["event"] == "note"]


def test_a_command_that_was_damaged_on_its_way_is_repeated_and_the_run_goes_on(robot):
    robot.act(lambda robot: robot.devices.once.update(drive_tank_si_units={"error": 5}))
    robot.run(GO, "--duration", "1.5")
    check(robot, 0, "The duration is over")
    lines = [cycle["lines"]["rvr"] for cycle in cycles(robot)]
    assert [lines[0][-1], lines[-1][-1]] == [0, 1]  # repeated
    assert lines[-1][-2] - lines[0][-2] == 1  # without a sound answer
    assert lines[-1][-3] > 10
    assert notes(robot).count("drive_tank_si_units was refused: bad data length") == 1


@pytest.mark.parametrize("number", SIGNALS)
def test_signals(number, robot):
    robot.act(lambda _: os.kill(os.getpid(), number))
    robot.run()
    check(robot, 128 + number, f"Stopped by {number.name}.")
    assert robot.late() <= 2.0 * robot.devices.period


def leave():
    sys.exit(7)


CONTROLLER_FAULTS = {
    "exit": (leave, 7, ""),
    "not a number": (
        lambda: drive(math.nan, 1.0),
        4,
        "wheels: expected speeds from -0.3 to 0.3 m/s, found nan, 0.3",
    ),
    "infinite": (lambda: drive(0.0, -math.inf), 4, "found 0, -inf"),
    "too fast": (lambda: drive(1.0, 1.01), 4, "found 0.3, 0.303"),
}


def decide(monkeypatch, robot, decides):
    """Let something else decide once the robot has driven for some cycles."""
    step = Controller.step

    def faulty(controller, readings, draws):
        if not robot.drives():
            return step(controller, readings, draws)
        robot.began = time.monotonic()
        return decides()

    monkeypatch.setattr(Controller, "step", faulty)


@pytest.mark.parametrize("what", CONTROLLER_FAULTS)
def test_controllers_that_fail(what, robot, monkeypatch):
    decides, code, words = CONTROLLER_FAULTS[what]
    decide(monkeypatch, robot, decides)
    robot.run()
    check(robot, code, words)
    assert robot.late() <= 2.0 * robot.devices.period


def test_a_robot_that_does_not_obey_in_the_end_is_reported(robot):
    """The duration is over, and the RVR has stopped, if it has, because it hears nothing."""
    robot.act(is_deaf)
    robot.run(GO, "--duration", "1")
    error = check(robot, 1, "Error: RVR stop not confirmed: rvr: no answer;", zeros=False)
    *_, note, end = read(robot.folder / "log.jsonl")
    assert note["text"] in error
    assert end["why"] == "The duration is over"


def test_whatever_ended_the_run_a_robot_that_does_not_obey_is_reported(robot):
    robot.act(is_deaf)
    robot.act(lambda _: os.kill(os.getpid(), signal.SIGTERM))
    robot.run()
    check(robot, 143, "Stopped by SIGTERM.; RVR stop not confirmed: rvr: no answer;", zeros=False)


def introducing(monkeypatch, then):
    """Somebody is told what robot it is, and then something happens."""
    introduce = Mercator.introduce
    monkeypatch.setattr(Mercator, "introduce", lambda robot, report: (introduce(robot, report), then()))


@pytest.mark.parametrize("seconds", [0.0, 0.15, 0.2, 0.5])
def test_who_was_held_up_before_the_drive_looks_anew(seconds, robot, monkeypatch):
    """By somebody who was told something, and took his time."""
    introducing(monkeypatch, lambda: time.sleep(seconds))
    robot.run(GO, "--duration", "0.5")
    check(robot, 0, "The duration is over")
    assert any(note.startswith("held up for ") for note in notes(robot)) == (seconds > STALL)


def test_who_was_held_up_and_then_hears_nothing_does_not_drive(robot, monkeypatch):
    """A device fell silent meanwhile: what it told before is too old."""
    introducing(monkeypatch, lambda: (robot.devices.silent.add("proximity"), time.sleep(0.5)))
    robot.run()
    check(robot, 1, "proximity: nothing yet; it was heard before")
    assert not robot.devices.drives()


def test_the_rvr_lost(robot):
    """Nothing can be told to a robot whose line is cut, but it stops by itself."""
    robot.act(unplugs("rvr"))
    robot.run()
    check(robot, 4, "/rvr is lost: ", zeros=False)
    robot.devices.come_to_rest()
    assert robot.devices.rests_since() - robot.began <= COMMANDS_END


def test_the_end_of_the_duration(robot):
    robot.run(GO, "--duration", "1")
    check(robot, 0, "The duration is over")
    driven = [when for when, left, _ in robot.devices.wheels if left]
    assert robot.devices.rests_since() - driven[0] == pytest.approx(1.0, abs=2.0 * robot.devices.period)
    names = [name for _, name, _ in robot.devices.commands]
    stopped = len(names) - 1 - names[::-1].index("stop_streaming_service") - 1
    assert names[stopped : stopped + 6] == [
        *["stop_streaming_service"] * 2,
        *["clear_streaming_service"] * 2,
        "enable_color_detection",
        "release_led_requests",
    ]
    assert names[stopped - 4 : stopped] == ["drive_tank_si_units", "drive_stop"] * 2
    assert set(names[stopped + 6 : -2]) == {"drive_stop"}
    assert names[-2:] == ["restore_default_control_system_timeout", LAST]
    assert robot.devices.lidar_commands[-2:] == ["force_stop", "stop"]


def test_a_run_is_as_the_pfsm_was_raced(robot):
    header = {
        "control period": "0.05",
        "maximum speed": "0.1",
        "reference model": '{"neighbour_range": 0.5}',
        "control software": "another",
    }
    fsm = "".join(f"# {key}: {value}\n" for key, value in header.items()) + GO
    robot.run(fsm, "--duration", "1")
    check(robot, 0, "Warning: the PFSM was designed with another version")
    assert max(left for _, left, _ in robot.devices.wheels) == pytest.approx(0.1)
    start, *_ = read(robot.folder / "log.jsonl")
    assert len(cycles(robot)) == 20
    assert (start["control_period"], start["control_software"]) == (0.05, control_digest())
    assert start["reference_model"] == ReferenceModel(neighbour_range=0.5)._asdict()


def test_a_run_without_a_device_that_is_broken(robot):
    """Neither its port is needed nor what it would say; all that stops another run stops this one."""
    robot.devices.unplugged.add("lidar")
    robot.act(tells("motor_fault", is_fault=True))
    robot.run(GO, "--without", "lidar")
    error = check(robot, 4, "rvr: a motor has a fault")
    assert error.startswith("Without lidar: it is not used, and its readings are neutral.\n")
    assert robot.devices.lidar_commands == []
    start, *_ = read(robot.folder / "log.jsonl")
    first, *_ = cycles(robot)
    assert (start["without"], start["facts"].get("lidar")) == (["lidar"], None)
    assert first["lines"].keys() == {"rvr", "proximity"}
    assert (first["readings"][2:5], first["neighbours"]) == ([0.0] * 3, [])


def test_a_run_with_the_rvr_alone(robot):
    robot.devices.unplugged |= {"lidar", "proximity"}
    without = ("--without", "lidar", "--without", "proximity", "--without", "lidar")
    robot.run("--nstates 1 --s0 1", "--duration", "0.5", *without)
    assert check(robot, 0, "The duration is over").count("Without") == 2
    start, *_ = read(robot.folder / "log.jsonl")
    cycle, *_ = cycles(robot)
    assert start["without"] == ["lidar", "proximity"]
    assert (cycle["lines"].keys(), cycle["readings"][:5]) == ({"rvr"}, [0.0] * 5)


@pytest.mark.parametrize("device", ["lidar", "proximity"])
def test_no_run_goes_without_what_it_reads(robot, device):
    robot.run(ALL, "--without", device)
    returned, error = robot.ended()
    assert (returned, f"--without {device}: the PFSM reads " in error) == (2, True), error
    assert robot.devices.commands == []
    assert not (robot.folder / "log.jsonl").exists()


def test_a_dry_run_never_turns_the_wheels(robot):
    robot.run(GO, "--duration", "1", "--dry-run")
    said = check(robot, 0, "The duration is over").splitlines()
    assert (said[0], said[-1]) == ("Dry run: the wheels do not turn.", "The log is log.jsonl")
    assert not robot.devices.drives()
    assert cycles(robot)[0]["wheels"] == [1.0, 1.0]


def test_a_dry_run_is_stopped_by_what_would_stop_another(robot, monkeypatch):
    monkeypatch.setattr(Controller, "step", lambda *_: drive(math.nan, 1.0))
    robot.run(GO, "--dry-run")
    said = check(robot, 4, "wheels: expected speeds from -0.3 to 0.3 m/s, found nan, 0.3")
    assert "The log is log.jsonl\n" in said


class TestWhatStoppedIt:
    """It is in the log."""

    def test_what_a_device_told(self, robot):
        robot.act(tells("motor_fault", is_fault=True))
        robot.run()
        check(robot, 4, "rvr: a motor has a fault")
        *_, told, end = read(robot.folder / "log.jsonl")
        assert (told["event"], told["text"]) == ("note", "rvr: motor fault is fault True")
        assert end["why"] == "rvr: a motor has a fault"
        assert told["time"] > 0.0

    def test_what_was_decided(self, robot, monkeypatch, robot_command):
        with monkeypatch.context() as patched:
            decide(patched, robot, lambda: drive(math.nan, -1.01))
            robot.run()
        check(robot, 4, "found nan, -0.303")
        *_, cycle, _ = read(robot.folder / "log.jsonl")
        assert (cycle["event"], cycle["wheels"]) == ("cycle", [None, -1.01])
        code, out, err = robot_command("replay", "log.jsonl")
        assert (code, "None, -1.01); 1 of" in err) == (1, True)
        assert len(out.splitlines()) == cycle["cycle"] + 1


def test_a_log_that_exists_keeps_the_robot_from_starting(robot):
    (robot.folder / "log.jsonl").write_text("of another run")
    robot.run()
    returned, error = robot.ended()
    assert (returned, "log.jsonl: cannot be written: File exists" in error) == (1, True), error
    assert (robot.devices.commands, robot.devices.lidar_commands) == ([], [])
    assert (robot.folder / "log.jsonl").read_text() == "of another run"


def test_the_battery_is_asked_after(robot):
    robot.run(GO, "--duration", "5")
    check(robot, 0, "The duration is over")
    assert asked(robot.devices) == pytest.approx(5.0 / QUERY_EVERY, abs=1)


def test_a_hub_that_refuses_commands_and_sends_distances(robot):
    robot.devices.hub.is_old = True
    robot.run(ALL, "--duration", "0.5")
    error = check(robot, 0, "The duration is over")
    assert "Warning: proximity: it refuses command 0x52 as bad: is its firmware too old? Update it\n" in error
