"""Turns of the lidar and odometry in the log of a run, in simulated time in a twin's arena."""

import io
import json
from datetime import datetime

import numpy as np
import pytest
from mcap.reader import make_reader

from mercator_design.errors import RobotError
from mercator_design.mapping.poses import interpolate
from mercator_design.mapping.readers.robot_logs import read_robot_log
from mercator_design.robot.logs.events import TurnTaken
from mercator_design.robot.logs.log import Log, read, replay
from mercator_design.robot.logs.turns import packets_of, readings_of
from mercator_design.robot.protocols.ydlidar import Packet, PacketTurns, Turns
from mercator_design.show.files.robot_logs import write_mcap
from tests.robot.simulated import START, SimulatedDevices, SimulatedRun
from tests.twin.arenas import arena

pytestmark = pytest.mark.together("kernels")  # compiled once

SECONDS = 8.0
WALL = 1.0  # [m] from the middle
ROOM = (f"arena.walls={{shape: regular_polygon, sides: 4, apothem: {WALL}}}", "arena.wall_height=0.3")


class InAnArena(SimulatedDevices):
    """Devices of the robot in a twin's arena; `truth` has the time [s] and the true pose in each tick."""

    def __init__(self, inner):
        self.inner, self.truth = inner, []
        super().__init__()

    def step(self, treads):
        self.inner.step(treads)
        self.ticks = self.inner.ticks
        self.truth.append((START + self.ticks * self.inner.period, *self.inner.poses[0]))

    def measure(self, robot, device):
        return self.inner.measure(robot, device)

    def scan(self, robot, time):
        return self.inner.scan(robot, time)


@pytest.fixture(scope="module")
def runs():
    """What the first test has recorded, for all."""
    return []


@pytest.fixture
def run(runs, robot_command, tmp_path, monkeypatch):
    """The log of a robot among walls, in the current folder; when it begins [s], and times and true poses."""
    monkeypatch.chdir(tmp_path)
    if not runs:
        began, begin = [], Log.begin

        def begin_and_keep(log, start):
            begin(log, start)
            began.append(log.began)

        monkeypatch.setattr(Log, "begin", begin_and_keep)
        with InAnArena(arena((0.2, -0.3, 0.4), overrides=ROOM)) as devices:
            robot = SimulatedRun(devices, robot_command, tmp_path)
            robot.run("--nstates 1 --s0 0 --rwm0 20\n", "--duration", SECONDS)
            code, _ = robot.ended()
            assert code == 0
            runs.append(((tmp_path / "log.jsonl").read_bytes(), began[0], np.array(devices.truth)))
    data, *rest = runs[0]
    (tmp_path / "log.jsonl").write_bytes(data)
    return rest


def test_beams_meet_the_walls_from_where_the_robot_was_at_their_times(run, tmp_path):
    began, truth = run
    log = read_robot_log(tmp_path / "log.jsonl")
    since = datetime.fromisoformat(next(read(tmp_path / "log.jsonl")).time).timestamp()
    assert len(log.turns) > 0.85 * SECONDS * 5000 / 719
    off, turning = [], []
    for turn in log.turns:
        times = turn.times - since + began
        x, y, heading = interpolate(truth[:, 0], truth[:, 1:], times).T
        seen = turn.ranges > 0.0
        ends = np.abs(
            [x + turn.ranges * np.cos(heading + turn.angles), y + turn.ranges * np.sin(heading + turn.angles)]
        )
        off.append(np.abs(ends.max(axis=0) - WALL)[seen])
        turning.append(abs(heading[-1] - heading[0]) / (times[-1] - times[0]))
    assert max(turning) > 3.0  # [rad/s]
    assert np.median(np.concatenate(off)) < 0.003
    assert np.quantile(np.concatenate(off), 0.99) < 0.03  # 7 ms late while it turns is 3 cm


def test_times_of_turns_are_their_own(run, tmp_path):
    log = read_robot_log(tmp_path / "log.jsonl")
    for turn, following in zip(log.turns, log.turns[1:], strict=False):
        assert (np.diff(turn.times) >= 0.0).all()
        assert turn.times[-1] < following.times[0] + 0.005
        assert turn.times[-1] - turn.times[0] == pytest.approx(718 / 5000, rel=0.03)
    turns = [event for event in read(tmp_path / "log.jsonl") if isinstance(event, TurnTaken)]
    for turn in turns:
        assert turn.packets[-1][0] == 0  # the last packet has the time of the turn
        assert [time for _, time in packets_of(turn)][-1] == turn.time
        assert len(readings_of(turn, 0.0)) == sum(samples for *_, samples in turn.packets)


def test_odometry_comes_every_50_ms(run, tmp_path):
    began, truth = run
    log = read_robot_log(tmp_path / "log.jsonl")
    since = datetime.fromisoformat(next(read(tmp_path / "log.jsonl")).time).timestamp()
    assert np.diff(log.odometry_times).max() < 0.075
    assert np.median(np.diff(log.odometry_times)) == pytest.approx(0.05, abs=0.005)
    poses = interpolate(truth[:, 0], truth[:, 1:], log.odometry_times - since + began)
    yaws, headings = log.odometry[:, 2] - log.odometry[0, 2], poses[:, 2] - poses[0, 2]
    assert np.abs(yaws - headings).max() < 0.2  # 4 rad/s, up to 30 ms late
    way = np.hypot(*np.diff(log.odometry[:, :2], axis=0).T).sum()
    assert way == pytest.approx(np.hypot(*np.diff(truth[:, 1:3], axis=0).T).sum(), rel=0.1)


def test_turns_of_a_minute_take_at_most_1500_kb(run, tmp_path):
    lines = (tmp_path / "log.jsonl").read_bytes().splitlines(keepends=True)
    size = sum(len(line) for line in lines if line.startswith(b'{"event":"turn"'))
    assert 0.9e6 < size * 60.0 / SECONDS < 1.5e6


def test_an_mcap_file_has_the_turns(run, tmp_path):
    file = io.BytesIO()
    write_mcap(tmp_path / "log.jsonl", file)
    found = [message.data for *_, message in make_reader(io.BytesIO(file.getvalue())).iter_messages(topics=["/lidar"])]
    assert len(found) == len([event for event in read(tmp_path / "log.jsonl") if isinstance(event, TurnTaken)])
    ranges = np.array(json.loads(found[0])["ranges"])
    assert 600 < np.count_nonzero(ranges) <= 719
    assert 0.5 < np.median(ranges[ranges > 0.0]) < 2.0


def test_decisions_replay_as_before(run, tmp_path):
    decisions = [decision for _, decision in replay(tmp_path / "log.jsonl")]
    assert len(decisions) == SECONDS / 0.1
    assert {decision.differs for decision in decisions} == {""}


def test_a_turn_has_the_readings_of_its_packets():
    packets = [
        Packet(64 * k, 64 * k + 3900, (0, *range(4000 + k, 4040 + k)), is_ring_start=k == 0) for k in range(0, 360, 62)
    ]
    turns, of_packets = Turns(), PacketTurns()
    for k, packet in enumerate([*packets, packets[0]]):
        points, ended = turns.receive(packet), of_packets.receive(packet, 0.008 * k)
    assert [packet for packet, _ in ended] == packets
    assert [time for _, time in ended] == pytest.approx([0.008 * k for k in range(6)])
    assert [point for packet, _ in ended for point in packet.points()] == points


class TestLogsThatAreNotFit:
    def test_a_run_without_its_lidar(self, run, tmp_path):
        path, lines = tmp_path / "log.jsonl", (tmp_path / "log.jsonl").read_bytes().splitlines(keepends=True)
        path.write_bytes(b"".join(line for line in lines[:20] if not line.startswith(b'{"event":"turn"')))
        with pytest.raises(RobotError, match=r"log\.jsonl(: expected turns of the lidar, found none|, line \d+: )"):
            read_robot_log(path)

    @pytest.mark.parametrize("part", [0.3, 0.5, 0.9])
    def test_a_log_that_was_cut_off_has_the_turns_before(self, run, tmp_path, part):
        path = tmp_path / "log.jsonl"
        whole, data = len(read_robot_log(path).turns), path.read_bytes()
        path.write_bytes(data[: int(part * len(data))])
        assert 0.5 * part * whole < len(read_robot_log(path).turns) < whole

    def test_garbage(self, tmp_path):
        for data in (b"", b"\0" * 1000, b"{}\n", b"FLASER 3 1 2 3 0 0 0 0 0 0 0 x 0\n"):
            (tmp_path / "log.jsonl").write_bytes(data)
            with pytest.raises(RobotError, match=r"log\.jsonl"):
                read_robot_log(tmp_path / "log.jsonl")
