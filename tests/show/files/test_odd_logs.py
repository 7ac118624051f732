"""Logs and recordings whose checksums are right, and whose values nobody would write: never a traceback."""

import contextlib
import copy
import io
import json
import math
import zlib
from collections import deque

import pytest

from mercator_design.calibration.scenes import read_recording
from mercator_design.errors import RobotError
from mercator_design.robot.cli.replay import _show
from mercator_design.robot.logs import log
from mercator_design.robot.logs.log import replay
from mercator_design.show.files.robot_log_table import write_csv
from mercator_design.show.files.robot_logs import write_mcap
from tests.calibration.recordings import CENTRES, measured, write
from tests.robot.log_events import read
from tests.tiers import some
from tests.twin.recorded import unpack

pytestmark = pytest.mark.together

ODD = (None, "x", "\ud800", True, -1, 1e18, -1e308, math.inf, math.nan, 10**23, [], {}, [[[]]], [1.0] * 20)
GONE = object()


def line(event):
    """As `to_line`, which refuses what is no number."""
    text = json.dumps(event)
    return f'{text[:-1]},"crc":"{zlib.crc32(text.encode()):08x}"}}\n'


def places(value, way=()):
    """The ways to what is in a value; of lists and mappings only to the first and last item."""
    if way:
        yield way
    if isinstance(value, dict | list) and value:
        keys = [*value] if isinstance(value, dict) else range(len(value))
        for key in {keys[0], keys[-1]} if way else keys:
            yield from places(value[key], (*way, key))


def changed(event, way, value):
    """An event with another value somewhere, or with none."""
    event = inner = copy.deepcopy(event)
    for step in way[:-1]:
        inner = inner[step]
    if value is GONE:
        del inner[way[-1]]
    else:
        inner[way[-1]] = value
    return event


@pytest.fixture(scope="module")
def kinds(tmp_path_factory):
    """The events of a short run, and of a recording, by kind."""
    folder = tmp_path_factory.mktemp("logs")
    start, *run, end = read(unpack(folder) / "run0.jsonl")
    cycles = [event for event in run if event["event"] == "cycle"][:3]
    note = {"event": "note", "time": 0.1, "text": "battery 80 %"}
    centres = {name: CENTRES[name] for name in ("proximity", "attitude", "position", "lidar")}
    recording = [*read(write(folder / "still.jsonl", measured(0.4, centres=centres)), "recording")]
    drive = {"event": "wheels", "time": 0.2, "left": 0.1, "right": 0.0}
    found = {"run": [start, note, *cycles, end], "recording": [*recording[:-1], drive, note, recording[-1]]}
    return {kind: [e | {"line": k} for k, e in enumerate(events, start=1)] for kind, events in found.items()}


def show(path):
    for decided in replay(path):
        _show(decided)


READERS = {
    "replay": ("run", show),
    "table": ("run", lambda path: write_csv([path], io.BytesIO(), pytest.fail)),
    "messages": ("run", lambda path: write_mcap(path, io.BytesIO())),
    "recorded table": ("recording", lambda path: write_csv([path], io.BytesIO(), pytest.fail)),
    "recorded messages": ("recording", lambda path: write_mcap(path, io.BytesIO())),
    "calibration": ("recording", read_recording),
}


@pytest.fixture(scope="module")
def odd(kinds, tmp_path_factory):
    """Logs with an odd value, by kind: those that can be read, and those that no reader gets any further with."""
    path = tmp_path_factory.mktemp("odd") / "log.jsonl"
    found = {}
    for kind, events in kinds.items():
        lines = [*map(line, events)]
        seen, readable, refused = set(), [], []
        for k, event in enumerate(events):
            what = event["event"], event.get("sensor")
            if what in seen:
                continue
            seen.add(what)
            for way in places(event):
                for value in (*ODD, GONE):
                    text = "".join([*lines[:k], line(changed(event, way, value)), *lines[k + 1 :]])
                    path.write_text(text)
                    try:
                        deque(log.read(path, kind), maxlen=0)
                    except RobotError:
                        refused.append(text)
                    else:
                        readable.append(text)
        assert len(refused) > 50 * len(seen)
        found[kind] = readable, refused
    return found


@pytest.mark.swept
@pytest.mark.parametrize("reader", READERS)
def test_odd_values_are_refused_or_told(kinds, odd, tmp_path, reader):
    kind, run = READERS[reader]
    readable, refused = odd[kind]
    path = tmp_path / "log.jsonl"
    path.write_text("".join(map(line, kinds[kind])))
    run(path)  # as it is
    for text in some(readable, 8):
        path.write_text(text)
        with contextlib.suppress(RobotError):
            run(path)
    for text in some(refused[::10], 5):
        path.write_text(text)
        with pytest.raises(RobotError):
            run(path)


@pytest.mark.parametrize("reader", READERS)
def test_lines_that_are_missing_or_not_in_their_order_are_told(kinds, tmp_path, reader):
    kind, run = READERS[reader]
    lines, path = [*map(line, kinds[kind])], tmp_path / "log.jsonl"
    for k in range(1, len(lines) - 1):
        missing, twice = [*lines[:k], *lines[k + 1 :]], [*lines[:k], *lines[k - 1 :]]
        swapped = [*lines[:k], lines[k + 1], lines[k], *lines[k + 2 :]]
        for others, found in ((missing, k + 2), (twice, k), (swapped, k + 2)):
            path.write_text("".join(others))
            words = f"log.jsonl, line {k + 1}: expected line {k + 1}, found line {found}: lines are missing"
            with pytest.raises(RobotError, match=words):
                run(path)


@pytest.mark.parametrize("reader", READERS)
def test_a_log_that_breaks_off_is_read(kinds, tmp_path, reader):
    kind, run = READERS[reader]
    lines, path = [*map(line, kinds[kind])], tmp_path / "log.jsonl"
    for cut in (1, len(lines[-1]) // 2, len(lines[-1]), len(lines[-1]) + 1):
        path.write_text("".join(lines)[:-cut])
        run(path)


@pytest.mark.parametrize("reader", READERS)
def test_a_last_line_that_was_changed_is_reported(kinds, tmp_path, reader):
    """It is whole, so nobody is still writing it."""
    kind, run = READERS[reader]
    *lines, last = map(line, kinds[kind])
    path = tmp_path / "log.jsonl"
    for changed_to in (last.replace("why", "whY"), "garbage\n", "\n"):
        path.write_text("".join(lines) + changed_to)
        with pytest.raises(RobotError, match=rf"log.jsonl, line {len(lines) + 1}: "):
            run(path)
