"""What a replay holds: poses, states, transitions, readings, the floor and the score."""

import base64
import dataclasses
import json
import re
import zlib

import numpy as np
import pytest

import mercator_design as md
from mercator_design.missions.floor_kernels import colours_at
from mercator_design.results.experiments.experiment import ShownExperiment
from mercator_design.show.page import ReplayPage
from mercator_design.show.replay import replay_of
from mercator_design.sim.simulate import Simulator

MAX_PAGE = 250_000  # bytes


def unpacked(replay):
    """The arrays of a replay, as the viewer unpacks them."""
    data, at, arrays = zlib.decompress(base64.b64decode(replay["data"])), 0, {}
    for entry in replay["header"]["layout"]:
        shape = (entry["rows"], entry["columns"])
        n = shape[0] * shape[1]
        planes = 2 if entry["kind"] == "delta16" else 1
        values = np.frombuffer(data, np.uint8, planes * n, at).reshape(planes, *shape).astype(np.int64)
        at += planes * n
        if planes == 2:
            values = np.cumsum(values[0] + 256 * values[1], axis=1)
            values = values.astype(np.uint16).astype(np.int16).astype(np.int64)[np.newaxis]
        arrays[entry["name"]] = values[0]
    assert at == len(data)
    return arrays


@pytest.fixture(scope="module")
def replay(shown):
    return replay_of(shown)


def test_poses_and_states(shown, replay):
    header, arrays = replay["header"], unpacked(replay)
    poses = shown.trace.poses
    places = np.stack([arrays["x"], arrays["y"]], axis=-1) * header["poses"]["unit"] + header["poses"]["origin"]
    assert np.abs(places.swapaxes(0, 1) - poses[..., :2]).max() <= 0.0005 + 1e-12
    turns = arrays["heading"].T * 2.0 * np.pi / 65536.0 - poses[..., 2]
    assert np.abs(np.arctan2(np.sin(turns), np.cos(turns))).max() < np.radians(0.1)
    assert (shown.trace.states == arrays["state"].T).all()


def test_transitions_explain_each_change_of_state(shown, replay):
    states, fired = unpacked(replay)["state"], unpacked(replay)["fired"]
    before = np.hstack([np.zeros((len(states), 1), dtype=int), states[:, :-1]])
    assert ((fired > 0) == (states != before)).all()
    assert fired.max() == 1
    machine = shown.pfsms[0]
    for robot, cycle in np.argwhere(fired):
        taken = machine.states[before[robot, cycle]].transitions[fired[robot, cycle] - 1]
        assert taken.target == states[robot, cycle]


def test_readings(shown, replay):
    header, arrays = replay["header"], unpacked(replay)
    recording = shown.recording
    assert (recording.measure("neighbours")[..., 0] == arrays["neighbours"].T).all()
    names = [colour["name"] for colour in header["grounds"]]
    assert set(names) == {"gray", "black"}
    grey = np.array([names[k] == "gray" for k in arrays["ground"].ravel()]).reshape(arrays["ground"].shape).T
    assert (grey == (recording.measure("ground")[..., 0] == 127.0)).all()
    measured = recording.measure("proximity")
    levels = arrays["proximity"].reshape(shown.trace.robots, shown.trace.cycles, -1).swapaxes(0, 1)
    assert ((levels == 255) == np.isposinf(measured)).all()
    near = np.isfinite(measured)
    step = header["proximity"]["range"] / header["proximity"]["steps"]
    assert np.abs(levels[near] * step - measured[near]).max() <= 0.5 * step + 1e-9
    counts = np.unpackbits(arrays["seen"].astype(np.uint8), axis=1).reshape(*arrays["state"].shape, -1).sum(axis=2)
    assert (recording.measure("neighbours")[..., 0] >= counts.T).all()
    assert counts.any()


def test_score_so_far_ends_with_the_score(shown, replay, simulator):
    curve = replay["header"]["curve"]
    assert replay["header"]["score"] == shown.mission.objective(shown.trace) == curve["scores"][-1]
    assert curve["cycles"][-1] == shown.trace.cycles
    shorter = Simulator(md.load_mission("aggregation", ["duration=3"])).run(shown.pfsms[0], 2)
    assert curve["scores"][curve["cycles"].index(30)] == shorter.score


def test_floor_that_changes(cleaning):
    floor = replay_of(cleaning)["header"]["floor"]
    zones = np.array(floor["zones"])
    assert floor["changes"]
    for _, row, values in floor["changes"]:
        zones[row] = values
    final = cleaning.trace.floor._replace(zones=zones)
    middles = zones[:, 1:3]
    expected = cleaning.trace.zone_colors(tuple(cleaning.trace.zone_rows))[-1]
    assert (colours_at(final, middles) == expected).all()


@pytest.mark.thorough
def test_bytes_of_twenty_robots():
    mission = md.load_mission("aggregation_20")
    explore = md.parse_fsm(
        "--nstates 2 --s0 0 --rwm0 5 --n0 1 --n0x0 0 --c0x0 5 --p0x0 0.02 "
        "--s1 2 --att1 2 --n1 1 --n1x0 0 --c1x0 5 --p1x0 0.02"
    )
    assert (mission.robots, mission.duration) == (20, 120.0)
    page = ReplayPage([ShownExperiment.simulated(Simulator(mission), explore, seed=1)])
    assert len(page.html.encode()) <= MAX_PAGE


def test_words_of_others_are_text(shown):
    title = "</script><script>alert(1)</script>\u202e<img src=x>" + "x" * 10_000
    page = ReplayPage([dataclasses.replace(shown, title=title, names=("<b>", "&amp;", "\x1b[31m"))]).html
    assert page.count("<script") == 2
    assert "<img" not in page
    data = json.loads(re.search(r'id="replays">(.*?)</script>', page, re.DOTALL).group(1))
    assert data[0]["header"]["title"] == title
    assert data[0]["header"]["names"] == ["<b>", "&amp;", "\x1b[31m"]


def test_page_asks_for_nothing(shown):
    page = ReplayPage([shown]).html
    assert "default-src 'none'" in page
    assert set(re.findall(r"https?://[\w./-]+", page)) <= {"http://www.w3.org/2000/svg"}


def test_notebook(simulator):
    trace = md.simulate(simulator.mission, md.parse_fsm("--nstates 1 --s0 0 --rwm0 5"), seed=3)
    cell = trace.replay()._repr_html_()
    assert cell.startswith('<iframe srcdoc="&lt;!doctype html&gt;')
    assert 'sandbox="allow-scripts"' in cell


def test_saving(shown, tmp_path):
    page = ReplayPage([shown])
    page.save(tmp_path / "replay.html")
    assert (tmp_path / "replay.html").read_text() == page.html


def test_mission_that_is_too_long_to_be_shown_is_not_simulated(monkeypatch):
    mission = md.load_mission("aggregation_20", ["duration=26000"])
    simulator = Simulator(mission)
    monkeypatch.setattr(Simulator, "run", lambda *_, **__: pytest.fail("it was simulated"))
    with pytest.raises(md.MercatorError, match="5,000,000 cycles of all robots together, found 20 robots and 260000"):
        ShownExperiment.simulated(simulator, md.parse_fsm("--nstates 1 --s0 1"), seed=1)
