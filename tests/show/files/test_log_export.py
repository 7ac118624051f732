"""mdesign export csv and mcap: all that logs and recordings of robots have, exactly, as other programs read it."""

import gc
import io
import itertools
import json
import math
import re
import tracemalloc
from datetime import datetime, timedelta
from functools import partial
from importlib.metadata import version
from pathlib import Path

import pandas as pd
import pytest
from jsonschema import Draft202012Validator
from mcap.reader import make_reader
from mcap.writer import Writer

from mercator_design.fsm import Readings
from mercator_design.robot.logs import log as log_module
from mercator_design.robot.logs.events import NoteTaken, RecordingStarted, SampleTaken, TurnTaken, WheelsDriven
from mercator_design.robot.logs.log import Log, controller_of, to_lines
from mercator_design.show.files.robot_log_table import write_csv
from mercator_design.show.files.robot_logs import write_mcap
from tests.robot.log_events import read
from tests.twin.recorded import ROBOTS, unpack

SENSORS = {
    "acceleration", "turning", "attitude", "orientation", "position", "velocity", "ground", "ambient_light",
    "proximity", "lidar",
}  # fmt: skip


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    folder = unpack(tmp_path_factory.mktemp("logs"))
    return [folder / f"run{robot}.jsonl" for robot in range(ROBOTS)]


@pytest.fixture(scope="module")
def log(logs):
    return logs[0]


@pytest.fixture(scope="module")
def events(log):
    return [*read(log)]


@pytest.fixture(scope="module")
def cycles(events):
    return [event for event in events if event["event"] == "cycle"]


def to_csv(log, file):
    """A log by itself as a table."""
    return write_csv([log], file, pytest.fail)[0]


def written(text, lines):
    text.write_text("".join(to_lines(lines)))
    return text


class TestCsv:
    @pytest.fixture
    def table(self, mdesign, log, tmp_path):
        code, out, err = mdesign("export", "csv", log, "-o", tmp_path / "run.csv")
        assert (code, out) == (0, "")
        assert err == f"{tmp_path}/run.csv: 120 cycles; The duration is over\n"
        exactly = {} if version("pandas") >= "3.1" else {"float_precision": "round_trip"}
        return pd.read_csv(tmp_path / "run.csv", **exactly)

    def test_every_number_is_that_of_the_log(self, table, cycles):
        columns = {
            tuple(Readings._fields): "readings",
            ("left", "right"): "wheels",
        }
        for names, kind in columns.items():
            assert table[list(names)].to_numpy().tolist() == [event[kind] for event in cycles]
        assert [*map(json.loads, table.draws)] == [event["draws"] for event in cycles]
        for name in ("time", "cycle", "state", "next_state", "cpu", "led_colour", "signal"):
            assert table[name].tolist() == [event[name] for event in cycles]
        assert [*map(json.loads, table.neighbour_places)] == [event["neighbours"] for event in cycles]
        assert any(event["neighbours"] for event in cycles)

    def test_what_sensors_told(self, table, cycles):
        assert set(cycles[0]["sensed"]) == SENSORS
        for sensor in SENSORS:
            names = [name for name in table if name.startswith(f"sensed_{sensor}_")]
            told = [[math.inf if x is None else x for x in event["sensed"][sensor]] for event in cycles]
            assert table[names].to_numpy().tolist() == told

    def test_nothing_in_sight_is_inf_and_what_is_not_there_empty(self, tmp_path, events):
        start, first = events[0], next(event for event in events if event["event"] == "cycle")
        first = first | {"sensed": {"proximity": [0.1, None, 0.0, 1, 1, 1, 1, 1, 1]}, "wheels": [None, 0.5]}
        file = io.BytesIO()
        to_csv(written(tmp_path / "log.jsonl", [start, first]), file)
        (row,) = pd.read_csv(io.BytesIO(file.getvalue())).to_dict("records")
        assert (row["sensed_proximity_distance_0"], row["sensed_proximity_distance_1"]) == (math.inf, 0.0)
        assert math.isnan(row["sensed_position_x"])
        assert (math.isnan(row["left"]), row["right"]) == (True, 0.5)
        file = io.BytesIO()
        write_mcap(tmp_path / "log.jsonl", file)
        ((*_, wheels),) = make_reader(io.BytesIO(file.getvalue())).iter_messages(topics=["/wheels"])
        assert json.loads(wheels.data) == {"right": 0.5}

    def test_the_numbers_of_a_line(self, tmp_path, events):
        start, first = events[0], next(event for event in events if event["event"] == "cycle")
        told = [0.98, 5000, 100, 3, 0.95, 40, 2, 1]
        file = io.BytesIO()
        to_csv(written(tmp_path / "log.jsonl", [start, first | {"lines": {"rvr": told}}]), file)
        (row,) = pd.read_csv(io.BytesIO(file.getvalue())).to_dict("records")
        names = ("whole", "received", "lost", "refused", "answered", "commands", "unanswered", "repeated")
        assert [row[f"line_rvr_{name}"] for name in names] == told

    def test_behaviours_and_conditions(self, logs):
        seen = set()
        for log in logs:
            file = io.BytesIO()
            to_csv(log, file)
            pfsm = controller_of(next(log_module.read(log))).software
            for row in pd.read_csv(io.BytesIO(file.getvalue()), keep_default_na=False).to_dict("records"):
                state = pfsm.states[row["state"]]
                assert row["behaviour"] == state.behaviour
                taken = {edge.condition for edge in state.transitions if edge.target == row["next_state"]}
                assert row["condition"] in (taken or {""})
                seen.add(row["condition"])
        assert len(seen) > 4

    def test_the_clock_is_that_of_the_robot(self, table, events):
        assert table.robot.unique().tolist() == ["twin-0"]
        start = datetime.fromisoformat(events[0]["time"])
        assert (table.clock - table.time).to_numpy() == pytest.approx(start.timestamp(), rel=0.0, abs=2e-6)

    def test_stdout_has_the_same(self, mdesign, log):
        file = io.BytesIO()
        to_csv(log, file)
        code, out, _ = mdesign("export", "csv", log, "-o", "-")
        assert (code, out.encode()) == (0, file.getvalue())


class TestSideBySide:
    """Logs of robots whose clocks were off, and were compared with one clock when they were started."""

    AHEAD = (3600.0, -0.25, -1.7e9)

    @pytest.fixture
    def apart(self, logs, tmp_path):
        """The same logs as if the robots' clocks had been off, and that had been measured."""
        return [self.shifted(*each, tmp_path) for each in zip(logs, self.AHEAD, strict=True)]

    @staticmethod
    def shifted(log, ahead, folder, **given):
        start, *events = read(log)
        time = (datetime.fromisoformat(start["time"]) + timedelta(seconds=ahead)).isoformat(timespec="microseconds")
        clock = {"reference": "desk", "ahead": ahead, "uncertainty": 0.002, **given}
        return written(folder / log.name, [start | {"time": time, "clock": clock}, *events])

    def test_one_table_in_the_order_of_one_clock(self, mdesign, logs, apart, tmp_path):
        code, out, err = mdesign("export", "csv", *apart, "-o", tmp_path / "all.csv")
        assert (code, out) == (0, "")
        assert err == "".join(f"{tmp_path}/all.csv: {log}: 120 cycles; The duration is over\n" for log in apart)
        table = pd.read_csv(tmp_path / "all.csv")
        assert table.clock.is_monotonic_increasing
        for log in logs:
            file = io.BytesIO()
            to_csv(log, file)
            alone = pd.read_csv(io.BytesIO(file.getvalue()))
            mine = table[table.robot == alone.robot[0]].reset_index(drop=True)
            assert mine.clock.to_numpy() == pytest.approx(alone.clock.to_numpy(), rel=0.0, abs=2e-6)
            pd.testing.assert_frame_equal(mine.drop(columns="clock"), alone.drop(columns="clock"))

    def test_the_program_in_the_documents(self, mdesign, apart, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        assert mdesign("export", "csv", *apart, "-o", "all.csv")[0] == 0
        document = (Path(__file__).parents[3] / "docs/how-to/analyse-robot-logs.md").read_text()
        (program,) = re.findall(r"```py\n(import pandas.*?)```", document, re.DOTALL)
        found = {}
        exec(program, found)  # noqa: S102 - our own
        assert found["states"].shape[1] == len(apart)
        assert len(found["states"]) > 100

    def test_messages_have_the_same_clock(self, logs, apart):
        for log, other in zip(logs, apart, strict=True):
            times = []
            for path in (log, other):
                file = io.BytesIO()
                write_mcap(path, file)
                times.append([m.log_time for *_, m in make_reader(io.BytesIO(file.getvalue())).iter_messages()])
            assert times[0] == pytest.approx(times[1], rel=0.0, abs=2000)  # [ns]

    def test_clocks_that_were_not_compared_are_told(self, mdesign, logs, apart, tmp_path):
        first, _, third = apart
        third.unlink()
        other = self.shifted(logs[2], 1.0, tmp_path, reference="laptop")
        code, _, err = mdesign("export", "csv", first, logs[1], other, "-o", tmp_path / "all.csv")
        warnings = [line for line in err.splitlines() if line.startswith("Warning")]
        assert code == 0
        assert warnings == [
            f"Warning: {logs[1]}: its clock is its robot's own, which was not compared with those of the other logs",
            f"Warning: {other}: its clock is that of laptop, which was not compared with those of the other logs",
        ]

    def test_logs_of_two_kinds_are_no_table(self, mdesign, log, recording, tmp_path):
        code, _, err = mdesign("export", "csv", log, recording, "-o", tmp_path / "all.csv")
        words = f"Error: {recording}: expected the log of a run, as {log} is, found that of a recording\n"
        assert (code, err) == (1, words)
        assert not (tmp_path / "all.csv").exists()

    @pytest.mark.parametrize(
        ("clock", "words"),
        [
            (7, ": expected a mapping of keys or null, found 7"),
            ({}, ".reference: missing key; expected text"),
            ({"reference": "desk", "ahead": "1", "uncertainty": 0}, ".ahead: expected a number >= -1e+10 and"),
            ({"reference": 7, "ahead": 1, "uncertainty": 0}, ".reference: expected text, found 7"),
            ({"reference": "desk", "ahead": 1e11, "uncertainty": 0}, ".ahead: expected a number >= -1e+10 and <="),
            ({"reference": "desk", "ahead": 1}, ".uncertainty: missing key; expected a number"),
        ],
    )
    def test_a_clock_that_is_none(self, mdesign, log, tmp_path, clock, words):
        start, *events = read(log)
        bad = written(tmp_path / "bad.jsonl", [start | {"clock": clock}, *events])
        code, _, err = mdesign("export", "csv", bad, "-o", tmp_path / "all.csv")
        assert (code, err.startswith(f"Error: {bad}, line 1: start.clock{words}")) == (1, True)


class TestMcap:
    @pytest.fixture
    def reader(self, mdesign, log, tmp_path):
        code, out, err = mdesign("export", "mcap", log, "-o", tmp_path / "run.mcap")
        assert (code, out, err) == (0, "", f"{tmp_path}/run.mcap: 120 cycles; The duration is over\n")
        with (tmp_path / "run.mcap").open("rb") as file:
            yield make_reader(file, validate_crcs=True)

    def test_it_is_whole(self, reader, cycles):
        summary, messages = reader.get_summary(), [*reader.iter_messages(log_time_order=False)]
        times = [message.log_time for _, _, message in messages]
        assert times == sorted(times)
        statistics = summary.statistics
        assert (statistics.message_count, statistics.metadata_count) == (len(messages), 1)
        assert (statistics.message_start_time, statistics.message_end_time) == (times[0], times[-1])
        topics = {channel.topic for channel in summary.channels.values()}
        assert topics == {
            "/state", "/readings", "/draws", "/wheels", "/outputs", "/neighbours", "/odometry", "/tf", "/notes",
            *(f"/sensors/{name}" for name in SENSORS),
        }  # fmt: skip
        for number, channel in summary.channels.items():
            if channel.topic != "/notes":
                assert statistics.channel_message_counts[number] == len(cycles)
        assert reader.get_header().profile == ""

    def test_messages_are_as_their_schemas_say(self, reader):
        validators = {}
        for schema, channel, message in reader.iter_messages():
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            if schema.id not in validators:
                described = json.loads(schema.data)
                Draft202012Validator.check_schema(described)
                assert described["title"] == schema.name
                validators[schema.id] = Draft202012Validator(closed(described))
            validators[schema.id].validate(json.loads(message.data))
        assert len(validators) == 19

    def test_messages_are_what_the_log_has(self, reader, cycles, events):
        said = {}
        for _, channel, message in reader.iter_messages():
            said.setdefault(channel.topic, []).append((message, json.loads(message.data)))
        start = pd.Timestamp(events[0]["time"]).value
        for k, event in enumerate(cycles):
            at = {topic: messages[k][1] for topic, messages in said.items() if topic != "/notes"}
            message, state = said["/state"][k]
            assert message.log_time == start + round(1e6 * event["time"]) * 1000
            assert [state[name] for name in ("cycle", "state", "next_state")] == [
                event[name] for name in ("cycle", "state", "next_state")
            ]
            assert [*at["/readings"].values()] == event["readings"]
            assert [*at["/wheels"].values()] == event["wheels"]
            assert at["/draws"]["draws"] == event["draws"]
            assert [[place["distance"], place["bearing"]] for place in at["/neighbours"]["places"]] == event[
                "neighbours"
            ]
            for name, values in event["sensed"].items():
                assert [*at[f"/sensors/{name}"].values()] == [value for value in values if value is not None]
            stamp, pose = at["/odometry"]["timestamp"], at["/odometry"]["pose"]
            assert [pose["position"]["x"], pose["position"]["y"]] == event["sensed"]["position"][1:]
            assert at["/tf"] == {
                "timestamp": stamp,
                "parent_frame_id": "start",
                "child_frame_id": "robot",
                "translation": pose["position"],
                "rotation": pose["orientation"],
            }
            yaw = 2 * math.atan2(pose["orientation"]["z"], pose["orientation"]["w"])
            assert math.cos(yaw - event["sensed"]["attitude"][3]) == pytest.approx(1.0)
            age = message.log_time - (10**9 * stamp["sec"] + stamp["nsec"])
            assert age == pytest.approx(1e9 * event["sensed"]["position"][0], abs=2e3)
        *notes, end = [note["message"] for _, note in said["/notes"]]
        assert notes == [event["text"] for event in events if event["event"] == "note"]
        assert end == "The end: The duration is over"

    def test_the_start_is_metadata(self, reader, events):
        (metadata,) = reader.iter_metadata()
        told = metadata.metadata
        assert (told["fsm"], told["robot"], told["seed"]) == (events[0]["fsm"], "twin-0", "0")
        assert json.loads(told["facts"]) == events[0]["facts"]
        assert metadata.name == "start"


SAMPLES = {
    "position": [0.5, -0.1],
    "attitude": [0.01, -0.02, 3.1],
    "ground": [120, 121, 119],
    "proximity": [0.4, None, 0.0, 1.5, 1.6, 1.7, 1.8, 1.9],
}
TURN = [(0.0, 0.31), (0.001, 0.3), (0.002, 0.32), (0.01, 0.0), (0.5 * math.pi, 2.5), (6.28, 0.4)]


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "recording.jsonl"
    with Log(path) as log:
        log.begin(RecordingStarted(robot="mercator-3", facts={}, proximity_angles=(0.0,) * 8, lidar_angle=0.0))
        for k in range(3):
            for sensor, values in SAMPLES.items():
                log.note(SampleTaken(time=0.05 * k, sensor=sensor, values=tuple(values)))
            log.note(TurnTaken(time=0.05 * k + 0.01, readings=tuple(TURN)))
            log.note(WheelsDriven(time=0.05 * k + 0.02, left=0.1 * k, right=-0.1 * k))
        log.note(NoteTaken(time=0.2, text="lidar: nothing for 0.70 s"))
    return path


class TestRecordings:
    def test_a_table_has_a_row_for_each_sample_and_reading(self, recording, mdesign, tmp_path):
        code, out, err = mdesign("export", "csv", recording, "-o", tmp_path / "table.csv")
        assert (code, out) == (0, "")
        assert err.endswith("table.csv: 15 samples and turns; The duration is over\n")
        table = pd.read_csv(tmp_path / "table.csv")
        assert table.robot.unique().tolist() == ["mercator-3"]
        for sensor, values in SAMPLES.items():
            rows = table[table.sensor == sensor]
            assert rows.time.tolist() == [0.0, 0.05, 0.1]
            told = [math.inf if value is None else value for value in values]
            for row in rows[[f"value_{k}" for k in range(8)]].to_numpy().tolist():
                assert row[: len(told)] == told
                assert all(map(math.isnan, row[len(told) :]))
        treads = table[table.sensor == "wheels"]
        assert treads.time.tolist() == pytest.approx([0.02, 0.07, 0.12])
        assert treads[["value_0", "value_1"]].to_numpy().tolist() == [[0.1 * k, -0.1 * k] for k in range(3)]
        turns = table[table.sensor == "lidar"]
        assert turns[["value_0", "value_1"]].to_numpy().tolist() == [[*reading] for reading in 3 * TURN]
        start = datetime.fromisoformat(next(read(recording, "recording"))["time"]).timestamp()
        assert (table.clock - table.time).to_numpy() == pytest.approx(start, rel=0.0, abs=2e-6)

    def test_messages(self, recording):
        file = io.BytesIO()
        write_mcap(recording, file)
        said, times = {}, {}
        for schema, channel, message in make_reader(io.BytesIO(file.getvalue()), validate_crcs=True).iter_messages():
            told = json.loads(message.data)
            Draft202012Validator(closed(json.loads(schema.data))).validate(told)
            said.setdefault((channel.topic, schema.name), []).append(told)
            times.setdefault(channel.topic, []).append(message.log_time)
        assert {key: len(messages) for key, messages in said.items()} == {
            ("/sensors/attitude", "mercator.Attitude"): 3,
            ("/sensors/ground", "mercator.Ground"): 3,
            ("/sensors/proximity", "mercator.Proximity"): 3,
            ("/sensors/position", "mercator.Position"): 3,
            ("/odometry", "foxglove.PoseInFrame"): 2,  # from the first attitude on
            ("/tf", "foxglove.FrameTransform"): 2,
            ("/lidar", "foxglove.LaserScan"): 3,
            ("/treads", "mercator.Treads"): 3,
            ("/notes", "foxglove.Log"): 2,
        }
        assert said["/sensors/attitude", "mercator.Attitude"][0] == {"roll": 0.01, "pitch": -0.02, "yaw": 3.1}
        assert "distance_1" not in said["/sensors/proximity", "mercator.Proximity"][0]
        assert said["/treads", "mercator.Treads"][1] == {"left": 0.1, "right": -0.1}
        pose = said["/odometry", "foxglove.PoseInFrame"][0]["pose"]
        assert pose["position"] == {"x": 0.5, "y": -0.1, "z": 0.0}
        assert pose["orientation"]["w"] == pytest.approx(math.cos(1.55))
        note, end = said["/notes", "foxglove.Log"]
        assert (note["message"], end["message"]) == ("lidar: nothing for 0.70 s", "The end: The duration is over")
        start = pd.Timestamp(next(read(recording, "recording"))["time"]).value
        assert times["/treads"] == [start + 10**6 * ms for ms in (20, 70, 120)]
        assert times["/notes"] == [start + 200 * 10**6] * 2

    def test_ranges_lie_at_their_angles(self, recording):
        file = io.BytesIO()
        write_mcap(recording, file)
        ((*_, message), *_) = make_reader(io.BytesIO(file.getvalue())).iter_messages(topics=["/lidar"])
        scan = json.loads(message.data)
        step = (scan["end_angle"] - scan["start_angle"]) / (len(scan["ranges"]) - 1)
        seen = {round(scan["start_angle"] + k * step, 3): at for k, at in enumerate(scan["ranges"]) if at > 0.0}
        assert seen == {0.0: 0.3, round(0.5 * math.pi, 3): 2.5, round(1439 * math.tau / 1440, 3): 0.4}


def closed(schema):
    """A schema of objects that have nothing else."""
    if schema.get("type") == "object":
        properties = {name: closed(part) for name, part in schema["properties"].items()}
        return schema | {"properties": properties, "additionalProperties": False}
    return schema | {"items": closed(schema["items"])} if schema.get("type") == "array" else schema


@pytest.mark.parametrize("write", [to_csv, write_mcap])
def test_a_log_that_was_cut_is_exported_as_far_as_it_goes(write, log, tmp_path):
    cut = tmp_path / "log.jsonl"
    lines = log.read_bytes().splitlines(keepends=True)
    cut.write_bytes(b"".join(lines[:50])[:-7])
    whole, part = io.BytesIO(), io.BytesIO()
    assert write(cut, part).endswith("; the log has no end: it is still being written, or the program was killed")
    cut.write_bytes(b"".join(lines[:49]))
    write(cut, whole)
    assert part.getvalue() == whole.getvalue()


@pytest.mark.thorough
@pytest.mark.parametrize("write", [to_csv, write_mcap])
def test_memory_does_not_grow_with_the_log(write, events, tmp_path, monkeypatch):
    monkeypatch.setattr("mcap.writer.Writer", partial(Writer, chunk_size=1 << 16))  # 1 MiB would hide a growth
    peaks = []
    for times in (1, 3):
        path = tmp_path / f"{times}.jsonl"
        with path.open("w") as file:
            again = (event | {"time": event["time"] + 100.0 * k} for k in range(times) for event in events[1:-1])
            file.writelines(to_lines(itertools.chain(events[:1], again)))
        with (tmp_path / "out").open("wb") as file:
            tracemalloc.start()
            write(path, file)
            peaks.append(tracemalloc.get_traced_memory()[1])
            tracemalloc.stop()
    assert peaks[1] < 1.3 * peaks[0]


def test_mcap_needs_a_file(mdesign, log):
    code, _, err = mdesign("export", "mcap", log, "-o", "-")
    assert (code, "expected a file" in err) == (2, True)


@pytest.mark.parametrize("form", ["csv", "mcap"])
class TestErrors:
    @pytest.fixture
    def export(self, mdesign, form, tmp_path):
        def run(log, output=tmp_path / "out"):
            code, out, err = mdesign("export", form, log, "-o", output)
            assert out == ""
            assert not (tmp_path / "out").exists()
            return code, err

        return run

    def test_no_log(self, export, tmp_path):
        assert export(tmp_path / "no.jsonl") == (
            1,
            f"Error: {tmp_path}/no.jsonl: cannot be read: No such file or directory\n",
        )
        (tmp_path / "other").write_text("time,x\n1,2\n")
        code, err = export(tmp_path / "other")
        assert (code, "line 1: expected an event that ends in its checksum" in err) == (1, True)
        (tmp_path / "other").write_text("")
        assert export(tmp_path / "other") == (1, f"Error: {tmp_path}/other: expected a robot's log, found nothing\n")

    def test_damage_in_the_middle(self, export, log, tmp_path):
        damaged = tmp_path / "log.jsonl"
        lines = log.read_bytes().splitlines(keepends=True)
        damaged.write_bytes(b"".join([*lines[:50], lines[50].replace(b"0", b"1", 1), *lines[51:]]))
        code, err = export(damaged)
        assert (code, "log.jsonl, line 51: expected the checksum" in err) == (1, True)

    @pytest.mark.parametrize(
        ("change", "words"),
        [
            ({"state": 7}, "expected what this version writes, found other events"),
            ({"readings": [0.5] * 9}, "line 2: cycle.readings: expected"),
            ({"sensed": {"smell": [0.1, 1.0]}}, "line 2: cycle.sensed: expected"),
            ({"sensed": {"position": [0.1, 1.0]}}, "line 2: cycle.sensed: expected"),
        ],
        ids=["state", "readings", "sensor", "values"],
    )
    def test_events_of_another_version(self, export, events, cycles, tmp_path, change, words):
        log = written(tmp_path / "log.jsonl", [events[0], cycles[0] | change])
        gc.disable()  # which would close it
        try:
            code, err = export(log)
            files = [one for one in gc.get_objects() if type(one) is io.BufferedReader and not one.closed]
        finally:
            gc.enable()
        assert (code, words in err) == (1, True)
        assert str(log) not in [str(getattr(file, "name", "")) for file in files]

    def test_the_log_itself_is_not_written_over(self, export, log):
        before = log.read_bytes()
        code, err = export(log, log)
        assert (code, "expected another file than the one that is read" in err) == (2, True)
        assert log.read_bytes() == before

    def test_a_folder_that_is_not_there(self, export, log, tmp_path):
        assert export(log, tmp_path / "no" / "out") == (
            1, f"Error: {tmp_path}/no/out: cannot be written: No such file or directory\n",
        )  # fmt: skip
