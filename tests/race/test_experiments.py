"""Experiments in memory: what is held comes out as it was, in whatever order experiments end."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mercator_design.race.session.events import ExperimentDone, ScoreRevised
from mercator_design.race.session.experiments import MAX_NUMBER, Experiments, Results

NUMBERS = st.integers(0, MAX_NUMBER)
SCORES = st.one_of(st.floats(allow_nan=False, allow_infinity=False), st.integers(-9, 9))
OUTCOMES = st.one_of(st.binary(max_size=9).map(bytes.hex), st.sampled_from(["0A", "a b", "00 11", "abc", "ü"]))


@st.composite
def events(draw):
    done = []
    for number in range(draw(st.integers(1, 12))):
        score = draw(st.one_of(st.none(), SCORES))
        done.append(
            ExperimentDone(
                experiment=number,
                iteration=draw(NUMBERS),
                configuration=draw(st.integers(0, 3)),
                instance=draw(NUMBERS),
                seed=draw(st.integers(0, 2**66)),
                score=score,
                outcome=draw(OUTCOMES),
                failure="" if score is not None else "why",
                scores=draw(st.sampled_from([(), (1.0, 2.0)])),
            )
        )
    return done


@given(events(), st.randoms())
def test_they_come_out_as_they_were(done, order):
    """Also their types, which the digest of a race sees, while numbers are missing, and in the order of numbers."""
    experiments, known = Experiments(), {}
    for one in order.sample(done, len(done)):
        assert one.experiment not in experiments
        experiments[one.experiment] = known[one.experiment] = one
        numbers = sorted(known)
        assert list(experiments) == numbers
        assert len(experiments) == len(numbers)
        assert experiments.has_gaps == (numbers[-1] >= len(numbers))
        for number in numbers:
            assert repr(experiments[number]) == repr(known[number])
            assert repr(experiments.score(number)) == repr(known[number].score)
    for configuration in experiments.configurations:
        own = [one for one in done if one.configuration == configuration and one.score is not None]
        numbers = experiments.numbers_of(configuration)
        assert numbers == [one.experiment for one in done if one.configuration == configuration]
        assert experiments.scores_of(configuration) == {one.instance: one.score for one in own}
    assert {one.configuration for one in done} == {*experiments.configurations}


def test_a_revised_score_is_the_current_one():
    one = ExperimentDone(experiment=0, iteration=1, configuration=2, instance=3, seed=4, score=5.0)
    experiments = Experiments()
    experiments[0] = one
    experiments.revise(ScoreRevised(experiment=1, configuration=2, instance=9, score=6.0))
    assert experiments.current(0) == one
    experiments.revise(ScoreRevised(experiment=1, configuration=2, instance=3, score=6.0))
    assert (experiments[0], experiments.current(0)) == (one, replace(one, score=6.0))
    assert list(Results(experiments, experiments.numbers)) == [replace(one, score=6.0)]
    assert experiments.scores_of(2) == {3: 6.0}
    experiments.revise(ScoreRevised(experiment=1, configuration=2, instance=3, score=None, failure="worse"))
    assert (experiments.scores_of(2), experiments.current(0).failure) == ({}, "worse")


def test_what_has_not_run_is_not_there():
    for number in (-1, 0, 2**40):
        assert number not in Experiments()
        with pytest.raises(KeyError):
            Experiments()[number]
