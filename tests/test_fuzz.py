"""Missions and control software with random mistakes lead to errors with places, never to a traceback."""

import collections

import pytest

from benchmarks.fuzz_files import KINDS, fuzzed_mission
from tests.tiers import cases, some


def outcomes(kind, numbers):
    return collections.Counter(KINDS[kind](number) for number in numbers)


@pytest.mark.swept
def test_missions():
    numbers = some(cases(1000), 100)
    found = outcomes("missions", numbers)
    assert found["refused, several mistakes"] > 0.2 * len(numbers)
    assert found["refused, one mistake"] > 0.2 * len(numbers)
    assert found["read"] > 0.05 * len(numbers)
    assert sum(found.values()) == len(numbers)


@pytest.mark.swept
def test_fsm_texts():
    numbers = some(cases(10_000), 600)
    found = outcomes("fsms", numbers)
    assert found["refused"] > len(numbers) / 3
    assert found["read"] > len(numbers) / 30
    assert found["refused without a word"] == 0
    assert sum(found.values()) == len(numbers)


@pytest.mark.swept
@pytest.mark.parametrize("kind", ["trees", "networks", "genomes"])
def test_other_software(kind):
    numbers = some(cases(1000), 100)
    found = outcomes(kind, numbers)
    assert found["refused"] > len(numbers) / 3
    assert found["read"] > len(numbers) / 50
    assert found["refused without a place"] == 0
    assert sum(found.values()) == len(numbers)


def test_the_same_number_gives_the_same_text():
    assert fuzzed_mission(7) == fuzzed_mission(7)
    assert fuzzed_mission(7) != fuzzed_mission(8)
