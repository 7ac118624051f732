"""The shipped studies: found by name, at full budgets, smaller by overrides."""

import pytest

from mercator_design.config import shipped
from mercator_design.errors import MissionError, StudyError
from mercator_design.studies.plan import load_plan
from mercator_design.studies.resolving import resolve


@pytest.mark.usefixtures("registries")
@pytest.mark.parametrize("name", shipped.studies())
def test_shipped_studies_can_be_run(name):
    plan = load_plan(name)
    assert plan.name == name
    assert max(plan.budgets) == 10_000
    assert plan.repetitions == 10
    one_mission = load_plan(name, [f"missions=[{plan.missions[0]}]", "budgets=[100]"])
    assert {cell.budget for cell in resolve(one_mission).layout.cells} <= {0, 100}


def test_other_names_and_keys_are_refused():
    with pytest.raises(MissionError, match="no such study; did you mean 'maple'"):
        load_plan("mapel")
    with pytest.raises(StudyError, match="--set budgets=x"):
        load_plan("maple", ["budgets=x"])
