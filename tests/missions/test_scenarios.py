"""Every shipped mission is tested by being there: what it says, that robots fit, and the scores of three FSMs."""

import json
import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from benchmarks import expected_scores as expected
from mercator_design import schema, shipped
from mercator_design.fsm import parse
from mercator_design.missions.mission import load_mission
from mercator_design.missions.plugins import DYNAMICS, OBJECTIVES

ROOT = Path(__file__).parents[2]
BANDS = json.loads((ROOT / "tests" / "data" / "expected_scores.json").read_text())["bands"]


@pytest.mark.parametrize("name", shipped.missions())
class TestEveryMission:
    def test_it_says_what_it_is_in_a_line(self, name):
        mission = load_mission(name)
        for text in (mission.description, mission.source):
            assert 10 < len(text) <= 200
            assert "\n" not in text
        assert all(
            line.startswith("#") for line in shipped.missions()[name].read_text().split("schema:")[0].splitlines()
        )

    def test_three_fsms_score_as_they_should(self, name):
        """Chance of failing by luck below 1e-6 for all missions together; see benchmarks/expected_scores.py."""
        assert name in BANDS, f"no bands for {name}; make them with: python benchmarks/expected_scores.py {name}"
        simulator = expected.simulator(name)
        flavour, texts = expected.fsms(simulator.mission)
        for label, text in texts.items():
            pfsm = parse(text, flavour)
            with ThreadPoolExecutor(2) as pool:
                scores = list(pool.map(lambda seed: simulator.run(pfsm, seed).score, range(1, 1 + expected.RUNS)))  # noqa: B023
            band = BANDS[name][label]
            assert band["low"] - 1e-9 <= np.mean(scores) <= band["high"] + 1e-9, f"{label}: expected {band}"


def test_there_are_no_bands_of_missions_that_are_gone():
    assert set(BANDS) <= set(shipped.missions())


class TestTheDocument:
    TEXT = (ROOT / "docs" / "missions.md").read_text()

    @pytest.mark.parametrize("name", [*OBJECTIVES, *DYNAMICS])
    def test_every_objective_and_dynamic_has_its_row_with_all_parameters(self, name):
        (row,) = (line for line in self.TEXT.splitlines() if line.startswith(f"| `{name}` |"))
        parameters = row.split("|")[2]
        for parameter in schema.parameters_of({**OBJECTIVES, **DYNAMICS}[name]):
            assert re.search(rf"`{parameter}\b", parameters), parameter

    @pytest.mark.parametrize("name", shipped.missions())
    def test_every_mission_is_in_the_table(self, name):
        assert f"`{name}`" in self.TEXT.split("## Shipped missions")[1]
