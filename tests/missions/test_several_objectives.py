"""Missions with several objectives: their files, scores and weights."""

import json

import pytest

from mercator_design.config.writing import dump, plain
from mercator_design.errors import MissionError
from mercator_design.fsm import parse
from mercator_design.missions.mission import load_mission, parse_mission
from mercator_design.results.analysis.evaluation import Evaluation
from mercator_design.sim.simulate import Simulator

HEAD = """
schema: 1
robots: 2
duration: 5
arena: {walls: {shape: regular_polygon, sides: 12, apothem: 1.226}}
floor: {zones: [{name: spot, shape: disc, center: [0, 0], radius: 0.5, color: black}]}
placement: {shape: disc, radius: 1.2}
"""
FIRST, SECOND = "{name: robots_in_zone, zones: [spot], direction: maximise}", "{name: path_length, direction: minimise}"
SEVERAL = f"{HEAD}objectives:\n- {FIRST}\n- {SECOND}\n"
WEIGHTS = "weights:\n- {weight: 3, low: 0, high: 2}\n- {low: 1, high: 6}\n"
STRAIGHT = "--nstates 1 --s0 0 --rwm0 50"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (HEAD, "expected either objective or objectives, found neither"),
        (f"{SEVERAL}objective: {SECOND}\n", "expected either objective or objectives, found both"),
        (f"{HEAD}objectives:\n- {FIRST}\n", "expected two or more, found one"),
        (f"{HEAD}objectives: [{', '.join([SECOND] * 5)}]", "objectives: expected a list of at most 4"),
        (f"{HEAD}objective: {FIRST}\n{WEIGHTS}", "weights: expected none, or one for each of 0 objectives, found 2"),
        (f"{SEVERAL}weights: [{{low: 0, high: 1}}]", "expected none, or one for each of 2 objectives, found 1"),
        (f"{SEVERAL}{WEIGHTS.replace('high: 6', 'high: 1')}", "weights[1].high: expected more than low, 1, found 1"),
        (f"{SEVERAL}{WEIGHTS.replace('weight: 3', 'weight: 0')}", "weights[0].weight"),
        (SEVERAL.replace("[spot]", "[spit]"), "objectives[0].zones[0]: no zone is called 'spit'; did you mean 'spot'?"),
        (SEVERAL.replace("path_length,", "path_lenght,"), "objectives[1].name"),
    ],
)
def test_mistakes_name_their_place(text, expected):
    with pytest.raises(MissionError) as error:
        parse_mission(text)
    assert expected in str(error.value)


def test_an_experiment_has_a_score_by_each_objective():
    mission = parse_mission(SEVERAL)
    outcome = Simulator(mission).run(parse(STRAIGHT, "watermelon"), 1)
    each = tuple(one(outcome.trace) for one in mission.all_objectives)
    assert outcome.scored == (each[0], each)
    assert mission.costs(each) == (-each[0], each[1])
    assert mission.goal == "maximise robots_in_zone and minimise path_length"
    assert mission.is_ranked_by_all
    assert (mission.direction, mission.possible_scores()[:2]) == ("maximise", (0.0, 2.0))


def test_weights_scale_and_sum_costs():
    mission = parse_mission(SEVERAL + WEIGHTS)
    assert mission.score_of((2.0, 1.0)) == 0.0
    assert mission.score_of((0.0, 6.0)) == 1.0
    assert mission.score_of((1.0, 11.0)) == (3 * 0.5 + 2.0) / 4
    assert (mission.direction, mission.is_ranked_by_all) == ("minimise", False)
    low, high, maximise = mission.possible_scores()
    assert (low, maximise) == (-0.2 / 4, False)  # the spot has both, and nobody has moved
    assert high > 1e100  # paths may be of any length
    assert mission.cost(0.3) == mission.score(0.3) == 0.3


def test_files_and_digests(tmp_path):
    mission = parse_mission(SEVERAL + WEIGHTS)
    assert parse_mission(dump(mission)) == mission
    assert mission.digest != parse_mission(SEVERAL).digest
    assert not {"objective", "weights"} & plain(parse_mission(SEVERAL)).keys()
    assert not {"objectives", "weights"} & plain(load_mission("aggregation")).keys()
    twice = parse_mission(
        f"{HEAD}objectives: [{SECOND}, {SECOND}, {FIRST}]", overrides=["objectives[1].direction=maximise"]
    )
    assert twice.objective_names == ("path_length", "path_length (2)", "robots_in_zone")
    assert parse_mission(SEVERAL, overrides=["objectives[1].direction=maximise"]).goal.endswith("maximise path_length")


def test_an_objective_twice_is_refused():
    with pytest.raises(MissionError, match=r"objectives\[1\]: expected another one than objectives\[0\]"):
        parse_mission(f"{HEAD}objectives: [{SECOND}, {SECOND}, {FIRST}]")


def test_an_objective_that_cannot_differ_is_refused_by_its_place():
    mission = parse_mission(SEVERAL.replace("center: [0, 0]", "center: [9, 9]"))
    with pytest.raises(MissionError) as error:
        Simulator(mission).refuse_impossible()
    assert "lies outside the walls" in str(error.value)


def test_evaluations_have_the_figures_of_each(tmp_path):
    mission = parse_mission(SEVERAL)
    scored = [mission.scored(Simulator(mission).run(parse(STRAIGHT, "watermelon"), seed).trace) for seed in (1, 2, 3)]
    found = Evaluation.of(mission, scored, (1, 2, 3))
    assert found.by_objective["path_length"].values == tuple(one.by_objective[1] for one in scored)
    assert found.scores.values == found.by_objective["robots_in_zone"].values
    assert "path_length mean" in found.summary


def test_verbs_have_a_figure_for_each(mdesign, tmp_path):
    (tmp_path / "m.yaml").write_text(SEVERAL)
    (tmp_path / "w.yaml").write_text(SEVERAL + WEIGHTS)
    fsms = [tmp_path / "straight.txt", tmp_path / "stop.txt"]
    for file, text in zip(fsms, (STRAIGHT, "--nstates 1 --s0 1"), strict=True):
        file.write_text(f"{text}\n")
    on, few = ("--mission", tmp_path / "m.yaml"), ("-n", 3, "-j", 1)
    out = mdesign("evaluate", fsms[1], *on, *few)[1]
    assert "path_length (minimise)" in out
    assert "on the front" not in out
    out = mdesign("evaluate", *fsms, *on, *few)[1]
    assert "stop.txt" in out
    assert "on the front" in out
    assert "Best by robots_in_zone: " in out
    found = json.loads(mdesign("evaluate", fsms[1], *on, *few, "--json")[1])
    assert found["objectives"]["path_length"]["mean"] == 0.0
    assert found["objectives"]["robots_in_zone"]["scores"] == found["scores"]
    assert "mean of path_length" in mdesign("evaluate", *fsms, *on, *few, "--csv")[1].splitlines()[0]
    code, _, err = mdesign("evaluate", fsms[1], *on, *few, "--cost")
    assert (code, "several objectives; give them weights" in err) == (2, True)
    weighted = mdesign("evaluate", fsms[1], "--mission", tmp_path / "w.yaml", *few, "--cost")
    assert weighted[0] == 0
    assert float(weighted[1]) == pytest.approx((3 * (2 - found["mean"]) / 2 + (0 - 1) / 5) / 4)
    out = mdesign("record", fsms[1], *on, "-o", tmp_path / "trace.npz")[1]
    assert "path_length 0" in out
    code, _, err = mdesign("fsm", "simplify", fsms[0], "-o", tmp_path / "simple.txt", *on)
    assert (code, "give the objectives weights" in err) == (3, True)
