"""mdesign evaluate: several PFSMs on the same instances, and what a swarm did."""

import csv
import io
import json

import numpy as np
import pytest

from mercator_design.api import evaluate, simulate
from mercator_design.errors import FsmError
from mercator_design.fsm import parse
from mercator_design.missions.mission import load_mission
from mercator_design.race.analysis.pairs import compared
from mercator_design.race.elimination.summary import Scores
from mercator_design.results.analysis.evaluation import Evaluation
from mercator_design.results.analysis.swarm import evaluate_with_stats
from mercator_design.show.text.evaluations import Comparison, Evaluated, comparison_text
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.simulate import Simulator
from mercator_design.software.files import read_fsm, read_fsms

STOP, WALK, W1 = (
    "--nstates 1 --s0 1",
    "--nstates 1 --s0 0 --rwm0 20",
    "--nstates 2 --s0 0 --rwm0 20 --n0 1 --n0x0 0 --c0x0 0 --p0x0 0.5 --s1 1",
)
QUICK = ["--set", "robots=3", "--set", "duration=10"]


@pytest.fixture(scope="module")
def mission():
    return load_mission("aggregation", ("robots=3", "duration=10"))


@pytest.fixture
def lines(tmp_path):
    file = tmp_path / "set.txt"
    file.write_text(f"# mission: aggregation\n\n{STOP}\n{WALK}\n# a remark\n{W1}\nscore 3\n")
    return file


class TestLines:
    def test_by_their_numbers(self, lines):
        found = read_fsms(lines)
        assert {number: file.pfsm for number, file in found.items()} == {3: parse(STOP), 4: parse(WALK), 6: parse(W1)}
        assert all(file.header["mission"] == "aggregation" for file in found.values())
        with pytest.raises(FsmError, match=r"one line with control software, found 3 \(line 3, line 4, line 6\)"):
            read_fsm(lines)

    def test_one_line_is_a_file_of_one(self, tmp_path):
        (tmp_path / "fsm.txt").write_text(f"{WALK}\n")
        assert read_fsms(tmp_path / "fsm.txt") == {1: read_fsm(tmp_path / "fsm.txt")}

    def test_the_line_of_a_mistake(self, lines):
        lines.write_text(f"{STOP}\n--nstates x\n")
        with pytest.raises(FsmError, match=r"set\.txt:2: "):
            read_fsms(lines)


class TestStats:
    def test_they_are_those_of_the_traces(self, mission):
        pfsm, seeds = parse(W1), [5, 6]
        result, stats = evaluate_with_stats(Simulator(mission), pfsm, seeds)
        assert result.scores == evaluate(mission, pfsm, seeds=seeds).scores
        traces = [simulate(mission, pfsm, seed=seed, record=True) for seed in seeds]
        states = np.concatenate([trace.states.ravel() for trace in traces])
        assert stats.states == pytest.approx([np.mean(states == 0), np.mean(states == 1)])
        began = [np.vstack([np.zeros((1, 3), dtype=np.int8), trace.states]) for trace in traces]
        assert stats.transitions == pytest.approx(sum((np.diff(one, axis=0) != 0).sum() for one in began) / 60)
        paths = [np.hypot(*np.moveaxis(np.diff(trace.poses[..., :2], axis=0), -1, 0)).sum() for trace in traces]
        assert stats.speed == pytest.approx(sum(paths) / 60)
        black = np.mean([np.mean(trace.colors("always").sum(axis=-1) == 0) for trace in traces])
        assert stats.ground["black"] == pytest.approx(black)
        assert sum(stats.ground.values()) == pytest.approx(1)
        assert stats.neighbours == pytest.approx(np.mean([trace.measure("neighbours")[..., 0] for trace in traces]))
        assert 0 <= stats.obstacles <= 1

    def test_of_a_swarm_that_stands(self, mission):
        _, stats = evaluate_with_stats(Simulator(mission), parse(STOP), [1])
        assert (stats.states, stats.transitions) == ((1.0,), 0.0)
        assert stats.speed == pytest.approx(0, abs=1e-9)


class TestVerdict:
    """The line that names the best, and the others that are not significantly worse."""

    SCORES = (1.0, 2.0, 3.0, 4.0)

    def verdict(self, mission, *others):
        def evaluated(k, scores):
            return Evaluated(f"f{k}", parse(STOP), Evaluation(scores=Scores(scores), seeds=tuple(range(4))))

        of = [evaluated(k, scores) for k, scores in enumerate((self.SCORES, *others))]
        text = comparison_text(Comparison(of, mission, load_robot_model(mission.robot_model)), seed=1)
        return next(line for line in text.splitlines() if line.startswith("Best: "))

    def worse(self, *by):
        return tuple(score - less for score, less in zip(self.SCORES, by, strict=True))

    def test_a_single_one(self, mission):
        assert self.verdict(mission) == "Best: f0"

    def test_better_than_all(self, mission):
        words = "Best: f0, significantly better than the others"
        assert self.verdict(mission, self.worse(1, 1, 1, 1.01), self.worse(2, 2, 2, 2.01)) == words

    def test_better_than_some(self, mission):
        words = "Best: f0; not significantly worse: f1"
        assert self.verdict(mission, self.worse(1, -1, 1, 0), self.worse(2, 2, 2, 2.01)) == words

    def test_equal_ones_that_are_too_many_to_be_named(self, mission):
        same = [self.SCORES] * 10
        assert self.verdict(mission, *same) == "Best: f0; not significantly worse: 10 of the 10 others"


class TestVerb:
    def test_a_table_with_tests(self, mdesign, lines, mission):
        code, out, _ = mdesign("evaluate", lines, *QUICK, "-n", 6, "--stats")
        assert code == 0
        labels = [f"...{f'{lines}:{number}'[-27:]}" for number in (3, 4, 6)]  # the end, because it has the line
        assert [line.split()[0] for line in out.splitlines() if line.startswith("...")][:3] == labels
        seeds = json.loads(mdesign("evaluate", lines, *QUICK, "-n", 6, "--json")[1])["seeds"]
        scores = [evaluate(mission, parse(fsm), seeds=seeds).scores.values for fsm in (STOP, WALK, W1)]
        pairs = compared({k: dict(enumerate(one)) for k, one in enumerate(scores)})
        table = out.partition("\npair ")[2].splitlines()[1:4]
        expected = ["< 0.0001" if pair.p_value < 1e-4 else f"{pair.p_value:.4f}" for pair in pairs]
        assert all(line.endswith(f"  {p}") for line, p in zip(table, expected, strict=True))
        best = max(range(3), key=lambda k: np.mean(scores[k]))
        assert f"Best: {labels[best]}" in out
        assert "transitions/s" in out

    def test_as_json(self, mdesign, lines):
        code, out, _ = mdesign("evaluate", lines, *QUICK, "-n", 3, "--json", "--stats")
        found = json.loads(out)
        assert code == 0
        assert {*found} == {
            *("mission", "direction", "robots", "duration", "robot_model", "runs", "seed", "seeds", "best", "fsms"),
            *("pairs", "possible_scores"),
        }
        assert found["possible_scores"][0] == 0.0
        assert [one["fsm"] for one in found["fsms"]] == [STOP, WALK, W1]
        assert {*found["fsms"][0]["stats"]} == {
            *("states", "transitions", "ground", "neighbours", "obstacles", "speed"),
        }
        assert len(found["pairs"]) == 3
        assert found["best"] == max(found["fsms"], key=lambda one: one["mean"])["name"]

    def test_as_csv(self, mdesign, lines):
        code, out, _ = mdesign("evaluate", lines, *QUICK, "-n", 3, "--csv", "--stats")
        rows = list(csv.DictReader(io.StringIO(out)))
        assert (code, [row["fsm"].rpartition(":")[2] for row in rows]) == (0, ["3", "4", "6"])
        assert [float(row["speed m/s"]) > 0.001 for row in rows] == [False, True, True]
        assert sum(row["p_value_against_best"] == "" for row in rows) == 1

    def test_a_single_one_stays_as_it_was(self, mdesign, tmp_path):
        (tmp_path / "fsm.txt").write_text(f"# mission: aggregation\n{W1}\n")
        plain = mdesign("evaluate", tmp_path / "fsm.txt", *QUICK, "-n", 2)[1]
        more = mdesign("evaluate", tmp_path / "fsm.txt", *QUICK, "-n", 2, "--stats")[1]
        assert more.startswith(plain)
        assert [line[:19].strip() for line in more.removeprefix(plain).splitlines()] == [
            *("in state 0", "in state 1", "transitions", "on black", "on gray", "neighbours", "obstacles in sight"),
            "speed",
        ]

    @pytest.mark.parametrize(
        ("more", "words"),
        [(["--cost"], "--cost is of one controller, found 3"), (["--csv", "--json"], "exclude each other")],
    )
    def test_wrong_usage(self, mdesign, lines, more, words):
        code, _, err = mdesign("evaluate", lines, *QUICK, *more)
        assert (code, words in err) == (2, True)

    def test_other_missions(self, mdesign, lines, tmp_path):
        (tmp_path / "fsm.txt").write_text(f"# mission: foraging\n{WALK}\n")
        code, _, err = mdesign("evaluate", lines, tmp_path / "fsm.txt")
        assert (code, "designed for another mission or robot model" in err) == (2, True)

    def test_names_are_printed_as_text(self, mdesign, tmp_path):
        for name in ("a\x1b[31m.txt", "b\u202e.txt"):
            (tmp_path / name).write_text(f"{STOP}\n")
        code, out, _ = mdesign("evaluate", *tmp_path.iterdir(), "--mission", "aggregation", *QUICK, "-n", 1)
        assert code == 0
        assert all(line.isprintable() for line in out.splitlines())
