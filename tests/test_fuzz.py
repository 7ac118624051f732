"""Missions and FSM texts with random mistakes lead to errors with places, never to a traceback."""

import collections

import pytest

from benchmarks.fuzz_files import KINDS, fuzzed_mission

MANY = 100_000


def outcomes(kind, numbers):
    return collections.Counter(KINDS[kind](number) for number in numbers)


def test_missions():
    found = outcomes("missions", range(400))
    assert found["refused, several mistakes"] > 80
    assert found["refused, one mistake"] > 80
    assert found["read"] > 20


def test_fsm_texts():
    found = outcomes("fsms", range(3000))
    assert found["refused"] > 1000
    assert found["read"] > 100
    assert found["refused without a word"] == 0


def test_the_same_number_gives_the_same_text():
    assert fuzzed_mission(7) == fuzzed_mission(7)
    assert fuzzed_mission(7) != fuzzed_mission(8)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_many(kind):
    assert sum(outcomes(kind, range(MANY)).values()) == MANY
