import json

import pytest

from mercator_design import designer
from mercator_design.designer import Designer
from mercator_design.jit import marked
from mercator_design.missions.mission import load_mission
from mercator_design.modules.reference import ReferenceModel
from mercator_design.race import Experiment
from mercator_design.race.analysis.pairs import compared
from mercator_design.race.elimination.summary import Scores
from mercator_design.scores import ScoreRange
from mercator_design.seeds import MAX_SEED, instance_seed
from mercator_design.show.text.columns import difference
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.simulate import Simulator
from mercator_design.software.digest import FILES, control_digest


def test_scores_sum_up():
    scores = Scores((1.0, 2.0, 3.0, 6.0))
    assert scores.mean == 3.0
    assert scores.standard_deviation == pytest.approx(2.160247)
    assert scores.quartiles == (1.75, 2.5, 3.75)
    low, high = scores.confidence_interval  # t of 3 degrees of freedom: 3.182446
    assert (low, high) == (pytest.approx(3 - 3.182446 * 2.160247 / 2), pytest.approx(3 + 3.182446 * 2.160247 / 2))


def test_intervals_are_within_what_scores_can_be():
    """As of two runs, whose t interval is 12.7 times as wide as their standard error."""
    assert Scores((0.0, 3600.0)).confidence_interval[0] < -20000.0
    assert Scores((0.0, 3600.0), ScoreRange(0.0, 3600.0)).confidence_interval == (0.0, 3600.0)
    low, high = Scores((1.0, 2.0, 3.0, 6.0)).confidence_interval
    assert Scores((1.0, 2.0, 3.0, 6.0), ScoreRange(low=0.0)).confidence_interval == (0.0, high)
    assert Scores((1.0, 2.0, 3.0, 6.0), ScoreRange(-9.0, 5.0)).confidence_interval == (low, 5.0)
    scores = {0: {0: 0.0, 1: 3600.0}, 1: {0: 1.0, 1: 0.0}}
    (pair,) = compared(scores, possible=ScoreRange(0.0, 3600.0))
    assert pair.differences.confidence_interval == (-3600.0, 3600.0)
    assert difference((0.0, 3600.0), (1.0, 0.0), ScoreRange(0.0, 3600.0)) == "+1.8e+03 ± 5.4e+03"


def test_the_best_possible_score_depends_on_the_direction():
    possible = ScoreRange(0.0, 3600.0, maximise=True)
    assert (possible.limit, possible._replace(maximise=False).limit) == (" of at most 3600", " of at least 0")
    assert ScoreRange(low=0.0, maximise=True).limit == ScoreRange(high=3.0).limit == ""


def test_a_single_score_has_no_spread():
    assert Scores((4.0,)).standard_deviation is None
    assert Scores((4.0,)).confidence_interval is None


@pytest.mark.thorough
def test_a_huge_budget_costs_nothing_before_it_is_used():
    simulator = Simulator(load_mission("aggregation", ["duration=1"]))
    assert Designer(simulator, budget=10**12, seed=1).optimizer.ask()


def test_seeds_of_instances_are_those_of_irace_s_domain_and_differ_by_purpose():
    seeds = [instance_seed(1, purpose, k) for purpose in ("race", "evaluation") for k in range(500)]
    assert all(1 <= seed <= MAX_SEED for seed in seeds)
    assert len(set(seeds)) == len(seeds)  # a chance below 3e-4 for one master seed; this one is fixed


def test_the_header_tells_a_robot_what_was_raced():
    mission = load_mission("aggregation", ["duration=1", "control_period=0.05"])
    header = Designer(Simulator(mission), budget=100, seed=1).header()
    keys = ("robots", "control period", "maximum speed", "reference model", "control software")
    assert {key: header[key] for key in keys} == {
        "robots": "3",
        "control period": "0.05",
        "maximum speed": "0.3",
        "reference model": "{}",
        "control software": control_digest(),
    }
    model = load_robot_model("mercator-argos")
    header = Designer(Simulator(mission, model), budget=100, seed=1).header()
    raced = json.loads(header["reference model"])
    assert ReferenceModel(**raced) == model.reference_model
    assert raced.keys() < model.reference_model._asdict().keys()


def test_the_digest_is_of_every_file_with_a_kernel_of_control_software():
    covered = {f"mercator_design.{folder}.{name}" for folder, names in FILES.items() for name in names}
    rooms = tuple(f"mercator_design.{folder}." for folder in FILES)
    assert {function.__module__ for function in marked() if function.__module__.startswith(rooms)} <= covered


def test_no_more_control_software_is_kept_than_run_at_a_time(monkeypatch):
    monkeypatch.setattr(designer, "MAX_SOFTWARE", 3)
    one = Designer(Simulator(load_mission("aggregation", ["duration=1"])), budget=100, seed=1)
    one.optimizer.ask()
    items = [one.item(Experiment(number, 0), one.optimizer.configurations[number])[0] for number in range(10)]
    assert len(one._software) <= 3
    assert items[9] is one.item(Experiment(9, 0), one.optimizer.configurations[9])[0]
    assert items[0] == one.item(Experiment(0, 0), one.optimizer.configurations[0])[0]
