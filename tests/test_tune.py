"""mdesign tune and mdesign export irace, as a user runs them."""

import csv
import io
import json
import os
import shlex
import shutil
import signal
import subprocess
import sys

import pandas as pd
import pytest

from mercator_design.race.session.journal import read
from mercator_design.results.files import JOURNAL
from mercator_design.results.tables import experiments_table
from tests.processes import LIMIT, signal_when, started, wait_until
from tests.race.test_target import gone
from tests.tiers import some

MDESIGN = [sys.executable, "-m", "mercator_design"]
SPACE = """
x    "--x "    i (0, 30)
rule "--rule " c (slow, fast)
y    "--y="    r (0, 1) | rule == "fast"
"""
RUNNER = """\
#!/bin/sh
seed=$3 instance=$4 x=0 more=0
shift 4
while [ $# -gt 0 ]; do
  case $1 in --x) x=$2;; slow) more=10;; esac
  shift
done
echo $(( (x - 7) * (x - 7) + more + seed % 3 + ${#instance} ))
"""
SCENARIO = """
instances = c("a", "bb", "ccc", "dddd", "eeeee", "ffffff")
testInstances = c("t", "tt")
maxExperiments = 110
parallel = 2
seed = 3
"""
WAITING = "#!/bin/sh\nif [ -e go ]; then echo 1; else sleep 600 & echo $! > child; wait; fi\n"
SHORT = 'instances = "i"\nmaxExperiments = 60\nnbIterations = 1\ntargetRunnerRetries = 3\n'
QUICK_TO_START = ["--method", "random"]
"""irace's first configurations are a Sobol sequence, whose import takes long."""
INTERRUPTED = signal.SIGINT, 130, "Interrupted."
TERMINATED = signal.SIGTERM, 75, "Terminated."


@pytest.fixture
def folder(tmp_path):
    """The folder of a scenario."""
    return written(tmp_path / "sharpen")


def written(folder, runner=RUNNER, scenario=SCENARIO):
    folder.mkdir(exist_ok=True)
    (folder / "parameters.txt").write_text(SPACE)
    (folder / "scenario.txt").write_text(scenario)
    (folder / "target-runner").write_text(runner)
    (folder / "target-runner").chmod(0o755)
    return folder


def child_of(folder):
    """The process that a waiting runner has started; None if it has not."""
    file = folder / "child"
    text = file.read_text() if file.exists() else ""  # read once: another runner may empty it to write its own
    return int(text) if text else None


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory, mdesign_once):
    """The folder of a scenario whose race nothing stopped, and that of the race."""
    folder = written(tmp_path_factory.mktemp("tuning") / "sharpen")
    run = folder / "r"
    mdesign_once("tune", folder / "scenario.txt", "-o", run)
    return folder, run


def digest(run):
    return read(run / JOURNAL).record.digest()


class TestTune:
    def test_to_the_best(self, mdesign, folder, monkeypatch):
        monkeypatch.chdir(folder)
        code, out, err = mdesign("tune", "scenario.txt", "--progress", "none")
        assert (code, err) == (0, "")
        assert "Scenario   sharpen, seed 3; scores are costs: lower is better\n" in out
        assert "of 110 experiments, " in out
        assert " on 2 fresh instances" in out
        run = folder / "runs" / "sharpen-1"
        results = pd.read_csv(run / "results.csv")
        assert (results.x[0], results.rule[0], results.tests[0]) == (7, "fast", 2)
        lines = [line for line in (run / "best.txt").read_text().splitlines() if not line.startswith("#")]
        assert lines[0].split() == ["x", "rule", "y"]
        assert lines[1].split()[:2] == ["7", "fast"]
        assert f"--x 7 --rule fast --y={lines[1].split()[2]}" in out

    def test_its_result_begins_another(self, mdesign, undisturbed, folder, tmp_path):
        best = undisturbed[1] / "best.txt"
        (folder / "scenario.txt").write_text(f'{SCENARIO}configurationsFile = "{best}"\n')
        code, _, _ = mdesign("tune", folder / "scenario.txt", "-o", tmp_path / "q")
        assert code == 0
        record = read(tmp_path / "q" / JOURNAL).record
        first = read(undisturbed[1] / JOURNAL).record
        assert record.configurations[0] == first.configurations[first.ends[-1].winner]

    def test_instances_come_in_turn_with_seeds_of_their_own(self, undisturbed):
        table = experiments_table(undisturbed[1])
        seeds = table.groupby("instance").seed.unique()
        assert all(len(seed) == 1 for seed in seeds)
        assert len({seed[0] for seed in seeds}) == len(seeds)
        calls = read(undisturbed[1] / JOURNAL).record
        lengths = {  # of the instance's name, which is part of the cost
            one.instance: int(one.score) - (one_x(calls, one) - 7) ** 2 - slow(calls, one) - one.seed % 3
            for one in calls.experiments.values()
        }
        assert sorted(lengths[instance] for instance in range(6)) == [1, 2, 3, 4, 5, 6]

    def test_one_that_lost_its_provenance(self, mdesign, undisturbed, tmp_path):
        """The command that begins it again is named, and gives the same race."""
        path = shutil.copytree(undisturbed[1], tmp_path / "lost")
        (path / "provenance.json").unlink()
        code, out, err = mdesign("tune", "--resume", path)
        assert (code, out) == (1, "")
        again = ["tune", f"{path}/scenario.txt", "--method", "irace"]
        assert f"in another folder with: {shlex.join(['mdesign', *again])} -o ANOTHER\n" in err
        assert mdesign(*again, "-o", tmp_path / "again")[0] == 0
        same, before = (read(folder / JOURNAL).record for folder in (tmp_path / "again", undisturbed[1]))
        assert (same.view.results(), same.configurations) == (before.view.results(), before.configurations)

    @pytest.mark.thorough
    def test_killed_and_resumed(self, mdesign, undisturbed, tmp_path):
        folder, whole = undisturbed
        run = tmp_path / "r"
        command = [*MDESIGN, "tune", folder / "scenario.txt", "-o", run]
        with started(*command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL):
            journal = run / JOURNAL
            wait_until(lambda: journal.exists() and journal.read_bytes().count(b'"experiment"') >= 20)
        assert mdesign("tune", "--resume", run)[0] == 0
        assert digest(run) == digest(whole)
        for name in ("best.txt", "results.csv"):
            assert (run / name).read_bytes() == (whole / name).read_bytes()

    @pytest.mark.swept
    @pytest.mark.parametrize("options", some([[], ["--speculate"]], 1))
    def test_the_budget_is_that_of_runs(self, mdesign, tmp_path, options):
        """The runner notes each run."""
        folder = written(tmp_path / "s", RUNNER.replace("#!/bin/sh\n", '#!/bin/sh\necho "$*" >> runs\n'))
        (folder / "scenario.txt").write_text(SCENARIO.replace("testInstances", ".no"))
        code, out, _ = mdesign("tune", folder / "scenario.txt", "-o", tmp_path / "r", "-j", 8, *options)
        made = len((folder / "runs").read_text().splitlines())
        record = read(tmp_path / "r" / JOURNAL).record
        unasked = len(record.speculative.keys() - {(e.configuration, e.instance) for e in record.experiments.values()})
        assert code == 0
        assert f"the target runner ran {made} times now" in out
        if options:
            assert made == len(record.experiments) + unasked
            assert not unasked or f"ran {made} times now: {made - unasked} experiments, {unasked} speculative" in out
        else:
            assert made == len(record.experiments) <= 110
            assert record.speculative == {}

    def test_a_launcher_by_its_name(self, mdesign, tmp_path):
        folder = written(tmp_path / "s", RUNNER, f'{SCENARIO}targetRunnerLauncher = "sh"\n')
        (folder / "target-runner").chmod(0o644)
        assert mdesign("tune", folder / "scenario.txt", "-o", tmp_path / "r", "--max-experiments", 100)[0] == 0
        assert mdesign("tune", "--resume", tmp_path / "r", "--max-experiments", 110)[0] == 0

    def test_which_changes_led_to_the_best(self, mdesign, undisturbed):
        _, run = undisturbed
        code, out, _ = mdesign("runs", "ablation", run, "--from-first", "-n", 2, "--csv")
        assert code == 0
        table = pd.read_csv(io.StringIO(out))
        best = read(run / JOURNAL).record
        assert table.x.iloc[-1] == best.configurations[best.ends[-1].winner]["x"]
        assert table["mean"].iloc[-1] <= table["mean"][0]
        code, _, err = mdesign("runs", "ablation", run)
        assert code == 1
        assert "the winner is not a PFSM: give --from CONFIGURATION or --from-first" in err

    def test_a_larger_budget(self, mdesign, folder, tmp_path):
        run = tmp_path / "r"
        assert mdesign("tune", folder / "scenario.txt", "-o", run, "--max-experiments", 100)[0] == 0
        code, out, _ = mdesign("tune", "--resume", run, "--max-experiments", 125, "-j", 1)
        assert code == 0
        assert "of 125 experiments" in out

    def test_what_is_said_of_it(self, mdesign, undisturbed):
        run = undisturbed[1]
        code, out, _ = mdesign("runs", "show", run)
        assert code == 0
        assert "Scenario   sharpen, seed 3; scores are costs: lower is better\n" in out
        assert "x = 7\n" in out
        assert mdesign("runs", "verify", run, "-n", 10)[0] == 0
        [listed] = json.loads(mdesign("runs", "list", run.parent, "--json")[1])
        assert (listed["name"], listed["state"]) == ("sharpen", "finished")

    def test_the_verb_of_another_task(self, mdesign, undisturbed):
        code, _, err = mdesign("race", "--resume", undisturbed[1])
        assert code == 2
        assert "resume it with mdesign tune --resume" in err

    def test_a_runner_in_python(self, mdesign, tmp_path):
        runner = f"#!{sys.executable}\nimport sys\nprint(abs(int(sys.argv[6]) - 7), 'x' and 0.5)\n"
        folder = written(tmp_path / "p", runner, 'instances = "i"\nmaxExperiments = 25\nnbIterations = 1\n')
        assert mdesign("tune", folder / "scenario.txt", "-o", tmp_path / "r")[0] == 0
        assert abs(pd.read_csv(tmp_path / "r" / "results.csv").x[0] - 7) < 4

    @pytest.mark.parametrize("method", ["halving", "random"])
    def test_other_methods(self, mdesign, folder, tmp_path, method):
        (folder / "scenario.txt").write_text(f"{SCENARIO}configurationsFile = 'c.txt'\n")
        (folder / "c.txt").write_text("x rule y\n7 fast 0.5\n")
        code, out, _ = mdesign("tune", folder / "scenario.txt", "-o", tmp_path / "r", "--method", method)
        assert code == 0
        assert f"Race       {method}, " in out
        assert read(tmp_path / "r" / JOURNAL).record.configurations[0] == {"x": 7, "rule": "fast", "y": 0.5}


def one_x(record, one):
    return record.configurations[one.configuration]["x"]


def slow(record, one):
    return 10 * (record.configurations[one.configuration]["rule"] == "slow")


class TestCheck:
    def test_shows_commands_and_costs(self, mdesign, folder, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        code, out, err = mdesign("tune", folder / "scenario.txt", "--check")
        assert (code, err) == (0, "")
        lines = out.splitlines()
        assert len(lines) == 4
        for command, cost in zip(lines[::2], lines[1::2], strict=True):
            done = subprocess.run(command, shell=True, check=True, capture_output=True, text=True)  # noqa: S602
            assert float(cost.removeprefix("  cost ")) == float(done.stdout)
        assert not (tmp_path / "runs").exists()

    def test_says_what_makes_no_difference(self, mdesign, folder):
        (folder / "scenario.txt").write_text(f"debugLevel = 2\n{SCENARIO}")
        code, _, err = mdesign("tune", folder / "scenario.txt", "--check")
        assert code == 0
        assert err.startswith(f"Note: {folder / 'scenario.txt'}:1: debugLevel has no effect: ")

    def test_fails_with_what_the_runner_said(self, mdesign, tmp_path):
        folder = written(tmp_path / "s", "#!/bin/sh\necho no licence >&2\nexit 4\n")
        code, out, err = mdesign("tune", folder / "scenario.txt", "--check")
        assert code == 1
        assert "expected exit status 0, found exit status 4; it printed 'no licence'" in out
        assert "found failures" in err


class TestOnlyTest:
    CONFIGURATIONS = "  x rule y\n3 7 fast 0.5\n9 5 slow NA\n"

    @pytest.fixture
    def table(self, folder):
        (folder / "c.txt").write_text(self.CONFIGURATIONS)
        return folder / "c.txt"

    def test_costs_on_test_instances(self, mdesign, folder, table, tmp_path):
        arguments = ["tune", folder / "scenario.txt", "--only-test", table]
        code, out, err = mdesign(*arguments, "-o", tmp_path / "t", "-j", 3)
        assert (code, err) == (0, "")
        header, *rows = [line.split() for line in out.splitlines()]
        assert header == ["test", "instance", "seed", "1", "2"]
        for name, row in zip(["t", "tt"], rows, strict=False):
            noise = int(row[1]) % 3 + len(name)
            assert row == [name, row[1], str(noise), str(4 + 10 + noise)]
        assert rows[2][0] == "mean"
        written = list(csv.reader((tmp_path / "t" / "tests.csv").read_text().splitlines()))
        assert written == [["test instance", "seed", "1", "2"], *rows[:2]]
        assert mdesign(*arguments)[1] == out
        assert not (folder / "runs").exists()

    def test_the_seeds_are_those_of_a_race_s_tests(self, mdesign, undisturbed, table):
        folder, run = undisturbed
        _, out, _ = mdesign("tune", folder / "scenario.txt", "--only-test", run / "best.txt")
        seeds = [line.split()[1] for line in out.splitlines()[1:3]]
        tests = read(run / JOURNAL).record.tests
        assert seeds == [str(tests[where].seed) for where in sorted(tests)[:2]]

    @pytest.mark.parametrize(
        ("scenario", "configurations", "runner", "message"),
        [
            (SCENARIO.replace("testInstances", ".no"), CONFIGURATIONS, RUNNER, "expected test instances for --only"),
            (SCENARIO, "x rule y\n", RUNNER, "c.txt: expected configurations, found none"),
            (SCENARIO, "x rule y\n31 slow NA\n", RUNNER, "c.txt:2: parameter 'x': expected integer within (0, 30)"),
            (SCENARIO, CONFIGURATIONS, "#!/bin/sh\necho oh; exit 3\n", "a test (configuration 1, instance of seed "),
        ],
    )  # fmt: skip
    def test_what_is_wrong_is_named(self, mdesign, folder, table, scenario, configurations, runner, message):
        (folder / "scenario.txt").write_text(scenario)
        (folder / "target-runner").write_text(runner)
        table.write_text(configurations)
        code, out, err = mdesign("tune", folder / "scenario.txt", "--only-test", table)
        assert (code, out) == (1, "")
        assert message in err

    def test_one_that_fails_may_be_passed_over(self, mdesign, folder, table):
        (folder / "target-runner").write_text(RUNNER.replace("echo", "[ $x = 5 ] && exit 3\necho"))
        arguments = ["tune", folder / "scenario.txt", "--only-test", table, "--on-failure", "reject"]
        code, out, _ = mdesign(*arguments)
        assert code == 0
        assert [line.split()[-1] for line in out.splitlines()[1:]] == ["inf"] * 3


class TestFailures:
    @pytest.fixture
    def nervous(self, tmp_path):
        return written(tmp_path / "s", RUNNER.replace("echo", "[ $x -gt 20 ] && { echo too much; exit 1; }\necho"))

    def test_one_stops_the_race_with_the_command_that_shows_it(self, mdesign, nervous, tmp_path):
        code, out, err = mdesign("tune", nervous / "scenario.txt", "-o", tmp_path / "r")
        assert (code, out) == (1, "")
        assert "expected exit status 0, found exit status 1; it printed 'too much'" in err
        command = next(line for line in err.splitlines() if line.startswith("To run only the failed experiment: "))
        done = subprocess.run(command.partition(": ")[2], shell=True, capture_output=True, text=True, check=False)  # noqa: S602
        assert (done.returncode, done.stdout) == (1, "too much\n")
        code, out, _ = mdesign("tune", "--resume", tmp_path / "r", "--on-failure", "reject")
        assert code == 0
        assert "Failed     " in out

    def test_a_runner_that_was_mended_goes_on(self, mdesign, nervous, tmp_path, undisturbed):
        assert mdesign("tune", nervous / "scenario.txt", "-o", tmp_path / "r")[0] == 1
        (nervous / "target-runner").write_text(RUNNER)
        assert mdesign("tune", "--resume", tmp_path / "r")[0] == 0
        ours, whole = (experiments_table(run) for run in (tmp_path / "r", undisturbed[1]))
        assert ours.equals(whole)

    def test_a_runner_that_was_moved_is_named_anew(self, mdesign, nervous, tmp_path):
        run = tmp_path / "r"
        assert mdesign("tune", nervous / "scenario.txt", "-o", run)[0] == 1
        (nervous / "target-runner").rename(tmp_path / "moved")
        code, _, err = mdesign("tune", "--resume", run)
        assert code == 1
        assert f"{run / 'scenario.txt'}:4: targetRunner: expected a file, found none at {nervous}" in err
        text = (run / "scenario.txt").read_text()
        (run / "scenario.txt").write_text(text.replace(str(nervous / "target-runner"), str(tmp_path / "moved")))
        assert mdesign("tune", "--resume", run, "--on-failure", "reject")[0] == 0
        (run / "scenario.txt").write_text(text.replace('"ffffff"', '"gggggg"'))
        (nervous / "target-runner").symlink_to(tmp_path / "moved")
        assert "instances_digest: raced with " in mdesign("tune", "--resume", run)[2]

    def test_an_infinite_cost_rejects_and_stops_nothing(self, mdesign, tmp_path):
        folder = written(tmp_path / "s", RUNNER.replace("echo", "[ $x -gt 20 ] && { echo Inf; exit; }\necho"))
        code, _, err = mdesign("tune", folder / "scenario.txt", "-o", tmp_path / "r")
        assert code == 0
        assert "the target runner rejects it by a cost of inf" in err
        failed = experiments_table(tmp_path / "r").query("failure != ''")
        record = read(tmp_path / "r" / JOURNAL).record
        assert len(failed)
        assert all(record.configurations[configuration]["x"] > 20 for configuration in failed.configuration)

    @pytest.mark.thorough
    @pytest.mark.parametrize(("number", "code", "word"), [INTERRUPTED, TERMINATED, (signal.SIGHUP, 75, "Terminated.")])
    def test_a_signal_ends_what_runs(self, mdesign, tmp_path, number, code, word):
        """A run may take hours: it is not waited for; nor is it noted as failed."""
        folder = written(tmp_path / "s", WAITING, SHORT)
        run = tmp_path / "r"
        arguments = ["tune", folder / "scenario.txt", "-o", run, "--on-failure", "reject", *QUICK_TO_START]
        if number == signal.SIGINT:  # a whole process ends as well
            with started(*MDESIGN, *arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
                wait_until(lambda: child_of(folder))
                os.kill(process.pid, number)
                out, err = process.communicate(timeout=LIMIT)
            found = process.returncode
        else:
            with signal_when(lambda: child_of(folder), number):
                found, out, err = mdesign(*arguments)
        assert (found, out, err.splitlines()[-1]) == (code, "", word)
        assert gone(child_of(folder))
        assert read(run / JOURNAL).record.experiments == {}
        (folder / "go").touch()
        assert mdesign("tune", "--resume", run)[0] == 0

    @pytest.mark.thorough
    def test_its_terminal_is_closed(self, tmp_path):
        """That is told by a signal, perhaps twice; then there is nobody to tell anything."""
        folder = written(tmp_path / "s", WAITING, SHORT)
        terminal, end = os.openpty()
        command = [*MDESIGN, "tune", folder / "scenario.txt", "-o", tmp_path / "r", *QUICK_TO_START]
        with started(*command, stdin=end, stdout=end, stderr=end) as process:
            os.close(end)
            child = wait_until(lambda: child_of(folder))
            os.close(terminal)
            os.kill(process.pid, signal.SIGHUP)
            os.kill(process.pid, signal.SIGHUP)
            process.wait(timeout=LIMIT)
        assert process.returncode == 75
        assert gone(child)
        assert read(tmp_path / "r" / JOURNAL).record.sessions[-1].why == "Signalled"

    @pytest.mark.thorough
    @pytest.mark.parametrize(
        ("command", "number", "code", "word"),
        [
            ("verify", *INTERRUPTED),
            ("verify", *TERMINATED),
            ("ablation --from-first -n 2", *INTERRUPTED),
            ("check", *INTERRUPTED),
            ("check", *TERMINATED),
        ],
    )
    def test_a_signal_ends_what_is_run_again(self, mdesign, tmp_path, command, number, code, word):
        """SIGHUP is taken as SIGTERM is; an ablation stops as a verification does."""
        folder = written(tmp_path / "s", WAITING, SHORT)
        run = tmp_path / "r"
        if command == "check":
            arguments = ["tune", folder / "scenario.txt", "--check"]
        else:
            (folder / "go").touch()
            assert mdesign("tune", folder / "scenario.txt", "-o", run)[0] == 0
            (folder / "go").unlink()
            verb, *options = command.split()
            arguments = ["runs", verb, run, *options, "-j", "2"]
        with signal_when(lambda: child_of(folder), number):
            found, _, err = mdesign(*arguments)
        assert (found, err.splitlines()[-1]) == (code, word)
        assert gone(child_of(folder))


@pytest.mark.parametrize(
    ("text", "options", "code", "message"),
    [
        ("nonsense", [], 1, "scenario.txt:1: expected NAME = VALUE, found 'nonsense'"),
        ("targetRunner = 'none'\n" + SCENARIO, [], 1, "scenario.txt:1: targetRunner: expected a file, found none at "),
        (SCENARIO.replace("110", "5"), [], 1, "scenario.txt: budget: expected at least "),
        (SCENARIO, ["--target-runner", "none"], 1, "the command line: targetRunner: expected a file, found none at "),
        (SCENARIO, ["--max-experiments", "0"], 2, "--max-experiments"),
        (SCENARIO, ["--resume", "r"], 2, "SCENARIO is fixed when a race begins"),
        (SCENARIO, ["--check", "--only-test", "c.txt"], 2, "--check takes neither --only-test nor --output"),
        (SCENARIO, ["--only-test", "c.txt", "--optuna", "sqlite:///o.db"], 2, "--check and --only-test run none"),
        ("nbConfigurations = 2\n" + SCENARIO, [], 1, "nbConfigurations: expected more than the 3 survivors"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(mdesign, folder, tmp_path, monkeypatch, text, options, code, message):
    monkeypatch.chdir(tmp_path)
    (folder / "scenario.txt").write_text(text)
    found, out, err = mdesign("tune", folder / "scenario.txt", *options)
    assert (found, out) == (code, "")
    assert message in err
    assert not (tmp_path / "runs").exists()


def test_a_scenario_is_needed(mdesign):
    code, _, err = mdesign("tune")
    assert code == 2
    assert "Missing argument 'SCENARIO'" in err


def test_the_scenario_may_be_given_as_iraces_option(mdesign, folder, tmp_path):
    scenario = folder / "scenario.txt"
    plain = mdesign("tune", scenario, "--check")
    assert mdesign("tune", "--scenario", scenario, "--check") == plain == mdesign("tune", "-s", scenario, "--check")
    code, _, err = mdesign("tune", scenario, "--scenario", scenario)
    assert code == 2
    assert "SCENARIO and --scenario exclude each other" in err
    code, _, err = mdesign("tune", "--scenario", scenario, "--resume", tmp_path)
    assert code == 2
    assert "--scenario is fixed when a race begins" in err


class TestExport:
    @pytest.fixture(autouse=True)
    def plain_python(self, monkeypatch):
        """In which experiments as short as these take less time than to load compiled code."""
        monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")

    @pytest.fixture
    def exported(self, mdesign, tmp_path, monkeypatch):
        monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
        folder = tmp_path / "an irace"
        code, out, _ = mdesign("export", "irace", "aggregation", "-o", folder, "--budget", 60, "--jobs", 2,
                               "--set", "robots=2", "--set", "duration=2")  # fmt: skip
        assert (code, out) == (0, f"cd '{folder}' && irace --scenario scenario.txt\n")
        return folder

    @pytest.mark.thorough
    def test_a_tiny_budget_runs(self, mdesign, exported, tmp_path):
        (exported / "scenario.txt").write_text(
            (exported / "scenario.txt").read_text() + "nbIterations = 1\nminNbSurvival = 1\nfirstTest = 1\nmu = 1\n"
        )
        code, out, _ = mdesign("tune", exported / "scenario.txt", "--max-experiments", 4, "-o", tmp_path / "r")
        assert code == 0
        best = out.rstrip().splitlines()[-3]
        assert best.startswith("--nstates ")
        (tmp_path / "fsm.txt").write_text(f"{best}\n")
        one = experiments_table(tmp_path / "r").iloc[-1]
        code, out, _ = mdesign("evaluate", tmp_path / "fsm.txt", "--mission", exported / "mission.yaml", "--json")
        assert code == 0
        assert one.score <= 0  # minus the robots in the zone

    def test_the_cost_is_minus_the_score_that_is_maximised(self, mdesign, exported):
        """A cost and nothing else: irace reads stderr, too."""
        fsm = "--nstates 1 --s0 1"
        call = [exported / "target-runner", "1", "1", "5", "mission.yaml", *fsm.split()]
        done = subprocess.run(call, capture_output=True, text=True, check=True)
        assert done.stderr == ""
        (exported / "fsm.txt").write_text(f"{fsm}\n")
        mission = ["--mission", exported / "mission.yaml", "--instance", 5, "--json"]
        score = json.loads(mdesign("evaluate", exported / "fsm.txt", *mission)[1])["mean"]
        assert float(done.stdout) == 0 - score

    def test_a_wrong_configuration_is_an_error(self, exported):
        call = [exported / "target-runner", "1", "1", "5", "mission.yaml", "--nstates", "9"]
        done = subprocess.run(call, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stdout) == (3, "")
        assert "--nstates" in done.stderr

    @pytest.mark.thorough
    @pytest.mark.usefixtures("registries")
    def test_plugins_come_along(self, mdesign, tmp_path, monkeypatch):
        monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
        plugin, folder = tmp_path / "mine.py", tmp_path / "its own"
        plugin.write_text(
            "from mercator_design import objective\n\n"
            "@objective\ndef always(trace, *, score: float) -> float:\n    return score\n"
        )
        objective = "objective={name: always, score: 2.5, direction: maximise}"
        code, _, _ = mdesign("export", "irace", "aggregation", "-o", folder, "--plugin", plugin,
                             "--set", objective, "--set", "duration=1", "--set", "robots=1")  # fmt: skip
        assert code == 0
        plugin.unlink()
        call = [folder / "target-runner", "1", "1", "5", "mission.yaml", "--nstates", "1", "--s0", "1"]
        done = subprocess.run(call, capture_output=True, text=True, check=True)
        assert (done.stdout, done.stderr) == ("-2.5\n", "")

    def test_results_are_never_mixed(self, mdesign, exported):
        code, _, err = mdesign("export", "irace", "aggregation", "-o", exported)
        assert code == 1
        assert "expected a new or empty folder" in err

    def test_a_budget_that_irace_refuses_is_said(self, mdesign, tmp_path):
        _, _, err = mdesign("export", "irace", "aggregation", "-o", tmp_path / "e", "--budget", 1000)
        assert "Warning: R's irace refuses this scenario: a budget of 1000 is planned for" in err


def test_a_controller_is_given_once(mdesign):
    assert mdesign("evaluate")[0] == 2
    assert mdesign("evaluate", "fsm.txt", "--fsm-config", "--nstates 1 --s0 1")[0] == 2
    assert "--mission" in mdesign("evaluate", "--fsm-config", "--nstates 1 --s0 1")[2]
