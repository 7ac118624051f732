"""Every shipped mission is tested by being there: what it says, that robots fit, and the scores of three FSMs."""

import functools
import json
import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from benchmarks import expected_scores as expected
from mercator_design.config import schema, shipped
from mercator_design.fsm import parse
from mercator_design.missions.mission import load_mission
from mercator_design.missions.plugins import DYNAMICS, OBJECTIVES
from tests.tiers import some

ROOT = Path(__file__).parents[2]
EXPECTED = json.loads((ROOT / "tests" / "data" / "expected_scores.json").read_text())["missions"]
FEW = 4
"""Experiments of each FSM, unless rounding may change most of its scores."""


simulator_of = functools.cache(expected.simulator)


class TestEveryMission:
    @pytest.mark.parametrize("name", shipped.missions())
    def test_it_says_what_it_is_in_a_line(self, name):
        mission = load_mission(name)
        for text in (mission.description, mission.source):
            assert 10 < len(text) <= 200
            assert "\n" not in text
        assert all(
            line.startswith("#") for line in shipped.missions()[name].read_text().split("schema:")[0].splitlines()
        )

    @pytest.mark.swept
    @pytest.mark.parametrize("name", some(shipped.missions(), 4))
    def test_three_fsms_score_as_they_should(self, name):
        """Chance of failing by luck below 1e-6 for all missions together; see benchmarks/expected_scores.py."""
        assert name in EXPECTED, f"no scores of {name}; make them with: python benchmarks/expected_scores.py {name}"
        simulator = simulator_of(name)
        for label, text in expected.fsms(simulator.mission)[1].items():
            entry = EXPECTED[name][label]
            n = FEW if entry["scores"].count(None) <= expected.RUNS // 2 else expected.RUNS
            found, scores = run(simulator, text, n), entry["scores"][:n]
            assert not expected.unlike(found, scores), f"{label}: expected {scores}, found {found}"
            if n == expected.RUNS:  # scores of few seeds can be known, but the mean is within a band
                assert entry["low"] - 1e-9 <= np.mean(found) <= entry["high"] + 1e-9, f"{label}: expected {entry}"

    @pytest.mark.parametrize("name", shipped.missions())
    def test_enough_is_expected_of_it_to_tell_one_mission_from_another(self, name):
        entries = EXPECTED[name].values()
        assert len(entries) == 3
        scores = [score for entry in entries for score in entry["scores"] if score is not None]
        assert len(scores) >= 1.5 * expected.RUNS
        assert len(set(scores)) > 1
        least, most = expected.possible(simulator_of(name).mission)
        assert all(least <= entry["low"] <= entry["high"] <= most for entry in entries)
        # There robots cross hardly more often one way than the other, or are about as many on one spot as on the other.
        assert name in {"directional_gate", "waffle_difference"} or any(entry["low"] > least for entry in entries)


def run(simulator, text, n):
    pfsm = parse(text, expected.fsms(simulator.mission)[0])
    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(lambda seed: simulator.run(pfsm, seed).score, range(1, 1 + n)))


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        (
            "directional_gate",  # all of it turned by 30 degrees about the centre
            [
                "floor.zones[0].center=[-0.36667,0.63508]",
                "floor.zones[0].angle=0.5236",
                "floor.zones[1].angle=0.5236",
                "objective.angle=-1.0472",
                "arena.obstacles[0]={center: [-0.25817, -0.05283], size: [0.045, 0.5], height: 0.07, angle: 0.5236}",
                "arena.obstacles[1]={center: [0.17484, 0.19717], size: [0.045, 0.5], height: 0.07, angle: 0.5236}",
            ],
        ),
        ("directional_gate", ["objective.angle=-1.0472"]),
        ("aggregation", ["floor.zones[0].radius=0.6"]),
        ("foraging", ["floor.zones[1].center=[-0.75,0.15]"]),
        ("shelter_behind", ["arena.obstacles[2].center=[1.1,0]"]),  # as good as gone
        ("shelter", ["placement.radius=1.0"]),
        ("color_aggregation", ["objective.values.red=2"]),
        ("chocolate_spc", ["objective.square_unit=0.04"]),
        ("chocolate_lcn", ["objective.link=0.36"]),
    ],
)
def test_another_mission_does_not_score_as_expected(name, changes):
    mission = load_mission(name, [*changes, f"duration={simulator_of(name).mission.duration}"])
    simulator, texts = expected.Simulator(mission), expected.fsms(mission)[1]
    assert any(
        expected.unlike(run(simulator, texts[label], FEW), EXPECTED[name][label]["scores"][:FEW]) for label in texts
    )


def test_nothing_is_expected_of_missions_that_are_gone():
    assert set(EXPECTED) <= set(shipped.missions())


class TestTheDocument:
    TEXT = (ROOT / "docs" / "reference" / "missions.md").read_text()
    SHIPPED = (ROOT / "docs" / "reference" / "shipped-missions.md").read_text().partition("## Pictures")[0]

    @pytest.mark.parametrize("name", [*OBJECTIVES, *DYNAMICS])
    def test_every_objective_and_dynamic_has_its_row_with_all_parameters(self, name):
        (row,) = (line for line in self.TEXT.splitlines() if line.startswith(f"| `{name}` |"))
        parameters = row.split("|")[2]
        for parameter in schema.parameters_of({**OBJECTIVES, **DYNAMICS}[name]):
            assert re.search(rf"`{parameter}\b", parameters), parameter

    @pytest.mark.parametrize("name", shipped.missions())
    def test_every_mission_is_in_the_table(self, name):
        assert f"`{name}`" in self.SHIPPED
