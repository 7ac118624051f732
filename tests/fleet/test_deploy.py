"""Robots are deployed to over an ssh and an scp that act in local folders: a host is a folder, its home."""

import fcntl
import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from mercator_design import __version__
from mercator_design.fleet import ssh
from mercator_design.fleet.deploy import read_fleet
from mercator_design.fleet.start import start
from tests.fleet.fakes import GO, settings
from tests.processes import LIMIT
from tests.robot.devices import Devices


def test_copies(deploy, field):
    """And the program runs with nothing but Python."""
    (field / "bin/python3").unlink()
    (field / "bin/python3").symlink_to(sys.executable)
    rows = "".join(f"ok      {name:<16} mercator-robot, version {__version__}\n" for name in ("r1", "r2"))
    assert deploy("fsm.txt") == (0, rows, "")
    for name in ("r1", "r2"):
        assert (field / name / "mercator/fsm.txt").read_text() == GO
    calls = (field / "calls").read_text().splitlines()
    assert len(calls) == 6
    assert sum("-o User=pi -o Port=2222" in call for call in calls) == 3


def test_what_failed_copies_leave_on_a_robot_is_removed(deploy, field):
    """If it is old: others may copy at the same time."""
    (field / "robots.yaml").write_text("robots: [{name: r1, host: r1}]\n")
    folder = field / "r1/mercator"
    for name, age in (("of another", 0.0), ("old", 2 * 3600.0)):
        (folder / "new" / name).mkdir(parents=True)
        os.utime(folder / "new" / name, (time.time() - age,) * 2)
    assert deploy("fsm.txt")[0] == 0
    assert [path.name for path in (folder / "new").iterdir()] == ["of another"]
    (field / "bin/python3").write_text("#!/bin/sh\nexit 1\n")
    assert deploy("fsm.txt")[0] == 1
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert "a run is in progress" in deploy("fsm.txt")[1]
    (folder / "fsm.txt").unlink()
    (folder / "fsm.txt").mkdir()  # in the way
    assert deploy("fsm.txt")[0] == 1
    assert [path.name for path in (folder / "new").iterdir()] == ["of another"]


def test_runs_stops_and_collects(deploy, field):
    with Devices() as devices:
        (field / "r1/mercator").mkdir()
        (field / "r1/mercator/robot.yaml").write_text(settings(devices))
        (field / "robots.yaml").write_text("robots: [{name: mercator 1, host: r1}]\n")
        code, out, err = deploy("fsm.txt", "--start", "--duration", 60)
        assert (code, err) == (0, "")
        assert "ok      mercator 1       runs, logs/run-" in out.splitlines()[1]
        devices.when(devices.drives)
        for arguments in (["fsm.txt"], ["fsm.txt", "--start"]):
            code, out, err = deploy(*arguments)
            assert (
                out
                == "FAILED  mercator 1       a run is in progress; end it first: mdesign deploy --robots ... --stop\n"
            )
            assert (code, err) == (1, "Error: 1 of 1 robots failed\n")
        assert deploy("--stop", "--collect", "all") == (
            0,
            "ok      mercator 1       stopped\nok      mercator 1       2 files in all/mercator 1\n",
            "",
        )
        assert devices.rests_since() < time.monotonic()
        assert deploy("--stop") == (0, "ok      mercator 1       nothing that deploy has started runs\n", "")
    (log,) = (field / "all/mercator 1").glob("*.jsonl")
    first, *_, last = log.read_text().splitlines()
    assert '"duration":60.0' in first.replace(" ", "")
    assert "Stopped by SIGTERM." in last


def test_of_two_starts_at_once_one_is_refused(deploy, field):
    """And what runs is what is stopped, however long each start takes to begin."""
    date = field / "bin/date"
    date.write_text('#!/bin/sh\nsleep 0.5\nexec /bin/date "$@"\n')
    date.chmod(0o755)
    (field / "r1/mercator").mkdir()
    (field / "robots.yaml").write_text("robots: [{name: r1, host: r1}]\n")
    assert deploy("fsm.txt")[0] == 0
    with Devices() as devices:
        (field / "r1/mercator/robot.yaml").write_text(settings(devices))
        fleet = read_fleet(field / "robots.yaml")
        with ThreadPoolExecutor(2) as pool:
            starts = [*pool.map(lambda _: start(fleet, [], 60.0, 0.1), range(2))]
        refused, runs = sorted(starts, key=lambda each: not each.why)
        assert refused.why == "r1: a run is in progress; end it first: mdesign deploy --robots ... --stop"
        assert (runs.why, [each.is_done for each in runs.results]) == ("", [True])
        devices.when(devices.drives)
        assert deploy("--stop")[1] == "ok      r1               stopped\n"
        assert devices.rests_since() < time.monotonic()


@pytest.mark.thorough
def test_a_robot_that_does_not_start(deploy, field):
    for name in ("r1", "r2"):
        (field / name / "mercator").mkdir()
        (field / name / "mercator/robot.yaml").write_text("ports: {rvr: /dev/no_such_port}\n")
    code, out, err = deploy("fsm.txt", "--start", "--dry-run")
    assert (code, err.startswith("Error: no robot runs: r")) == (1, True), err
    for row in out.splitlines()[2:]:
        assert "Error: rvr: /dev/no_such_port: no such port" in row
        assert row.startswith("FAILED  r")


def test_nothing_starts_if_a_robot_is_missing(deploy, field):
    (field / "r2").rmdir()
    code, out, err = deploy("fsm.txt", "--start")
    assert (code, err) == (1, "Error: 1 of 2 robots failed\n")
    assert out.splitlines()[1:] == ["FAILED  r2               ssh: connect to host r2 port 22: No route to host"]
    assert not list(field.glob("*/mercator/logs"))
    code, out, err = deploy("--collect", "logs")
    assert out.startswith("ok      r1               no logs\nFAILED  r2 ")
    assert code == 1


def test_a_robot_that_does_not_answer(deploy, field):
    (field / "r2/slow").touch()
    begin = time.monotonic()
    code, out, _ = deploy("--stop", "--timeout", 1)
    assert time.monotonic() - begin < LIMIT
    assert code == 1
    assert "FAILED  r2               ssh: not done after 1 s" in out


def test_a_process_that_is_another_s_is_left_alone(deploy, field):
    other = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
    (field / "r1/mercator").mkdir()
    (field / "r2/mercator").mkdir()
    (field / "r1/mercator/pid").write_text(f"{other.pid}\n")
    assert deploy("--stop")[1].count("nothing that deploy has started runs") == 2
    assert other.poll() is None
    other.kill()
    other.wait()


def test_no_ssh(deploy, field, monkeypatch):
    monkeypatch.setenv("PATH", "/nonexistent")
    assert "ssh: no such program here; install OpenSSH" in deploy("--stop")[1]


def test_an_ssh_that_does_not_end(field, monkeypatch):
    (field / "bin/ssh").write_text("#!/bin/sh\nexec sleep 600 >&-\n")
    monkeypatch.setattr(ssh, "END_WAIT", 0.01)
    with ssh.conversing(read_fleet(field / "robots.yaml").robots, "", []) as robots:
        for each in robots.values():
            assert each.read() is None
            assert (each.has_ended, each.words) == (True, "the connection has ended, ssh has not")


@pytest.mark.thorough
def test_an_fsm_of_another_flavour_that_is_run_as_it_was_checked(deploy, field):
    (field / "fsm.txt").write_text("--nstates 1 --s0 5 --rep0 4 --rep0 5")
    code, _, err = deploy("fsm.txt", "--flavour", "chocolate")
    assert (code, "--rep0" in err) == (3, True)
    for name in ("r1", "r2"):
        (field / name / "mercator").mkdir()
        (field / name / "mercator/robot.yaml").write_text("ports: {rvr: /dev/no_such_port}\n")
    code, out, err = deploy("fsm.txt", "--flavour", "chocolate", "--lenient", "--start")
    assert (code, err.startswith("Warning: fsm.txt: ")) == (1, True)
    assert out.count("rvr: /dev/no_such_port: no such port") == 2  # so it was taken for what it is there too


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["fsm.txt", "--stop"],
        ["fsm.txt", "--collect", "x"],
        ["--stop", "--start"],
        ["--stop", "--lenient"],
        ["fsm.txt", "--duration", "5"],
        ["fsm.txt", "--without", "lidar"],
        ["--stop", "--without", "lidar"],
        ["--check", "--without", "rvr"],
    ],
)
def test_wrong_usage(deploy, field, arguments):
    assert deploy(*arguments)[0] == 2
    assert not (field / "calls").exists()


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("robots: []", "robots.yaml:1: robots: expected"),
        ("robots:\n- {host: r1}", "robots.yaml:2: robots[0].name: missing key"),
        ("robots:\n- {name: a, host: -oProxyCommand=x}", "robots.yaml:2: robots[0].host: expected"),
        ("robots:\n- {name: a, host: b, user: -l}", "robots.yaml:2: robots[0].user: expected"),
        ("robots:\n- {name: a, host: b, folder: $(x)}", "robots.yaml:2: robots[0].folder: expected"),
        ("robots:\n- {name: a, host: b, folder: a/../../etc}", "robots.yaml:2: robots[0].folder: expected"),
        ("robots:\n- {name: a, host: b, folder: a/..}", "robots.yaml:2: robots[0].folder: expected"),
        ("robots:\n- {name: a, host: b, port: 0}", "robots.yaml:2: robots[0].port: expected"),
        ("robots:\n- {name: a, host: b, prot: 1}", "robots[0].prot: unknown key; did you mean 'port'?"),
        (
            "robots:\n- {name: a, host: b}\n- {name: a, host: c}",
            "robots.yaml:3: robots[1].name: there are two robots a",
        ),
        ("robots:\n- {name: a, host: b}\n- {name: c, host: b}", "robots.yaml:3: robots[1].host: another robot is at"),
        ("robots:\n- {name: a, host: b}\n- {name: c, host: B}", "robots.yaml:3: robots[1].host: another robot is at"),
        (
            "robots:\n- {name: a, host: b, folder: x/y..z}\n- {name: c, host: b, folder: x/.//y..z/}",
            "robots.yaml:3: robots[1].host: another robot is at",
        ),
    ],
)
def test_robots_that_are_none(deploy, field, text, error):
    (field / "robots.yaml").write_text(text)
    code, _, err = deploy("--stop")
    assert (code, error in err) == (3, True), err
    assert not (field / "calls").exists()


def test_a_pfsm_that_is_none(deploy, field):
    (field / "fsm.txt").write_text("--nstates 1 --s0 9")
    assert deploy("fsm.txt")[0] == 3
    assert not (field / "calls").exists()


@pytest.mark.parametrize("header", ["control period: 9", "reference model: {x: 1}"])
def test_a_header_that_no_robot_obeys(deploy, field, header):
    (field / "fsm.txt").write_text(f"# {header}\n{GO}")
    code, out, err = deploy("fsm.txt", "--start", "--without", "lidar")
    assert (code, out) == (3, "")
    assert err.startswith(f"Error: fsm.txt: {header.partition(':')[0]} in the header: ")


@pytest.mark.thorough
def test_logs_of_a_day_that_comes_again_are_kept(deploy, field):
    """A Pi has no clock."""
    (field / "bin/date").write_text("#!/bin/sh\necho 20260101-000000\n")
    (field / "bin/date").chmod(0o755)
    (field / "robots.yaml").write_text("robots: [{name: r1, host: r1}]\n")
    logs = field / "r1/mercator/logs"
    logs.mkdir(parents=True)
    old = {f"run-20260101-000000{number}" for number in (".jsonl", ".txt", "-1.txt")}
    for name in old:
        (logs / name).write_text("old")
    (field / "r1/mercator/robot.yaml").write_text("ports: {rvr: /dev/no_such_port}\n")
    code, out, _ = deploy("fsm.txt", "--start")
    assert (code, "FAILED  r1               Error: rvr: /dev/no_such_port" in out) == (1, True), out
    assert {(logs / name).read_text() for name in old} == {"old"}
    assert {path.name for path in logs.iterdir()} - old == {"run-20260101-000000-2.txt"}


def test_logs_in_a_folder_of_their_own_are_collected_too(deploy, field):
    (field / "robots.yaml").write_text("robots: [{name: r1, host: r1}]\n")
    logs = field / "r1/mercator/logs"
    (logs / "monday").mkdir(parents=True)
    for name in ("run.jsonl", "monday/run.jsonl"):
        (logs / name).write_text(name)
    for _ in range(2):
        assert deploy("--collect", "all") == (0, "ok      r1               2 files in all/r1\n", "")
    assert (field / "all/r1/run.jsonl").read_text() == "run.jsonl"
    assert (field / "all/r1/monday/run.jsonl").read_text() == "monday/run.jsonl"


@pytest.mark.parametrize("folder", ["logs-12:30", "-p"])
def test_a_folder_that_scp_would_take_for_something_else(deploy, field, folder):
    (field / "robots.yaml").write_text("robots: [{name: r1, host: r1}]\n")
    (field / "r1/mercator/logs").mkdir(parents=True)
    (field / "r1/mercator/logs/run.jsonl").write_text("log")
    assert deploy(f"--collect={folder}") == (0, f"ok      r1               1 files in {folder}/r1\n", "")
    assert (field / folder / "r1/run.jsonl").read_text() == "log"


CHANGED = """@@@@@@@@@@@@@@@@@@@@@@@@@@@@@@@@@@@@@@@@@@@@@@@@@@@@@@@@@@@
@    WARNING: REMOTE HOST IDENTIFICATION HAS CHANGED!     @
Offending ED25519 key in /home/me/.ssh/known_hosts:1
  remove with:
  ssh-keygen -f "/home/me/.ssh/known_hosts" -R "[r2]:2222"
Host key for [r2]:2222 has changed and you have requested strict checking.
Host key verification failed.
"""
"""Of OpenSSH 9.2."""


@pytest.mark.parametrize(
    ("said", "words"),
    [
        (CHANGED, "its host key has changed: if it was installed anew, or has the address of another computer, "
         "`ssh-keygen -R '[r2]:2222'`, then log in once by hand: `ssh -p 2222 pi@r2`"),
        ("Host key verification failed.\n", "its host key is not known here: log in once by hand and accept it: "
         "`ssh -p 2222 pi@r2`"),
        ("pi@r2: Permission denied (publickey,password).\n",
         "pi@r2: Permission denied (publickey,password): it accepts no key of yours: `ssh-copy-id -p 2222 pi@r2`"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("program", ["ssh", "scp"])
def test_keys_that_are_not_accepted(deploy, field, program, said, words):
    """What scp says last is no reason: it closes the connection."""
    (field / "said").write_text(said)
    (field / "robots.yaml").write_text("robots: [{name: r2, host: r2, user: pi, port: 2222}]\n")
    last = "" if program == "ssh" else 'echo "scp: Connection closed" >&2; '
    (field / "bin" / program).write_text(f"#!/bin/sh\ncat {field}/said >&2; {last}exit 255\n")
    code, out, _ = deploy("fsm.txt")
    assert (code, out) == (1, f"FAILED  r2               {words}\n")


def test_a_key_that_has_changed_meanwhile(deploy, field):
    """As the check, over another connection, finds."""
    (field / "said").write_text(CHANGED)
    usual = (field / "bin/ssh").rename(field / "bin/usual-ssh")
    (field / "bin/ssh").write_text(
        f'#!/bin/sh\ncase "$*" in *--json*) cat {field}/said >&2; exit 255;; esac\n'
        f"exec {sys.executable} -IS -c \"import sys; sys.argv[0] = 'ssh'; exec(open('{usual}').read())\" \"$@\"\n"
    )
    (field / "bin/ssh").chmod(0o755)
    code, out, _ = deploy("--check")
    assert code == 1
    assert out.count("WRONG  r1: its host key has changed: ") == 1
