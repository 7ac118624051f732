import math

import pytest

from mercator_design.errors import RaceError
from mercator_design.race import EliminationRace, Experiment, RaceRules


def new_race(n=4, *, limit=1000, earlier=None, instances=(), **rules):
    return EliminationRace(
        range(n),
        earlier=earlier or {},
        instances=instances,
        next_instance=len(instances),
        rules=RaceRules(**rules),
        survivors=1,
        planned_budget=limit,
        max_experiments=limit,
    )


def test_the_same_experiments_are_asked_for_until_their_costs_are_told():
    race = new_race()
    assert race.ask() == race.ask() == [Experiment(c, 0) for c in range(4)]
    race.tell([1.0, 2.0, 3.0, 4.0])
    assert race.ask() == [Experiment(c, 1) for c in range(4)]


@pytest.mark.parametrize("cost", [math.nan, None, "1"])
def test_what_is_not_a_number_is_refused_and_named(cost):
    race = new_race()
    batch = race.ask()
    with pytest.raises(RaceError, match=f"cost of configuration 2 on instance 0: expected a number, found {cost!r}"):
        race.tell([1.0, 1.0, cost, 1.0])
    assert race.ask() == batch
    assert race.used == 0


def test_a_race_of_nothing_is_refused():
    with pytest.raises(RaceError, match="expected configurations, found none"):
        new_race(0)


def test_too_few_costs_are_refused():
    with pytest.raises(RaceError, match="expected 4, one for each experiment asked for, found 3"):
        new_race().tell([1.0, 1.0, 1.0])


@pytest.mark.parametrize("cost", [math.inf, -math.inf])
def test_an_infinite_cost_rejects_at_once(cost):
    race = new_race()
    race.tell([1.0, cost, 1.0, 1.0])
    assert race.rejected == [1]
    assert race.alive == [0, 2, 3]
    assert [e.configuration for e in race.ask()] == [0, 2, 3]
    with pytest.raises(RaceError, match="all were rejected"):
        race.tell([cost] * 3)


def test_the_limit_is_kept_to_the_last_experiment():
    race = new_race(limit=10)
    for _ in range(2):
        race.tell([1.0] * 4)
    assert race.ask() == []
    assert race.used == 8
    assert race.stop_reason == "the whole budget is used"


def test_an_elite_is_protected_until_its_results_have_been_seen_again():
    """Configuration 0 is the worst everywhere, but has results on instances 0 .. 6."""
    race = new_race(3, earlier={0: dict.fromkeys(range(7), 9.0)}, instances=range(7))
    alive, run = [], []
    while batch := race.ask():
        run += batch
        race.tell([9.0 if e.configuration == 0 else (e.configuration + e.instance) % 2 for e in batch])
        alive.append(0 in race.alive)
    assert alive[:6] == [True] * 6
    assert alive[6:] == [False] * len(alive[6:])
    assert 0 not in {experiment.configuration for experiment in run}
