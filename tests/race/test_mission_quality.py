"""The benchmark of designs on missions: how it runs races once, compares and reports."""

import json
import re
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks import mission_quality, published_designs, race_results, where_lost
from benchmarks.race_results import Race, fingerprint, results
from mercator_design.race import Space
from mercator_design.race.space.parameter import real
from mercator_design.studies.statistics.effects import a_measure
from mercator_design.studies.statistics.rank_tests import van_elteren


class Near:
    """The nearer x is to 1, the better."""

    is_maximised = True

    def __init__(self, name="near"):
        self.space = Space([real("x", 0.0, 1.0)])

    def start(self, seed):
        self.seed = seed

    def cost(self, configuration, instance):
        return -configuration["x"] + (instance * 7 + self.seed) % 5 / 10

    def measure(self, configuration):
        return {"score": configuration["x"], "error": 0.0}

    def random_scores(self):
        return np.array([-0.6, -0.4])


def row(mission, method, budget, seed, score, error=0.0):
    return {"problem": mission, "method": method, "budget": budget, "seed": seed, "score": score, "error": error}


@pytest.fixture
def near(monkeypatch):
    monkeypatch.setattr(mission_quality, "problem", Near)


def test_missions_load_and_are_of_many_kinds():
    loaded = [(one.load(), one.flavour) for one in mission_quality.MISSIONS.values()]
    assert len(loaded) >= 12
    assert {flavour for _, flavour in loaded} == {"watermelon", "chocolate"}
    assert {mission.objective.direction for mission, _ in loaded} == {"maximise", "minimise"}
    assert {3, 20} <= {mission.robots for mission, _ in loaded}
    assert len({mission.digest for mission, _ in loaded}) == len(loaded)
    assert {one.load().robots for one in mission_quality.SWARMS.values()} == {20}


@pytest.mark.thorough
def test_a_run_goes_on_from_its_file(near, tmp_path, monkeypatch, capsys):
    path = tmp_path / "cache.jsonl"
    arguments = ["--missions", "aggregation", "--budgets", "100", "200", "--seeds", "6", "--cache", str(path)]
    monkeypatch.setattr(sys, "argv", ["mission_quality.py", *arguments])
    mission_quality.main()
    first = capsys.readouterr().out
    assert "* default beside irace at 200: better on 1 of 1 missions" in first
    lines = path.read_text().splitlines(keepends=True)
    assert len(lines) == 24
    path.write_text("".join(lines[:-1]) + lines[-1][:40])  # killed in a write
    race_results.result_file.cache_clear()
    mission_quality.main()
    assert capsys.readouterr().out == first
    monkeypatch.setattr(race_results, "run", None)
    race_results.result_file.cache_clear()
    mission_quality.main()
    assert capsys.readouterr().out == first


def test_processes_share_a_file(tmp_path):
    path = tmp_path / "cache.jsonl"
    races = [Race("near", method, 100, seed) for seed in range(1, 7) for method in ("irace", "random")]
    rows = results(races, Near, path=path, jobs=2)
    assert [(one["method"], one["seed"]) for one in rows] == [(race.method, race.seed) for race in races]
    assert len(path.read_text().splitlines()) == len(races)
    mine = race_results.ResultFile(path)
    assert not mine.claims(races[0])  # it is known
    earlier = {**rows[0], "code": "0123", "score": 0.25}
    path.write_text(path.read_text() + json.dumps(earlier) + "\n")
    both = results([races[0], races[0]._replace(method="irace@0123")], Near, path=path)
    assert [(one["method"], one["code"]) for one in both] == [("irace", fingerprint()), ("irace@0123", "0123")]
    assert both[1]["score"] == 0.25
    with pytest.raises(SystemExit, match="expected a row of near irace@4567 100 1, found none"):
        results([races[0]._replace(method="irace@4567")], Near, path=path)


def test_the_report_says_what_is_better_and_what_is_worse(near):
    rows = [
        row(mission, method, budget, seed, seed / 100 + (method == winner) + budget / 1e4)
        for mission, winner in (("up", "default"), ("down", "irace"), ("same", None))
        for method in ("default", "irace", "no-structure")
        for budget in (500, 2000)
        for seed in range(1, 11)
    ]
    lines = list(mission_quality.report(mission_quality.Table(rows), "irace"))
    assert any(line.startswith("| up | 0.105 (0.08") and "| 1.00 (1.00 to 1.00) | 3.2e-05 |" in line for line in lines)
    verdict = next(line for line in lines if line.startswith("* default beside irace at 500"))
    assert (
        "better on 1 of 3 missions (1 of the 3 with headroom), worse on 1 at 5% (down); higher ranks on 1;" in verdict
    )
    assert "mean share of better designs 0.50; van Elteren p 1" in verdict
    assert any(line.startswith("| structure | 0.67") and "better on 1, worse on 0 of 3" in line for line in lines)
    assert "* up: at most 500" in lines
    assert "* down: more than 2000" in lines
    assert "* same: 2000" in lines


def test_what_was_measured_badly_is_no_headroom(near):
    for error, found in ((0.02, "1 of the 1"), (0.6, "0 of the 0")):
        rows = [
            row("up", method, 500, seed, seed / 100 + (method == "default"), error)
            for method in ("default", "irace")
            for seed in range(1, 11)
        ]
        (verdict,) = (line for line in mission_quality.report(mission_quality.Table(rows), "irace") if "beside" in line)
        assert f"({found} with headroom)" in verdict


def test_designs_beside_published_ones(near, monkeypatch, capsys):
    """The published ones score 0.5; a race finds an x near 1."""
    monkeypatch.setattr(published_designs, "problem", Near)
    monkeypatch.setattr(Near, "fresh_scores", lambda self, pfsm: np.array([0.4, 0.6]), raising=False)
    arguments = ["--missions", "aggregation", "--budget", "60", "--seeds", "3", "--method", "irace"]
    monkeypatch.setattr(sys, "argv", ["published_designs.py", *arguments])
    published_designs.main()
    row = capsys.readouterr().out.splitlines()[-1]
    assert row.startswith("| aggregation | 0.5 (0.5 to 0.5) [10] | 0.9")
    assert "[3] | 1.00 (1.00 to 1.00) | 0." in row


def test_the_rows_that_are_kept_give_the_figures_of_the_documents(monkeypatch):
    """The mean share and the pooled p of each budget, and the share on each mission."""
    root = Path(mission_quality.__file__).parents[1]
    kept = [json.loads(line) for line in (root / "benchmarks" / "mission_quality.jsonl").read_text().splitlines()]
    text = (root / "docs" / "explanation" / "benchmarks.md").read_text()
    minimised = {"grid_exploration", "chocolate_spc, 10 robots"}
    monkeypatch.setattr(mission_quality, "problem", lambda name: SimpleNamespace(is_maximised=name not in minimised))
    for budget in (500, 2000, 5000):
        rows = [
            one
            for one in kept
            if (one["problem"] in mission_quality.MISSIONS and one["budget"] == budget and one["seed"] <= 20)
            and one["method"] in {"default", "irace"}
        ]
        pairs = {
            block.mission: (block.values("default"), block.values("irace"))
            for block in mission_quality.study_of(rows).blocks()
        }
        shares = {mission: a_measure(*pair) for mission, pair in pairs.items()}
        pooled = f"| {np.mean([*shares.values()]):.2f} | {van_elteren(pairs.values()):.2g} |"
        assert re.search(rf"^\| {budget} \| \d of \d+ \| 0 {re.escape(pooled)}$", text, re.MULTILINE), pooled
        table = text.partition(f"| budget {budget} | `irace` |")[2].partition("\n\n")[0]
        for mission, share in shares.items():
            assert re.search(rf"^\| {re.escape(mission)}.*\| {share:.2f} \(", table, re.MULTILINE), mission


def test_where_races_lose(near, monkeypatch, capsys):
    def values(self, configurations, instances):
        return np.array([one["x"] for one in configurations])

    monkeypatch.setattr(Near, "values", values, raising=False)
    for module in (mission_quality, where_lost):
        monkeypatch.setattr(module, "problem", Near)
    missions = {"near": None}
    monkeypatch.setattr(where_lost, "MISSIONS", missions)
    monkeypatch.setattr(
        sys, "argv", ["where_lost.py", "--missions", "near", "--budget", "60", "--seeds", "2", "--given"]
    )
    where_lost.main()
    rows = [re.split(r" *\| *", line.strip("|")) for line in capsys.readouterr().out.splitlines()[5:]]
    assert len(rows) == 2
    for _, chosen, kept, sampled, _, _, others, given_kept, given_chosen in (
        [cell.strip() for cell in row] for row in rows
    ):
        assert float(chosen) <= float(kept) <= float(sampled)  # without noise what is chosen again is the best
        assert float(others) <= 1
        assert (given_kept == "yes") == (float(given_chosen) == float(others))
