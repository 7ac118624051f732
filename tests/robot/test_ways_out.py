"""Every way out of a run, from the fault to wheels at rest, as the robot hears it over its serial line.

`mercator-robot run` is a process of its own; clocks are the same in all processes.
"""

import os
import signal
import socket
import threading
import time
from contextlib import contextmanager, suppress

import pytest

from mercator_design.fsm import ReferenceModel
from mercator_design.fsm.digest import control_digest
from mercator_design.robot.devices.health import ANSWERS_WINDOW, IN_TIME, WINDOW
from mercator_design.robot.devices.settings import Limits
from mercator_design.robot.run.mercator import COMMANDS_END, QUERY_EVERY
from mercator_design.robot.run.network import ASK, HEARTBEAT, SIGN, SIGNED, STOP, Speaker, signature
from tests.robot.log_events import read
from tests.robot.ways import (
    ALL,
    ATTEMPTS,
    GO,
    IMPATIENT,
    LAST,
    LATEST,
    OFTEN,
    SLOW,
    SOON,
    asked,
    made_in_time,
    running,
    soonest,
)

CYCLE = 0.1
"""[s]"""
KEY = "a key that nobody guesses"


class Forger(socket.socket):
    """Somebody in the network of a robot, without its key."""

    def __init__(self, port):
        super().__init__(socket.AF_INET, socket.SOCK_DGRAM)
        self.connect(("127.0.0.1", port))
        self.settimeout(5.0)

    def has_signed(self, key):
        """What was recorded of somebody who has the key: signed, and not yet told; and told already."""
        signed = []
        for _ in range(2):
            self.send(ASK)
            sealed = self.recv(200).removeprefix(SIGN)
            signed.append(SIGNED + sealed + b" " + signature(key, sealed))
        self.send(signed[0])
        return signed

    @contextmanager
    def saying(self, messages):
        """Say these again and again."""
        over = threading.Event()

        def say():
            while not over.wait(0.02):
                for message in messages:
                    with suppress(ConnectionError):
                        self.send(message)

        thread = threading.Thread(target=say)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()


def check(robot, code, words, *, zeros=True):
    """How a run has ended."""
    returned, error = robot.ended()
    assert (returned, words in error) == (code, True), (returned, error)
    if zeros:
        stops = [name for _, name, _ in robot.devices.commands if name == "drive_stop"]
        assert len(stops) >= 2
        *_, end = read(robot.folder / "log.jsonl")
        assert end["event"] == "end"
        assert end["why"] in error
    return error


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


DEVICE_FAULTS = {
    # what happens: how, seconds that it may go on, what is said
    "ground silent": (silence("color_detection"), 0.25, "ground: nothing for"),
    "attitude silent": (silence("imu"), 0.25, "attitude: nothing for"),
    "rvr silent": (silence("rvr"), 0.25, "nothing for"),
    "hub silent": (silence("proximity"), 0.5, "proximity: nothing for"),
    "lidar silent": (silence("lidar"), 0.6, "lidar: nothing for"),
    "hub's sensor off": (lambda robot: setattr(robot.devices.hub, "plugged_in", 0x7F), 0.5, "proximity: nothing for"),
    "lidar stuck": (lambda robot: setattr(robot.devices, "is_stuck", True), 0.6, "lidar: nothing for"),
    "lidar damaged": (lambda robot: robot.devices.torn.add("lidar"), WINDOW, "% of what the lidar sends arrives whole"),
    "rvr noisy": (noise("rvr"), WINDOW, "% of what the rvr sends arrives whole; the limit is 80 %"),
    "hub noisy": (noise("proximity"), WINDOW, "% of what the proximity sends arrives whole; the limit is 50 %"),
    "rvr hears badly": (
        lambda robot: robot.devices.misheard.add("rvr"),
        ANSWERS_WINDOW + IN_TIME,
        "% of the commands to it are answered; the limit is 80 %; is its cable loose",
    ),
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
    "motor fault": (tells("motor_fault", is_fault=True), 0.0, "rvr: a motor has a fault"),
    "drive refused": (refuses, 0.1, "rvr: it does not drive: restricted"),
}


@pytest.mark.parametrize("what", DEVICE_FAULTS)
def test_devices_that_fail(what, tmp_path):
    act, allowed, words = DEVICE_FAULTS[what]

    def attempt(number):
        with running(tmp_path / str(number), ALL) as robot:
            robot.drives()
            began = time.monotonic()
            act(robot)
            check(robot, 4, words)
            return robot.devices.told_to_rest(began) - allowed

    assert soonest(attempt) <= LATEST


def test_an_rvr_that_hears_nothing_has_stopped_by_itself_and_ends_the_run(tmp_path):
    def attempt(number):
        with running(tmp_path / str(number)) as robot:
            robot.drives()
            began = time.monotonic()
            cycles = robot.cycles()
            robot.devices.deaf.add("rvr")
            check(robot, 4, "of the commands to it are answered; the limit is 80 %; is its cable loose,", zeros=False)
            assert CYCLE * (robot.cycles() - cycles) < 1.6
            return robot.devices.rests_since() - began - COMMANDS_END

    assert soonest(attempt, 0.05) <= 0.05


@made_in_time
def test_a_command_that_was_damaged_on_its_way_is_repeated_and_the_run_goes_on(tmp_path):
    with running(tmp_path, GO, "", "", "--duration", "1.5") as robot:
        robot.drives()
        robot.devices.once["drive_tank_si_units"] = {"error": 5}
        check(robot, 0, "The duration is over")
        events = [*read(tmp_path / "log.jsonl")]
        lines = [event["lines"]["rvr"] for event in events if event["event"] == "cycle"]
        assert [lines[0][-1], lines[-1][-1]] == [0, 1]  # repeated
        assert lines[-1][-2] - lines[0][-2] >= 1  # without a sound answer; the machine may be busy
        assert lines[-1][-3] > 10
        notes = [event["text"] for event in events if event["event"] == "note"]
        assert notes.count("drive_tank_si_units was refused: bad data length") == 1


@pytest.mark.parametrize("number", ["SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGTSTP"])
def test_signals(number, tmp_path):
    which = signal.Signals[number]

    def attempt(k):
        with running(tmp_path / str(k)) as robot:
            robot.drives()
            began = time.monotonic()
            robot.process.send_signal(which)
            check(robot, 128 + which, f"Stopped by {number}.")
            return robot.devices.told_to_rest(began)

    assert soonest(attempt) <= LATEST


CONTROLLER_FAULTS = {
    "exception": ("1 / 0", 1, "ZeroDivisionError"),
    "exit": ("sys.exit(7)", 7, ""),
    "not a number": ("return Wheels(math.nan, 1.0)", 4, "wheels: expected speeds from -0.3 to 0.3 m/s, found nan, 0.3"),
    "infinite": ("return Wheels(0.0, -math.inf)", 4, "found 0, -inf"),
    "too fast": ("return Wheels(1.0, 1.01)", 4, "found 0.3, 0.303"),
    "stalled": ("time.sleep(1.0)", 4, "the control loop stalled"),
    "no memory": ("raise MemoryError", 1, "Error: not enough memory"),
    "watchdog": (
        "from mercator_design.robot.run import safety; safety.Watchdog._look = None",
        4,
        "the watchdog failed",
    ),
    "busy": ("while not os.path.exists('stop'): pass", 4, "stalled"),
}


@pytest.mark.parametrize("what", CONTROLLER_FAULTS)
def test_controllers_that_fail(what, tmp_path):
    fault, code, words = CONTROLLER_FAULTS[what]

    def attempt(number):
        with running(tmp_path / str(number), fault=fault) as robot:
            robot.drives()
            began = robot.fault()
            if what == "busy":
                time.sleep(0.5)
                (robot.folder / "stop").touch()
            returned, error = robot.ended()
            assert (returned, words in error) == (code, True), (returned, error)
            return robot.devices.told_to_rest(began)

    assert soonest(attempt) <= LATEST


@made_in_time
def test_a_stalled_loop_does_not_drive_again_and_can_be_ended(tmp_path):
    with running(tmp_path, fault="time.sleep(60)") as robot:
        robot.drives()
        robot.fault()
        time.sleep(1.0)
        assert robot.process.poll() is None
        robot.process.terminate()
        check(robot, 143, "Stopped by SIGTERM.")
        assert [bool(left or right) for _, left, right in robot.devices.wheels] == [False, True, False]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_process_that_is_killed_or_suspended_is_stopped_by_the_robot(number, tmp_path):
    def attempt(k):
        with running(tmp_path / str(k)) as robot:
            robot.drives()
            began = time.monotonic()
            robot.process.send_signal(number)
            time.sleep(COMMANDS_END + 0.1)
            return robot.devices.rests_since() - began - COMMANDS_END

    assert soonest(attempt, 0.05) <= 0.05


def test_a_process_that_was_suspended_does_not_drive_again(tmp_path):
    """The robot has stopped by itself meanwhile, and wheels that rest turn again only in a new run."""
    with running(tmp_path) as robot:
        robot.drives()
        began = time.monotonic()
        robot.process.send_signal(signal.SIGSTOP)
        time.sleep(1.0)
        robot.process.send_signal(signal.SIGCONT)
        check(robot, 4, "the control loop stalled: no command for 1.")
        assert robot.devices.rests_since() - began < 1.0


@made_in_time
def test_a_robot_that_does_not_obey_in_the_end_is_told(tmp_path):
    """The duration is over, and the RVR has stopped, if it has, because it hears nothing."""
    with running(tmp_path, GO, "", "", "--duration", "1") as robot:
        robot.drives()
        robot.devices.deaf.add("rvr")
        error = check(robot, 1, "Error: RVR stop not confirmed: rvr: no answer;", zeros=False)
        *_, note, end = read(tmp_path / "log.jsonl")
        assert note["text"] in error
        assert end["why"] == "The duration is over"


@made_in_time
def test_whatever_ended_the_run_a_robot_that_does_not_obey_is_told(tmp_path):
    with running(tmp_path) as robot:
        robot.drives()
        robot.devices.deaf.add("rvr")
        robot.process.terminate()
        check(robot, 143, "Stopped by SIGTERM.; RVR stop not confirmed: rvr: no answer;", zeros=False)


@pytest.mark.parametrize("settings", ["", ", heartbeat: 2"])
@pytest.mark.parametrize("seconds", [0.0, 0.5])
def test_who_was_held_up_before_the_drive_looks_anew(settings, seconds, tmp_path):
    """By somebody who was told something, and took his time, whether there was a heartbeat to wait for or not."""
    lead = f"{SOON}introduce = mercator.Mercator.introduce\n"
    lead += "mercator.Mercator.introduce = lambda robot, tell: (introduce(robot, tell), time.sleep(SECONDS))\n"
    lead = f"import time\n{lead}".replace("SECONDS", str(seconds))

    def looks_anew(number):
        folder = tmp_path / str(number)
        with running(folder, GO, settings, lead=lead) as robot, Speaker(["127.0.0.1"], robot.port) as speaker:
            robot.devices.when(lambda: speaker.send(HEARTBEAT) or robot.devices.driven() > 2)
            notes = [event["text"] for event in read(folder / "log.jsonl") if event["event"] == "note"]
            return any(note.startswith("held up for ") for note in notes)

    if seconds:
        assert looks_anew(0)
    else:  # a busy machine may hold it up too
        assert not all(map(looks_anew, range(ATTEMPTS)))


def test_who_was_held_up_and_then_hears_nothing_does_not_drive(tmp_path):
    """A device fell silent meanwhile: what it told before is too old."""
    lead = f"{SOON}import os, time\nmercator._BEGIN = 0.5\nintroduce = mercator.Mercator.introduce\n"
    lead += (
        "held = lambda: [open('held', 'w').close(), *iter(lambda: os.path.exists('on') or time.sleep(0.05), True)]\n"
    )
    lead += "mercator.Mercator.introduce = lambda robot, tell: (introduce(robot, tell), held())\n"
    with running(tmp_path, lead=lead) as robot:
        robot.devices.when((tmp_path / "held").exists)
        robot.devices.silent.add("proximity")
        time.sleep(0.5)
        (tmp_path / "on").touch()
        check(robot, 1, "proximity: nothing yet; it was heard before")
        assert not robot.devices.drives()


STARTING = ("wake", "get_active_control_system_id", "start_streaming_service")


@pytest.mark.parametrize("command", STARTING)
def test_a_signal_during_the_start(command, tmp_path):
    with running(tmp_path, lead="") as robot:
        robot.devices.when(lambda: command in [name for _, name, _ in robot.devices.commands])
        robot.process.terminate()
        returned, error = robot.ended()
        assert (returned, error) == (143, "Stopped by SIGTERM.\n")
        assert not robot.devices.drives()
        robot.devices.when(lambda: robot.devices.commands[-1][1] == LAST)
        robot.devices.when(lambda: robot.devices.lidar_commands[-2:] == ["force_stop", "stop"])
        assert not (tmp_path / "log.jsonl").exists()


@made_in_time
def test_a_signal_during_the_end_interrupts_nothing(tmp_path):
    with running(tmp_path, lead=SOON + SLOW) as robot:
        robot.drives()
        robot.process.terminate()
        robot.devices.when(lambda: not any(robot.devices.wheels[-1][1:]))
        robot.process.send_signal(signal.SIGINT)
        check(robot, 143, "Stopped by SIGTERM.")
        robot.devices.when(lambda: robot.devices.commands[-1][1] == LAST)


def test_a_line_that_takes_nothing_any_more(tmp_path):
    """As if the robot were lost: what waits in the line does not let it drive on later."""

    def attempt(number):
        with running(tmp_path / str(number)) as robot:
            robot.drives()
            began = time.monotonic()
            with robot.devices.suspended:
                fill(robot.devices.names.rvr)
                returned, error = robot.ended()
                assert (returned, "is lost: Write timeout" in error) == (4, True), error
                time.sleep(COMMANDS_END)
            time.sleep(0.2)
            return robot.devices.rests_since() - began - COMMANDS_END

    assert soonest(attempt, 0.05) <= 0.05


def fill(port):
    """Let nothing more go into a line that nobody reads."""
    line = os.open(port, os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY)
    for _ in range(5):  # the system moves some on, and then takes more
        with suppress(BlockingIOError):
            while os.write(line, bytes(100)):
                pass
        time.sleep(0.005)
    os.close(line)


@made_in_time
def test_the_log_is_whole_but_for_its_end_when_the_process_is_killed(tmp_path):
    with running(tmp_path) as robot:
        robot.drives()
        robot.process.kill()
        robot.process.wait()
        kinds = [event["event"] for event in read(tmp_path / "log.jsonl")]
    assert kinds[0] == "start"
    assert kinds.count("cycle") >= 2


def test_the_rvr_lost(tmp_path):
    """Nothing can be told to a robot whose line is cut, but it stops by itself."""

    def attempt(number):
        with running(tmp_path / str(number)) as robot:
            robot.drives()
            began = time.monotonic()
            robot.devices.unplugged.add("rvr")
            check(robot, 4, "/rvr is lost: ", zeros=False)
            time.sleep(COMMANDS_END)
            return robot.devices.rests_since() - began - COMMANDS_END

    assert soonest(attempt, 0.05) <= 0.05


@made_in_time
def test_the_end_of_the_duration(tmp_path):
    with running(tmp_path, GO, "", "", "--duration", "1") as robot:
        check(robot, 0, "The duration is over")
        driven = [when for when, left, _ in robot.devices.wheels if left]
        assert 0.8 < robot.devices.rests_since() - driven[0] < 1.3
        names = [name for _, name, _ in robot.devices.commands]
        stopped = len(names) - 1 - names[::-1].index("clear_streaming_service") - 1
        assert names[stopped : stopped + 4] == [
            *["clear_streaming_service"] * 2,
            "enable_color_detection",
            "release_led_requests",
        ]
        assert names[stopped - 4 : stopped] == ["drive_tank_si_units", "drive_stop"] * 2
        assert set(names[stopped + 4 : -2]) == {"drive_stop"}
        assert names[-2:] == ["restore_default_control_system_timeout", LAST]
        robot.devices.when(lambda: robot.devices.lidar_commands[-2:] == ["force_stop", "stop"])


@made_in_time
def test_a_run_is_as_the_pfsm_was_raced(tmp_path):
    header = {
        "control period": "0.05",
        "maximum speed": "0.1",
        "reference model": '{"neighbour_range": 0.5}',
        "control software": "another",
    }
    fsm = "".join(f"# {key}: {value}\n" for key, value in header.items()) + GO
    with running(tmp_path, fsm, "", "", "--duration", "1") as robot:
        check(robot, 0, "Warning: the PFSM was designed with another version")
        assert max(left for _, left, _ in robot.devices.wheels) == pytest.approx(0.1)
        start, *events = read(tmp_path / "log.jsonl")
        assert sum(event["event"] == "cycle" for event in events) > 15
        assert (start["control_period"], start["control_software"]) == (0.05, control_digest())
        assert start["reference_model"] == ReferenceModel(neighbour_range=0.5)._asdict()


@made_in_time
def test_a_run_without_a_device_that_is_broken(tmp_path):
    """Neither its port is needed nor what it would say; all that stops another run stops this one."""
    with running(tmp_path, GO, "", "", "--without", "lidar") as robot:
        robot.devices.unplugged.add("lidar")
        robot.drives()
        robot.devices.tell("motor_fault", is_fault=True)
        error = check(robot, 4, "rvr: a motor has a fault")
        assert error.startswith("Without lidar: it is not used, and its readings are neutral.\n")
        assert robot.devices.lidar_commands == []
        start, *events = read(tmp_path / "log.jsonl")
        cycles = [event for event in events if event["event"] == "cycle"]
        assert (start["without"], start["facts"].get("lidar")) == (["lidar"], None)
        assert cycles[0]["lines"].keys() == {"rvr", "proximity"}
        assert (cycles[0]["readings"][2:5], cycles[0]["neighbours"]) == ([0.0] * 3, [])


@pytest.mark.parametrize("what", ["hub silent", "rvr noisy", "tread stuck", "rvr hears badly"])
def test_a_run_without_a_device_is_stopped_as_any_other(what, tmp_path):
    act, allowed, words = DEVICE_FAULTS[what]

    def attempt(number):
        with running(tmp_path / str(number), GO, "", "", "--without", "lidar") as robot:
            robot.drives()
            began = time.monotonic()
            act(robot)
            check(robot, 4, words)
            return robot.devices.told_to_rest(began) - allowed

    assert soonest(attempt) <= LATEST


@made_in_time
def test_a_run_with_the_rvr_alone(tmp_path):
    options = ("--duration", "0.5", "--without", "lidar", "--without", "proximity", "--without", "lidar")
    with running(tmp_path, "--nstates 1 --s0 1", "", "", *options) as robot:
        robot.devices.unplugged |= {"lidar", "proximity"}
        returned, error = robot.ended()
        assert (returned, error.count("Without")) == (0, 2), error
        start, *events = read(tmp_path / "log.jsonl")
        cycle = next(event for event in events if event["event"] == "cycle")
        assert start["without"] == ["lidar", "proximity"]
        assert (cycle["lines"].keys(), cycle["readings"][:5]) == ({"rvr"}, [0.0] * 5)


@pytest.mark.parametrize("device", ["lidar", "proximity"])
def test_no_run_goes_without_what_it_reads(tmp_path, device):
    with running(tmp_path, ALL, "", "", "--without", device) as robot:
        returned, error = robot.ended()
        assert (returned, f"--without {device}: the PFSM reads " in error) == (2, True), error
        assert robot.devices.commands == []
        assert not (tmp_path / "log.jsonl").exists()


@made_in_time
def test_a_dry_run_never_turns_the_wheels(tmp_path):
    with running(tmp_path, GO, "", "", "--duration", "1", "--dry-run") as robot:
        said = check(robot, 0, "The duration is over").splitlines()
        assert (said[0], said[-1]) == ("Dry run: the wheels do not turn.", "The log is log.jsonl")
        assert not robot.devices.drives()
        cycles = [event for event in read(tmp_path / "log.jsonl") if event["event"] == "cycle"]
        assert cycles[0]["wheels"] == [1.0, 1.0]


@made_in_time
def test_a_dry_run_is_stopped_by_what_would_stop_another(tmp_path):
    with running(tmp_path, GO, "", "return Wheels(math.nan, 1.0)", "--dry-run") as robot:
        robot.devices.when(lambda: (tmp_path / "log.jsonl").exists() and (tmp_path / "log.jsonl").stat().st_size)
        robot.fault()
        said = check(robot, 4, "wheels: expected speeds from -0.3 to 0.3 m/s, found nan, 0.3")
        assert "The log is log.jsonl\n" in said


class TestWhatStoppedIt:
    """It is in the log."""

    @made_in_time
    def test_what_a_device_told(self, tmp_path):
        with running(tmp_path) as robot:
            robot.drives()
            robot.devices.tell("motor_fault", is_fault=True)
            check(robot, 4, "rvr: a motor has a fault")
        *_, told, end = read(tmp_path / "log.jsonl")
        assert (told["event"], told["text"]) == ("note", "rvr: motor fault is fault True")
        assert end["why"] == "rvr: a motor has a fault"
        assert told["time"] > 0.0

    @made_in_time
    def test_what_was_decided(self, tmp_path, robot_command):
        with running(tmp_path, fault="return Wheels(math.nan, -1.01)") as robot:
            robot.drives()
            robot.fault()
            check(robot, 4, "found nan, -0.303")
        *_, cycle, _ = read(tmp_path / "log.jsonl")
        assert (cycle["event"], cycle["wheels"]) == ("cycle", [None, -1.01])
        code, out, err = robot_command("replay", tmp_path / "log.jsonl")
        assert (code, "has (0, 0, None, -1.01)" in err) == (1, True)
        assert len(out.splitlines()) == cycle["cycle"] + 1


def test_a_log_that_exists_keeps_the_robot_from_starting(tmp_path):
    (tmp_path / "log.jsonl").write_text("of another run")
    with running(tmp_path) as robot:
        returned, error = robot.ended()
        assert (returned, "log.jsonl: cannot be written: File exists" in error) == (1, True), error
        assert (robot.devices.commands, robot.devices.lidar_commands) == ([], [])
    assert (tmp_path / "log.jsonl").read_text() == "of another run"


@made_in_time
def test_the_battery_is_asked_after(tmp_path):
    with running(tmp_path, fault=OFTEN) as robot:
        robot.drives()
        robot.fault()
        robot.devices.when(lambda: asked(robot.devices) > 5)


@made_in_time
def test_what_all_threads_took_of_processors_is_in_the_log(tmp_path):
    busy = "import threading; threading.Thread(target=sum, args=[range(10**6)]).start()"
    with running(tmp_path, GO, "", busy, "--duration", "1.5") as robot:
        robot.drives()
        robot.fault()
        began = time.process_time()
        sum(range(10**6))
        took = time.process_time() - began
        robot.ended()
    cpu = sorted(event["program_cpu"] for event in read(tmp_path / "log.jsonl") if event["event"] == "cycle")
    assert cpu[len(cpu) // 2] > 0.5 * took


def test_a_full_disk(tmp_path):
    """A run whose log is lost is worth nothing."""
    limit = "import resource; n = os.path.getsize('log.jsonl'); resource.setrlimit(resource.RLIMIT_FSIZE, (n, n))"

    def attempt(number):
        with running(tmp_path / str(number), fault=limit) as robot:
            robot.drives()
            began = robot.fault()
            returned, error = robot.ended()
            assert (returned, "log.jsonl: cannot be written: File too large" in error) == (1, True), error
            return robot.devices.told_to_rest(began) - CYCLE

    assert soonest(attempt) <= LATEST


def test_a_disk_that_hangs(tmp_path):
    """Such a run goes on for a while, in which others would recover."""
    soon = "from mercator_design.robot.logs import log; log._HANGS = 0.5; log.SYNC_EVERY = 0"
    hangs = f"{soon}; os.fsync = lambda _: time.sleep(60)"

    def attempt(number):
        with running(tmp_path / str(number), fault=hangs) as robot:
            robot.drives()
            began = robot.fault()
            returned, error = robot.ended()
            assert (returned, "log.jsonl: cannot be written: the disk hangs" in error) == (1, True), error
            return robot.devices.told_to_rest(began) - 0.5 - 2 * CYCLE

    assert soonest(attempt) <= LATEST


class TestSwarm:
    def test_stop(self, tmp_path):
        def attempt(number):
            with running(tmp_path / str(number)) as robot, Speaker(["127.0.0.1"], robot.port) as speaker:
                robot.drives()
                began = time.monotonic()
                assert speaker.stop() == (["mercator (127.0.0.1)"], [])
                check(robot, 4, "swarm: told to stop by 127.0.0.1")
                return robot.devices.told_to_rest(began)

        assert soonest(attempt) <= LATEST

    @made_in_time
    def test_a_flood_of_stops_does_not_hold_up_the_end(self, tmp_path):
        with running(tmp_path) as robot, Speaker(["127.0.0.1"], robot.port) as speaker:
            robot.drives()
            began = time.monotonic()
            while robot.process.poll() is None:
                assert time.monotonic() < began + 10.0
                for _ in range(100):
                    speaker.send(STOP)
            took = time.monotonic() - began
            check(robot, 4, "swarm: told to stop by 127.0.0.1")
            robot.devices.when(lambda: robot.devices.commands[-1][1] == LAST)
            names = [name for _, name, _ in robot.devices.commands]
            assert names.count("drive_stop") < 10 + 2 * took / 0.2

    @made_in_time
    def test_a_stop_is_obeyed_each_time(self, tmp_path):
        """As what it sent before may have been damaged, and the program hangs."""
        with running(tmp_path, fault="time.sleep(60)") as robot, Speaker(["127.0.0.1"], robot.port) as speaker:
            robot.drives()
            robot.fault()
            for _ in range(2):
                before = len(robot.devices.commands)
                speaker.stop()
                assert "drive_stop" in [name for _, name, _ in robot.devices.commands[before:]]

    def test_stop_during_the_start(self, tmp_path):
        with running(tmp_path, lead="") as robot, Speaker(["127.0.0.1"], robot.port) as speaker:
            robot.devices.when(lambda: robot.devices.commands)
            speaker.stop()
            returned, error = robot.ended()
            assert (returned, error) == (4, "Error: swarm: told to stop by 127.0.0.1\n")
            assert not robot.devices.drives()

    def test_silence(self, tmp_path):
        def attempt(number):
            over = threading.Event()
            with (
                running(tmp_path / str(number), GO, ", heartbeat: 0.4") as robot,
                Speaker(["127.0.0.1"], robot.port) as speaker,
            ):

                def beat():
                    while not over.wait(0.05):
                        speaker.send(HEARTBEAT)

                beating = threading.Thread(target=beat)
                beating.start()
                robot.drives()
                time.sleep(0.5)
                assert robot.process.poll() is None
                over.set()
                beating.join()
                began = time.monotonic()
                check(robot, 4, "swarm: no heartbeat for 0.4 s")
                return robot.devices.told_to_rest(began) - 0.4

        assert soonest(attempt) <= LATEST

    def test_silence_of_who_has_the_key(self, tmp_path):
        """All that others say meanwhile keeps it running no longer: what is not signed, and what was, again."""

        def attempt(number):
            over = threading.Event()
            with (
                running(tmp_path / str(number), GO, f", heartbeat: 0.4, key: {KEY}") as robot,
                Speaker(["127.0.0.1"], robot.port) as speaker,
                Forger(robot.port) as forger,
            ):

                def beat():
                    while not over.is_set():
                        speaker.beat(KEY, 0.05)

                beating = threading.Thread(target=beat)
                beating.start()
                robot.drives()
                time.sleep(0.5)
                assert robot.process.poll() is None
                signed = forger.has_signed(KEY)
                over.set()
                beating.join()
                began = time.monotonic()
                with forger.saying([HEARTBEAT, *signed]):
                    error = check(robot, 4, "swarm: no heartbeat for 0.4 s")
                assert "not signed: anybody" not in error
                text = (robot.folder / "log.jsonl").read_text()
                assert (KEY in text + error, "heartbeats refused, the last from 127.0.0.1: " in text) == (False, True)
                return robot.devices.told_to_rest(began) - 0.4

        assert soonest(attempt) <= LATEST

    def test_who_has_another_key_lets_no_robot_begin(self, tmp_path):
        lead = SOON + IMPATIENT
        with (
            running(tmp_path, GO, f", heartbeat: 0.4, key: {KEY}", lead=lead) as robot,
            Speaker(["127.0.0.1"], robot.port) as speaker,
        ):
            while robot.process.poll() is None:
                speaker.beat("another key of the same length", 0.05)
            error = check(robot, 1, " were refused: its signature is wrong); is `mercator-robot heartbeat` running")
            assert KEY not in error
            assert not robot.devices.drives()

    @made_in_time
    def test_without_a_key_it_says_so(self, tmp_path):
        with (
            running(tmp_path, GO, ", heartbeat: 2", "", "--duration", "1") as robot,
            Speaker(["127.0.0.1"], robot.port) as speaker,
        ):
            robot.devices.when(lambda: speaker.send(HEARTBEAT) or robot.process.poll() is not None)
            error = check(
                robot, 0, "Warning: heartbeats are not signed: anybody in the network can keep this robot runn"
            )
            assert error.count("not signed") == 1
            notes = [event["text"] for event in read(tmp_path / "log.jsonl") if event["event"] == "note"]
            assert "heartbeats are not signed: anybody in the network can keep this robot running" in notes

    def test_without_a_heartbeat_it_does_not_begin(self, tmp_path):
        with running(tmp_path, GO, ", heartbeat: 0.4", lead=SOON + IMPATIENT) as robot:
            error = check(robot, 1, "swarm: no heartbeat; is `mercator-robot heartbeat` running")
            assert "Traceback" not in error
            assert not robot.devices.drives()

    def test_stop_while_it_waits_for_a_heartbeat(self, tmp_path):
        with running(tmp_path, GO, ", heartbeat: 0.4") as robot, Speaker(["127.0.0.1"], robot.port) as speaker:
            robot.devices.when((robot.folder / "log.jsonl").exists)
            robot.devices.when(lambda: (robot.folder / "log.jsonl").stat().st_size)
            speaker.stop()
            check(robot, 4, "swarm: told to stop by 127.0.0.1")

    def test_two_programs_cannot_hear_at_one_port(self, tmp_path):
        with running(tmp_path) as robot, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.bind(("", robot.port))
            returned, error = robot.ended()
        assert (returned, "does another mercator-robot run here?" in error) == (1, True), error
