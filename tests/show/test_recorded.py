"""Traces and robot logs as experiments."""

import json
import os
import shutil

import numpy as np
import pandas as pd
import pytest

from mercator_design.config.checked_lines import to_line
from mercator_design.errors import MissionError, RobotError
from mercator_design.results.experiments.robot_logs import is_log, read_logs
from mercator_design.results.experiments.traces import read_trace
from mercator_design.robot.logs.events import CycleDone
from mercator_design.robot.logs.log import read
from mercator_design.show.replay import replay_of
from mercator_design.show.text.recording import write_recording


def ignore(_):
    pass


@pytest.fixture(params=[".npz", ".csv"])
def table(request, shown, tmp_path):
    """A function that writes the trace to a file."""

    def written(every=1):
        path = tmp_path / f"trace{request.param}"
        with path.open("wb") as file:
            write_recording(file, shown.trace, [], every=every, suffix=request.param)
        return path

    return written


class TestTrace:
    def test_it_is_the_experiment(self, table, shown, simulator):
        found = read_trace(table(), simulator, 2, shown.pfsms[0])
        assert np.allclose(found.trace.poses, shown.trace.poses, atol=1e-12)
        assert (found.trace.states == shown.trace.states).all()
        assert found.score == shown.score
        assert (found.curve.scores == shown.curve.scores).all()
        assert found.trace.control_period == pytest.approx(0.1)

    def test_every_second_cycle(self, table, shown, simulator):
        found = read_trace(table(every=2), simulator, 2, None)
        assert found.trace.control_period == pytest.approx(0.2)
        assert np.allclose(found.trace.poses[1:], shown.trace.poses[2::2], atol=1e-12)

    def test_tracking_camera(self, tmp_path, simulator):
        path = tmp_path / "camera.csv"
        rows = [(time, robot, time, robot, 0.5) for time in (0.0, 0.5, 1.0) for robot in ("b", "a")]
        pd.DataFrame(rows, columns=["time", "robot", "x", "y", "heading"]).replace({"y": {"a": 1.0, "b": 2.0}}).to_csv(
            path, index=False
        )
        found = read_trace(path, simulator, 1, None)
        assert found.trace.poses.shape == (3, 2, 3)
        assert found.trace.poses[:, 0, 1].tolist() == [1.0, 1.0, 1.0]  # a before b
        assert found.pfsms == ()
        assert replay_of(found)["header"]["machines"] == []

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            (lambda t: t.drop(columns="heading"), "heading is missing"),
            (lambda t: t.iloc[:-1], "one row for each time and robot"),
            (lambda t: pd.concat([t, t.iloc[:1]]), "one row for each time and robot"),
            (lambda t: t.assign(x=np.nan), "finite numbers"),
            (lambda t: t.assign(heading="north"), "finite numbers"),
            (lambda t: t.assign(state=-1), "state: expected numbers from 0 to 127"),
            (lambda t: t.assign(time=t.time**2), "times in equal steps"),
            (lambda t: t[t.time < 0.15], "at least two times"),
            (lambda t: t.assign(state=3), "below 2, found 3"),
            (lambda t: t.iloc[:0], "one row for each time and robot"),
        ],
    )
    def test_tables_that_are_no_traces(self, change, message, shown, simulator, tmp_path):
        path = tmp_path / "trace.csv"
        change(shown.trace.to_frame()).to_csv(path, index=False)
        with pytest.raises(MissionError, match=message) as error:
            read_trace(path, simulator, 2, shown.pfsms[0])
        assert str(error.value).startswith(f"{path}: ")

    @pytest.mark.parametrize("suffix", [".npz", ".csv"])
    @pytest.mark.parametrize("content", [b"", b"\x00\xff\xfe", b"a,b\n1,2\n", b"PK\x03\x04"])
    def test_other_files(self, suffix, content, simulator, tmp_path):
        path = tmp_path / f"other{suffix}"
        path.write_bytes(content)
        with pytest.raises(MissionError, match="expected"):
            read_trace(path, simulator, 2, None)


class TestLogs:
    def test_poses_are_the_odometry_from_the_start(self, logs, simulator):
        starts = [(1.0, 2.0, np.pi / 2), (0.0, 0.0, 0.0), (-1.0, 0.0, np.pi)]
        found = read_logs(logs, simulator.robot_model, simulator=None, seed=1, starts=starts, warn=ignore)
        assert found.names == ("twin-0", "twin-1", "twin-2")
        for robot, (log, (x, y, heading)) in enumerate(zip(logs, starts, strict=True)):
            last = [event for event in read(log) if isinstance(event, CycleDone)][-1]
            _, forwards, left = last.sensed["position"]
            c, s = np.cos(heading), np.sin(heading)
            expected = (x + c * forwards - s * left, y + s * forwards + c * left)
            assert found.trace.poses[-1, robot, :2] == pytest.approx(expected, abs=1e-9)
            assert found.trace.poses[0, robot].tolist() == [x, y, heading]
            assert found.trace.states[-1, robot] == last.next_state
        assert found.score is None
        assert len(found.pfsms) == 3

    def test_each_transition_is_shown_once(self, logs, simulator):
        found = read_logs(logs, simulator.robot_model, simulator=simulator, seed=1, starts=(), warn=ignore)
        for robot, log in enumerate(logs):
            cycles = [event for event in read(log) if isinstance(event, CycleDone)]
            changes = sum(event.state != event.next_state for event in cycles)
            assert np.count_nonzero(found.fired[:, robot]) == changes

    def test_clock_offsets_put_robots_side_by_side(self, logs, simulator, tmp_path):
        """A robot that says that its clock is an hour ahead is shown with the others."""
        late = tmp_path / "late.jsonl"
        lines = logs[1].read_text().splitlines()
        start = json.loads(lines[0])
        text = lines[0].replace("T17:10", "T18:10")
        assert text != lines[0]
        start = json.loads(text)
        start["clock"] = {"reference": "desk", "ahead": 3600.0, "uncertainty": 0.001}
        start.pop("crc")
        late.write_text("".join([to_line(start), *(line + "\n" for line in lines[1:])]))
        together = read_logs(logs, simulator.robot_model, simulator=simulator, seed=1, starts=(), warn=ignore)
        shifted = read_logs(
            [logs[0], late, logs[2]], simulator.robot_model, simulator=simulator, seed=1, starts=(), warn=ignore
        )
        assert np.allclose(together.trace.poses, shifted.trace.poses)

    def test_what_it_warns_of(self, logs, simulator):
        warnings = []
        read_logs(logs[:1], simulator.robot_model, simulator=None, seed=1, starts=(), warn=warnings.append)
        assert [message for message in warnings if "clock was not compared" in message]
        assert [message for message in warnings if "starting poses are not known" in message]

    def test_too_few_starts(self, logs, simulator):
        with pytest.raises(RobotError, match="a starting pose for each of 3 logs, found 1"):
            read_logs(logs, simulator.robot_model, simulator=None, seed=1, starts=[(0.0, 0.0, 0.0)], warn=ignore)

    def test_log_without_cycles(self, logs, simulator, tmp_path):
        path = tmp_path / "short.jsonl"
        path.write_text(logs[0].read_text().splitlines()[0] + "\n")
        with pytest.raises(RobotError, match="expected control cycles, found none"):
            read_logs([path], simulator.robot_model, simulator=None, seed=1, starts=(), warn=ignore)

    def test_which_files_are_logs(self, logs, tmp_path):
        assert is_log(logs[0])
        fsm = tmp_path / "fsm.txt"
        fsm.write_text("--nstates 1 --s0 1\n")
        assert not is_log(fsm)
        assert not is_log(tmp_path / "none")
        shutil.copy(logs[0], tmp_path / "log.txt")
        assert is_log(tmp_path / "log.txt")


class TestHostileFiles:
    @pytest.mark.parametrize("suffix", [".csv", ".npz"])
    def test_pipe_and_folder(self, suffix, simulator, tmp_path):
        path = tmp_path / f"pipe{suffix}"
        os.mkfifo(path)
        with pytest.raises(MissionError, match="found a device or pipe"):
            read_trace(path, simulator, 1, None)
        assert not is_log(path)
        (tmp_path / f"folder{suffix}").mkdir()
        with pytest.raises(MissionError, match="found a folder"):
            read_trace(tmp_path / f"folder{suffix}", simulator, 1, None)

    def arrays(self, **changes):
        arrays = {"time": np.arange(1.0, 4.0), "pose": np.zeros((3, 2, 3)), "state": np.zeros((3, 2), np.int8)}
        return arrays | changes

    @pytest.mark.parametrize(
        ("changes", "message"),
        [
            ({"time": np.array(1.0)}, "expected times"),
            ({"time": np.zeros((3, 1))}, "expected times"),
            ({"time": 1e10 * np.arange(1.0, 4.0)}, "time: expected at most"),
            ({"time": 1e-321 * np.arange(1.0, 4.0)}, "times in equal steps|expected cycles of"),
            ({"pose": np.full((3, 2, 3), 1e308)}, "expected places up to 10000 m"),
            ({"pose": np.full((3, 2, 3), 1e20)}, "expected places up to 10000 m"),
            ({"pose": np.zeros((3, 3000, 3)), "state": np.zeros((3, 3000))}, "at most 2000 robots"),
            ({"pose": np.array([None])}, "expected a trace"),
        ],
    )
    def test_arrays(self, changes, message, simulator, tmp_path):
        np.savez_compressed(tmp_path / "t.npz", **self.arrays(**changes))
        with pytest.raises(MissionError, match=message):
            read_trace(tmp_path / "t.npz", simulator, 1, None)

    def test_damaged_archives(self, simulator, tmp_path):
        """Every byte of the first kilobyte, changed: it is read, or refused."""
        np.savez_compressed(tmp_path / "t.npz", **self.arrays())
        good = (tmp_path / "t.npz").read_bytes()
        refused = 0
        for place in range(0, len(good), 3):
            (tmp_path / "t.npz").write_bytes(good[:place] + bytes([good[place] ^ 0x55]) + good[place + 1 :])
            try:
                read_trace(tmp_path / "t.npz", simulator, 1, None)
            except MissionError:
                refused += 1
        assert refused > len(good) // 10

    def test_archive_that_unpacks_to_much(self, simulator, tmp_path, monkeypatch):
        monkeypatch.setattr("mercator_design.results.experiments.traces.MAX_UNPACKED", 100)
        np.savez_compressed(tmp_path / "t.npz", **self.arrays())
        with pytest.raises(MissionError, match="MiB of arrays"):
            read_trace(tmp_path / "t.npz", simulator, 1, None)


def changed(log, path, change):
    """A log with changed events."""
    events = [json.loads(line) for line in log.read_text().splitlines()]
    for event in events:
        event.pop("crc")
        change(event)
    path.write_text("".join(map(to_line, events)))
    return path


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"control_period": -0.1}, "expected cycles of 0.001 to 10000 s, found -0.1 s"),
        ({"next_state": 99}, "expected a state below 3, found 99"),
    ],
)
def test_logs_that_no_robot_wrote(changes, message, logs, simulator, tmp_path):
    (name,) = changes
    log = changed(logs[0], tmp_path / "log.jsonl", lambda event: event.update(changes) if name in event else None)
    with pytest.raises((MissionError, RobotError), match=message):
        read_logs([log], simulator.robot_model, simulator=None, seed=1, starts=(), warn=ignore)
