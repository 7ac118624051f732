"""Replays and pictures of trees and networks: what their nodes do, colours, and LEDs that modules set."""

import dataclasses

import numpy as np
import pytest
from PIL import Image

import mercator_design as md
from mercator_design.config.colours import STATE_COLOURS
from mercator_design.modules.reference import LED_COLOURS
from mercator_design.network.grammar import parameters_of, to_network
from mercator_design.results.experiments import experiment
from mercator_design.results.experiments.experiment import ShownExperiment
from mercator_design.show.page import ReplayPage
from mercator_design.show.pictures.figures import house_style
from mercator_design.show.pictures.film import Film, Stage
from mercator_design.show.pictures.plots import plots, usual_kinds
from mercator_design.show.replay import replay_of
from mercator_design.tree.text import parse
from tests.own_modules import BLINKS, blink, entered
from tests.show.browser import CHROMIUM
from tests.show.test_film import CAPTION, has
from tests.show.test_replay import unpacked
from tests.show.test_viewer import READY

pytestmark = pytest.mark.together("kernels")  # compiled once

RING = (
    "--nroot 3 --nchildroot 2 --n0 0 --nchild0 2 --n00 6 --c00 5 --p00 0.2 --n01 5 --a01 0 --rwm01 5 --p01 0 "
    "--n1 0 --nchild1 2 --n10 6 --c10 5 --p10 0.2 --n11 5 --a11 1 --p11 0"
)
RUNNING, SUCCESS = 1, 2


@pytest.fixture(scope="module")
def tree(simulator):
    return ShownExperiment.simulated(simulator, parse(RING, "maple"), seed=2)


@pytest.fixture(scope="module")
def network(simulator):
    weights = {one.name: 0.3 * (k % 7 - 3) for k, one in enumerate(parameters_of("evostick"))}
    return ShownExperiment.simulated(simulator, to_network(weights, "evostick"), seed=2)


def test_the_nodes_that_run_are_the_branch_to_the_acting_one(tree):
    activity = unpacked(replay_of(tree))["activity"].reshape(*tree.trace.states.T.shape, 7)
    branches = {0: set(), 3: {0, 1, 3}, 6: {0, 4, 6}}
    for statuses, state in zip(activity.reshape(-1, 7), tree.trace.states.T.ravel(), strict=True):
        assert set(np.flatnonzero(statuses == RUNNING)) == branches[state]
        assert (statuses[0] == SUCCESS) == (state == 0)
    assert {*np.unique(tree.trace.states)} == {0, 3, 6}
    assert replay_of(tree)["header"]["machines"][0]["parents"] == [0, 0, 1, 1, 0, 4, 4]


def test_outputs_of_a_network_are_its_wheels(network):
    nodes = unpacked(replay_of(network))["activity"].reshape(*network.trace.states.T.shape, 17)
    wheels = network.recording.history.wheels.swapaxes(0, 1)
    assert np.abs(nodes[..., 15:] / 50 - 1 - wheels).max() <= 0.0101
    assert (nodes[..., 14] == 100).all()  # the bias
    assert np.ptp(wheels, axis=(0, 1)).min() > 0.5


def test_what_nodes_did_is_not_shown_where_it_is_not_known(tree, shown, monkeypatch):
    assert shown.activity is None
    recording = tree.recording
    states = recording.history.states.copy()
    states[7, 1] = 3 if states[7, 1] != 3 else 6
    other = dataclasses.replace(recording, history=recording.history._replace(states=states))
    assert not experiment._activity(tree.pfsms[0], other)[:, 1].any()
    monkeypatch.setattr(experiment, "MAX_READINGS", tree.activity.size - 1)
    assert experiment._activity(tree.pfsms[0], recording) is None
    assert "activity" not in unpacked(replay_of(dataclasses.replace(tree, activity=None)))


def test_colours_are_those_of_the_diagram(tree):
    machine = replay_of(tree)["header"]["machines"][0]
    blue, orange = "#0072b2", "#e69f00"
    assert machine["colours"] == [None, None, None, blue, None, None, orange]
    for k, colour in ((3, blue), (6, orange)):
        assert f'stroke="{colour}"' in machine["diagram"].split(f'<g data-state="{k}">\n<rect')[1].split("</g>")[0]
    assert tree.legend == [(-1, "none"), (0, "exploration"), (1, "stop")]
    assert tree.colours_at(0).tolist() == [-1, -1, -1]
    acting = {0: -1, 3: 0, 6: 1}
    assert [acting[state] for state in tree.trace.states[-1]] == tree.colours_at(60).tolist()


def test_lamps_show_the_acting_node_and_are_dark_without_one(tree):
    lamps = tree.recording.measure("leds")[:, :, 0]
    for state, colour in ((0, (0, 0, 0)), (3, STATE_COLOURS[0]), (6, STATE_COLOURS[1])):
        assert (lamps[tree.trace.states == state] == colour).all()


@pytest.fixture
def blinking(simulator):
    with entered(blink, **BLINKS) as flavour:
        software = md.parse_fsm("--nstates 1 --s0 0 --led0 5 --call0 0", flavour.name)
        yield ShownExperiment.simulated(simulator, software, seed=2)


def test_films_and_plots_show_leds_that_modules_set(blinking, shown):
    magenta = LED_COLOURS["magenta"]
    with house_style():
        stage = Stage([blinking], CAPTION)
        assert not has(stage.frame(0.1), magenta)
        assert has(stage.frame(3.0), magenta)
        assert not has(Stage([shown], CAPTION).frame(3.0), magenta)
        axes, none = plots([blinking, shown], ["leds"], caption=CAPTION).axes
    assert axes.images[0].get_array().tolist() == [[0, 0] + [5] * 58] * 3
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["off", "magenta"]
    assert none.texts[0].get_text() == "no module sets the LEDs"
    assert "leds" in usual_kinds([shown, blinking])
    assert "leds" not in usual_kinds([shown])


def test_gif_has_colours_that_come_later(blinking, tmp_path):
    Film([blinking], tmp_path / "film.gif", speed=24.0, caption=CAPTION).write()
    with Image.open(tmp_path / "film.gif") as image:
        assert not has(np.asarray(image.convert("RGB")), LED_COLOURS["magenta"])
        image.seek(image.n_frames - 1)
        assert has(np.asarray(image.convert("RGB")), LED_COLOURS["magenta"])


def test_robots_whose_modules_set_no_leds_have_none(blinking):
    mixed = dataclasses.replace(
        blinking, pfsms=(*blinking.pfsms, md.parse_fsm("--nstates 1 --s0 1")), pfsm_of=(0, 1, 0), named_states=()
    )
    assert mixed.led_colours[-1].tolist() == [5, -1, 5]


LIT = """(() => {
  const { diagram } = player.scenes[0], all = (selector) => [...diagram.querySelectorAll(selector)];
  const nodes = (name) => [...new Set(all(`[data-state].${name}`).map((one) => one.dataset.state))].sort();
  const marks = all(".mark").map((one) => one.textContent);
  return { active: nodes("active"), branch: nodes("branch"), idle: nodes("idle"), marks };
})()"""


@pytest.mark.together("browser")
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed")
def test_viewer_shows_the_branch_and_what_was_ticked(tree, page, tmp_path):
    ReplayPage([tree]).save(tmp_path / "page.html")
    page.open(tmp_path / "page.html")
    page.evaluate(READY)
    marks = ["", "", "✓", "✗"]
    for state in (0, 3, 6):
        cycle, robot = np.argwhere(tree.trace.states == state)[0].tolist()
        lit = page.evaluate(f"player.choose({robot}); player.seek({cycle + 1}); player.draw(); {LIT}")
        statuses = tree.activity[cycle, robot]
        assert lit["active"] == ([str(state)] if state else [])
        assert lit["branch"] == [str(k) for k in np.flatnonzero(statuses == RUNNING)]
        assert lit["idle"] == [str(k) for k in np.flatnonzero(statuses == 0)]
        assert lit["marks"] == [marks[status] for status in statuses]
    start = page.evaluate(f"player.seek(0); player.draw(); {LIT}")
    assert start == {"active": [], "branch": [], "idle": [], "marks": [""] * 7}
    assert page.complaints == page.requests == []


@pytest.mark.together("browser")
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed")
def test_viewer_shows_inputs_and_wheels_of_a_network(network, page, tmp_path):
    ReplayPage([network]).save(tmp_path / "page.html")
    page.open(tmp_path / "page.html")
    page.evaluate(READY)
    panel = page.evaluate("player.choose(1); player.seek(30); player.draw(); player.scenes[0].panel.textContent")
    left, right = network.activity[29, 1, 15:] / 50 - 1
    assert f"Wheelsleft {left:.2f}, right {right:.2f}Place" in panel
    titles = page.evaluate('[...document.querySelectorAll("[data-node] title")].map((one) => one.textContent)')
    assert titles[14] == "bias: 1.00"
    assert titles[8] == f"floor: {network.activity[29, 1, 8] / 100:.2f}"
    assert page.complaints == page.requests == []
