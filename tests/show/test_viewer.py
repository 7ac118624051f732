"""The viewer in a browser: it decodes what the simulator did, draws it, and asks for nothing."""

import json

import numpy as np
import pytest
from PIL import Image

import mercator_design as md
from mercator_design.missions.floor_kernels import colours_at
from mercator_design.results.experiments.experiment import ShownExperiment
from mercator_design.show.page import ReplayPage
from mercator_design.sim.simulate import Simulator
from tests.processes import wait_until
from tests.show.browser import CHROMIUM

pytestmark = [pytest.mark.together("browser"), pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed")]

READY = "new Promise((done) => { const wait = setInterval(() => window.player && (clearInterval(wait), done()), 5); })"
DECODED = """player.replays.map((replay) => {
  const poses = [], states = [];
  for (let cycle = 0; cycle <= replay.cycles; cycle++) {
    for (let robot = 0; robot < replay.robots; robot++) {
      poses.push(replay.pose(robot, cycle));
      if (cycle) states.push(replay.state(robot, cycle));
    }
  }
  return { poses, states, score: replay.score, last: replay.scoreAt(replay.cycles) };
})"""
PRESS = """for (const key of %s) {
  document.body.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true }));
}
player.draw();"""
SEEN = """(() => {
  const { canvas } = player.scenes[0].stage;
  const pixels = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  const colours = new Set();
  for (let k = 0; k < pixels.length; k += 4) colours.add((pixels[k] << 16) | (pixels[k + 1] << 8) | pixels[k + 2]);
  return {
    cycle: player.cycle, options: player.options, colours: [...colours],
    active: [...player.scenes[0].diagram.querySelectorAll("[data-state].active")].map((node) => node.dataset.state),
    panel: document.querySelector(".mr-panel").textContent, zoom: player.scenes[0].stage.zoom,
    width: document.documentElement.scrollWidth,
  };
})()"""
PICTURE = "player.scenes[0].stage.canvas.toDataURL()"
PLAYED = """new Promise((done) => {
  player.speed = 64;
  player.toggle();
  const wait = setInterval(() => player.isPlaying || (clearInterval(wait), done(player.cycle)), 5);
})"""
AGAIN = """(() => {
  delete window.DecompressionStream;
  const source = JSON.parse(document.getElementById("replays").textContent)[0];
  return MercatorReplay.Replay.load(source).then((again) => again.pose(0, again.cycles));
})()"""


@pytest.fixture(scope="module")
def folder(shown, cleaning, tmp_path_factory):
    folder = tmp_path_factory.mktemp("viewer")
    ReplayPage([shown, cleaning]).save(folder / "page.html")
    return folder


@pytest.fixture
def opened(page, folder):
    """The page of two experiments, newly opened."""
    page.open(folder / "page.html")
    page.evaluate(READY)
    yield page
    assert page.complaints == []
    assert page.requests == []


def test_poses_states_and_scores_of_each_cycle(opened, shown, cleaning):
    for decoded, experiment in zip(opened.evaluate(DECODED), (shown, cleaning), strict=True):
        trace = experiment.trace
        poses = np.array(decoded["poses"]).reshape(trace.poses.shape)
        assert np.abs(poses[..., :2] - trace.poses[..., :2]).max() < 0.001
        turns = poses[..., 2] - trace.poses[..., 2]
        assert np.abs(np.arctan2(np.sin(turns), np.cos(turns))).max() < np.radians(0.1)
        assert decoded["states"] == trace.states.reshape(-1).tolist()
        assert decoded["score"] == decoded["last"] == experiment.score


def test_keys_choose_step_and_show(opened, shown):
    opened.evaluate(PRESS % '["]", "f", "l", "n", "x", "p", "ArrowRight", "ArrowRight"]')
    found = opened.evaluate(SEEN)
    assert (found["cycle"], found["options"]["robot"]) == (2, 0)
    assert all(found["options"][name] for name in ("follow", "lidar", "neighbours", "proximity", "presence"))
    assert found["active"] == [str(shown.trace.states[1, 0])]
    assert "exploration" in found["panel"]
    assert found["zoom"] > 1
    opened.evaluate(PRESS % '["Escape", "f", "End"]')
    assert opened.evaluate("player.cycle") == 200


@pytest.mark.parametrize("dark", [False, True])
def test_colours(dark, page, folder):
    page.open(folder / "page.html", dark=dark)
    page.evaluate(READY)
    page.evaluate("player.draw()")
    colours = page.evaluate(SEEN)["colours"]
    assert 0x7F7F7F in colours  # the floor
    assert 0x0072B2 in colours  # robots in their initial state
    assert (0x0A0D10 if dark else 0xE4E9EE) in colours  # beyond the walls


def test_telephone(page, folder):
    page.open(folder / "page.html", width=375)
    page.evaluate(READY)
    page.evaluate(PRESS % '["]"]')
    assert page.evaluate(SEEN)["width"] == 375


def test_playing_to_the_end(opened, cleaning):
    assert opened.evaluate(PLAYED) == cleaning.trace.cycles


def test_browser_that_cannot_inflate(opened, shown):
    assert np.abs(np.array(opened.evaluate(AGAIN)[:2]) - shown.trace.poses[-1, 0, :2]).max() < 0.001


FLOOR = """(() => {
  const { stage } = player.scenes[0], { canvas } = stage, cycle = player.cycles;
  stage.draw(cycle);
  const context = canvas.getContext("2d"), { scale, middle } = stage.view(cycle);
  const place = ([x, y]) => [canvas.width / 2 + scale * (x - middle[0]), canvas.height / 2 - scale * (y - middle[1])];
  const [left, top] = place([0, 0]);
  context.setTransform(scale, 0, 0, -scale, left, top);
  stage.drawFloor(context, cycle);
  const { data } = context.getImageData(0, 0, canvas.width, canvas.height);
  return %s.map(place).map(([x, y]) => {
    const k = 4 * (Math.floor(y) * canvas.width + Math.floor(x));
    return [data[k], data[k + 1], data[k + 2]];
  });
})()"""
EVERY_ZONE = """
schema: 1
robots: 1
duration: 1
arena: {walls: {shape: polygon, vertices: [[-2, -1.5], [2, -1.5], [2, 1.5], [-2, 1.5]]}}
placement: {shape: disc, radius: 0.5}
floor:
  background: gray
  image: {path: floor.png, center: [-1, 0.5], size: [1.5, 1]}
  zones:
    - {shape: half_plane, point: [1.5, 0], normal: [1, 0.3], color: blue}
    - {shape: disc, center: [-1, -1], radius: 0.4, color: black}
    - {shape: ring, center: [0.3, 0.3], radius: 0.5, inner_radius: 0.3, color: white}
    - {shape: rectangle, center: [0.5, -1], size: [1, 0.5], angle: 0.5, color: red}
    - {shape: polygon, vertices: [[-0.5, -0.9], [0, -0.7], [-0.3, -0.2]], color: green}
objective: {name: path_length, direction: maximise}
"""


def test_floor_of_every_kind_of_zone(page, tmp_path):
    pixels = np.random.default_rng(1).integers(0, 256, (4, 6, 3), dtype=np.uint8)
    Image.fromarray(pixels).save(tmp_path / "floor.png")
    (tmp_path / "mission.yaml").write_text(EVERY_ZONE)
    mission = md.load_mission(str(tmp_path / "mission.yaml"))
    shown = ShownExperiment.simulated(Simulator(mission), md.parse_fsm("--nstates 1 --s0 1"), seed=1)
    assert len({row[0] for row in shown.trace.floor.zones}) == 5
    ReplayPage([shown]).save(tmp_path / "page.html")
    page.open(tmp_path / "page.html")
    page.evaluate(READY)
    page.evaluate(
        "new Promise((done) => (function look() {"
        "player.scenes[0].stage.floor.image.complete ? done() : setTimeout(look, 5); })())"
    )
    points = np.random.default_rng(2).uniform((-1.9, -1.4), (1.9, 1.4), (2000, 2))
    drawn = np.array(page.evaluate(FLOOR % json.dumps(points.tolist())))
    differ = np.abs(drawn - colours_at(shown.trace.floor, points)).max(axis=1) > 3.0
    assert differ.mean() < 0.03  # at the edges
    assert page.complaints == []


def test_neighbours_are_shown(opened, shown):
    cycle = int(np.flatnonzero(shown.perceived.seen.any(axis=(1, 2)))[0]) + 1
    before = opened.evaluate(f"player.seek({cycle}); player.draw(); {PICTURE}")
    after = opened.evaluate((PRESS % '["n"]') + PICTURE)
    assert before != after


def test_a_player_whose_element_has_gone_is_freed(opened):
    opened.evaluate(
        """(async () => {
          const element = document.body.appendChild(document.createElement("div"));
          const sources = JSON.parse(document.getElementById("replays").textContent);
          window.gone = new WeakRef(await MercatorReplay.mount(element, sources));
          await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
          element.remove();
        })()"""
    )
    wait_until(lambda: opened.collect_garbage() or opened.evaluate("gone.deref() === undefined"))


def test_escape_is_left_to_others_when_no_robot_is_chosen(opened):
    pressed = """(() => {
      const event = new KeyboardEvent("keydown", { key: "Escape", bubbles: true, cancelable: true });
      player.toggles.trails.dispatchEvent(event);
      return [event.defaultPrevented, player.options.robot];
    })()"""
    assert opened.evaluate(pressed) == [False, None]
    opened.evaluate(PRESS % '["]"]')
    assert opened.evaluate("player.options.robot") == 0
    assert opened.evaluate(pressed) == [True, None]


def test_space_on_a_button_presses_it_only(opened):
    pressed = 'new KeyboardEvent("keydown", { key: " ", bubbles: true })'
    opened.evaluate(f"player.toggles.trails.dispatchEvent({pressed})")
    assert not opened.evaluate("player.isPlaying")


def test_keys_elsewhere_are_not_for_a_viewer_within_a_page(shown, tmp_path, page):
    path = tmp_path / "page.html"
    whole = ReplayPage([shown]).html
    path.write_text(whole.replace("replays, true)", "replays)"))
    assert path.read_text() != whole
    page.open(path)
    page.evaluate(READY)
    page.evaluate(PRESS % '["ArrowRight"]')
    assert page.evaluate("player.cycle") == 0
