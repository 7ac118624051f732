"""Diagrams of PFSMs: everything is in them, and nothing covers anything else."""

import itertools
import json
import random
import re
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from mercator_design.fsm.pfsm import Pfsm, State, Transition
from mercator_design.fsm.text import parse
from mercator_design.fsm.words.names import state_names
from mercator_design.missions.mission import load_mission
from mercator_design.missions.trace import Trace
from mercator_design.modules.flavour import define_flavour
from mercator_design.results.analysis.occupancy import Occupancy, occupancy
from mercator_design.seeds import generator
from mercator_design.show.machines.diagram import _arrows, _box_lines, diagram_svg
from mercator_design.show.machines.layout import laid_out
from mercator_design.show.machines.notations import to_mermaid, to_tikz
from tests.fsm.strategies import FLAVOURS
from tests.fsm.test_files import random_file
from tests.tiers import some

PUBLISHED = json.loads((Path(__file__).parents[1] / "data" / "published_fsms.json").read_text())
W1 = parse(PUBLISHED["watermelon"]["W1"])
SVG = "{http://www.w3.org/2000/svg}"


def crowded():
    """Random PFSMs, many of them with 3 or 4 states and up to 16 transitions, and the published ones."""
    draws = random.Random(3)
    found = [random_file(draws).pfsm for _ in range(60)]
    found.sort(key=lambda pfsm: -sum(len(state.transitions) for state in pfsm.states))
    published = [parse(line, flavour) for flavour in FLAVOURS for line in list(PUBLISHED[flavour].values())[::6]]
    return [*found[:12], *published]


@pytest.mark.swept
@pytest.mark.parametrize("narrow", [False, True])
@pytest.mark.parametrize("pfsm", some(crowded(), 4))
def test_no_label_covers_a_box_or_another_label(pfsm, narrow):
    names = state_names(pfsm)
    texts = [_box_lines(pfsm, k, names, None) for k in range(len(pfsm.states))]
    layout = laid_out(texts, _arrows(pfsm, None), narrow=narrow)
    assert {(arrow.source, arrow.target) for arrow in layout.arrows} == {
        (i, edge.target) for i, state in enumerate(pfsm.states) for edge in state.transitions
    }
    solid = [*layout.boxes, *(arrow.block for arrow in layout.arrows)]
    assert sum(one.covers(other) for one, other in itertools.combinations(solid, 2)) < 1.0


def parts(svg, attribute):
    return {part.get(attribute) for part in ET.fromstring(svg).iter() if part.get(attribute)}  # noqa: S314


def test_what_a_picture_has():
    pfsm = parse(PUBLISHED["watermelon"]["W9"])
    svg = diagram_svg(pfsm)
    assert parts(svg, "data-state") == {"0", "1", "2", "3"}
    assert parts(svg, "data-transition") == {
        f"{i}-{j}" for i, s in enumerate(pfsm.states) for j in range(len(s.transitions))
    }
    for words in ("beta 0.28 per cycle", "xi 9 robots, eta 0.55", "0 exploration 1", "tau 5 cycles", "label red"):
        assert f">{words}" in svg or f", {words}<" in svg
    assert "url(" not in svg
    assert svg.count("http") == 1  # the name space


def test_names_and_captions_are_text():
    svg = diagram_svg(W1, ("search", "rest"), caption=["<script>alert(1)</script> &\u202e\x1b"])
    texts = [part.text for part in ET.fromstring(svg).iter(f"{SVG}text")]  # noqa: S314
    assert "0 search" in texts
    assert texts[-1] == r"<script>alert(1)</script> &\u202e\x1b"
    assert "<script" not in svg


def test_a_single_state():
    assert parts(diagram_svg(Pfsm(W1.states[1:])), "data-state") == {"0"}


def test_what_was_measured_is_shown():
    svg = diagram_svg(W1, measured=Occupancy(shares=(0.25, 0.75), rates={(0, 1): 0.125}))
    for words in ("25.0 % of time", "75.0 % of time", "0.12 per s"):
        assert f">{words}<" in svg


def test_occupancy_of_a_trace():
    states = np.array([[0, 0], [1, 0], [1, 0], [0, 1]], dtype=np.int8)
    floor = load_mission("aggregation").realise_floor(generator(1, "floor"))
    trace = Trace(poses=np.zeros((5, 2, 3)), states=states, floor=floor, zone_rows={}, control_period=0.5)
    found = occupancy([trace, trace], 3)
    assert found.shares == (5 / 8, 3 / 8, 0.0)
    assert {pair: rate for pair, rate in found.rates.items() if rate} == {(0, 1): 2 / 4.0, (1, 0): 1 / 4.0}


def test_mermaid():
    assert to_mermaid(W1, ("search", "rest")) == (
        "stateDiagram-v2\n  [*] --> s0\n  s0: search<br>exploration<br>tau 20 cycles\n  s1: rest<br>stop\n"
        "  s0 --> s1: black floor<br>beta 0.5 per cycle\n"
    )


def test_tikz():
    text = to_tikz(W1, ("search_1", "stop"))
    assert r"\node[state, initial] (s0) at (0, 0) {search\_1 \\ exploration \\ tau 20 cycles};" in text
    assert r"\path (s0) edge node[condition, pos=0.35] {black floor, beta 0.5 per cycle} (s1);" in text
    assert text.count("{") == text.count("}")


@pytest.mark.parametrize("n", [5, 7, 16])
@pytest.mark.usefixtures("registries")
def test_more_than_four_states(n):
    text = "schema: 1\nlimits: {states: 16}\nbehaviours: {stop: 0}\nconditions: {fixed probability: 0}\n"
    define_flavour(text, "large")
    draws = random.Random(n)
    others = [[k for k in range(n) if k != i] for i in range(n)]
    edges = [[Transition("fixed probability", (0.5,), draws.choice(own)) for _ in range(2)] for own in others]
    pfsm = Pfsm(tuple(State("stop", (), tuple(own)) for own in edges), "large")
    for narrow in (False, True):
        assert parts(diagram_svg(pfsm, narrow=narrow), "data-state") == {str(k) for k in range(n)}
    boxes = laid_out([["stop"]] * n, _arrows(pfsm, None)).boxes
    assert not any(one.covers(other) for one, other in itertools.combinations(boxes, 2))
    assert len(set(re.findall(r" at (\(\d+, -?\d+\)) ", to_tikz(pfsm, state_names(pfsm))))) == n


class TestVerb:
    def test_what_robots_do(self, mdesign, tmp_path):
        (tmp_path / "fsm.txt").write_text(PUBLISHED["watermelon"]["W1"])
        picture = tmp_path / "fsm.svg"
        code, _, _ = mdesign("fsm", "show", tmp_path / "fsm.txt", "--mission", "aggregation", "-n", 2, "-o", picture)
        assert code == 0
        assert "2 experiments of 120 s with 3 robots" in picture.read_text()
        assert "% of time" in picture.read_text()

    @pytest.mark.parametrize(
        ("options", "words"),
        [
            (["-n", 2], "--runs and --seed need --mission"),
            (["--mission", "a", "--format", "dot"], "needs --format svg"),
        ],
    )
    def test_wrong_usage(self, mdesign, tmp_path, options, words):
        (tmp_path / "fsm.txt").write_text(PUBLISHED["watermelon"]["W1"])
        code, _, err = mdesign("fsm", "show", tmp_path / "fsm.txt", *options)
        assert (code, words in err) == (2, True)
