"""What is wrong with any of the robots: over the ssh of `fakes`, on devices that a test has in hand."""

import fcntl
import json
import re
import subprocess
import time

import pytest

from mercator_design.fleet.check import COLUMNS
from mercator_design.robot.protocols.clocks import from_line, probe
from tests.fleet.fakes import settings
from tests.robot.devices import Devices
from tests.tiers import some


@pytest.fixture
def robots(field):
    """The devices of r1 and r2."""
    with Devices() as first, Devices() as second:
        for name, devices in (("r1", first), ("r2", second)):
            (field / name / "mercator").mkdir()
            (field / name / "mercator/robot.yaml").write_text(settings(devices))
        yield first, second


def cells(row):
    return re.split(r" {2,}", row)


@pytest.mark.thorough
def test_a_table_of_batteries_lines_and_clocks_and_what_is_wrong(deploy, robots, field):
    """The program is copied first; an fsm.txt is not needed."""
    robots[1].rvr.level = 9.0
    robots[1].unplugged.add("lidar")
    code, out, err = deploy("--check")
    head, *rows = out.splitlines()[2:]
    assert cells(head) == ["robot", *COLUMNS, "clock"]
    first, second = map(cells, rows[:2])
    assert first[:2] == ["r1", "87 %"]
    assert all(re.fullmatch(r"\d+\.\d % arrives whole( WRONG)?", cell) for cell in first[2:5]), first
    assert second[:2] == ["r2", "9 % WRONG"]
    assert second[3] == "not found WRONG"
    for row in (first, second):
        ahead, uncertainty = re.fullmatch(r"(\d\.\d+) s (?:ahead|behind), give or take (\S+) ms", row[-1]).groups()
        assert float(ahead) <= 0.001 * (float(uncertainty) + 1.0)  # it is the same clock
    told = [row for row in rows[2:] if "r2" in row]
    assert any(re.fullmatch(r"WRONG  r2: battery: 9 %; .*charge it", row) for row in told), told
    assert any(row.startswith("WRONG  r2: lidar: ") and "no such port" in row for row in told), told
    assert (code, bool(re.fullmatch(r"Error: \d of 2 robots failed the check\n", err))) == (1, True)
    assert not any(devices.drives() for devices in robots)


@pytest.mark.thorough
def test_a_device_that_is_left_out_is_not_looked_at(deploy, robots, field):
    for devices in robots:
        devices.unplugged.add("lidar")
    _, out, _ = deploy("--check", "--without", "lidar")
    rows = [cells(row) for row in out.splitlines()[3:5]]
    assert [(row[0], row[3]) for row in rows] == [("r1", "left out"), ("r2", "left out")]
    assert "lidar:" not in out
    assert not any(devices.lidar_commands for devices in robots)


@pytest.mark.thorough
def test_nothing_starts_if_something_is_wrong(deploy, robots, field):
    robots[1].rvr.level = 9.0
    code, out, _ = deploy("fsm.txt", "--check", "--start")
    assert (code, "9 % WRONG" in out) == (1, True)
    assert not list(field.glob("*/mercator/logs"))


def test_a_robot_that_runs_is_not_checked(deploy, field):
    """Its ports are in use, and questions would disturb it."""
    (field / "robots.yaml").write_text("robots: [{name: r1, host: r1}]\n")
    assert deploy("fsm.txt")[0] == 0
    with (field / "r1/mercator/lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        code, out, _ = deploy("--check")
    assert (code, out.count("a run is in progress; end it first")) == (1, 1)


def test_robots_that_cannot_be_looked_at(deploy, field):
    python = field / "bin/python3"
    python.write_text(
        '#!/bin/sh\ncase "$*" in *version*) echo 1; exit 0;; esac\n[ ${PWD##*r1/*} ] || sleep 60\nexit 7\n'
    )
    for seconds in (2, 10, 50):  # r2 may need long on a busy machine
        code, out, err = deploy("--check", "--timeout", seconds)
        rows = out.splitlines()[3:]
        if "WRONG  r2: ssh: exit code 7" in rows:
            break
    assert [cells(row) for row in rows[:2]] == [[name, *["?"] * 5] for name in ("r1", "r2")]
    assert rows[2:] == [f"WRONG  r1: not done after {seconds} s", "WRONG  r2: ssh: exit code 7"]
    assert (code, err) == (1, "Error: 2 of 2 robots failed the check\n")


def test_findings_as_lines_of_json(robots, field):
    """For other programs; the clock is told to who asks."""
    home = field / "r1/mercator"
    line = ["python3", "-m", "mercator_design.robot", "check", "--json", "--robot", home / "robot.yaml"]
    line[1:3] = [field / "check.py"]
    (field / "check.py").write_text("from mercator_design.robot.cli import main; main()")
    with subprocess.Popen(line, stdin=-1, stdout=-1, stderr=subprocess.DEVNULL, text=True) as process:
        sent = time.monotonic()
        process.stdin.write(f"Hello!\n{probe(sent)}")
        process.stdin.flush()
        said = [json.loads(line) for line in process.stdout]
    (clock,) = [each for each in said if each["say"] == "clock"]
    assert clock["sent"] == sent
    assert sent <= clock["monotonic"] <= time.monotonic()
    found = {each["what"]: each for each in said if each["say"] == "finding"}
    assert {"clock", "battery", "lidar's turns", "rvr's line", "lidar's line", "proximity's line"} <= found.keys()
    assert set(COLUMNS.values()) <= {(each["device"], each["quantity"]) for each in found.values()}
    assert found["battery"]["words"] == "87 %"
    assert all(from_line(json.dumps(each).encode()) for each in said)


@pytest.mark.swept
@pytest.mark.parametrize("ends", some(["exit 137", "kill -9 $$", "exit 255"], 1))
def test_a_check_that_breaks_off_is_reported(deploy, field, ends):
    """What was not looked at is not fine, though all that was is."""
    finding = '{"say": "finding", "what": "clock", "is_fine": true, "words": "12:00"}'
    python = field / "bin/python3"
    python.write_text(f"#!/bin/sh\ncase \"$*\" in *version*) echo 1; exit 0;; esac\necho '{finding}'\n{ends}\n")
    code, out, err = deploy("--check")
    assert [row.partition(":")[0] for row in out.splitlines()[5:]] == ["WRONG  r1", "WRONG  r2"], out
    assert (code, err) == (1, "Error: 2 of 2 robots failed the check\n")


@pytest.mark.swept
@pytest.mark.parametrize(
    ("finding", "n", "words"),
    some(
        [
            ('"words": "12:00", "device": ["rvr"]', 1, "its check sends what is no finding: finding.device: expected"),
            ('"words": 12', 1, "its check sends what is no finding: finding.words: expected text, found 12"),
            ('"words": "12:00"', 101, "its check has more than 100 findings"),
        ],
        1,
    ),
)
def test_findings_that_no_check_has(deploy, field, finding, n, words):
    finding = f'{{"say": "finding", "what": "clock", "is_fine": true, {finding}}}'
    said = "\n".join([*[finding] * n, '{"say": "done"}'])
    python = field / "bin/python3"
    python.write_text(f"#!/bin/sh\ncase \"$*\" in *version*) echo 1; exit 0;; esac\ncat <<'END'\n{said}\nEND\n")
    code, out, err = deploy("--check")
    assert (code, out.count(f"WRONG  r1: {words}")) == (1, 1), (out, err)


def test_what_a_person_has_to_judge_is_shown_and_prevents_no_start(deploy, field):
    """As a clock that NTP cannot reach: the start is tried."""
    finding = '{"say": "finding", "what": "clock", "is_fine": true, "is_unclear": true, "words": "12:00 was not set"}'
    python = field / "bin/python3"
    python.write_text(
        f"#!/bin/sh\ncase \"$*\" in *version*) echo 1; exit 0;; *check*) echo '{finding}'; "
        "echo '{\"say\": \"done\"}'; exit 0;; esac\necho '- no run here -' >&2; exit 7\n"
    )
    code, out, err = deploy("fsm.txt", "--check", "--start")
    assert out.count("look   r1: clock: 12:00 was not set\n") == 1
    assert "WRONG" not in out
    assert (code, "failed the check" in err, "no robot runs" in err) == (1, False, True), (out, err)
