"""The benchmark of the race's quality: how it reads problems, compares and keeps results."""

import json
import sys

import pytest

from benchmarks import race_quality, race_results
from benchmarks.race_results import options_of, result_file, space_for
from mercator_design.race import Halving, HalvingOptions, Space
from tests.race.mixed import run
from tests.race.spaces import uniform
from tests.race.test_structure import SPACE as OF_PAIRS
from tests.race.test_structure import Pairs

PARAMETERS = [
    {"name": "n", "type": "int", "low": 1, "high": 3, "log": False, "condition": None},
    {"name": "c", "type": "cat", "values": ["a", "b"], "condition": [">=", "n", 2]},
    {"name": "o", "type": "ord", "values": ["1", "5"], "condition": ["and", ["in", "c", ["a"]], [">=", "n", 3]]},
    {"name": "r", "type": "real", "low": 0.01, "high": 1.0, "log": True, "digits": 3, "condition": ["in", "c", ["b"]]},
]

PROBLEM = f"""
class Tiny:
    name = "tiny"
    parameters = {PARAMETERS!r}
    instances = ["1", "2"]
    optimum, reference = 1.0, 2.5

    def true_cost(self, configuration):
        return configuration["n"]

    def evaluate(self, configuration, instance, seed):
        return configuration["n"] + int(instance) + seed % 7 / 10

PROBLEMS = [Tiny()]
"""


def test_a_problem_s_parameters_become_a_space():
    import numpy as np

    space = race_quality.space_of(PARAMETERS)
    for configuration in uniform(space, 100, np.random.default_rng(1)):
        assert ("c" in configuration) == (configuration["n"] >= 2)
        assert ("o" in configuration) == (configuration.get("c") == "a" and configuration["n"] == 3)
        assert ("r" in configuration) == (configuration.get("c") == "b")
    assert (space["r"].log, space["r"].digits, space["o"].kind) == (True, 3, "ordered")


def test_methods_are_options():
    assert options_of("default") == HalvingOptions()
    assert options_of("no-surrogate") == HalvingOptions(surrogate=0)
    assert options_of("simple=0.3") == HalvingOptions(simple=0.3)
    assert options_of("elites=3") == HalvingOptions(elites=3)
    for wrong in ("no-such", "such=1", "surrogate", "surrogate=2", "surrogate=much", "elites=inf"):
        with pytest.raises(SystemExit, match="expected default, NAME=VALUE or no-NAME of an option or halving, irace"):
            options_of(wrong)


def test_without_moves_a_race_keeps_simple_configurations_and_canonical_form():
    pairs = Pairs(n_simple=30)
    race = Halving(space_for("no-moves", Space(OF_PAIRS, structure=pairs)), budget=500, seed=1)
    race.ask()
    assert sum(c["a"] == c["b"] for c in race.configurations) >= 30
    run(race, cost=lambda c: abs(c["a"] * c["b"] - 600) / 100 + c["x"])
    assert all(c["a"] <= c["b"] for c in race.configurations)
    assert any(parent is not None for parent in race.parents)
    assert pairs.asked == 0


@pytest.mark.thorough
def test_it_prints_regrets_and_goes_on_from_its_cache(tmp_path, monkeypatch, capsys):
    module, cache, recorded = tmp_path / "tiny.py", tmp_path / "cache.jsonl", tmp_path / "irace.json"
    module.write_text(PROBLEM)
    runs = [{"method": "irace", "problem": "tiny", "budget": 200, "seed": s, "true_cost": 2.5} for s in range(8)]
    recorded.write_text(json.dumps({"runs": runs}))
    arguments = ["--problems", module, "--budgets", 200, "--seeds", 8, "--irace", recorded, "--cache", cache]
    monkeypatch.setattr(sys, "argv", ["race_quality.py", *map(str, arguments)])
    race_quality.main()
    first = capsys.readouterr().out
    assert "| tiny | 0.000 (0.000) [8] | 0.000 (0.000) [8] | 1.000 (0.000) [8] |" in first
    assert "* default beside R irace: lower ranks on 1 of 1, better on 1, worse on 0 at 5%" in first
    assert len(cache.read_text().splitlines()) == 16
    result_file.cache_clear()
    monkeypatch.setattr(race_results, "run", None)
    race_quality.main()
    assert capsys.readouterr().out == first


def test_ranks_say_which_method_is_better(capsys):
    """One race that failed badly gives a higher mean, though nearly all races are better."""
    regrets = {("one", "mine"): [0.1 + k / 1000 for k in range(19)] + [50.0], ("one", "theirs"): [0.5] * 20}
    race_quality.print_verdict("mine", "theirs", regrets, ["one"])
    assert "* mine beside theirs: lower ranks on 1 of 1, better on 1, worse on 0 at 5%" in capsys.readouterr().out
    race_quality.print_verdict("theirs", "mine", regrets, ["one"])
    assert "* theirs beside mine: lower ranks on 0 of 1, better on 0, worse on 1 at 5%" in capsys.readouterr().out
