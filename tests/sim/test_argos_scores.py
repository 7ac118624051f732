"""Agreement with the original: scores and statistics of controllers, as distributions and run by run."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks import two_samples
from benchmarks.argos import correlations, scores
from benchmarks.argos.recordings import RecordingError, mission_and_robot, read
from mercator_design.fsm import parse
from tests.tiers import takes_long

pytestmark = [pytest.mark.together("kernels"), pytest.mark.usefixtures("experiments_once")]  # compiled once

DATA = read(Path(__file__).parents[1] / "data" / "argos_scores.json.gz")
# If nothing differs, Benjamini and Hochberg's procedure rejects anything with at most this chance. Seeds are fixed: it
# is the chance over their choice, for all missions together.
FALSE_ALARM = 1e-6
STAYS = parse("--nstates 1 --s0 1")
SHUFFLES = parse("--nstates 2 --s0 0 --rwm0 5 --n0 2 --n0x0 0 --c0x0 0 --p0x0 0.5 --n0x1 0 --c0x1 1 --p0x1 0.5 --s1 1")


def compare(runs=DATA["runs"], meta=DATA["meta"], experiments=40):
    return scores.compare(meta, runs, experiments=experiments, seed=1, jobs=2, report=lambda _: None)


@pytest.fixture(scope="module")
def comparisons(experiments_once):
    return compare()


def all_tests(comparisons):
    return [test for kind in (True, False) for test in scores.first_tests(comparisons, of_scores=kind)[0]]


def rejected(tests):
    return [tests[k].statistic for k in two_samples.rejected([test.p for test in tests], FALSE_ALARM)]


@pytest.mark.thorough
def test_distributions(comparisons):
    assert not any(c.left_out for c in comparisons)
    tests = all_tests(comparisons)
    assert len(tests) == 12 * (1 + 26)
    assert rejected(tests) == []


def test_distributions_tell_another_robot():
    """Proximity that reaches 5 cm less far is found out."""
    meta = {"missions": {"aggregation": {"n_robots": 3, "prox_range": 0.35}}}
    runs = [run for run in DATA["runs"] if run["mission"] == "aggregation" and run["name"] == "explore_rwm20"]
    assert "prox" in rejected(all_tests(compare(runs, meta)))


def artificial(means, spread, recorded=20, ours=200):
    """A comparison of controllers whose scores are normal and all have one standard deviation, here and there."""
    random = np.random.default_rng(1)
    controllers = [
        scores.Controller(
            str(mean),
            *({"score": random.normal(mean, spread, n)} for n in (recorded, ours)),
            pfsm=STAYS,
            seeds=[],
        )
        for mean in means
    ]
    return scores.Comparison("artificial", controllers)


@pytest.mark.thorough
def test_limits_of_correlation():
    exact = correlations.correlation_limits(artificial(range(10), spread=0.01))
    assert (exact.median, exact.lowest) == pytest.approx((1.0, 1.0))
    assert exact.visible > 0.95
    limits, halves = [], []
    for spread in (3.0, 10.0):
        c = artificial(range(10), spread)
        limits.append(correlations.correlation_limits(c))
        halves.append(correlations.halves(c))
        assert correlations.correlation_limits(c, missions=9).lowest < limits[-1].lowest < limits[-1].median < 1.0
        # Another simulator that is told orders the means otherwise, by more than the noise of the data.
        assert limits[-1].visible < limits[-1].median
    assert limits[0].median > limits[1].median
    assert limits[0].visible > 0.5 > limits[1].visible
    assert halves[0] > halves[1]


def test_a_simulator_whose_means_are_ordered_as_said_is_reported():
    """The power that is stated, played with other simulators of which some order the means as bad, or worse."""
    random = np.random.default_rng(2)
    limits = correlations.correlation_limits(artificial(range(20), spread=5.0))
    true = np.arange(20.0)
    truth, found = [], []
    for size in np.tile([0.0, 5.0, 10.0], 200):
        means = true + random.normal(0.0, size, 20)
        truth.append(correlations.correlation(true, means))
        ours, theirs = (random.normal(mean, 5.0 / np.sqrt(n)) for mean, n in ((true, 180), (means, 20)))
        found.append(correlations.correlation(theirs, ours))
    told, truth = np.array(found) < limits.lowest, np.array(truth)
    assert min(np.sum(truth == 1.0), np.sum(truth <= limits.visible)) >= 100
    assert told[truth <= limits.visible].mean() > correlations.POWER - 0.05
    assert told[truth == 1.0].mean() < 0.05  # 1 %, of a limit that is itself estimated


def test_limits_with_other_numbers_of_runs():
    c = artificial(range(10), spread=3.0)
    for one in c.controllers[:3]:
        one.theirs["score"], one.ours["score"] = one.theirs["score"][:2], one.ours["score"][:50]
    assert (
        correlations.correlation_limits(c).lowest
        < correlations.correlation_limits(artificial(range(10), spread=3.0)).lowest
    )
    assert (c.recorded_runs, c.our_runs) == (20, 200)
    c.controllers[0].ours["score"] = c.controllers[0].ours["score"][:1]
    assert np.isnan(correlations.correlation_limits(c).lowest)


def test_bias_counts_the_luck_of_shared_seeds_once():
    c = artificial([0.0] * 10, spread=1.0)
    for one in c.controllers:
        one.theirs["score"] = c.controllers[0].theirs["score"]
    _, error = correlations.bias(c, "score")
    assert error == pytest.approx(1 / np.sqrt(20), rel=0.4)


def shuffling(effect=0.0, again=0.0, pfsm=SHUFFLES):
    """Judged: ten controllers of which the first's recorded scores are `effect` sd away from ours.

    Shuffled alike, ours are `again` away.
    """
    c = artificial([0.0] * 10, spread=1.0)
    first = c.controllers[0]
    first.pfsm = pfsm
    first.theirs["score"] += effect
    random = np.random.default_rng(3)
    if first.is_shuffled:
        first.shuffled = {"score": random.normal(again, 1.0, 200)}
    return c, scores.judge([c], of_scores=True)


def test_what_shuffling_explains_is_excused():
    _, judgement = shuffling(effect=2.0, again=2.0)
    assert judgement.rejected == []
    (excuse,) = judgement.excused
    assert excuse.first.p < 1e-4
    assert excuse.final.p > 0.01
    assert excuse.p_effect < 1e-9
    assert len(judgement.tests) == 10
    assert excuse.final in judgement.tests


@pytest.mark.parametrize("again", [0.0, -2.0, 5.0])
def test_what_shuffling_does_not_explain_is_not_excused(again):
    _, judgement = shuffling(effect=2.0, again=again)
    assert [test.controller.name for test in judgement.rejected] == ["0.0"]
    assert judgement.excused == []


def test_no_second_chance_for_another_sample():
    """A recording at the edge of rejection is not excused by a sample of ours that lies closer by luck."""
    c = artificial([0.0] * 10, spread=1.0)
    first = c.controllers[0]
    first.theirs["score"] = first.ours["score"][:20] + 0.85
    first.shuffled = {"score": first.ours["score"] + 0.15}  # what luck may do
    assert scores.p_value("score", first.theirs["score"], first.shuffled["score"]) > 0.001  # so it would not reject
    assert [test.controller for test in scores.judge([c], of_scores=True).rejected] == [first]


def test_a_controller_without_an_order_of_conditions_has_no_excuse():
    c, judgement = shuffling(effect=2.0, again=2.0, pfsm=STAYS)
    assert not c.controllers[0].is_shuffled
    assert len(judgement.rejected) == 1


def test_rejections_that_hung_on_others_are_said():
    c = artificial([0.0] * 10, spread=1.0)
    ps = [1e-9] * 5 + [0.004] + [0.5] * 4
    tests = [scores.Test("m", one, "score", p) for one, p in zip(c.controllers, ps, strict=True)]
    assert two_samples.rejected([test.p for test in tests]) == [0, 1, 2, 3, 4, 5]
    for one in c.controllers[:5]:
        one.theirs["score"] = one.theirs["score"] + 3.0
        one.shuffled = {"score": one.ours["score"] + 3.0}
    one = c.controllers[5]
    for shift in np.arange(0.5, 1.0, 0.01):  # until it is rejected, but would not be alone
        one.theirs["score"] = one.ours["score"][:20] + shift
        if 0.002 < scores.p_value("score", one.theirs["score"], one.ours["score"]) < 0.005:
            break
    judgement = scores.judge([c], of_scores=True)
    assert len(judgement.excused) == 5
    assert [test.controller for test in judgement.lapsed] == [one]
    assert judgement.rejected == []


@pytest.mark.thorough
def test_runs_repeated_from_their_seeds(comparisons):
    """Runs in which no robots collide are the recorded ones to the last digit, score and statistics."""
    for c in comparisons:
        identical = {one.name: scores.same(one.theirs, one.repeated, list(one.theirs)).mean() for one in c.controllers}
        assert all(len(one.theirs) == 27 for one in c.controllers)
        if "random_02" in identical:
            assert identical["random_02"] == 1.0  # hardly moves
        assert np.mean(list(identical.values())) > 0.05, c.mission


def test_failed_runs_and_missing_statistics():
    run = {**DATA["runs"][0], "scores": [None, *DATA["runs"][0]["scores"][1:]]}
    bare = {key: run[key] for key in ("mission", "name", "fsm")} | {"scores": [1.0, 2.0]}
    refused = {**bare, "name": "refused", "fsm": "--nstates 1 --s0 9"}
    elsewhere = {**bare, "mission": "beyond"}
    comparison, other = compare([run, bare, refused, elsewhere], experiments=4)
    first, second = comparison.controllers
    assert len(first.theirs["score"]) == len(first.theirs["occ[3]"]) == len(first.repeated["r"]) == 39
    assert list(second.theirs) == ["score"]
    assert second.repeated is None
    assert comparison.failed == [f"{run['mission']}: {run['name']}: 1 of 40 runs"]
    assert [sentence.split(":")[1].strip() for sentence in comparison.left_out] == ["refused"]
    assert "beyond" in other.left_out[0]
    assert len(all_tests([comparison])) == 28


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"\x1f\x8bnonsense", "damaged gzip"),
        (b"{", "expected JSON"),
        (b"[]", "'runs'"),
        (b'{"runs": []}', "'runs'"),
        (b'{"runs": [{"name": "a"}]}', "runs[0]: no 'mission'"),
        (b'{"runs": [{"name": 1}]}', "runs[0].name: expected text, found 1"),
        (b'{"runs": [1]}', "'runs'"),
        (b'{"meta": 1, "runs": [{"name": 1}]}', "meta"),
    ],
)
def test_files_that_are_no_recordings(tmp_path, content, complaint):
    file = tmp_path / "file.json.gz"
    file.write_bytes(content)
    with pytest.raises(RecordingError, match=r"file\.json\.gz") as caught:
        read(file)
    assert complaint in str(caught.value)


@pytest.mark.parametrize(
    ("settings", "complaint"),
    [
        ({"base": "beyond"}, "made from 'beyond'"),
        ({"base": "coverage", "gravity": 1}, "gravity"),
        ({"base": "coverage", "n_robots": 0}, "n_robots"),
        ({"base": "coverage", "velocity": "fast"}, "velocity"),
    ],
)
def test_settings_that_are_not_known(settings, complaint):
    with pytest.raises(RecordingError, match=complaint):
        mission_and_robot("mine", settings)


@takes_long
@pytest.mark.thorough
def test_many_experiments():
    """With twenty times the experiments, which tells smaller differences."""
    tests = all_tests(compare(experiments=800))
    assert rejected(tests) == []
