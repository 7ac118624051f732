"""mdesign tune with a targetEvaluator that compares configurations, as irace calls it."""

import itertools
import json
import subprocess

import optuna
import pandas as pd
import pytest

from mercator_design.race.session.journal import read
from mercator_design.results.files import JOURNAL
from mercator_design.results.tables import experiments_table
from tests.storages import connections_closed
from tests.test_tune import written

RUNNER = """\
#!/bin/sh
seed=$3 of=$1-$3
shift 4
echo $(( ($1 - 7) * ($1 - 7) )) > result-$of
echo "run $of" >> log
"""
EVALUATOR = """\
#!/bin/sh
# The cost is the result less the worst of all that are alive.
configuration=$1 seed=$3 n=$5
shift 5
worst=0
for other in "$@"; do
  read found < result-$other-$seed || exit 1
  [ $found -gt $worst ] && worst=$found
done
echo "evaluate $configuration-$seed $n $*" >> log
read found < result-$configuration-$seed
echo $(( found - worst ))
"""
SCENARIO = """
instances = c("a", "b")
testInstances = c("t", "u")
testNbElites = 2
maxExperiments = 100
targetEvaluator = "evaluator"
seed = 3
parallel = 3
postselection = 0
"""


@pytest.fixture
def folder(tmp_path):
    folder = written(tmp_path / "s", RUNNER, SCENARIO)
    (folder / "parameters.txt").write_text('x "" i (0, 30)\n')
    (folder / "evaluator").write_text(EVALUATOR)
    (folder / "evaluator").chmod(0o755)
    return folder


def steps(folder):
    """What was run and evaluated, in turn: one or the other, of which configurations and seed, and who was alive."""
    found = []
    for line in (folder / "log").read_text().splitlines():
        what, of, *alive = line.split()
        configuration, seed = of.split("-")
        found.append((what, int(configuration), int(seed), tuple(map(int, alive[1:]))))
        assert not alive or int(alive[0]) == len(alive) - 1
    return found


def check(folder, run):
    """That all runs of an instance come before its evaluations, which are of all that are alive, and count."""
    record = read(run / JOURNAL).record
    seeds = {one.seed for one in record.experiments.values()}
    revised = 0
    batches = itertools.groupby((step for step in steps(folder) if step[2] in seeds), key=lambda step: step[2])
    latest = {}
    for seed, several in batches:
        batch = list(several)
        runs = [step[1] for step in batch if step[0] == "run"]
        evaluated = [step for step in batch if step[0] == "evaluate"]
        assert [step[0] for step in batch] == ["run"] * len(runs) + ["evaluate"] * len(evaluated)
        alive = [step[1] for step in evaluated]
        assert all(step[3] == tuple(alive) for step in evaluated)
        assert set(runs) <= set(alive)
        revised += len(set(alive) - set(runs))
        costs = {number: (record.configurations[number]["x"] - 7) ** 2 for number in alive}
        latest |= {(number, seed): cost - max(costs.values()) for number, cost in costs.items()}
    table = experiments_table(run)
    assert {(one.configuration, one.seed): one.score for one in table.itertuples()} == latest
    return record, revised


def test_it_compares_all_that_are_alive(mdesign, folder, tmp_path):
    code, out, err = mdesign("tune", folder / "scenario.txt", "-o", tmp_path / "r", "--progress", "none")
    assert (code, err) == (0, "")
    record, revised = check(folder, tmp_path / "r")
    assert revised > 0
    assert sum(map(len, record.revised.values())) == revised
    results = pd.read_csv(tmp_path / "r" / "results.csv")
    assert abs(results.x[0] - 7) <= 2
    (run,) = json.loads(mdesign("runs", "list", tmp_path, "--json")[1])
    table = mdesign("runs", "show", tmp_path / "r")[1].partition("\niteration ")[2].splitlines()
    head = ["iteration", *table[0].replace("race mean", "mean").split()]
    last = dict(zip(head, table[len(record.iterations)].split(), strict=False))
    assert run["race_score"] == pytest.approx(results["mean"][0])  # by the scores that there are in the end
    assert float(last["mean"]) == pytest.approx(results["mean"][0], rel=1e-3)
    tests = [step for step in steps(folder) if step[2] in {test.seed for test in record.tests.values()}]
    assert [step[0] for step in tests] == ["run"] * (len(tests) // 2) + ["evaluate"] * (len(tests) // 2)
    assert f"{len(tests) // 2} tests" in out
    assert "were not run again" in mdesign("runs", "verify", tmp_path / "r")[1]
    code, _, err = mdesign("runs", "ablation", tmp_path / "r", "--from-first")
    assert code == 1
    assert "found a targetEvaluator: it cannot be ablated" in err


@pytest.mark.thorough
def test_stopped_and_resumed_it_is_the_same(mdesign, folder, tmp_path):
    """Stopped by an evaluation that fails, with all of the batch run."""
    whole = tmp_path / "whole"
    assert mdesign("tune", folder / "scenario.txt", "-o", whole)[0] == 0
    first = (folder / "log").read_text()
    for fails_at in (1, 40, 75):
        run = tmp_path / f"{fails_at}"
        (folder / "log").unlink()
        (folder / "go").unlink(missing_ok=True)
        broken = EVALUATOR.replace(
            'echo "eval', f'[ ! -e go ] && [ $(grep -c eval log) -ge {fails_at} ] && exit 3\necho "eval'
        )
        (folder / "evaluator").write_text(broken)
        code, _, err = mdesign("tune", folder / "scenario.txt", "-o", run)
        assert code == 1
        assert "expected exit status 0, found exit status 3" in err
        (folder / "go").touch()
        assert mdesign("tune", "--resume", run)[0] == 0
        one, other = (read(path / JOURNAL).record for path in (whole, run))
        assert one.ends[-1].digest == other.ends[-1].digest
        assert sorted((folder / "log").read_text().splitlines()) == sorted(first.splitlines())
        check(folder, run)


def test_one_that_is_rejected_by_a_later_comparison(mdesign, folder, tmp_path):
    """By an infinite cost when it is evaluated on an instance for the second time."""
    again = '[ $(grep -c "evaluate $configuration-$seed" log) = 1 ] && echo Inf && exit\n'
    refusing = EVALUATOR.replace("shift 5\n", f"shift 5\n{again}")
    (folder / "evaluator").write_text(refusing)
    code, _, _ = mdesign("tune", folder / "scenario.txt", "-o", tmp_path / "r")
    assert code == 0
    record = read(tmp_path / "r" / JOURNAL).record
    rejected = {where.configuration for several in record.revised.values() for where in several}
    assert rejected
    assert record.ends[-1].winner not in rejected
    failed = experiments_table(tmp_path / "r").query("failure != ''")
    assert set(failed.configuration) == rejected


def test_only_test_and_check(mdesign, folder):
    (folder / "c.txt").write_text("x\n7\n9\n10\n")
    code, out, _ = mdesign("tune", folder / "scenario.txt", "--only-test", folder / "c.txt")
    assert code == 0
    assert [line.split()[2:] for line in out.splitlines()[1:3]] == [["-9", "-5", "0"]] * 2
    assert [step[0] for step in steps(folder)] == ["run"] * 6 + ["evaluate"] * 6
    code, out, _ = mdesign("tune", folder / "scenario.txt", "--check")
    assert code == 0
    lines = out.splitlines()
    assert [line.startswith("  cost ") for line in lines] == [False, False, False, True, False, True]


def test_the_command_that_shows_a_failure_runs_the_evaluator_too(mdesign, folder, tmp_path):
    (folder / "evaluator").write_text("#!/bin/sh\n[ $1 = 2 ] && exit 3\necho 1\n")
    code, _, err = mdesign("tune", folder / "scenario.txt", "-o", tmp_path / "r")
    assert code == 1
    (line,) = [line for line in err.splitlines() if line.startswith("To run only the failed experiment: ")]
    found = subprocess.run(
        ["/bin/sh", "-c", line.removeprefix("To run only the failed experiment: ")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (found.returncode, found.stdout) == (3, "")
    assert (folder / "log").read_text().splitlines()[-1].startswith("run 2-")


@pytest.mark.thorough
def test_the_optuna_storage_has_the_scores_that_were_given_last(mdesign, folder, tmp_path):
    """Also those of before a race was resumed: into a storage of its own, it brings all of them again."""
    run, few = tmp_path / "r", ("--max-experiments", 60)
    assert mdesign("tune", folder / "scenario.txt", "-o", run, *few, "--optuna", f"sqlite:///{tmp_path}/a.db")[0] == 0
    record = read(run / JOURNAL).record
    assert record.revised
    assert mdesign("tune", "--resume", run, "--optuna", f"sqlite:///{tmp_path}/b.db")[0] == 0
    scores = {}
    for one in record.view.results():
        scores.setdefault(one.configuration, {})[one.instance] = one.score
    for name in ("a", "b"):
        with connections_closed():
            (study,) = optuna.get_all_study_summaries(f"sqlite:///{tmp_path}/{name}.db")
            trials = optuna.load_study(study_name=study.study_name, storage=f"sqlite:///{tmp_path}/{name}.db").trials
        assert {trial.number: trial.intermediate_values for trial in trials} == scores
