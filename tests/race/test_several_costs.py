"""Races by several objectives: blocks of the test, the front, journals, and methods that cannot."""

import json
import random

import numpy as np
import pytest
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mercator_design.errors import RaceError
from mercator_design.race import Experiment, IteratedRace
from mercator_design.race.elimination.fronts import front_candidates, hypervolume, nondominated, scaled
from mercator_design.race.elimination.options import RaceOptions
from mercator_design.race.elimination.race import EliminationRace, RaceRules
from mercator_design.race.elimination.statistics import eliminate
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.race.methods.halving import Halving
from mercator_design.race.methods.table import METHODS, SEVERAL_COSTS
from mercator_design.race.session.events import ExperimentDone, Measurement, event_of, to_json
from mercator_design.race.session.journal import Journal, read
from mercator_design.race.session.record import Record
from mercator_design.race.session.runner import RaceRun
from tests.race.racing import SPACE, Measuring

TABLES = arrays(np.float64, st.tuples(st.integers(2, 9), st.integers(2, 7)), elements=st.integers(0, 5).map(float))


def costs_of(configuration, seed):
    """Costs whose front are x from -1 to 1, y = 0 and the rule fast; the second in another unit, with other noise."""
    x, y, rule = configuration.values() if isinstance(configuration, dict) else configuration
    noise = random.Random(f"{seed} {x} {y} {rule}")
    off = y**2 + 4 * (rule != "fast")
    return (x - 1) ** 2 + off + noise.gauss(0, 0.5), 100 * ((x + 1) ** 2 + off + noise.gauss(0, 0.5))


def raced(make, seed=1, budget=1500):
    race = make(SPACE, budget=budget, seed=seed)
    while batch := race.ask():
        race.tell([costs_of(race.configurations[one.configuration], one.instance) for one in batch])
    return race


class TwoCosts(Measuring):
    n_objectives = 2

    def costs(self, scores):
        return scores


def measure(item):
    values, seed = item
    scores = costs_of(values, seed)
    return Measurement(scores[0], f"{scores}", scores)


def runner(make, record, executor, *, budget=400):
    race = make(SPACE, budget=budget, seed=3)
    if not record.record.start:
        record.begin({"race": "of two costs", "budget": budget, "seed": 3})
    return RaceRun(TwoCosts(race, 3, measure), executor, record)


@pytest.mark.parametrize("make", [Halving, IteratedRace])
class TestRaces:
    def test_find_the_known_front(self, make):
        """The seed is fixed: nothing is left to luck."""
        race = raced(make)
        front = front_candidates(race.history.tables, race.history.former_elites, 10)
        found = [race.configurations[number] for number in front]
        assert len(found) >= 4
        for one in found:
            assert one["rule"] == "fast"
            assert -1.5 <= one["x"] <= 1.5
            assert abs(one["y"]) < 0.9
        xs = [one["x"] for one in found]
        assert xs[0] > 0.3  # in the order of the first cost
        assert xs[-1] < -0.3

    def test_any_number_of_jobs_and_a_resume_give_the_same(self, make, tmp_path):
        records = []
        for jobs in (1, 3):
            record = Record()
            with ThreadExecutor(jobs) as executor:
                race = runner(make, record, executor)
                race.finish()
            tables = race.problem.optimizer.history.tables
            records.append((record.ends[-1].digest, front_candidates(tables, [*range(len(tables[0]))], 10)))
        path = tmp_path / "journal.jsonl"
        with Journal(path, new=True) as journal, ThreadExecutor(2) as executor:
            race = runner(make, journal, executor)
            while len(journal.record.experiments) < 150:
                next(race)
            race.close()
        with Journal(path, new=False) as journal, ThreadExecutor(2) as executor:
            assert len(journal.record.experiments) < 400
            race = runner(make, journal, executor)
            race.finish()
        tables = race.problem.optimizer.history.tables
        records.append((read(path).record.ends[-1].digest, front_candidates(tables, [*range(len(tables[0]))], 10)))
        assert records[0] == records[1] == records[2]

    def test_do_not_depend_on_units(self, make):
        """A cost in any other unit gives the same ranks, so the same elites."""
        race, other = make(SPACE, budget=300, seed=1), make(SPACE, budget=300, seed=1)
        for one, scale in ((race, 1.0), (other, 1024.0)):  # a power of two changes no digit
            while batch := one.ask():
                given_ = [costs_of(one.configurations[e.configuration], e.instance) for e in batch]
                one.tell([(first, scale * second) for first, second in given_])
        assert [e.configuration for e in race.elites] == [e.configuration for e in other.elites]

    def test_a_failure_rejects(self, make):
        race = make(SPACE, budget=300, seed=1)
        first = race.ask()
        race.tell([float("inf")] * 3 + [(1.0, 2.0)] * (len(first) - 3))
        assert not {one.configuration for one in first[:3]} & {one.configuration for one in race.ask()}

    def test_a_cost_that_is_no_number_is_refused(self, make):
        race = make(SPACE, budget=300, seed=1)
        with pytest.raises(RaceError, match="expected a number"):
            race.tell([(1.0, float("nan")) for _ in race.ask()])


class TestBlocks:
    @given(TABLES)
    def test_friedman_is_scipys(self, table):
        if (np.ptp(table, axis=1) == 0).all():
            return
        found = eliminate(table, "friedman", 0.95, several=True)
        if table.shape[1] > 2:  # scipy wants three
            assert found.p_value == pytest.approx(scipy.stats.friedmanchisquare(*table.T).pvalue, abs=1e-12)
        assert found.ranks.tolist() == scipy.stats.rankdata(table, axis=1).sum(axis=0).tolist()

    def test_a_race_ranks_pairs_of_instance_and_objective(self):
        rng = np.random.default_rng(1)
        first, second = rng.normal(size=(8, 3)), 1000 * rng.normal(size=(8, 3)) + [0, 1500, 3000]
        race = EliminationRace(
            [0, 1, 2],
            earlier={},
            instances=[],
            next_instance=0,
            rules=RaceRules(first_test=8),
            survivors=1,
            planned_budget=100,
            max_experiments=100,
        )
        for instance in range(8):
            batch = race.ask()
            assert batch == [Experiment(c, instance) for c in range(3)]
            race.tell(first[instance].tolist(), [second[instance].tolist()])
        verdict = eliminate(np.vstack((first, second)), "friedman", 0.95, several=True)
        assert race.alive == np.flatnonzero(verdict.survivors).tolist()
        sums = scipy.stats.rankdata(np.vstack((first, second)), axis=1).sum(axis=0)
        assert verdict.ranks.tolist() == sums.tolist()

    def test_two_configurations_are_not_compared_by_sizes(self):
        """One is a little better in 15 blocks, and far worse in 3, in another unit."""
        table = np.array([[0.0, 1.0]] * 15 + [[1e6, 0.0]] * 3)
        assert eliminate(table, "friedman", 0.95, several=True).survivors.tolist() == [True, False]
        assert eliminate(table, "friedman", 0.95).survivors.tolist() == [True, True]

    def test_other_tests_are_refused(self):
        with pytest.raises(RaceError, match="expected friedman, as there are several objectives, found t-test"):
            eliminate(np.zeros((3, 3)), "t-test", 0.95, several=True)
        race = IteratedRace(SPACE, budget=600, seed=1, options=RaceOptions(test="t-test"))
        tell = lambda: race.tell([costs_of(race.configurations[e.configuration], e.instance) for e in race.ask()])  # noqa: E731
        for _ in range(4):
            tell()
        with pytest.raises(RaceError, match="expected friedman"):
            tell()


class TestFronts:
    @given(TABLES)
    def test_none_dominates_those_on_the_front(self, points):
        def dominates(one, other):
            return all(a <= b for a, b in zip(one, other, strict=True)) and tuple(one) != tuple(other)

        for point, is_on in zip(points, nondominated(points), strict=True):
            assert is_on == (not any(dominates(other, point) for other in points))

    @given(arrays(np.float64, st.tuples(st.integers(0, 5), st.integers(1, 4)), elements=st.integers(0, 4).map(float)))
    def test_hypervolume_counts_unit_cells(self, points):
        d = points.shape[1]
        cells = np.stack(np.meshgrid(*[np.arange(4)] * d, indexing="ij"), axis=-1).reshape(-1, d)
        covered = (points[:, np.newaxis] <= cells).all(axis=2).any(axis=0).sum() if len(points) else 0
        assert hypervolume(points, np.full(d, 4.0)) == covered

    def test_candidates(self):
        costs = [
            [{0: 0.0}, {0: 5.0}, dict.fromkeys(range(5), 2.5), {0: 9.0}, {0: float("inf")}, {}],
            [{0: 5.0}, {0: 0.0}, dict.fromkeys(range(5), 2.0), {0: 9.0}, {0: float("inf")}, {}],
        ]
        assert front_candidates(costs, [0, 1, 3, 4, 5], 9) == [0, 2, 1, 3]  # the next layer, too
        assert front_candidates(costs, [0, 1, 3, 4, 5], 3) == [0, 2, 1]
        assert front_candidates(costs, [0], 9) == [0, 2]  # a single result is too few without being an elite
        assert front_candidates([[{}], [{}]], [], 9) == []
        assert scaled(np.array([[1.0, 3.0], [3.0, 3.0]])).tolist() == [[0.0, 0.0], [1.0, 0.0]]


class TestJournal:
    def test_scores_are_in_lines_of_several_objectives_only(self):
        fields = {"experiment": 0, "iteration": 1, "configuration": 0, "instance": 0, "seed": 1, "score": 1.0}
        assert "scores" not in to_json(ExperimentDone(**fields))
        several = ExperimentDone(**fields, scores=(1.0, 2.5))
        assert event_of(json.loads(json.dumps(to_json(several)))) == several

    def test_missing_scores_are_found(self):
        record = Record()
        with ThreadExecutor(1) as executor:
            runner(Halving, record, executor).finish()
            first = record.experiments[0]
            record.experiments[0] = ExperimentDone(
                **{name: getattr(first, name) for name in first.__slots__ if name != "scores"}
            )
            with pytest.raises(RaceError, match="expected 2 scores of experiment 0, found 0"):
                runner(Halving, record, executor).finish()


def test_methods_that_can():
    assert SEVERAL_COSTS == ("halving", "irace")
    assert set(METHODS) > set(SEVERAL_COSTS)
