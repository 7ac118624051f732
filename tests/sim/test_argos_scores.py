"""Agreement with the original: scores and statistics of controllers, as distributions and run by run."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.argos import scores
from benchmarks.argos.recordings import RecordingError, mission_and_robot, read

DATA = read(Path(__file__).parents[1] / "data" / "argos_scores.json.gz")
# If nothing differs, Benjamini and Hochberg's procedure rejects anything with at most this chance. Seeds are fixed: it
# is the chance over their choice, for all missions together.
FALSE_ALARM = 1e-6


def compare(runs=DATA["runs"], meta=DATA["meta"], experiments=40):
    return scores.compare(meta, runs, experiments=experiments, seed=1, jobs=2, tell=lambda _: None)


@pytest.fixture(scope="module")
def comparisons():
    return compare()


def all_tests(comparisons):
    return [test for c in comparisons for kind in (True, False) for test in scores.tests(c, of_scores=kind)]


def test_distributions(comparisons):
    assert not any(c.left_out for c in comparisons)
    tests = all_tests(comparisons)
    assert len(tests) == 12 * (1 + 26)
    assert scores.rejected(tests, FALSE_ALARM) == []


def test_distributions_tell_another_robot():
    """Proximity that reaches 5 cm less far is found out."""
    meta = {"missions": {"aggregation": {"n_robots": 3, "prox_range": 0.35}}}
    runs = [run for run in DATA["runs"] if run["mission"] == "aggregation" and run["name"] == "explore_rwm20"]
    found = scores.rejected(all_tests(compare(runs, meta)), FALSE_ALARM)
    assert "prox" in {test.statistic for test in found}


def artificial(means, spread, recorded=20, ours=200):
    """A comparison of controllers whose scores are normal and all have one standard deviation, here and there."""
    random = np.random.default_rng(1)
    controllers = [
        scores.Controller(
            str(mean),
            *({"score": random.normal(mean, spread, n)} for n in (recorded, ours)),
        )
        for mean in means
    ]
    return scores.Comparison("artificial", controllers)


def test_limits_of_correlation():
    assert scores.correlation_limits(artificial(range(10), spread=0.01)) == pytest.approx((1.0, 1.0))
    lowest, median, halves = [], [], []
    for spread in (3.0, 10.0):
        c = artificial(range(10), spread)
        for found, value in zip((median, lowest), scores.correlation_limits(c), strict=True):
            found.append(value)
        halves.append(scores.halves(c))
        assert lowest[-1] < median[-1] < 1.0
    assert median[0] > median[1]
    assert halves[0] > halves[1]


def test_bias_counts_the_luck_of_shared_seeds_once():
    c = artificial([0.0] * 10, spread=1.0)
    for one in c.controllers:
        one.theirs["score"] = c.controllers[0].theirs["score"]
    _, error = scores.bias(c, "score")
    assert error == pytest.approx(1 / np.sqrt(20), rel=0.4)


def test_rejections_are_those_of_benjamini_and_hochberg():
    tests = [scores.Test(str(p), "score", p) for p in (0.03, 0.0004, 0.0041, 0.0058, 0.5)]
    assert [test.p for test in scores.rejected(tests, 0.01)] == [0.0004, 0.0041, 0.0058]
    assert scores.rejected(tests, 0.001) == []


def test_difference_that_comes_from_shuffling():
    c = artificial([0.0, 100.0], spread=1.0)
    one, other = c.controllers
    one.shuffled = {"score": one.ours["score"]}
    one.theirs["score"], other.theirs["score"] = one.ours["score"][:20], one.ours["score"][:20]
    other.shuffled = {"score": other.ours["score"]}
    first, second = scores.tests(c, of_scores=True)
    assert scores.comes_from_shuffling(c, first)
    assert not scores.comes_from_shuffling(c, second)
    other.shuffled = None
    assert not scores.comes_from_shuffling(c, second)


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
    assert [sentence.split(":")[1].strip() for sentence in comparison.left_out] == [run["name"], "refused"]
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
        ({"base": "foraging"}, "made from 'foraging'"),
        ({"base": "coverage", "gravity": 1}, "gravity"),
        ({"base": "coverage", "n_robots": 0}, "n_robots"),
        ({"base": "coverage", "velocity": "fast"}, "velocity"),
    ],
)
def test_settings_that_are_not_known(settings, complaint):
    with pytest.raises(RecordingError, match=complaint):
        mission_and_robot("mine", settings)


@pytest.mark.slow
def test_many_experiments():
    """With twenty times the experiments, which tells smaller differences."""
    tests = all_tests(compare(experiments=800))
    assert scores.rejected(tests, FALSE_ALARM) == []
