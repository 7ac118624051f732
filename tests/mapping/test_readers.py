"""Readers of traces, bags and robots' recordings: what comes back, and what is said of files that are not fit."""

import contextlib
import math
import os
import random
import zipfile

import numpy as np
import pytest

from mercator_design.errors import MercatorError
from mercator_design.fsm import parse
from mercator_design.mapping.readers.bags import Topics, is_bag, read_bag
from mercator_design.mapping.readers.reading import LidarOptions, read_logs
from mercator_design.mapping.readers.robot_logs import read_robot_log
from mercator_design.mapping.readers.simulation import logs_of
from mercator_design.mapping.readers.traces import read_trace_logs
from mercator_design.missions.mission import load_mission
from mercator_design.robot.logs.events import RecordingStarted, SampleTaken, TurnTaken
from mercator_design.robot.logs.log import Log
from mercator_design.show.text.recording import write_recording
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.simulate import Simulator

pytestmark = pytest.mark.together("kernels")  # compiled once


@pytest.fixture(scope="module")
def outcome():
    simulator = Simulator(load_mission("map_dodecagon", ["duration=3"]), load_robot_model("mercator-drifting"))
    return simulator.run(parse("--nstates 1 --s0 0 --rwm0 20"), 1)


@pytest.fixture(scope="module")
def logs(outcome):
    return logs_of(outcome.recording, outcome.trace.walls)


@pytest.fixture
def trace(outcome, tmp_path):
    with (tmp_path / "trace.npz").open("wb") as file:
        write_recording(file, outcome.trace, [], every=1, suffix=".npz", turns=outcome.recording)
    return tmp_path / "trace.npz"


def assert_same(found, expected, *, exact=1e-6):
    assert len(found.turns) == len(expected.turns)
    for one, other in zip(found.turns, expected.turns, strict=True):
        for name in ("times", "angles", "ranges"):
            assert getattr(one, name) == pytest.approx(getattr(other, name), abs=exact), name
    assert found.odometry_times == pytest.approx(expected.odometry_times, abs=exact)
    assert found.odometry == pytest.approx(expected.odometry, abs=exact)


class TestTraces:
    def test_all_robots_with_their_true_poses(self, trace, logs, outcome):
        found = read_trace_logs(trace)
        assert [log.name for log in found] == ["robot 0", "robot 1", "robot 2"]
        for log, expected in zip(found, logs, strict=True):
            assert_same(log, expected)
        assert np.array_equal(found[1].truth, outcome.trace.poses[1:, 1])
        assert found[0].start is None
        walls = outcome.trace.walls
        assert len(found[0].walls) == np.count_nonzero(walls.is_open) > 50
        assert np.array_equal(found[0].walls, logs[0].walls)
        assert np.hypot(*(found[0].walls[:, 2:] - found[0].walls[:, :2]).T).max() <= 0.1 + 1e-9
        mounted = read_trace_logs(trace, np.array([0.1, 0.0, 0.5]))
        assert mounted[0].lidar_pose.tolist() == [0.1, 0.0, 0.5]

    def test_a_trace_without_turns(self, outcome, tmp_path):
        with (tmp_path / "t.npz").open("wb") as file:
            write_recording(file, outcome.trace, [], every=1, suffix=".npz")
        with pytest.raises(
            MercatorError, match=r"t\.npz: expected the arrays .*missing: turn_.*record it with --turns"
        ):
            read_trace_logs(tmp_path / "t.npz")

    @pytest.mark.parametrize(
        ("name", "change", "words"),
        [
            ("turn", lambda a: a[:, :2], r"turn_start: expected numbers \(\d+, 3\)|turn: expected numbers"),
            ("turn", lambda a: np.full_like(a, np.nan), "turn: expected finite numbers in 3 dimensions"),
            ("pose", lambda a: a[..., 0], "pose: expected finite numbers in 3 dimensions, found 2 of float64"),
            ("odometry_time", lambda a: a[::-1], "odometry_time: expected times that rise"),
            ("odometry", lambda a: a.astype(str), "odometry: expected finite numbers in 3 dimensions, found 3 of <U"),
            ("pose", lambda a: a[:0], "expected numbers"),
            ("wall", lambda a: a[:, :3], r"wall: expected numbers \(walls, 4\), found \(\d+, 3\)"),
        ],
    )
    def test_arrays_that_do_not_fit(self, trace, name, change, words):
        with np.load(trace) as file:
            arrays = dict(file)
        np.savez(trace, **arrays | {name: change(arrays[name])})
        with pytest.raises(MercatorError, match=words):
            read_trace_logs(trace)


def test_garbage_is_no_trace(trace):
    whole, draw = trace.read_bytes(), random.Random(3)
    damaged = [b"", b"PK", whole[:100], whole[: len(whole) // 2], whole[:-30], bytes(draw.randbytes(2000))]
    for _ in range(10):
        at = draw.randrange(len(whole))
        damaged.append(whole[:at] + bytes([whole[at] ^ 0x55]) + whole[at + 1 :])
    for data in damaged:
        trace.write_bytes(data)
        with contextlib.suppress(MercatorError):  # a flipped bit may be of a checksum's own
            read_trace_logs(trace)
    with zipfile.ZipFile(trace, "w") as archive:
        archive.writestr("turn.npy", b"x")
    with pytest.raises(MercatorError, match=r"missing: time, .*; is it damaged\?"):
        read_trace_logs(trace)


rosbags = pytest.importorskip("rosbags")


def messages(store, logs, stamp, ends=("scan", "odom"), reach=12.0):
    """The topics, types, times and messages of logs."""
    types = store.types
    scan, odometry = types["sensor_msgs/msg/LaserScan"], types["nav_msgs/msg/Odometry"]

    def header(time):
        return types["std_msgs/msg/Header"](stamp=stamp(time), frame_id="laser", **({"seq": 0} if has_numbers else {}))

    has_numbers = "seq" in types["std_msgs/msg/Header"].__annotations__  # ROS 1
    for number, log in enumerate(logs):
        for turn in log.turns:
            n = len(turn.times)
            yield (
                f"/robot{number}/{ends[0]}",
                scan,
                float(turn.times[0]),
                scan(
                    header=header(float(turn.times[0])),
                    angle_min=float(turn.angles[0]),
                    angle_max=float(turn.angles[-1]),
                    angle_increment=float(turn.angles[-1] - turn.angles[0]) / (n - 1),
                    time_increment=float(turn.times[-1] - turn.times[0]) / (n - 1),
                    scan_time=0.14,
                    range_min=0.12,
                    range_max=reach,
                    ranges=np.where(turn.ranges > 0.0, turn.ranges, np.inf).astype(np.float32),
                    intensities=np.zeros(0, dtype=np.float32),
                ),
            )
        for time, (x, y, heading) in zip(log.odometry_times.tolist(), log.odometry.tolist(), strict=True):
            at = types["geometry_msgs/msg/Pose"](
                position=types["geometry_msgs/msg/Point"](x=x, y=y, z=0.0),
                orientation=types["geometry_msgs/msg/Quaternion"](
                    x=0.0, y=0.0, z=math.sin(0.5 * heading), w=math.cos(0.5 * heading)
                ),
            )
            zero = types["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0)
            yield (
                f"/robot{number}/{ends[1]}",
                odometry,
                time,
                odometry(
                    header=header(time),
                    child_frame_id="base",
                    pose=types["geometry_msgs/msg/PoseWithCovariance"](pose=at, covariance=np.zeros(36)),
                    twist=types["geometry_msgs/msg/TwistWithCovariance"](
                        twist=types["geometry_msgs/msg/Twist"](linear=zero, angular=zero), covariance=np.zeros(36)
                    ),
                ),
            )


BEGIN = 1_700_000_000.0
"""[s] of the clock of the bags."""


def write_bag(path, logs, version, **options):
    """A bag of ROS 1 or 2 with all topics of logs."""
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)

    def stamp(time):
        whole = math.floor(BEGIN + time)
        kind = store.types["builtin_interfaces/msg/Time"]
        return kind(sec=whole, nanosec=round(1e9 * (BEGIN + time - whole)) % 10**9)

    writer = rosbag1.Writer(path) if version == 1 else rosbag2.Writer(path, version=9)
    serialize = store.serialize_ros1 if version == 1 else store.serialize_cdr
    with writer:
        connections = {}
        for topic, kind, time, message in sorted(messages(store, logs, stamp, **options), key=lambda each: each[2]):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind.__msgtype__, typestore=store)
            writer.write(connections[topic], round(1e9 * (BEGIN + time)), serialize(message, kind.__msgtype__))
    return path


@pytest.fixture
def shifted(logs):
    """The first two logs, at times after that of a bag's beginning."""
    return logs[:2]


@pytest.mark.parametrize(("version", "name"), [(1, "swarm.bag"), (2, "swarm")])
def test_a_bag_of_ros(tmp_path, shifted, version, name):
    path = write_bag(tmp_path / name, shifted, version)
    assert is_bag(path)
    found = read_bag(path, np.array([0.0, 0.0, 0.1]))
    assert [log.name for log in found] == ["robot0", "robot1"]
    for log, expected in zip(found, shifted, strict=True):
        assert log.lidar_pose.tolist() == [0.0, 0.0, 0.1]
        assert len(log.turns) == len(expected.turns)
        for one, other in zip(log.turns, expected.turns, strict=True):
            assert one.times - BEGIN == pytest.approx(other.times, abs=1e-5)
            assert one.angles == pytest.approx(other.angles, abs=1e-4)
            assert one.ranges == pytest.approx(other.ranges, abs=1e-5)
        assert log.odometry_times - BEGIN == pytest.approx(expected.odometry_times, abs=1e-6)
        assert log.odometry == pytest.approx(expected.odometry, abs=1e-6)


@pytest.mark.parametrize(("version", "name"), [(1, "swarm.bag"), (2, "swarm")])
def test_a_damaged_bag(tmp_path, shifted, version, name):
    path = write_bag(tmp_path / name, shifted, version)
    file = path if version == 1 else next(path.glob("*.db3"))
    whole, draw = file.read_bytes(), random.Random(3)
    for part in (0.0, 0.001, 0.1, 0.5, 0.99):
        file.write_bytes(whole[: int(part * len(whole))])
        with pytest.raises(MercatorError, match=r"swarm(\.bag)?: expected "):
            read_bag(path)
    file.write_bytes(draw.randbytes(3000))
    with pytest.raises(MercatorError, match=r"swarm(\.bag)?: expected a bag of ROS 1 or 2, found "):
        read_bag(path)


@pytest.mark.parametrize(("version", "name"), [(1, "swarm.bag"), (2, "swarm")])
def test_a_bag_with_other_topics_and_a_wide_lidar(tmp_path, shifted, version, name):
    path = write_bag(tmp_path / name, shifted, version, ends=("base/laser", "wheels"), reach=30.0)
    found = read_bag(path, ends=Topics("/base/laser", "wheels"))
    assert [log.name for log in found] == ["robot0", "robot1"]
    assert [log.max_range for log in found] == [30.0, 30.0]
    with pytest.raises(MercatorError, match=r"expected topics /scan .* and /odom .*; --scan and --odom name others"):
        read_bag(path)
    (log, _) = read_logs([path], LidarOptions(topics=Topics("base/laser", "wheels"), max_range=5.0, head_radius=0.1))
    assert (log.max_range, log.head_radius) == (5.0, 0.1)


def test_a_bag_without_odometry_tells_its_topics(tmp_path, shifted):
    import dataclasses

    only_scans = [dataclasses.replace(shifted[0], odometry_times=np.zeros(0), odometry=np.zeros((0, 3)))]
    path = write_bag(tmp_path / "swarm.bag", only_scans, 1)
    with pytest.raises(
        MercatorError, match=r"expected topics /scan .* found /robot0/scan \(sensor_msgs/msg/LaserScan\)"
    ):
        read_bag(path)


def test_without_the_library_a_sentence_says_what_to_install(monkeypatch, tmp_path):
    import sys

    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(MercatorError, match=r"expected the package rosbags, found none: .*pip install '\.\[map\]'"):
        read_bag(tmp_path / "x.bag")


class TestRecordings:
    """Of `mercator-robot record` and `teleop`, also of an earlier version."""

    @pytest.mark.parametrize("has_packets", [True, False])
    def test_times_of_beams_follow_from_their_angles(self, tmp_path, has_packets):
        turn, beams = 719 / 5000, 719
        path = tmp_path / "r.jsonl"
        with Log(path) as log:
            log.begin(RecordingStarted(robot="one", lidar_angle=0.2))
            for k in range(20):
                log.note(SampleTaken(time=0.05 * k, sensor="attitude", values=(0.0, 0.0, 0.1 * k)))
                log.note(SampleTaken(time=0.05 * k, sensor="position", values=(0.01 * k, 0.0)))
            for n in range(5):
                clockwise = 2 * math.pi * np.arange(beams) / beams
                readings = tuple(((0.2 - angle) % (2 * math.pi), 0.0) for angle in clockwise.tolist())
                end = round(0.3 + (n + 1) * turn, 4)
                packets = (
                    tuple(
                        (round(1e4 * (turn - (k + count) / 5000)), 0, 0, count)
                        for k, count in [(0, 1), *((1 + 40 * i, 40) for i in range(17)), (681, 38)]
                    )
                    * has_packets
                )
                late = 0.0 if has_packets else 0.008
                log.note(TurnTaken(time=round(end + late, 4), readings=readings, packets=packets))
        found = read_robot_log(path)
        assert found.name == "one"
        assert found.odometry[:, 2] == pytest.approx(0.1 * np.arange(20))
        begin = found.odometry_times[0]
        for n, one in enumerate(found.turns):
            expected = 0.3 + (n + np.arange(beams) / beams) * turn
            assert one.times - begin == pytest.approx(expected, abs=0.002)
            assert np.sin(one.angles + 2 * math.pi * np.arange(beams) / beams) == pytest.approx(0.0, abs=1e-4)
        assert found.lidar_pose.tolist() == [0.0, 0.0, 0.2]
        assert read_robot_log(path, np.zeros(3)).lidar_pose.tolist() == [0.0, 0.0, 0.0]

    def stalled(self, path, lost=(), yaws=None):
        """A recording whose program was stalled from 0.6 s to 1.0 s, and then read what had come."""
        turn, beams, counts = 719 / 5000, 719, [1, *[40] * 17, 38]
        clockwise = 2 * math.pi * np.arange(beams) / beams
        readings = tuple(((0.2 - angle) % (2 * math.pi), 1.0) for angle in clockwise.tolist())
        with Log(path) as log:
            log.begin(RecordingStarted(robot="one", lidar_angle=0.2))
            for k in range(60):
                yaw = 0.1 * k if yaws is None else yaws(k)
                log.note(SampleTaken(time=0.05 * k, sensor="attitude", values=(0.0, 0.0, yaw)))
                if k not in lost:
                    log.note(SampleTaken(time=0.05 * k, sensor="position", values=(0.01 * k, 0.0)))
            for n in range(12):
                left = 0.1 + n * turn + np.cumsum(counts) / 5000
                came = np.where((left > 0.6) & (left < 1.0), 1.0, left)
                packets = tuple(
                    (round(1e4 * (came[-1] - one)), 0, 0, count) for one, count in zip(came, counts, strict=True)
                )
                log.note(TurnTaken(time=round(float(came[-1]), 4), readings=readings, packets=packets))

    def test_a_stalled_program_does_not_make_turns_late(self, tmp_path):
        self.stalled(tmp_path / "r.jsonl")
        found = read_robot_log(tmp_path / "r.jsonl")
        begins = np.array([one.times[0] for one in found.turns]) - found.odometry_times[0]
        assert begins == pytest.approx(0.1 + np.arange(12) * 719 / 5000, abs=0.006)

    def test_places_that_were_lost_are_a_gap_of_the_odometry(self, tmp_path):
        self.stalled(tmp_path / "r.jsonl", lost=range(20, 45))
        times = read_robot_log(tmp_path / "r.jsonl").odometry_times
        assert times[-1] - times[0] == pytest.approx(59 * 0.05)
        assert np.diff(times).max() == pytest.approx(26 * 0.05)

    def test_a_yaw_that_is_not_known_is_not_0(self, tmp_path):
        """Such a log is none of this program, which leaves a sample out that has not come."""
        self.stalled(tmp_path / "r.jsonl", yaws=lambda k: None if k % 7 == 3 else 2.0)
        with pytest.raises(MercatorError, match="line 8: sample: expected as many values as the sensor has"):
            read_robot_log(tmp_path / "r.jsonl")

    def test_a_log_that_is_cut_is_read_and_told(self, tmp_path):
        path = tmp_path / "r.jsonl"
        self.stalled(path)
        assert read_robot_log(path).notes == ()
        lines = path.read_bytes().splitlines(keepends=True)
        path.write_bytes(b"".join(lines[:-2]) + lines[-2][:40])
        found = read_robot_log(path)
        assert len(found.turns) == 11
        assert found.notes == ("the log has no end: it is still being written, or the program was killed.",)

    def test_without_odometry(self, tmp_path):
        with Log(tmp_path / "r.jsonl") as log:
            log.begin(RecordingStarted(robot="one", lidar_angle=0.0))
            log.note(TurnTaken(time=0.2, readings=((1.0, 2.0), (0.9, 2.0))))
        with pytest.raises(MercatorError, match=r"r\.jsonl: expected odometry, .* found 0 yaws and 0 places"):
            read_robot_log(tmp_path / "r.jsonl")


CARMEN = """# CARMEN Logfile
FLASER 3 1.0 2.0 81.91 0.1 0 0.3 0 0 0.3 1.5 host 1.5
ROBOTLASER1 0 -1.5 3.0 1.5 81.9 0.01 0 3 1 2 3 1 9 0.2 1 0.1 0.1 1 0.1 0 0 0 0 0 2.5 host 2.5
FLASER 3 1.0 2.0 3.0 1.1 0 0.3 1.0 0 0.3 3.5 host 3.5
"""


class TestCarmen:
    def test_both_kinds_of_lines(self, tmp_path):
        (tmp_path / "x.log").write_text(CARMEN)
        (log,) = read_logs([tmp_path / "x.log"])
        assert log.odometry == pytest.approx(np.array([[0, 0, 0.3], [0.1, 1, 0.1], [1.0, 0, 0.3]]))
        assert log.odometry_times.tolist() == [1.5, 2.5, 3.5]
        assert [turn.ranges.tolist() for turn in log.turns] == [[1.0, 2.0, 0.0], [1.0, 2.0, 3.0], [1.0, 2.0, 3.0]]
        assert log.turns[0].angles == pytest.approx([-math.pi / 2, 0.0, math.pi / 2])
        assert log.turns[1].angles == pytest.approx([-1.5, 0.0, 1.5])
        assert log.lidar_pose == pytest.approx([0.1 * math.cos(0.3), -0.1 * math.sin(0.3), 0.0])

    def lines(self, times):
        """A line for each time, whose place is its number."""
        return "".join(f"FLASER 3 1 2 3 {k} 0 0 {k} 0 0 {time} host {time}\n" for k, time in enumerate(times))

    @pytest.mark.parametrize(
        ("times", "rows", "told"),
        [
            ([1, 2, 2, 3, 4, 5], [0, 2, 3, 4, 5], "1 lines whose times do not rise are left out."),
            ([1, 2, 0.5, 3, 4, 5], [0, 1, 3, 4, 5], "1 lines whose times do not rise are left out."),
            ([1, 2, 900, 3, 4, 5], [0, 1, 3, 4, 5], "1 lines whose times do not rise are left out."),
        ],
    )
    def test_a_time_that_does_not_fit_costs_its_line_only(self, tmp_path, times, rows, told):
        (tmp_path / "x.log").write_text(self.lines(times))
        (log,) = read_logs([tmp_path / "x.log"])
        assert log.odometry[:, 0].tolist() == rows
        assert log.odometry_times.tolist() == [float(times[row]) for row in rows]
        assert log.notes == (told,)

    def test_times_that_were_rounded_are_counted_anew(self, tmp_path):
        (tmp_path / "x.log").write_text(self.lines([1, 1, 1, 2, 2, 2]))
        (log,) = read_logs([tmp_path / "x.log"])
        assert log.odometry_times.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
        assert log.notes == ("the times of its lines do not rise: a line stands for a second.",)

    def test_a_last_line_that_is_cut_is_left_out(self, tmp_path):
        (tmp_path / "x.log").write_text(CARMEN.rstrip("\n")[:-20])
        (log,) = read_logs([tmp_path / "x.log"])
        assert len(log.turns) == 2
        assert log.notes == ("its last line is cut, and left out.",)

    @pytest.mark.parametrize(
        ("old", "new", "words"),
        [
            ("FLASER 3 1.0 2.0 81", "FLASER 0 1.0 2.0 81", "x.log:2: expected the number of readings, a whole number"),
            ("FLASER 3 1.0 2.0 81", "FLASER 99 1.0 2.0 81", "x.log:2: expected 99 numbers \\(readings\\), found "),
            (" 1.5 host", " then host", "x.log:2: expected a number \\(time\\) in word 12, found 'then'"),
            ("0.1 0 0.3 0", "nan 0 0.3 0", "x.log:2: expected a number \\(pose of the laser\\) in word 6, found 'nan'"),
            ("3 1 9 0.2", "3 7 9 0.2", "x.log:3: expected 5 numbers"),
        ],
    )
    def test_a_line_that_is_not_right(self, tmp_path, old, new, words):
        (tmp_path / "x.log").write_text(CARMEN.replace(old, new, 1))
        with pytest.raises(MercatorError, match=words):
            read_logs([tmp_path / "x.log"])

    def test_damaged_lines_are_told_or_read(self, tmp_path):
        draw, told = random.Random(1), 0
        for _ in range(300):
            words = [line.split(" ") for line in CARMEN.splitlines()]
            line = draw.choice(words[1:])
            line[draw.randrange(len(line))] = draw.choice(["nan", "-1", "1e400", "x", "", "99999999999999999999", "0"])
            del draw.choice(words[1:])[draw.randrange(5, 30) :]
            (tmp_path / "x.log").write_text("\n".join(" ".join(line) for line in words))
            try:
                read_logs([tmp_path / "x.log"])
            except MercatorError:
                told += 1
        assert told > 100


class TestAnyFile:
    def test_formats_are_told_by_names_and_contents(self, trace, tmp_path, logs, shifted):
        carmen = tmp_path / "one.log"
        carmen.write_text("FLASER 2 1.0 2.0 0 0 0 0 0 0 1.0 h 1.0\nFLASER 2 1.0 2.0 0 0 0 1 0 0 2.0 h 2.0\n")
        recording = tmp_path / "r.jsonl"
        with Log(recording) as log:
            log.begin(RecordingStarted(robot="one", lidar_angle=0.0))
            for k in range(3):
                log.note(SampleTaken(time=0.05 * k, sensor="attitude", values=(0.0, 0.0, 0.0)))
                log.note(SampleTaken(time=0.05 * k, sensor="position", values=(0.0, 0.0)))
            log.note(TurnTaken(time=0.3, readings=((1.0, 2.0), (0.9, 2.0))))
        bag = write_bag(tmp_path / "bag", shifted, 2)
        found = read_logs([trace, carmen, recording, bag, next(bag.glob("*.db3"))])
        assert len(found) == 3 + 1 + 1 + 2 + 2

    def test_a_log_that_is_given_twice(self, trace):
        with pytest.raises(MercatorError, match="given twice; expected each log once"):
            read_logs([trace, trace.parent / "." / trace.name])

    def test_robots_of_one_name_are_told_apart(self, trace, tmp_path):
        other = tmp_path / f"other{trace.suffix}"
        other.write_bytes(trace.read_bytes())
        names = [log.name for log in read_logs([trace, other])]
        assert len(names) == len(set(names)) == 6
        assert {"robot 0", "robot 0 (2)"} < set(names)

    def test_times_since_1970_are_counted_from_the_first_turn(self, tmp_path, shifted):
        paths = [write_bag(tmp_path / f"{k}.bag", [log], 1) for k, log in enumerate(shifted)]
        found = read_logs(paths)
        first = min(log.turns[0].times[0] for log in shifted)
        for log, expected in zip(found, shifted, strict=True):
            assert log.odometry_times == pytest.approx(expected.odometry_times - first, abs=1e-6)
            assert log.turns[1].times == pytest.approx(expected.turns[1].times - first, abs=1e-5)

    def test_clocks_that_are_years_apart_are_told(self, tmp_path):
        for name, begin in (("a", 1.7e9), ("b", 1.7e9 + 3600.0), ("c", 1.4e9), ("d", 0.0)):
            lines = "".join(f"FLASER 2 1 2 0 0 0 {k} 0 0 {begin + k} h {begin + k}\n" for k in range(3))
            (tmp_path / f"{name}.log").write_text(lines)
        found = {log.name: log.notes for log in read_logs([tmp_path / f"{name}.log" for name in "abcd"])}
        assert found["a"] == found["b"] == ()
        assert found["c"] == ("it begins 3472.22 days before a; are these logs of one run, and their clocks right?",)
        assert found["d"] == (
            "its times are not counted from 1970, as those of a are: both are taken to begin at once.",
        )

    @pytest.mark.parametrize("data", [b"", b"abc\n", b"\x89PNG", b"\x1f\x8b garbage"])
    def test_another_file(self, tmp_path, data):
        (tmp_path / "x.txt").write_bytes(data)
        with pytest.raises(MercatorError, match=r"x\.txt: expected a log with turns of a lidar: of mercator-robot, "):
            read_logs([tmp_path / "x.txt"])
        os.mkfifo(tmp_path / "pipe")
        with pytest.raises(MercatorError, match="pipe: expected a log, found a folder, device or pipe"):
            read_logs([tmp_path / "pipe"])
        with pytest.raises(MercatorError, match=r"none\.txt: cannot be read: No such file"):
            read_logs([tmp_path / "none.txt"])
