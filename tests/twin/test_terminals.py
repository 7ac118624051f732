"""The twin's ports: sessions with pyserial, ports that go away, and that nothing is left behind."""

import contextlib
import errno
import fcntl
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
import serial

from mercator_design import jit
from mercator_design.errors import RobotError
from mercator_design.robot.cli import main
from mercator_design.robot.devices.ports import open_port, open_ports
from mercator_design.robot.devices.settings import read_settings
from mercator_design.robot.protocols import multiflex, rvr, ydlidar
from mercator_design.robot.protocols.rvr import Response
from mercator_design.robot.protocols.rvr_streaming import StreamData, streaming
from mercator_design.robot.protocols.ydlidar import Packet
from mercator_design.twin.arena import TwinArena
from mercator_design.twin.faults import PortLoss, Script
from mercator_design.twin.folder import LOG, open_log
from mercator_design.twin.terminals import Terminals, _free_ports
from mercator_design.twin.twin import Twin
from tests.processes import LIMIT, wait_until
from tests.robot.devices import by_hand
from tests.robot.ways import ATTEMPTS
from tests.twin.arenas import arena

pytestmark = pytest.mark.together("kernels")  # compiled once

ROOT = Path(__file__).parents[2]


@contextlib.contextmanager
def running(folder, script=None):
    """A twin of two robots that runs in a thread; its terminals."""
    here = arena((0.0, 0.0, 0.0), (0.0, 0.6, 0.0))
    here.scan(0, 0.0), here.measure(0, "proximity")  # compiled before the clock starts
    over = threading.Event()
    with open_log(folder) as log, Terminals(Twin(here, script, log), folder) as terminals:
        thread = threading.Thread(target=lambda: terminals.run(lambda _: over.is_set()))
        thread.start()
        try:
            yield terminals
        finally:
            over.set()
            thread.join()


def port_names(file):
    """Of a robot, from its robot.yaml."""
    return read_settings(file).ports


def events(folder, kind):
    """What the log says of a kind of event."""
    lines = map(json.loads, (folder / LOG).read_text().splitlines())
    return [event for event in lines if event["event"] == kind]


def hear(port, end, done):
    """What a port says until `done` says that it is enough."""
    said = []

    def is_enough():
        said.extend(end.receive(port.read(port.in_waiting)))
        return done(said)

    wait_until(is_enough)
    return said


def test_a_session_with_all_three_devices(tmp_path):
    assert any(has_had_a_session(tmp_path / str(number)) for number in range(ATTEMPTS))


def has_had_a_session(tmp_path):
    """Whether all that the devices told was read in time, and the RVR was told something in time."""
    tmp_path.mkdir()
    with running(tmp_path) as terminals, open_ports(port_names(terminals.robots[0])) as ports:
        host, lidar, hub = rvr.Host(), ydlidar.decoder(), multiflex.decoder()
        ports["rvr"].write(host.send("get_battery_percentage"))
        (response,) = hear(ports["rvr"], host, len)
        assert response.values == {"percentage": 100}
        for name, target, values in streaming(["imu", "color_detection"], 50):
            ports["rvr"].write(host.send(name, target=target, **values))
        ports["rvr"].write(host.send("drive_tank_si_units", left_velocity=0.1, right_velocity=0.1))
        said = hear(ports["rvr"], host, lambda said: len(said) >= 10)
        assert {type(event) for event in said} == {StreamData}
        ports["rvr"].write(host.send("drive_stop"))
        ports["lidar"].write(ydlidar.encode_command("device_info") + ydlidar.encode_command("scan"))
        info, *packets = hear(
            ports["lidar"], lidar, lambda said: sum(getattr(event, "is_ring_start", False) for event in said) > 2
        )
        if host.counts.lost or lidar.counts.lost:
            return False
        assert info.model == 6
        turns = ydlidar.Turns()
        assert [len(turn) for packet in packets if isinstance(packet, Packet) and (turn := turns.receive(packet))] == [
            719,
            719,
        ]
        ports["proximity"].write(multiflex.use_sensors(0xFF).encode())
        hear(ports["proximity"], hub, lambda said: len(said) > 3)
        if host.counts.lost or lidar.counts.lost or hub.counts.lost:
            return False
    told = [(event["left"], event["by"]) for event in events(tmp_path, "wheels") if event["robot"] == 0]
    if (0.0, "timeout") in told:
        return False
    assert told == [(0.0, "start"), (0.1, "drive_tank_si_units"), (0.0, "drive_stop")]
    (clock,) = events(tmp_path, "clock")
    assert 0.0 < time.monotonic() - clock["start"] < LIMIT
    return True


_IS_EXCLUSIVE = 0x80045440  # TIOCGEXCL


def test_a_port_that_was_somebody_s_alone_is_not_when_he_was_killed(tmp_path):
    """As that of a device, which a pseudo-terminal would not be."""
    with running(tmp_path) as terminals:
        port = port_names(terminals.robots[0]).rvr
        code = f"""
import time
from mercator_design.robot.devices.ports import open_port
port = open_port("rvr", {port!r})
print(flush=True)
time.sleep(60)
"""
        with subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, stdout=subprocess.PIPE) as program:
            program.stdout.readline()
            wait_until(lambda: len(events(tmp_path, "port")) == 1)
            program.kill()
        wait_until(lambda: len(events(tmp_path, "port")) == 2)
        closed = events(tmp_path, "port")[-1]["time"]
        wait_until(lambda: events(tmp_path, "poses")[-1]["time"] > closed)
        with serial.Serial(port) as opened:
            assert not any(fcntl.ioctl(opened.fileno(), _IS_EXCLUSIVE, bytes(4)))


def test_what_the_rvr_says_comes_at_the_speed_of_its_line(tmp_path):
    """The maker's threaded client takes one frame each time it reads, so frames must not come all at once."""
    host = rvr.Host()
    echoes = b"".join(host.send("echo", data=bytes(16)) for _ in range(20))
    with running(tmp_path) as terminals, serial.Serial(port_names(terminals.robots[0]).rvr, 115_200) as port:
        port.write(host.send("echo", data=b""))
        hear(port, host, len)
        start = time.monotonic()
        port.write(echoes)
        said = hear(port, host, lambda said: len(said) == 20)
        took = time.monotonic() - start
    assert [event.values for event in said] == [{"data": bytes(16)}] * 20
    assert took >= 20 * 24 * 10 / 115_200  # ten bits a byte


def test_who_opens_briefly_is_heard_and_ports_that_are_closed_are_quiet(tmp_path):
    with running(tmp_path) as terminals:
        names = port_names(terminals.robots[1])
        host = rvr.Host()
        for k, left in enumerate((0.1, 0.2), 1):
            with serial.Serial(names.rvr, 115_200) as port:
                port.write(host.send("drive_tank_si_units", left_velocity=left, right_velocity=0.0))
            wait_until(lambda: len(events(tmp_path, "port")) == 2 * k)  # noqa: B023 - called at once
        for k in range(3, 3 + ATTEMPTS):
            with serial.Serial(names.proximity, 115_200) as port:
                time.sleep(0.05)
                waiting = port.in_waiting
            wait_until(lambda: len(events(tmp_path, "port")) == 2 * k)  # noqa: B023 - called at once
            if waiting <= 40:  # more may come where this thread is held up
                break
        assert waiting <= 40  # nothing that was said before
    mine = [event["left"] for event in events(tmp_path, "wheels") if event["robot"] == 1]
    assert mine[:3] == [0.0, 0.1, 0.2]
    assert not any(mine[3:])  # on a busy machine the wheels stop meanwhile, because nothing was sent for 2 s
    opened = [event["open"] for event in events(tmp_path, "port") if event["device"] == "rvr"]
    assert opened == [True, False] * 2


def test_a_port_that_is_opened_again_at_once(tmp_path):
    """It had been closed when the twin looked, and has nothing to say now."""
    with open_log(tmp_path) as log, Terminals(Twin(arena((0.0, 0.0, 0.0)), None, log), tmp_path) as terminals:
        end = terminals._fds[0, "rvr"]
        with serial.Serial(port_names(terminals.robots[0]).rvr, 115_200):
            terminals._look(0.0)
            terminals._receive(end, 0.0)
        terminals._receive(end, 0.0)
    assert [event["open"] for event in events(tmp_path, "port")] == [True, False]


@pytest.mark.parametrize("is_locked", [False, True])
def test_a_port_that_is_opened_again_as_the_twin_sees_that_it_was_closed(tmp_path, monkeypatch, is_locked):
    """What is sent then arrives, also where the port is at once somebody's alone."""
    with open_log(tmp_path) as log, contextlib.ExitStack() as stack:

        def open_again(event):
            log(event)
            if event["event"] == "port" and not event["open"] and not again:
                again.append(stack.enter_context(serial.Serial(names.rvr, 115_200)))
                again[0].write(rvr.Host().send("drive_tank_si_units", left_velocity=0.1, right_velocity=0.0))
                if is_locked:
                    monkeypatch.setattr(os, "open", refuse)

        def refuse(*_):
            raise OSError(errno.EBUSY, "as to those who are not root")

        again = []
        terminals = stack.enter_context(Terminals(Twin(arena((0.0, 0.0, 0.0)), None, open_again), tmp_path))
        names = port_names(terminals.robots[0])
        end = terminals._fds[0, "rvr"]
        with serial.Serial(names.rvr, 115_200):
            terminals._look(0.0)
        terminals._receive(end, 0.0)
        terminals._look(0.0)
        terminals._receive(end, 0.0)
        assert [event["left"] for event in events(tmp_path, "wheels")] == [0.0, 0.1]


def test_a_port_that_stays_locked_is_replaced_and_has_its_name_all_the_time(tmp_path, monkeypatch):
    """As a twin without privileges cannot open it either; who waits for a port must not find that there is none."""

    def refuse(*_):
        raise OSError(errno.EBUSY, "as to those who are not root")

    with open_log(tmp_path) as log, Terminals(Twin(arena((0.0, 0.0, 0.0)), None, log), tmp_path) as terminals:
        link = Path(port_names(terminals.robots[0]).rvr)
        over, missing = threading.Event(), []

        def watch():
            while not over.is_set():
                if not link.is_symlink():
                    missing.append(link)

        watching = threading.Thread(target=watch)
        watching.start()
        try:
            for _ in range(10):
                end, before = terminals._fds[0, "rvr"], link.readlink()
                with open_port("rvr", str(link)):
                    terminals._look(0.0)
                with monkeypatch.context() as patch:
                    patch.setattr(os, "open", refuse)
                    terminals._receive(end, 0.0)
                assert link.readlink() != before
        finally:
            over.set()
            watching.join()
    assert not missing
    assert [event["open"] for event in events(tmp_path, "port")] == [True, False] * 10


def test_how_late_it_was_is_reported_whatever_it_was_waiting_for(tmp_path):
    """The clock jumps as a device is heard, which it is at once, and not when it is looked at."""
    times, told = iter([0.0, 0.0, 0.0, 0.5]), []
    with (
        open_log(tmp_path) as log,
        Terminals(Twin(arena((0.0, 0.0, 0.0)), None, log), tmp_path) as terminals,
        serial.Serial(port_names(terminals.robots[0]).rvr, 115_200) as port,
    ):
        port.write(rvr.Host().send("get_sku"))
        terminals._look(0.0)
        timing = terminals.run(lambda now: now >= 0.5, told.append, lambda: next(times, 0.5))
    assert timing.latest == pytest.approx(0.49)
    (warning,) = told
    assert warning.startswith("Warning: the twin was 490 ms late")


def test_it_is_reported_that_it_is_late_each_time_that_it_is_twice_as_late(tmp_path):
    told = []
    with open_log(tmp_path) as log, Terminals(Twin(arena((0.0, 0.0, 0.0)), None, log), tmp_path) as terminals:
        terminals.run(lambda _: True, told.append)
        for now in (0.05, 0.20, 0.40, 0.80, 0.90, 1.10):  # the latest by 40, 140, 190, 390, 90, 190 ms
            terminals._keep_up(now)
    assert [re.search(r"was (\d+) ms late", warning)[1] for warning in told] == ["140", "390"]


def test_a_port_that_is_pulled_out_and_comes_back(tmp_path):
    is_lost = threading.Event()
    script = Script(faults=[by_hand(is_lost.is_set, PortLoss, device="proximity")])
    with running(tmp_path, script) as terminals:
        name = Path(port_names(terminals.robots[0]).proximity)
        with serial.Serial(str(name), 115_200, timeout=LIMIT) as port:
            is_lost.set()
            with pytest.raises(serial.SerialException):
                port.read(10**6)
        assert not name.exists()
        is_lost.clear()
        wait_until(name.exists)
        with serial.Serial(str(name), 115_200) as port:
            hear(port, multiflex.decoder(), lambda said: len(said) > 1)


def test_nothing_is_left_behind(tmp_path):
    def held():
        return threading.active_count(), len(list(Path("/proc/self/fd").iterdir()))

    before = held()
    (tmp_path / "0").mkdir()
    (tmp_path / "0" / "mine.txt").write_text("")
    with running(tmp_path) as terminals:
        assert sorted(path.name for path in tmp_path.rglob("*")) == sorted(
            ["0", "1", "mine.txt", LOG, *2 * ["lidar", "proximity", "robot.yaml", "rvr"]]
        )
        assert [path.parent.name for path in terminals.robots] == ["0", "1"]
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["0", "mine.txt", LOG]
    assert held() == before


def test_links_of_a_twin_that_was_killed_are_replaced(tmp_path):
    (tmp_path / "0").mkdir()
    for name in ("rvr", "lidar.new"):
        (tmp_path / "0" / name).symlink_to("/dev/pts/no_longer")
    (tmp_path / "0" / "robot.yaml").touch()
    (tmp_path / LOG).write_text('{"time": 0.0, "event": "what was before"}\n')
    with running(tmp_path) as terminals, open_ports(port_names(terminals.robots[0])):
        pass
    assert "before" not in (tmp_path / LOG).read_text()


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("1/robot.yaml", "name: mercator-1\n"),
        ("1/rvr", "mine"),
        ("1/rvr.new", "mine"),
        ("1/lidar", None),
        (LOG, '{"event":"start","kind":"run"}\n'),
    ],
)
def test_somebody_else_s_file_is_left_alone(tmp_path, name, text):
    file = tmp_path / name
    file.parent.mkdir(exist_ok=True)
    file.symlink_to("/dev/serial0") if text is None else file.write_text(text)
    with pytest.raises(RobotError, match=f"{name} exists and is not a twin's"), running(tmp_path):
        pass
    assert str(file.readlink()) == "/dev/serial0" if text is None else file.read_text() == text
    assert not (tmp_path / "0").exists()


def test_a_folder_that_cannot_be_written_to(tmp_path):
    file = tmp_path / "0"
    file.touch()
    with pytest.raises(RobotError, match=f"{file} exists and is not a folder"), running(tmp_path):
        pass
    expected = f"{file}/log: cannot be written: Not a directory"
    with pytest.raises(RobotError, match=expected), open_log(file / "log"):
        pass


def test_a_folder_with_a_name_that_a_twin_needs_for_a_moment(tmp_path):
    (tmp_path / "0" / "rvr.new").mkdir(parents=True)
    with pytest.raises(RobotError, match=r"rvr.new exists and is not a twin's"), running(tmp_path):
        pass


def test_a_folder_that_was_removed_is_the_next_twin_s(tmp_path, monkeypatch):
    with Terminals(Twin(arena((0.0, 0.0, 0.0))), tmp_path) as first:
        shutil.rmtree(tmp_path / "0")
        monkeypatch.setattr(os, "getpid", lambda: 1)
        with Terminals(Twin(arena((0.0, 0.0, 0.0))), tmp_path) as second:
            there = {path: path.readlink() for path in (tmp_path / "0").iterdir() if path.is_symlink()}
            first.__exit__()
            assert {path: path.readlink() for path in there} == there
            assert len(there) == 3
            assert second.robots[0].exists()
    assert not (tmp_path / "0").exists()


@pytest.mark.parametrize("is_replaced", [False, True])
def test_a_port_that_is_closed_when_the_folder_is_no_longer_its_own(tmp_path, is_replaced):
    with Terminals(Twin(arena((0.0, 0.0, 0.0))), tmp_path) as terminals:
        link, end = tmp_path / "0" / "rvr", terminals._fds[0, "rvr"]
        with serial.Serial(str(link), 115_200):
            terminals._look(0.0)
        shutil.rmtree(tmp_path / "0")
        if is_replaced:
            (tmp_path / "0").mkdir()
            link.write_text("mine")
        with pytest.raises(RobotError, match=r"0/rvr.*; a twin needs its folder for itself until it ends"):
            terminals._receive(end, 0.0)
    assert not is_replaced or link.read_text() == "mine"


def test_a_file_that_comes_where_it_makes_links_stays(tmp_path):
    mine = tmp_path / "0" / "rvr.new"
    script = Script(faults=(PortLoss(at=0.0, duration=1.0, robot=0, device="rvr"),))
    with Terminals(Twin(arena((0.0, 0.0, 0.0)), script), tmp_path) as terminals:
        list(terminals._twin.advance(0.5))
        terminals._look(0.5)
        mine.write_text("mine")
        list(terminals._twin.advance(1.5))
        with pytest.raises(RobotError, match=r"File exists: .*0/rvr.new; a twin needs its folder for itself"):
            terminals._look(1.5)
    assert list((tmp_path / "0").iterdir()) == [mine]
    assert mine.read_text() == "mine"


def test_every_robot_has_a_udp_port_of_its_own():
    """Of 2000 times, ports that are drawn one by one had one twice 15 times."""
    assert all(len({*_free_ports(20)}) == 20 for _ in range(2000))


def test_what_others_write_into_robot_yaml_goes_with_it(tmp_path):
    with running(tmp_path) as terminals, terminals.robots[0].open("a") as file:
        file.write("labels: {black: [1, 2, 3]}\n")
    assert [path.name for path in tmp_path.iterdir()] == [LOG]


def test_what_somebody_puts_in_the_place_of_a_twin_s_file_stays(tmp_path):
    with running(tmp_path) as terminals:
        mine = [terminals.robots[0], terminals.robots[0].with_name("rvr")]
        for file in mine:
            file.unlink()
            file.write_text("mine")
    assert [file.read_text() for file in mine] == ["mine", "mine"]


def test_a_folder_is_one_twins(tmp_path):
    with open_log(tmp_path), pytest.raises(RobotError, match="another twin is running there"), open_log(tmp_path):
        pass
    with open_log(tmp_path):
        pass


def may_go_first():
    """Whether a process of this user may have a priority above others."""
    asked = "import os; os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(3))"
    return subprocess.run([sys.executable, "-c", asked], capture_output=True, check=False).returncode == 0


@contextlib.contextmanager
def command(*arguments):
    """`mercator-robot twin`, as a process."""
    line = [sys.executable, "-m", "mercator_design.twin", *map(str, arguments)]
    with subprocess.Popen(line, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


class TestTheCommand:
    @pytest.mark.thorough
    @pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
    def test_it_runs_before_runs_and_ends_and_leaves_only_the_log(self, tmp_path, number):
        with command("aggregation", "--folder", tmp_path, "--set", "robots=2", "--no-noise") as process:
            lines = [process.stdout.readline().strip() for _ in range(2)]
            if may_go_first():
                assert os.sched_getscheduler(process.pid) == os.SCHED_RR
                assert os.sched_getparam(process.pid).sched_priority > 2  # that of a run's watchdog
            assert lines == [f"robot {n}: {tmp_path}/{n}/robot.yaml" for n in range(2)]
            with open_ports(port_names(tmp_path / "1" / "robot.yaml")) as ports:
                host = rvr.Host()
                ports["rvr"].write(host.send("get_sku"))
                (response,) = hear(ports["rvr"], host, len)
                assert isinstance(response, Response)
            process.send_signal(number)
            _, messages = process.communicate(timeout=LIMIT)
        assert process.returncode == 0
        assert "of a core for each second; at most " in messages
        assert [path.name for path in tmp_path.iterdir()] == [LOG]

    def test_a_signal_ends_it_at_once_while_it_compiles(self, run_command, tmp_path, monkeypatch):
        found = []

        def rehearse(_):
            found.extend(map(signal.getsignal, (signal.SIGTERM, signal.SIGINT)))
            raise KeyboardInterrupt

        monkeypatch.setattr(TwinArena, "rehearse", rehearse)
        usual = [*map(signal.getsignal, (signal.SIGTERM, signal.SIGINT))]
        assert run_command("mercator-robot", main, "twin", "aggregation", "--folder", tmp_path)[0] == 130
        assert found == usual

    def test_what_is_compiled_is_announced_before_once(self, run_command, tmp_path, monkeypatch, capsys):
        """Even if that is as soon as robots are placed, which took 13 s of silence."""
        told = []

        def place(*_):
            for _ in range(2):
                jit._missed()
                told.append(capsys.readouterr().err)
            raise KeyboardInterrupt

        monkeypatch.setattr(TwinArena, "__init__", place)
        assert run_command("mercator-robot", main, "twin", "aggregation", "--folder", tmp_path)[0] == 130
        assert told == ["Compiling the twin; later runs find it in the cache ...\n", ""]

    def test_mistakes_are_told_before_it_compiles(self, run_command, tmp_path, monkeypatch):
        monkeypatch.setattr(TwinArena, "rehearse", lambda _: pytest.fail("compiles"))
        line = ["mercator-robot", main, "twin", "aggregation", "--folder", tmp_path]
        script = tmp_path / "faults.yaml"
        script.write_text("faults: [{kind: silence, at: 1, robot: 3, device: rvr}]")
        words = f"Error: {script}:1: faults[0].robot: expected a robot's number, 0 to 2, found 3\n"
        assert run_command(*line, "--faults", script) == (3, "", words)
        (tmp_path / "2").touch()
        words = f"Error: {tmp_path}/2 exists and is not a folder; move it, or choose another folder\n"
        assert run_command(*line) == (1, "", words)

    def test_it_ends_by_itself(self, run_command, tmp_path):
        line = ["mercator-robot", main, "twin", "aggregation", "--folder", tmp_path, "--duration", "0.5", "--seed", "7"]
        try:
            assert run_command(*line)[0] == 0
        finally:
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        poses = events(tmp_path, "poses")
        assert poses[-1]["time"] == pytest.approx(0.5, abs=0.11)
        assert len(poses[0]["poses"]) == 3
