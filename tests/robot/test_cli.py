"""The command line of mercator-robot: what a user types, and what is said of mistakes."""

import contextlib
import fcntl
import os
import pty
import re
import resource
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path

import click
import pytest

from mercator_design.errors import MercatorError, Signalled
from mercator_design.robot.cli import VERBS, cli
from mercator_design.robot.cli.options import new_file
from mercator_design.robot.devices.ports import DEVICES, OPTIONAL_DEVICES
from mercator_design.robot.run import network
from mercator_design.robot.run.network import ASK, HEARTBEAT, STOP, STOPPED, Heartbeats, Speaker, listener, receive
from tests.processes import LIMIT

ROOT = Path(__file__).parents[2]
GO = "--nstates 1 --s0 1"
NEAR = "--nstates 1 --s0 0 --rwm0 20"
"""Reads proximity."""
NEIGHBOURS = "--nstates 1 --s0 2 --att0 2"


@pytest.fixture
def fsm(tmp_path):
    file = tmp_path / "fsm.txt"
    file.write_text(GO)
    return file


@pytest.fixture
def robot():
    """A socket where a robot would listen, and its port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        port = probe.getsockname()[1]
    with listener(port) as listening:
        listening.setblocking(True)
        yield listening, port


@pytest.fixture
def answering(robot):
    """The port of a robot that says that it has stopped as often as it is told, and an event: it has been told."""
    listening, port = robot
    told, over = threading.Event(), threading.Event()
    listening.settimeout(0.05)

    def answer():
        while not over.is_set():
            with contextlib.suppress(TimeoutError):
                message, sender = listening.recvfrom(100)
                assert message == STOP
                told.set()
                listening.sendto(STOPPED + b"r2", sender)

    thread = threading.Thread(target=answer)
    thread.start()
    yield port, told
    over.set()
    thread.join()


class TestRun:
    def test_a_pfsm_that_is_none(self, robot_command, fsm, tmp_path):
        fsm.write_text("--nstates 1 --s0 9")
        code, _, err = robot_command("run", fsm)
        assert (code, err.startswith(f"Error: {fsm}:1: --s0, the behaviour of state 0: expected one of")) == (3, True)
        assert robot_command("run", tmp_path / "none.txt")[0] == 3

    @pytest.mark.parametrize(
        ("line", "words"),
        [
            ("floor: black, pink", "floor in the header: expected black, .*, found 'pink'"),
            ("control period: 0.5", 'control period in the header: expected .*, found "0.5"'),
            (
                "reference model: {neighbour_rangee: 1}",
                "reference model in the header: neighbour_rangee: unknown key.*",
            ),
            ("reference model: {", "reference model in the header: not valid YAML: .*"),
        ],
    )
    def test_a_header_that_is_none(self, robot_command, fsm, line, words):
        fsm.write_text(f"# {line}\n{GO}")
        code, _, err = robot_command("run", fsm)
        assert (code, bool(re.fullmatch(f"Error: {fsm}: {words}\n", err))) == (3, True), err

    def test_settings_that_are_none(self, robot_command, fsm, tmp_path, monkeypatch):
        settings = tmp_path / "robot.yaml"
        settings.write_text("limits:\n  speeed: 0.2\n")
        code, _, err = robot_command("run", fsm, "--robot", settings)
        assert (code, f"Error: {settings}:2: limits.speeed: unknown key; did you mean 'speed'?" in err) == (3, True)
        monkeypatch.setenv("MERCATOR_ROBOT", str(settings))
        code, _, err = robot_command("run", fsm)
        assert (code, err.startswith(f"Error: MERCATOR_ROBOT: {settings}:2: limits.speeed: ")) == (3, True)
        for verb in (["stop"], ["calibrate", "color"], ["install", "--dry-run"]):
            assert robot_command(*verb)[2].startswith("Error: MERCATOR_ROBOT: ")
        assert robot_command("run", fsm, "--robot", tmp_path / "none.yaml")[0] == 3

    def test_a_port_that_is_missing(self, robot_command, fsm, tmp_path):
        settings = tmp_path / "robot.yaml"
        settings.write_text("ports: {rvr: /dev/no_such_port}\n")
        log = tmp_path / "log.jsonl"
        code, _, err = robot_command("run", fsm, "--robot", settings, "-o", log)
        assert (code, err.startswith("Error: rvr: /dev/no_such_port: no such port")) == (1, True), err
        assert not log.exists()

    @pytest.mark.parametrize(
        ("pfsm", "constants", "words"),
        [
            (GO, "", "the PFSM does not need it: run with --without lidar"),
            (NEAR, "", "the PFSM does not need it: run with --without lidar"),
            (NEIGHBOURS, "", "the PFSM reads neighbours, which needs the lidar"),
            (
                NEAR,
                "reference_model: {neighbour_obstacle_range: 0.5}",
                "the PFSM reads proximity, with neighbours as obstacles (neighbour_obstacle_range is 0.5 m), "
                "which needs the lidar",
            ),
        ],
    )
    def test_a_device_that_is_missing_or_left_out(self, robot_command, fsm, tmp_path, pfsm, constants, words):
        """Whether the PFSM can go without it is told, and --without is refused for the same reason."""
        fsm.write_text(pfsm)
        settings = tmp_path / "robot.yaml"
        rvr, terminal = pty.openpty()
        ports = "ports: {{rvr: {}, lidar: /dev/no_such_port}}\n"
        settings.write_text(ports.format(os.ttyname(terminal)) + constants)
        code, _, err = robot_command("run", fsm, "--robot", settings, "-o", tmp_path / "log.jsonl")
        os.close(rvr)
        os.close(terminal)
        said = err.splitlines()[-1]
        assert (code, said.startswith("Error: lidar: /dev/no_such_port: no such port")) == (1, True), err
        assert said.endswith(f"; {words}")
        settings.write_text(ports.format("/dev/no_such_rvr") + constants)  # another test may have that terminal now
        code, _, err = robot_command("run", fsm, "--robot", settings, "--without", "lidar")
        is_refused = "--without lidar" not in words
        assert (code, err.endswith(f"Error: --without lidar: {words}\n")) == (2 if is_refused else 1, is_refused), err

    def test_what_was_raced_may_need_a_device(self, robot_command, fsm):
        fsm.write_text(f'# reference model: {{"neighbour_obstacle_range": 0.4}}\n{NEAR}')
        code, _, err = robot_command("run", fsm, "--without", "lidar")
        assert (code, "the PFSM reads proximity, with neighbours as obstacles" in err) == (2, True), err

    def test_what_can_be_left_out_is_a_device(self):
        assert set(DEVICES) - {"rvr"} == set(OPTIONAL_DEVICES)

    def test_where_its_log_is(self, tmp_path, monkeypatch):
        """Robots that begin in the same second in the same folder have a log each; a folder with a slash is made."""
        monkeypatch.chdir(tmp_path)
        names = [new_file(None, "run", robot).name for robot in ("r 1", "r2")]
        assert [name[: len("run-r-1-2")] for name in names] == ["run-r-1-2", "run-r2-20"]
        assert new_file("there/", "run", "r2").parent == Path("there")
        assert new_file("there", "run", "r2").parent == Path("there")
        assert new_file("not_there", "run", "r2") == Path("not_there")
        (tmp_path / "file").touch()
        with pytest.raises(MercatorError, match=r"^file: cannot be written: File exists$"):
            new_file("file/", "run", "r2")
        assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "there"]

    @pytest.mark.parametrize("options", [["--duration", "-1"], ["--seed", "x"], ["--speed", "1"]])
    def test_wrong_usage(self, robot_command, fsm, options):
        assert robot_command("run", fsm, *options)[0] == 2


@pytest.fixture(autouse=True)
def long_look_up(monkeypatch):
    """Names of hosts are looked up in threads, which may be late."""
    monkeypatch.setattr(network, "LOOK_UP_WAIT", LIMIT)


@pytest.fixture
def stop(robot_command, monkeypatch):
    """Run it on hosts, and again with more time if a robot that answers has not answered, as on a busy machine."""

    def run(*arguments):
        for seconds in (0.5, 5.0, 50.0):
            monkeypatch.setattr(Speaker.stop, "__defaults__", (seconds,))
            code, out, err = robot_command("stop", *arguments)
            if out:
                break
        return code, out, err

    return run


class TestStop:
    @pytest.mark.parametrize("host", ["localhost", "127.0.0.2", "127.255.255.255"])
    def test_a_robot_that_answers(self, stop, answering, host):
        """The last is a broadcast address; whatever address a robot answers from."""
        code, out, err = stop(host, "--port", answering[0])
        assert (code, err) == (0, "")
        assert re.fullmatch(r"r2 \(127\.0\.0\.\d\) has stopped\n", out)

    def test_hosts_that_are_unknown_silent_or_slow_keep_no_other_waiting(self, stop, answering, monkeypatch):
        port, told = answering
        found, waited = socket.gethostbyname, []

        def look_up(host):
            if host == "slow":
                waited.append(told.wait(LIMIT))
                return "127.0.0.1"
            return found(host)

        monkeypatch.setattr(socket, "gethostbyname", look_up)
        hosts = ["no..such..host", "slow", "192.0.2.1", "127.0.0.1"]
        code, out, err = stop(*hosts, "--port", port)
        assert (code, out) == (1, "r2 (127.0.0.1) has stopped\n")
        silent = f"192.0.2.1: no answer on UDP port {port}"
        assert err == f"Error: no..such..host: no such host; {silent}\n"
        assert set(waited) == {True}

    def test_a_name_that_is_not_found_in_time(self, stop, answering, monkeypatch):
        port, _ = answering
        monkeypatch.setattr(network, "LOOK_UP_WAIT", 0.2)
        over, found = threading.Event(), socket.gethostbyname

        def look_up(host):
            return found(host) if host != "slow" else str(over.wait(LIMIT))

        monkeypatch.setattr(socket, "gethostbyname", look_up)
        code, out, err = stop("slow", "127.0.0.1", "--port", port)
        over.set()
        assert (code, out) == (1, "r2 (127.0.0.1) has stopped\n")
        assert err == "Error: slow: its name could not be looked up in time\n"

    def test_none_answers(self, robot_command, robot, monkeypatch):
        monkeypatch.setattr(Speaker.stop, "__defaults__", (0.1,))
        code, out, err = robot_command("stop", "127.0.0.1", "--port", robot[1])
        assert (code, out) == (1, "")
        assert err == f"Error: 127.0.0.1: no answer on UDP port {robot[1]}\n"

    def test_more_descriptors_than_select_knows(self, stop, answering, monkeypatch):
        speaking = network.sending_socket

        def far():
            with speaking() as near:
                made = socket.socket(fileno=fcntl.fcntl(near, fcntl.F_DUPFD_CLOEXEC, 1024))
            made.setblocking(False)
            return made

        usual = resource.getrlimit(resource.RLIMIT_NOFILE)
        monkeypatch.setattr(network, "sending_socket", far)
        resource.setrlimit(resource.RLIMIT_NOFILE, (max(2048, usual[0]), usual[1]))
        try:
            code, out, err = stop("127.0.0.1", "--port", answering[0])
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, usual)
        assert (code, out, err) == (0, "r2 (127.0.0.1) has stopped\n", "")

    def test_a_host_that_is_not_known(self, robot_command, monkeypatch):
        monkeypatch.setattr(Speaker.stop, "__defaults__", (0.1,))
        code, _, err = robot_command("stop", "no..such..host")
        assert (code, err) == (1, "Error: no..such..host: no such host\n")


def test_no_verb_s_help_is_cut_short(robot_command):
    _, out, _ = robot_command("--help")
    assert len(out.partition("Commands:")[2].splitlines()) > len(VERBS)
    assert "..." not in out.partition("Commands:")[2]


def test_each_verb_is_found_by_its_name():
    context = click.Context(cli)
    assert [cli.get_command(context, name).name for name in VERBS] == sorted(VERBS)
    assert [name for name, row in VERBS.items() if not row.is_light] == ["twin"]


def test_a_run_loads_no_other_verb():
    script = (
        "import sys; from mercator_design.robot.cli import cli; cli(['run', '--help'], standalone_mode=False);"
        "print(*(name for name in sys.modules if name.startswith('mercator_design.robot.')))"
    )
    line = [sys.executable, "-c", script]
    done = subprocess.run(line, cwd=ROOT, capture_output=True, text=True, check=True)
    loaded = {name.split(".")[2] for name in done.stdout.splitlines()[-1].split()}
    assert loaded == {"cli", "devices", "logs", "protocols", "run"}


def test_no_robot_runs_before_all_hosts_are_known(robot_command, robot):
    """One that has heard a heartbeat would run, and stop for good."""
    listening, port = robot
    code, _, err = robot_command("heartbeat", "127.0.0.1", "no..such..host", "--port", port)
    assert (code, err) == (1, "Error: no..such..host: no such host\n")
    listening.setblocking(False)
    with pytest.raises(BlockingIOError):
        listening.recvfrom(100)


class TestKeys:
    """Who lets robots run that have a key."""

    @pytest.fixture
    def beats(self, robot, tmp_path, robot_command, monkeypatch):
        """Run it until a robot has heard it for a while; gives what was said, and what came."""
        listening, port = robot
        heartbeats, tell = Heartbeats("the key of this swarm", 1.0), Speaker.beat

        def run(*options):
            came = []

            def beat(speaker, key, _seconds):
                tell(speaker, key, 0.05)
                listening.setblocking(False)
                for message, sender in receive(listening):
                    came.append(message)
                    if answer := heartbeats.take(message, 5.0):
                        listening.sendto(answer, sender)
                if len(came) > 5:
                    raise Signalled("", 130)

            monkeypatch.setattr(Speaker, "beat", beat)
            monkeypatch.setattr(Speaker.stop, "__defaults__", (0.1,))
            code, out, err = robot_command("heartbeat", "127.0.0.1", "--port", port, *options)
            return code, out + err, came, heartbeats.heard

        return run

    def test_of_a_robot_yaml_or_a_file(self, beats, tmp_path):
        file, settings = tmp_path / "key", tmp_path / "robot.yaml"
        file.write_text("the key of this swarm\nand a remark\n")
        settings.write_text("swarm: {key: the key of this swarm}\n")
        for options in (("--key-file", file), ("--robot", settings)):
            code, said, came, heard = beats(*options)
            assert (code, said, heard) == (0, "Robots may run. Ctrl-C stops them.\n", 5.0)
            assert ASK in came
            assert HEARTBEAT not in came
            assert not any(b"the key" in message for message in came)

    def test_without_one_it_says_so(self, beats):
        code, said, came, heard = beats()
        assert (code, set(came) - {STOP}, heard) == (0, {HEARTBEAT}, None)
        assert said.startswith(
            "Warning: heartbeats are not signed, as there is no key; robots that have one do not run."
        )

    @pytest.mark.parametrize("option", ["--key-file", "--robot"])
    def test_one_that_is_short_is_refused_and_not_shown(self, robot_command, tmp_path, option):
        file = tmp_path / "file"
        file.write_text("qwertz123\n" if option == "--key-file" else "swarm: {key: qwertz123}\n")
        code, out, err = robot_command("heartbeat", "127.0.0.1", option, file)
        assert (code, out) == (3, "")
        assert "expected at least 16 characters, found 9" in err
        assert "qwertz" not in err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_heartbeats_until_they_end_and_then_stop(robot, number):
    """In the background of a script too, where SIGINT is ignored."""
    listening, port = robot
    ignoring = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"
    script = f"{ignoring}; from mercator_design.robot.cli import main; main()"
    with subprocess.Popen(
        [sys.executable, "-c", script, "heartbeat", "127.0.0.1", "--port", str(port)],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stderr=subprocess.PIPE,
        text=True,
    ) as beating:
        try:
            listening.settimeout(LIMIT)
            assert [listening.recvfrom(100)[0] for _ in range(5)] == [HEARTBEAT] * 5
            beating.send_signal(number)
            while listening.recvfrom(100)[0] != STOP:
                pass
            assert (f"Stopped by {number.name}." in beating.communicate(timeout=LIMIT)[1]) == (number != signal.SIGINT)
        finally:
            beating.kill()
    assert beating.returncode == (0 if number == signal.SIGINT else 128 + number)


def test_no_input_is_no_terminal():
    line = [sys.executable, "-c", "from mercator_design.robot.cli import main; main()", "teleop"]
    done = subprocess.run(
        ["sh", "-c", 'exec "$@" <&-', "sh", *line],  # noqa: S607
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, "teleop needs a terminal" in done.stderr) == (2, True), done.stderr
