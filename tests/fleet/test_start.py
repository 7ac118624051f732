"""All robots begin together, or none: over the ssh of `fakes`, on devices that a test has in hand.

Other failures: tests/test_joint_start.py, without a machine, and tests/robot/test_joint.py, of one robot.
"""

import contextlib
import os
import re
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from tests.fleet.fakes import settings
from tests.processes import LIMIT, wait_until
from tests.robot.devices import Devices
from tests.robot.log_events import read
from tests.robot.ways import ATTEMPTS, LAST, in_time

ROOT = Path(__file__).parents[2]
CYCLE = 0.1

pytestmark = pytest.mark.timing


@pytest.fixture
def robots(field):
    """The devices of r1 and r2."""
    with Devices() as first, Devices() as second:
        for name, devices in (("r1", first), ("r2", second)):
            (field / name / "mercator").mkdir()
            (field / name / "mercator/robot.yaml").write_text(settings(devices))
        yield first, second


def starting(*options):
    """`mdesign deploy --start` as a process of its own."""
    lead = "from mercator_design.robot.protocols import joint_start; joint_start.SILENCE = 60.0\n"
    line = [sys.executable, "-c", f"{lead}from mercator_design.cli import main; main()"]
    return subprocess.Popen(
        [*line, "deploy", "fsm.txt", "--robots", "robots.yaml", "--start", *options],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def is_started_up(devices):
    """Whether a run has told its devices all that it tells them before it is ready, or nearly so."""
    return "scan" in devices.lidar_commands


def rests(devices):
    """It never drove, and was shut down."""
    assert not devices.drives()
    devices.when(lambda: devices.commands[-1][1] == LAST and devices.lidar_commands[-2:] == ["force_stop", "stop"])


def is_idle(home):
    """Whether nothing runs there."""
    line = ["flock", "-n", home / "mercator/lock", "true"]
    return subprocess.run(line, check=False).returncode == 0


def kill(field, name, number=signal.SIGKILL):
    os.kill(int((field / name / "mercator/pid").read_text()), number)


def test_they_begin_within_a_control_cycle_and_their_logs_can_be_put_side_by_side(deploy, robots, field):
    in_time(lambda _: they_begin(deploy, robots, field))


def they_begin(deploy, robots, field):
    before = [len(devices.wheels) for devices in robots]
    code, out, err = deploy("fsm.txt", "--start", "--duration", "0.5")
    assert code == 0, (out, err)
    spread, unsure = map(float, re.fullmatch(r"All 2 began within (\S+) ms, give or take (\S+) ms\n", err).groups())
    assert spread + unsure <= 1000 * CYCLE + 0.1  # as they are rounded
    assert len(re.findall(r"runs, logs/run-\S+.jsonl; began \S+ ms after the first; its clock is 0.\d+ s", out)) == 2
    for devices in robots:
        devices.when(devices.is_let_go)
    assert deploy("--collect", "all")[0] == 0
    newest = [max((field / "all" / name).glob("*.jsonl")) for name in ("r1", "r2")]
    starts = [next(read(log)) for log in newest]
    assert {start["clock"]["reference"] for start in starts} == {os.uname().nodename}
    for start in starts:  # of the same clock
        assert abs(start["clock"]["ahead"]) <= start["clock"]["uncertainty"] + 0.05, "too busy?"
    driven = [devices.wheels[known:] for devices, known in zip(robots, before, strict=True)]
    begins = [min(when for when, left, _ in wheels if left) for wheels in driven]
    assert abs(begins[0] - begins[1]) < 1.0, "too busy?"


def test_if_one_is_not_ready_none_moves_and_the_reason_is_reported(deploy, robots, field):
    (field / "r2/mercator/robot.yaml").write_text("ports: {rvr: /dev/no_such_port}\n")
    code, out, err = deploy("fsm.txt", "--start")
    assert (code, err.startswith("Error: no robot runs: r2: Error: rvr: /dev/no_such_port: no such port")) == (1, True)
    r1, r2 = out.splitlines()[2:]
    assert r1.startswith("FAILED  r1               Error: the start was called off: r2: Error: rvr: /dev/no_such_port")
    assert r2.startswith("FAILED  r2               Error: rvr: /dev/no_such_port: no such port")
    rests(robots[0])
    assert all(is_idle(field / name) for name in ("r1", "r2"))


def test_they_start_without_a_device_that_the_pfsm_does_not_need(deploy, robots, field):
    """Else it is refused before anything is copied."""
    for devices in robots:
        devices.unplugged.add("lidar")
    code, _, err = deploy("fsm.txt", "--start", "--without", "lidar")
    assert (code, "Error: --without lidar: the PFSM reads neighbours, which needs the lidar\n" in err) == (2, True)
    assert not (field / "calls").exists()
    (field / "fsm.txt").write_text("--nstates 1 --s0 0 --rwm0 20\n")
    for _ in range(ATTEMPTS):
        code, out, err = deploy("fsm.txt", "--start", "--duration", "0.5", "--without", "lidar")
        if "too busy?" not in err:  # refused, as it should be
            break
    assert code == 0, (out, err)
    for devices in robots:
        devices.when(devices.is_let_go)
        assert devices.drives()
        assert devices.lidar_commands == []
    (start, *_) = read(max((field / "r1/mercator/logs").glob("*.jsonl")))
    assert start["without"] == ["lidar"]


@pytest.mark.thorough
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_if_one_is_killed_before_the_start_none_moves(deploy, robots, field, number):
    def act():
        robots[1].when(lambda: is_started_up(robots[1]))
        kill(field, "r2", number)

    killing = threading.Thread(target=act)
    killing.start()
    code, out, err = deploy("fsm.txt", "--start")
    killing.join()
    assert (code, "Error: no robot runs: r2: " in err) == (1, True), (out, err)
    assert "r1               Error: the start was called off: r2: " in out
    rests(robots[0])
    assert not robots[1].drives()


@pytest.mark.thorough
def test_if_who_starts_them_is_killed_none_moves_and_none_stays_armed(robots, field):
    with starting() as leader:
        for devices in robots:
            devices.when(lambda devices=devices: is_started_up(devices))
        leader.kill()
        leader.communicate()
    for devices in robots:
        rests(devices)
    wait_until(lambda: all(is_idle(field / name) for name in ("r1", "r2")))
    for name in ("r1", "r2"):
        (said,) = (field / name / "mercator/logs").glob("*.txt")
        assert "the connection to the computer that starts the robots has ended" in said.read_text()


@pytest.mark.thorough
def test_a_person_who_interrupts_the_start(robots, field):
    with starting() as leader:
        for devices in robots:
            devices.when(lambda devices=devices: is_started_up(devices))
        leader.send_signal(signal.SIGINT)
        _, err = leader.communicate(timeout=LIMIT)
    assert (leader.returncode, err.strip()) == (130, "Interrupted.")
    for name, devices in zip(("r1", "r2"), robots, strict=True):
        rests(devices)
        assert is_idle(field / name)  # it was waited for
        (said,) = (field / name / "mercator/logs").glob("*.txt")
        assert "Error: the start was called off: interrupted\n" in said.read_text()


@pytest.mark.thorough
def test_one_that_is_late_stops_the_others(deploy, robots, field):
    """By more than a control cycle: it does not drive, and who has begun is stopped."""
    python = field / "bin/python3"
    late = """from mercator_design.robot.run import joint
if "run" in sys.argv and Path.cwd().parent.name == "r2":
    robot.begin = begin
    joint.AwaitedStart.wait = lambda joint, control, due=joint.AwaitedStart.due: control.wait(due(joint) + 0.3)
"""
    python.write_text(python.read_text().replace("del sys", f"from pathlib import Path\n{late}del sys"))
    code, out, err = deploy("fsm.txt", "--start", "--duration", "60")
    assert (code, bool(re.match(r"Error: no robot runs: r2: the start is late by \d\.\d\d s: is this", err))) == (
        1,
        True,
    )
    assert not robots[1].drives()
    first = robots[0]
    with contextlib.suppress(AssertionError):
        assert first.rests_since() - min(when for when, left, _ in first.wheels if left) < 2.0
    assert first.commands[-1][1] == LAST
    assert "Error: the start was called off: r2: the start is late by" in out


@pytest.mark.thorough
def test_one_that_cannot_be_reached_any_more_is_stopped_over_another_connection(deploy, robots, field):
    """Its ssh has ended by itself, and the run there goes on waiting."""
    ssh = field / "bin/ssh"
    ssh.write_text(
        ssh.read_text().replace(
            'os.execvp("sh"',
            """if host == "r2" and "--await-start" in words[-1]:
        import subprocess
        from pathlib import Path
        streams = {"stdin": subprocess.PIPE, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        child = subprocess.Popen(["sh", "-c", " ".join(words[1:])], start_new_session=True, **streams)
        while not Path("mercator/pid").exists():
            time.sleep(0.05)
        time.sleep(0.5)
        subprocess.Popen(["sleep", "60"], stdout=child.stdin, stderr=subprocess.DEVNULL)  # nobody hangs up
        sys.exit(255)
    os.execvp("sh\"""",
        )
    )
    code, out, err = deploy("fsm.txt", "--start")
    assert (code, "no robot runs: r2: " in err) == (1, True), (out, err)
    assert "; over another connection: stopped" in out
    for devices in robots:
        assert not devices.drives()
    assert all(is_idle(field / name) for name in ("r1", "r2"))
