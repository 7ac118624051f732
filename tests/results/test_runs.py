"""Races that were stopped, and what is said of races: mdesign race --resume, mdesign runs."""

import contextlib
import io
import json
import math
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from types import SimpleNamespace

import optuna
import pandas as pd
import pytest

from mercator_design.cli.races.common import _Messages, new_folder
from mercator_design.command import print_message
from mercator_design.designer import Designer
from mercator_design.errors import RaceError
from mercator_design.fsm import parse
from mercator_design.fsm.space.grammar import from_pfsm, to_pfsm
from mercator_design.fsm.text import to_text
from mercator_design.modules.flavour import flavour_of
from mercator_design.plugins import loading as plugins
from mercator_design.race.analysis.ablation import Step
from mercator_design.race.elimination.summary import Elite, Progress
from mercator_design.race.session import events
from mercator_design.race.session.events import (
    ConfigurationAdded,
    ExperimentDone,
    IterationEnded,
    RaceEnded,
    ScoreRevised,
    SessionStopped,
)
from mercator_design.race.session.journal import Journal, read
from mercator_design.race.session.record import Record
from mercator_design.race.session.view import RaceView
from mercator_design.results import tables
from mercator_design.results.analysis.ablation import Ablation
from mercator_design.results.analysis.pruning import without
from mercator_design.results.files import JOURNAL
from mercator_design.results.tables import configurations_table, experiments_table
from mercator_design.scores import ANY_SCORE
from mercator_design.show.text.analysis import ablation_csv, ablation_page
from mercator_design.show.text.columns import difference, with_notes_wrapped
from mercator_design.show.text.iterations import iteration_notes, iterations_table, last_gain
from mercator_design.show.text.progress import RaceDisplay
from tests.processes import LIMIT, started, wait_until
from tests.race.lines import events_in, journal_of
from tests.storages import connections_closed
from tests.tiers import some, takes_long

pytestmark = pytest.mark.together

MDESIGN = [sys.executable, "-c", "from mercator_design.cli import main; main()"]
QUICK = ["--method", "irace", "--set", "robots=2", "--set", "duration=3", "-j", "2"]
RACE = ["race", "aggregation", "--budget", "120", "--test-runs", "0", *QUICK]
FAILING = """
from mercator_design import objective

@objective
def nervous(trace, *, least: float) -> float:
    x = float(trace.poses[-1, 0, 0])
    if x < least:
        raise ArithmeticError("too far to the left")
    return x
"""
SIGNALLING = """
import contextlib
import os
from mercator_design import objective

seen = []

@objective
def signalling(trace) -> float:
    if len(trace.poses) > 2:  # not the one cycle by which a race is rehearsed
        seen.append(trace)
        if len(seen) == 3:
            with contextlib.suppress(ProcessLookupError):  # it was another process, and has ended
                os.kill({process}, {number})
    return float(trace.poses[-1, 0, 0])
"""


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory, mdesign_once):
    """The folder of a race that nothing stopped."""
    folder = tmp_path_factory.mktemp("runs") / "whole"
    mdesign_once(*RACE, "-o", folder)  # and is compiled, so that no test here tells of that
    return folder


@pytest.fixture
def plain_python(monkeypatch):
    """Lets processes run a few short experiments in less time than they take to load compiled code."""
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")


@pytest.fixture
def folder(undisturbed, tmp_path):
    """A copy of it."""
    shutil.copytree(undisturbed, tmp_path / "r")
    return tmp_path / "r"


def digest(folder):
    return read(folder / JOURNAL).record.digest()


def warnings(err):
    """The lines on stderr but progress and notes on iterations: races as short as these hardly tell anything apart."""
    return [line for line in err.splitlines() if not line.startswith(("Note: iteration ", "aggregation: "))]


@contextlib.contextmanager
def dask_started(file):
    """A scheduler, which is found by its file, and a worker, as one starts them."""
    common = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    scheduler = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--port", "0"]
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", "--nthreads", "1", "--no-nanny"]
    options = ["--no-dashboard", "--scheduler-file", file]
    with started(*scheduler, *options, **common) as process, started(*worker, *options, **common):
        wait_until(file.exists)
        yield process


def stop(folder, number):
    """Cut a finished race back to some experiments, as if it had been stopped there."""
    lines = (folder / JOURNAL).read_bytes().splitlines(keepends=True)
    places = [k for k, line in enumerate(lines) if b'"event":"experiment"' in line]
    (folder / JOURNAL).write_bytes(b"".join(lines[: places[number] + 1]))
    for name in ("fsm.txt", "results.csv"):
        (folder / name).unlink()
    provenance = json.loads((folder / "provenance.json").read_text())
    for key in ("finished", "budget", "experiments", "winner", "journal", "seconds"):
        del provenance[key]
    (folder / "provenance.json").write_text(json.dumps(provenance))


def wait_for_an_experiment(folder):
    journal = folder / JOURNAL
    wait_until(lambda: journal.exists() and b'"event":"experiment"' in journal.read_bytes())


class TestResume:
    def test_after_whatever_stopped_it(self, mdesign, folder, undisturbed):
        stop(folder, 50)
        code, out, err = mdesign("race", "--resume", folder)
        assert (code, warnings(err)) == (0, [])
        assert re.search(
            r"^Winner .* score [\d.]+ of at most 2 in the race, \d+ runs \([\d.]+ to [\d.]+ at 95%\)$",
            out,
            re.MULTILINE,
        )
        assert "120 of 120 experiments" in out
        assert "69 of them now" in out
        assert digest(folder) == digest(undisturbed)
        for name in ("fsm.txt", "results.csv", "mission.yaml", "robot_model.yaml"):
            assert (folder / name).read_bytes() == (undisturbed / name).read_bytes()
        assert json.loads((folder / "provenance.json").read_text())["journal"] == digest(undisturbed)

    def test_what_has_finished_is_not_run_again(self, mdesign, folder, undisturbed):
        (folder / "fsm.txt").unlink()  # as if it had been stopped before that was written
        before = (folder / JOURNAL).read_bytes().count(b'"event":"experiment"')
        code, out, _ = mdesign("race", "--resume", folder)
        assert code == 0
        assert (folder / JOURNAL).read_bytes().count(b'"event":"experiment"') == before > 0
        assert "seed 1; it had ended: continue with --resume and a larger budget\n" in out
        assert (folder / "fsm.txt").read_bytes() == (undisturbed / "fsm.txt").read_bytes()

    def test_in_another_place_and_by_other_means(self, mdesign, folder, undisturbed, tmp_path, monkeypatch):
        """The folder has moved, this is another working folder, with a mission of that name, and with other workers."""
        stop(folder, 20)
        elsewhere = tmp_path / "elsewhere"
        shutil.copytree(folder, elsewhere / "moved")
        monkeypatch.chdir(elsewhere)
        (elsewhere / "aggregation").write_text("not a mission")
        assert mdesign("race", "--resume", "moved", "-j", 3)[0] == 0
        assert digest(elsewhere / "moved") == digest(undisturbed)

    @pytest.mark.swept
    @pytest.mark.parametrize("method", some(["halving", "random", "tpe", "cma-es", "evostick"], 1))
    def test_whatever_its_method(self, mdesign, tmp_path, method):
        """Which is what the race began with."""
        folder = tmp_path / "r"
        quick = ["--set", "robots=2", "--set", "duration=3"]
        code, out, _ = mdesign("race", "aggregation", "--budget", 100, "--method", method, *quick, "-o", folder)
        expected = digest(folder)
        assert code == 0
        raced = re.search(rf"Race       {method}, \d+ of 100", out)[0]
        stop(folder, 40)
        assert mdesign("race", "--resume", folder)[0] == 0
        assert digest(folder) == expected
        assert raced in mdesign("runs", "show", folder)[1]
        assert mdesign("runs", "verify", folder, "-n", 3)[0] == 0
        code, _, err = mdesign("race", "--resume", folder, "--method", method)
        assert code == 2
        assert "--method is fixed when a race begins" in err

    @pytest.mark.thorough
    def test_by_processes(self, mdesign, folder, undisturbed):
        stop(folder, 70)
        assert mdesign("race", "--resume", folder, "--executor", "processes", "-j", 2, "--timeout", 60)[0] == 0
        assert digest(folder) == digest(undisturbed)

    @pytest.mark.timing
    def test_by_dask(self, mdesign, folder, undisturbed, tmp_path):
        """By a scheduler and a worker as one starts them, found by their file."""
        pytest.importorskip("distributed")
        file = tmp_path / "scheduler.json"
        stop(folder, 70)
        with dask_started(file):
            assert mdesign("race", "--resume", folder, "--executor", "dask", "--scheduler", file)[0] == 0
        assert digest(folder) == digest(undisturbed)

    def test_with_a_larger_budget(self, mdesign, folder, undisturbed, tmp_path):
        """Whether it is asked for after the end or before."""
        early = tmp_path / "early"
        shutil.copytree(folder, early)
        stop(early, 30)
        for one in (folder, early):
            code, out, _ = mdesign("race", "--resume", one, "--budget", 200)
            assert code == 0
            assert "of 200 experiments" in out
        assert digest(folder) == digest(early) != digest(undisturbed)
        assert (folder / "fsm.txt").read_bytes() == (early / "fsm.txt").read_bytes()
        assert "# budget: 200\n" in (folder / "fsm.txt").read_text()

    def test_with_a_smaller_budget(self, mdesign, folder):
        code, _, err = mdesign("race", "--resume", folder, "--budget", 100)
        assert code == 1
        assert "expected a budget of 120, as before, or more, found 100" in err

    @pytest.mark.parametrize(
        "option",
        [
            ["aggregation"],
            ["--seed", "2"],
            ["--seed", "0"],
            ["--set", "robots=3"],
            ["-o", "x"],
            ["--flavour", "chocolate"],
        ],
    )
    def test_what_it_began_with_cannot_change(self, mdesign, folder, option):
        code, _, err = mdesign("race", "--resume", folder, *option)
        assert code == 2
        assert "cannot be given with --resume" in err

    @pytest.mark.parametrize(
        ("file", "old", "new", "words"),
        [
            ("mission.yaml", "robots: 2", "robots: 3", "mission_digest: raced with"),
            ("robot_model.yaml", "mass: ", "mass: 1", "robot_model_digest: raced with"),
            ("provenance.json", '"kernels": "', '"kernels": "0', "kernels: raced with 0"),
            ("provenance.json", '"options": {', '"options": {"nu": 1,', "found nothing in mercator_design"),
            ("provenance.json", '"options": {', '"options": {"means_scale": false,', "means_scale: raced with False"),
            (
                "provenance.json",
                '"seed": 1',
                '"seed": 2',
                "expected journal.jsonl to be of the race in provenance.json",
            ),
            ("provenance.json", '"race"', '"rice"', "rice: unknown key; did you mean 'race'?"),
            ("provenance.json", "{", "[" * 100_000, "expected JSON, found something else"),
            (
                "provenance.json",
                '"plugins": {',
                '"plugins": {"../mine.py": "1"',
                "expected plugins by the names of files",
            ),
        ],
    )
    def test_another_race_is_refused(self, mdesign, folder, file, old, new, words):
        text = (folder / file).read_text()
        assert old in text
        (folder / file).write_text(text.replace(old, new, 1))
        code, _, err = mdesign("race", "--resume", folder)
        assert code == 1
        assert words in err
        assert str(folder) in err

    @pytest.mark.parametrize("missing", ["provenance.json", JOURNAL])
    def test_no_race(self, mdesign, folder, missing):
        (folder / missing).unlink()
        code, _, err = mdesign("race", "--resume", folder)
        assert code == 1
        assert str(folder) in err
        assert mdesign("race", "--resume", folder / "nowhere")[0] == 1

    def test_a_torn_journal_is_reported(self, mdesign, folder, undisturbed):
        with (folder / JOURNAL).open("ab") as file:
            file.write(b'{"event":"exper')
        code, _, err = mdesign("race", "--resume", folder)
        assert code == 0
        assert f"Note: {folder / JOURNAL}, line" in err
        assert "the rest was cut off" in err
        assert digest(folder) == digest(undisturbed)

    def test_a_damaged_journal_is_refused(self, mdesign, folder):
        data = (folder / JOURNAL).read_bytes()
        (folder / JOURNAL).write_bytes(data.replace(b'"instance":1,', b'"instance":2,', 1))
        code, _, err = mdesign("race", "--resume", folder)
        assert code == 1
        assert "expected the checksum" in err

    def test_one_process_at_a_time(self, mdesign, folder):
        with Journal(folder / JOURNAL, new=False) as journal:
            journal.open_session()
            code, _, err = mdesign("race", "--resume", folder)
        assert code == 1
        assert f"process {os.getpid()} on" in err
        assert "is running this race" in err

    @pytest.mark.usefixtures("registries")
    def test_plugins_are_in_the_folder(self, mdesign, tmp_path):
        forget = plugins.snapshot()  # as another process knows nothing of the plugin
        plugin = tmp_path / "nervous.py"
        plugin.write_text(FAILING)
        options = ["--plugin", plugin, "--set", "objective={name: nervous, least: -9, direction: maximise}", *QUICK]
        assert mdesign("race", "aggregation", "--budget", 60, *options, "-o", tmp_path / "r")[0] == 0
        forget()
        plugin.unlink()
        expected = digest(tmp_path / "r")
        stop(tmp_path / "r", 20)
        code, _, err = mdesign("race", "--resume", tmp_path / "r")
        assert (code, warnings(err)) == (0, [])
        assert digest(tmp_path / "r") == expected


class TestTests:
    """Of the winner and others, on instances that the race never sees."""

    def test_a_race_with_tests(self, mdesign, tmp_path, undisturbed):
        folder = tmp_path / "r"
        code, out, err = mdesign(*RACE, "-o", folder, "--test-runs", 12, "--test-elites", 3, "--test-iterations")
        assert (code, warnings(err)) == (0, [])
        assert digest(folder) == digest(undisturbed)
        evaluated = json.loads(mdesign("evaluate", folder / "fsm.txt", "-n", 12, "--json")[1])
        tests, winner = tables.tests_table(folder), read(folder / JOURNAL).record.ends[-1].winner
        assert list(tests[tests.configuration == winner].score) == evaluated["scores"]
        assert f"configuration {winner}" in out.partition("Tested")[2]
        low, high = evaluated["confidence_interval"]
        score = f"{evaluated['mean']:.4g} of at most 2 on 12 fresh instances ({low:.4g} to {high:.4g} at 95%)"
        assert f"configuration {winner}: score {score}\n" in out
        assert f"on the same instances: mdesign evaluate {folder / 'fsm.txt'} -n 12\n" in out
        results = pd.read_csv(folder / "results.csv", index_col="configuration")
        assert len(results[results.tests == 12]) == len(set(tests.configuration)) >= 3
        assert (results.test_low[winner], results.test_high[winner]) == pytest.approx((low, high))
        lines = [re.split(" {2,}", line) for line in re.findall(r"^ {11}(configuration .*mean.*)$", out, re.MULTILINE)]
        assert (lines[0][0], lines[0][2].partition(" (")[0]) == (
            f"configuration {winner}",
            f"mean {evaluated['mean']:.4g}",
        )
        roles = [role for _, role, _ in lines]
        assert roles[:3] == ["winner", "elite 2", "elite 3"]
        assert len(roles) == len(set(tests.configuration)) == len(set(roles))
        assert all(re.fullmatch(r"(best|elite [23]) of iteration \d+", role) for role in roles[3:])
        tested = out.partition(":\n           configuration")[2].partition("\n           state")[0]
        assert tested in mdesign("runs", "show", folder)[1]
        assert mdesign("runs", "show", folder, "--csv", "tests")[1] == tests.to_csv(index=False)
        out = mdesign("runs", "verify", folder, "-n", 1000)[1]
        assert f"{120 + len(tests)} of 120 experiments and {len(tests)} tests were run again" in out
        assert "the digest, of all 120 experiments, is " in out

    def test_they_are_resumed_as_the_race_is(self, mdesign, tmp_path, undisturbed):
        whole, folder = tmp_path / "whole", tmp_path / "r"
        assert mdesign(*RACE, "-o", whole, "--test-runs", 9, "--test-elites", 2)[0] == 0
        lines = (whole / JOURNAL).read_bytes().splitlines(keepends=True)
        for n in (2, 60, len(lines) - 5):
            shutil.copytree(whole, folder)
            (folder / JOURNAL).write_bytes(b"".join(lines[:n]))
            (folder / "fsm.txt").unlink()
            assert mdesign("race", "--resume", folder)[0] == 0
            for name in ("fsm.txt", "results.csv"):
                assert (folder / name).read_bytes() == (whole / name).read_bytes()
            shutil.rmtree(folder)

    def test_after_the_race(self, mdesign, folder, undisturbed):
        assert "Tested" not in mdesign("race", "--resume", folder)[1]
        assert "on 5 fresh instances (" in mdesign("race", "--resume", folder, "--test-runs", 5)[1]
        out = mdesign("race", "--resume", folder, "--test-elites", 2)[1]
        assert re.findall(r"^ {11}configuration \d+ +(\w+(?: \d)?)", out, re.MULTILINE) == ["winner", "elite 2"]
        assert "Tested     on 5 fresh instances, beyond the budget:" in out
        assert digest(folder) == digest(undisturbed)
        out = mdesign("race", "--resume", folder, "--test-runs", 0)[1]
        assert "Tested" not in out
        assert "on 5 fresh instances (" in out  # what is known stays

    def test_thirty_by_default(self, mdesign, tmp_path):
        quick = [word for word in RACE if word not in ("--test-runs", "0")]
        out = mdesign(*quick, "-o", tmp_path / "r")[1]
        assert "on 30 fresh instances (" in out
        assert len(tables.tests_table(tmp_path / "r")) == 30

    def test_options_that_need_another(self, mdesign, folder):
        code, _, err = mdesign("race", "--resume", folder, "--test-elites", 2)
        assert code == 2
        assert "need --test-runs N" in err


@pytest.mark.thorough
def test_optuna_shows_the_race(mdesign, folder, undisturbed, tmp_path):
    stop(folder, 70)
    url = f"sqlite:///{tmp_path / 'race.db'}"
    code, _, err = mdesign("race", "--resume", folder, "--optuna", url)
    assert (code, warnings(err)) == (0, [])
    with connections_closed():
        [study] = optuna.get_all_study_names(url)
        best = optuna.load_study(study_name=study, storage=url).best_trial
    assert study.startswith("aggregation, seed 1, budget 120, ")
    record = read(undisturbed / JOURNAL).record
    assert best.user_attrs["configuration"] == record.ends[-1].winner
    assert best.params == record.configurations[record.ends[-1].winner]
    stop(folder, 70)
    code, _, err = mdesign("race", "--resume", folder, "--optuna", "sqlite:////nowhere/race.db")
    assert code == 0
    assert "Warning: the race is no longer copied to the Optuna storage" in err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--executor", "dask"], "go together"),
        (["--scheduler", "tcp://nowhere:1"], "go together"),
        (["--timeout", "3"], "--timeout needs --executor processes"),
        (["--timeout", "0"], "timeout"),
        (["--executor", "fairies"], "fairies"),
        (["--stop-when-stagnant", "--method", "irace"], "--stop-when-stagnant needs --method halving"),
    ],
)
def test_options_that_do_not_go_together(mdesign, tmp_path, options, words):
    code, _, err = mdesign(*RACE, "-o", tmp_path / "r", *options)
    assert code == 2
    assert words in err
    assert not (tmp_path / "r").exists()


class TestProgress:
    @pytest.fixture
    def shown(self, monkeypatch, capsys):
        """What a terminal of some width shows at last of a race that is where it is said to be."""

        def shown(columns, iteration, iterations, told=""):
            monkeypatch.setenv("FORCE_COLOR", "1")  # as if stderr were a terminal
            monkeypatch.setenv("COLUMNS", str(columns))
            best = Elite(configuration=31, mean=-2.8, sd=0.414, n_results=15)
            plan = Progress(iteration=1, iterations=9, alive=17, used=0, budget=5000, best=best)
            task = SimpleNamespace(name="aggregation", score=lambda cost: -cost, cost=lambda score: -score)
            done = ExperimentDone(experiment=1, iteration=1, configuration=1, instance=1, seed=1, score=2.8)
            view, now = RaceView(5000), 0.0
            view.live = lambda: replace(plan, iteration=iteration, iterations=iterations)
            with RaceDisplay(task, view, None, plan=plan, clock=lambda: now) as display:
                for number in range(4240):
                    if number == 4239:
                        now = 9.0  # what comes at once after something that was shown is not
                    view.note(done)
                    display.note(done)
                if told:
                    print_message(told)
            err = re.sub(r"\x1b\[[\d?;]*[a-zA-Z]", "", capsys.readouterr().err)
            return [line for line in re.split("[\r\n]+", err) if line.strip()]

        return shown

    @pytest.mark.parametrize(
        ("columns", "text"),
        [
            (60, "aggregation: iteration 8/9, "),
            (80, "aggregation: iteration 8/9, 17 alive, best 2.8"),
            (140, "aggregation: iteration 8/9, 17 alive, best 2.8 in the race (15 runs, sd 0.414)"),
        ],
    )
    def test_figures_are_whole_in_any_terminal(self, shown, columns, text):
        line = shown(columns, 8, 9)[-1]
        assert len(line) <= columns
        assert line.startswith(text)
        assert re.fullmatch(r"([\w ]*…)? +([━╸╺]{10} )?4240/5000 \d+/s [-\d]:[-\d]{2}:[-\d]{2}", line[len(text) :])
        assert ("━" in line) == (columns > 100)

    @pytest.mark.parametrize(
        ("iteration", "iterations", "words"),
        [(9, 9, "iteration 9/9,"), (10, 10, "iteration 10,"), (10, 12, "iteration 10/12,"), (11, 10, "final race,")],
    )
    def test_iterations_beyond_the_plan(self, shown, iteration, iterations, words):
        assert words in shown(80, iteration, iterations)[-1]

    def test_an_ablation_that_cannot_be_shows_nothing(self, mdesign, folder, monkeypatch):
        monkeypatch.setenv("FORCE_COLOR", "1")
        assert "\x1b" not in mdesign("runs", "ablation", folder, "--from", 99999)[2]

    def test_what_is_reported_has_a_line_of_its_own(self, shown):
        assert "Note: of something" in shown(80, 8, 9, "Note: of something")


class TestSignals:
    @pytest.mark.usefixtures("registries")
    @pytest.mark.parametrize(
        ("number", "code", "word"),
        [
            (signal.SIGINT, 130, "Interrupted."),
            (signal.SIGTERM, 75, "Terminated."),
            (signal.SIGHUP, 75, "Terminated."),
        ],
    )
    def test_a_signal_stops_cleanly(self, mdesign, tmp_path, number, code, word):
        """One that comes while its third experiment runs, or its fourth."""
        folder, plugin = tmp_path / "r", tmp_path / "plugin.py"
        plugin.write_text(SIGNALLING.format(process="os.getpid()", number=int(number)))
        options = ["--plugin", plugin, "--set", "objective={name: signalling, direction: maximise}"]
        found, out, err = mdesign(*RACE, *options, "-o", folder)
        assert (found, out) == (code, "")
        assert err.splitlines()[-1] == word
        assert f"to resume: mdesign race --resume {folder}" in err
        assert "Stopping when the running experiments have ended" in err
        assert "Traceback" not in err
        assert not (folder / "fsm.txt").exists()
        reading = read(folder / JOURNAL)
        assert reading.record.experiments
        assert reading.torn == ""
        assert isinstance(reading.record.sessions[-1], SessionStopped)
        assert "stopped" in mdesign("runs", "show", folder)[1]

    @pytest.mark.timing
    @pytest.mark.usefixtures("registries")
    def test_a_scheduler_is_killed(self, mdesign, tmp_path):
        """No experiment has failed by that, whatever failures do: the race ends, and can be resumed."""
        pytest.importorskip("distributed")
        file, folder, whole, plugin = (tmp_path / name for name in ("scheduler.json", "r", "whole", "plugin.py"))
        options = ["--plugin", plugin, "--set", "objective={name: signalling, direction: maximise}"]
        dask = ["--executor", "dask", "--scheduler", file, "--on-failure", "reject"]
        with dask_started(file) as scheduler:
            plugin.write_text(SIGNALLING.format(process=scheduler.pid, number=int(signal.SIGKILL)))
            code, out, err = mdesign(*RACE, *options, *dask, "-o", folder)
        assert (code, out) == (75, "")
        told, last = err.splitlines()[-2:]
        assert told.endswith(
            f"to resume: mdesign race --resume {folder} --jobs 2 --executor dask --scheduler {file} --on-failure reject"
        )
        assert last.startswith(f"Error: {file}: lost the Dask cluster")
        assert not any(one.failure for one in read(folder / JOURNAL).record.experiments.values())
        assert mdesign("race", "--resume", folder)[0] == 0
        assert mdesign(*RACE, *options, "-o", whole)[0] == 0
        assert digest(folder) == digest(whole)

    @pytest.mark.timing
    @pytest.mark.usefixtures("plain_python")
    @pytest.mark.parametrize("executor", ["processes", "concurrent.futures:ProcessPoolExecutor"])
    def test_a_job_is_stopped_whose_stderr_is_closed(self, tmp_path, executor):
        """All its processes get the signal, as of a scheduler, and none is left."""
        folder = tmp_path / "r"
        long = ["race", "aggregation", "--budget", "10000", "--set", "robots=2", "--set", "duration=3"]
        command = [*MDESIGN, *long, "--executor", executor, "-j", "1", "-o", folder]
        closed = ["/bin/sh", "-c", 'exec "$@" 2>&-', "sh"]
        with started(*closed, *command, stdout=subprocess.PIPE, start_new_session=True) as process:
            try:
                wait_for_an_experiment(folder)
                os.killpg(process.pid, signal.SIGTERM)
                assert process.communicate(timeout=LIMIT) == ("", None)  # which a worker would hold open
            except BaseException:
                os.killpg(process.pid, signal.SIGKILL)
                raise
        assert process.returncode == 75
        last = read(folder / JOURNAL).record.sessions[-1]
        assert (type(last), last.why) == (SessionStopped, "Signalled")

    @pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
    def test_before_its_first_experiment(self, mdesign, tmp_path, number):
        plugin = tmp_path / "plugin.py"
        plugin.write_text(f"import os\nos.kill(os.getpid(), {int(number)})\n")
        assert mdesign(*RACE, "--plugin", plugin, "-o", tmp_path / "r") == (75, "", "Terminated.\n")

    def test_nohup(self, mdesign, tmp_path):
        """It goes on, and finds fault with the plugin."""
        plugin = tmp_path / "plugin.py"
        plugin.write_text("import os, signal\nos.kill(os.getpid(), signal.SIGHUP)\nno_such_name\n")
        usual = signal.signal(signal.SIGHUP, signal.SIG_IGN)
        try:
            code, _, err = mdesign(*RACE, "--plugin", plugin, "-o", tmp_path / "r")
        finally:
            signal.signal(signal.SIGHUP, usual)
        assert code == 3
        assert "no_such_name" in err

    @pytest.mark.timing
    def test_killed(self, mdesign, tmp_path, undisturbed):
        folder = tmp_path / "r"
        command = ["env", "NUMBA_DISABLE_JIT=1", *MDESIGN, *RACE, "-o", folder]  # so that it begins soon
        with started(*command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
            wait_for_an_experiment(folder)
            process.kill()
            process.wait(timeout=LIMIT)
        assert process.returncode in {-signal.SIGKILL, 0}
        assert mdesign("race", "--resume", folder)[0] == 0
        assert digest(folder) == digest(undisturbed)

    @takes_long
    @pytest.mark.timing
    def test_killed_at_random_times(self, tmp_path):
        """At any time from its first byte on; each race is killed ten times before it may end."""
        draws = random.Random(1)
        for seed in (1, 2, 3):
            race = ["race", "aggregation", "--budget", "1000", *QUICK, "--seed", str(seed)]
            subprocess.run([*MDESIGN, *race, "-o", str(tmp_path / f"whole-{seed}")], check=True, capture_output=True)
            for k in range(3):
                folder = tmp_path / f"{seed}-{k}"
                command = [*race, "-o", str(folder)]
                for _ in range(10):
                    with started(*MDESIGN, *command, stdout=subprocess.DEVNULL) as process:
                        while process.poll() is None and not (folder / "provenance.json").exists():
                            time.sleep(0.01)
                        time.sleep(draws.uniform(0, 4))
                    command = ["race", "--resume", str(folder)]
                subprocess.run([*MDESIGN, *command], check=True, capture_output=True)
                assert digest(folder) == digest(tmp_path / f"whole-{seed}")
                assert (folder / "fsm.txt").read_bytes() == (tmp_path / f"whole-{seed}" / "fsm.txt").read_bytes()


@pytest.mark.usefixtures("registries")
class TestFailures:
    @pytest.fixture
    def nervous(self, tmp_path):
        (tmp_path / "nervous.py").write_text(FAILING)
        objective = "objective={name: nervous, least: -0.9, direction: maximise}"
        return ["race", "aggregation", "--budget", 120, "--plugin", tmp_path / "nervous.py", "--set", objective,
                "--set", "robots=1", "--set", "duration=5", "-o", tmp_path / "r"]  # fmt: skip

    def test_one_stops_the_race_with_the_command_that_shows_it(self, mdesign, nervous, tmp_path):
        code, out, err = mdesign(*nervous)
        assert (code, out) == (3, "")
        assert re.search(
            r"failed: MissionError: \S+nervous.py:\d+: objective nervous: ArithmeticError: too far to the", err
        )
        command = next(
            line for line in err.splitlines() if line.startswith("To run only the failed experiment: mdesign ")
        )
        code, out, err = mdesign(*command.partition("mdesign ")[2].split(" "))
        assert (code, out) == (3, "")
        assert "too far to the left" in err
        code, out, _ = mdesign("race", "--resume", tmp_path / "r", "--on-failure", "reject")
        assert code == 0
        assert "Failed     " in out

    @pytest.mark.swept
    @pytest.mark.parametrize(("executor", "jobs"), some([("threads", 2), ("processes", 1)], 1))
    def test_or_rejects_its_configuration(self, mdesign, nervous, tmp_path, executor, jobs):
        code, out, err = mdesign(*nervous, "--on-failure", "reject", "--executor", executor, "-j", jobs)
        assert code == 0
        assert "Warning: configuration " in err
        table = experiments_table(tmp_path / "r")
        failed = table[table.failure != ""]
        assert len(failed)
        assert failed.score.isna().all()
        assert f"Failed     {len(failed)} experiments; their configurations were rejected" in out
        assert "rejected" in mdesign("runs", "show", tmp_path / "r")[1]
        winner = int((tmp_path / "r" / "results.csv").read_text().splitlines()[1].split(",")[0])
        assert winner not in set(failed.configuration)


@pytest.mark.usefixtures("registries")
class TestLeaving:
    """An objective that would end the program is a failed experiment, whatever runs it."""

    @pytest.fixture
    def leaving(self, tmp_path):
        """Options with which some experiments leave; the one cycle by which a race is rehearsed does so if asked."""

        def options(how, least, also=False):
            text = FAILING.replace('raise ArithmeticError("too far to the left")', f"raise {how}")
            (tmp_path / "leaving.py").write_text(text.replace("if x", f"if ({also} or len(trace.poses) > 2) and x"))
            objective = f"objective={{name: nervous, least: {least}, direction: maximise}}"
            return ["--plugin", tmp_path / "leaving.py", "--set", objective, "--set", "robots=2", "--set", "duration=5"]

        return options

    @pytest.mark.swept
    @pytest.mark.parametrize("executor", some([("threads", 1), ("threads", 2), ("processes", 1)], 2))
    @pytest.mark.usefixtures("plain_python")
    def test_it_stops_the_race(self, mdesign, leaving, tmp_path, executor):
        name, jobs = executor
        race = ["race", "aggregation", "--budget", 60, *leaving("SystemExit(0)", -0.9), "-o", tmp_path / "r"]
        code, out, err = mdesign(*race, "--executor", name, "-j", jobs)
        assert (code, out) == (3, "")
        assert re.search(r"failed: MissionError: \S+leaving.py:8: objective nervous: SystemExit: 0", err)

    @pytest.mark.parametrize("jobs", [1, 2])
    def test_or_rejects_its_configuration_and_is_a_test_that_failed(self, mdesign, leaving, tmp_path, jobs):
        race = ["race", "aggregation", "--budget", 60, *leaving("KeyboardInterrupt", -0.9), "-o", tmp_path / "r"]
        code, _, err = mdesign(*race, "-j", jobs, "--on-failure", "reject", "--test-runs", 20, "--test-elites", 3)
        assert code == 0, err
        assert (tmp_path / "r" / "fsm.txt").exists()
        failed = f"MissionError: {tmp_path}/leaving.py:8: objective nervous: KeyboardInterrupt"
        assert set(experiments_table(tmp_path / "r").failure) == {"", failed}
        assert set(tables.tests_table(tmp_path / "r").failure) <= {"", failed}

    def test_in_evaluate_and_record(self, mdesign, leaving, tmp_path):
        (tmp_path / "fsm.txt").write_text("--nstates 1 --s0 0 --rwm0 5\n")
        evaluate = ["evaluate", tmp_path / "fsm.txt", "--mission", "aggregation", "-n", 20, "-j"]
        record = ["record", tmp_path / "fsm.txt", "--mission", "aggregation", "-o", tmp_path / "t.csv", "--seed"]
        options = leaving("SystemExit(0)", 0.0)
        for jobs in (1, 2):
            code, out, err = mdesign(*evaluate, jobs, *options)
            assert (code, out) == (3, "")
            assert err.endswith("leaving.py:8: objective nervous: SystemExit: 0\n")
        assert {mdesign(*record, seed, *options)[0] for seed in range(1, 7)} == {0, 3}  # halves of the arena

    @pytest.mark.parametrize("least", [0.0, 9.0])
    def test_one_that_raises_what_ctrl_c_does(self, mdesign, leaving, tmp_path, least):
        """In some experiments, or in all and in what is tried before."""
        (tmp_path / "fsm.txt").write_text("--nstates 1 --s0 0 --rwm0 5\n")
        evaluate = ["evaluate", tmp_path / "fsm.txt", "--mission", "aggregation", "-n", 20, "-j"]
        options = leaving("KeyboardInterrupt", least, also=least == 9)
        for jobs in (1, 2):
            code, out, err = mdesign(*evaluate, jobs, *options)
            assert (code, out) == (3, "")
            assert err.splitlines()[-1] == f"Error: {tmp_path}/leaving.py:8: objective nervous: KeyboardInterrupt"
        record = ["record", tmp_path / "fsm.txt", "--mission", "aggregation", "-o", tmp_path / "t.csv", "--seed"]
        assert {mdesign(*record, seed, *options)[0] for seed in range(1, 7)} == ({3} if least == 9 else {0, 3})

    @pytest.mark.parametrize(
        ("number", "code", "word"), [(signal.SIGINT, 130, "Interrupted."), (signal.SIGTERM, 75, "Terminated.")]
    )
    def test_ctrl_c_while_an_objective_works(self, mdesign, leaving, tmp_path, number, code, word):
        """In the main thread, whatever the objective makes of it."""
        options = leaving(f"ValueError(__import__('os').kill(__import__('os').getpid(), {int(number)}))", 9, also=True)
        found, _, err = mdesign("race", "aggregation", "--budget", 60, *options, "-o", tmp_path / "r")
        assert (found, err.splitlines()[-1]) == (code, word)

    def test_a_plugin_that_raises_it_when_it_is_loaded(self, mdesign, tmp_path):
        (tmp_path / "p.py").write_text("raise KeyboardInterrupt\n")
        code, out, err = mdesign("validate", "aggregation", "--plugin", tmp_path / "p.py")
        assert (code, out) == (3, "")
        assert err == f"Error: {tmp_path}/p.py:1: a plugin that cannot be run: KeyboardInterrupt\n"


class TestRuns:
    def test_list(self, mdesign, folder, tmp_path):
        stop(shutil.copytree(folder, tmp_path / "s"), 30)
        shutil.copytree(folder, tmp_path / "t")
        (tmp_path / "t" / JOURNAL).write_bytes(b"x\n" + (folder / JOURNAL).read_bytes())
        code, out, err = mdesign("runs", "list", tmp_path)
        assert (code, err.count("\n"), f"Warning: {tmp_path / 't' / JOURNAL}, line 1: " in err) == (0, 1, True)
        assert {line.split()[0]: line.split()[1:8] for line in out.splitlines()[1:]} == {
            str(folder): ["aggregation", "watermelon", "irace", "1", "120", "120", "finished"],
            str(tmp_path / "s"): ["aggregation", "watermelon", "irace", "1", "31", "120", "stopped"],
            str(tmp_path / "t"): ["damaged"],
        }
        with Journal(folder / JOURNAL, new=False):
            states = {run["run"]: run["state"] for run in json.loads(mdesign("runs", "list", tmp_path, "--json")[1])}
            assert states[str(folder)] == "running"
        session = read(folder / JOURNAL).record.sessions[0]
        assert next(line.split()[8] for line in out.splitlines() if line.startswith(f"{folder} ")) == session.time
        assert mdesign("runs", "list", tmp_path / "nowhere")[0] == 1

    def test_one_that_had_ended_and_lost_its_end(self, mdesign, folder, undisturbed):
        """As its provenance says."""
        lines = (folder / JOURNAL).read_bytes().splitlines(keepends=True)
        (folder / JOURNAL).write_bytes(b"".join(lines[:-1]))
        missing = (
            f"{folder / JOURNAL}: expected the end of the race after 120 experiments, as provenance.json says, found"
        )
        code, out, err = mdesign("runs", "list", folder.parent)
        assert (code, out.count("end missing"), err.count("\n")) == (0, 1, 1)
        assert f"Warning: {missing} none after 120" in err
        (run,) = json.loads(mdesign("runs", "list", folder.parent, "--json")[1])
        assert (run["state"], len(run["notes"])) == ("end missing", 1)
        assert run["notes"][0].startswith(missing)
        said = " ".join(mdesign("runs", "show", folder)[1].split())
        assert "State end missing" in said
        assert mdesign("runs", "verify", folder)[0] == 1
        assert mdesign("race", "--resume", folder)[0] == 0
        assert "finished" in mdesign("runs", "list", folder.parent)[1]
        assert digest(folder) == digest(undisturbed)
        provenance = json.loads((folder / "provenance.json").read_text())
        (folder / "provenance.json").write_text(json.dumps({**provenance, "journal": f"0{digest(folder)}"}))
        said = " ".join(mdesign("runs", "show", folder)[1].split())
        assert "State damaged" in said
        assert f"expected the digest 0{digest(folder)[:63]}, as provenance.json says, found {digest(folder)}" in said

    @pytest.mark.parametrize(
        ("change", "words"),
        [
            (lambda start: start.pop("name"), "start: expected the start of a race as mercator_design"),
            (
                lambda start: start.update(format=1),
                "start.format: expected 2, found 1: use the version of this program",
            ),
        ],
    )
    def test_the_race_of_another_version(self, mdesign, folder, tmp_path, change, words):
        """It is told, without advice on damage, and the others are listed."""
        old = shutil.copytree(folder, tmp_path / "old")
        events = events_in((old / JOURNAL).read_bytes())
        change(events[0])
        del events[-1]  # the end, whose digest is of the start, too
        (old / JOURNAL).write_bytes(journal_of(events))
        code, out, err = mdesign("runs", "list", tmp_path)
        assert (code, err, out.count("\n"), out.count("of another version\n")) == (0, "", 3, 1)
        for options in (["show", old], ["show", old, "--csv", "experiments"], ["verify", old], ["importance", old]):
            code, _, err = mdesign("runs", *options)
            assert code == 1
            assert f"{old / JOURNAL}, line 1: {words}" in err
            assert "damaged" not in err

    def test_a_race_of_a_method_that_is_gone(self, mdesign, folder, tmp_path):
        """A finished one, as another version left it: both files say the method, and the digest is of it, too."""
        old = shutil.copytree(folder, tmp_path / "old")
        *events, end = events_in((old / JOURNAL).read_bytes())
        events[0] |= {"method": "surrogate", "mercator_design": "0.1.0"}
        (old / JOURNAL).write_bytes(journal_of(events))
        ended = RaceEnded(**{key: end[key] for key in ("budget", "experiments", "winner")})
        end["digest"] = read(old / JOURNAL).record.with_digest(ended).digest
        (old / JOURNAL).write_bytes(journal_of([*events, end]))
        provenance = json.loads((old / "provenance.json").read_text())
        provenance["race"] |= {"method": "surrogate", "mercator_design": "0.1.0"}
        (old / "provenance.json").write_text(json.dumps(provenance))
        code, out, err = mdesign("runs", "list", tmp_path)
        assert (code, err, out.count("of another version\n")) == (0, "", 1)
        listed = json.loads(mdesign("runs", "list", tmp_path, "--json")[1])
        assert [run["state"] for run in listed].count("of another version") == 1
        before = {file: file.read_bytes() for file in old.iterdir()}
        for command in (
            ["race", "--resume", old],
            ["race", "--resume", old, "--budget", 500],
            ["runs", "show", old],
            ["runs", "show", old, "--csv", "experiments"],
            ["runs", "verify", old],
            ["runs", "importance", old],
            ["runs", "ablation", old],
        ):
            code, out, err = mdesign(*command)
            assert (code, out) == (1, "")
            assert err.removeprefix("Finding what explains the scores ...\n").startswith(f"Error: {old}/")
            words = (
                "method: expected halving, irace, random, tpe, cma-es, evostick, found surrogate, a method of another "
                "version: mercator_design 0.1.0 can read it"
            )
            assert words in err
        assert {file: file.read_bytes() for file in old.iterdir()} == before

    def test_without_a_verb_those_here_are_listed(self, mdesign, folder, tmp_path, monkeypatch):
        shutil.copytree(folder, tmp_path / "here" / "runs" / "r")
        monkeypatch.chdir(tmp_path / "here")
        assert mdesign("runs") == mdesign("runs", "list")
        assert "runs/r" in mdesign("runs")[1]

    def test_show(self, mdesign, folder):
        code, out, _ = mdesign("runs", "show", folder)
        assert code == 0
        assert digest(folder) in out
        assert (folder / "fsm.txt").read_text().splitlines()[-1] in out
        assert "State      finished" in out
        table = out.partition("iteration  budget")[2].splitlines()
        assert table[1].split()[:3] == ["1", "120", "108"]
        assert table[2].split()[0] == "2"
        assert mdesign("runs", "show", folder / "nowhere")[0] == 1

    def test_tables(self, mdesign, folder):
        experiments = experiments_table(folder)
        assert list(experiments.experiment) == list(range(120))
        assert mdesign("runs", "show", folder, "--csv", "experiments")[1] == experiments.to_csv(index=False)
        configurations = configurations_table(folder)
        assert configurations.experiments.sum() == 120
        row = configurations.iloc[3]
        own = experiments[experiments.configuration == configurations.index[3]].score
        assert row["mean"] == pytest.approx(own.mean())
        assert mdesign("runs", "show", folder, "--csv", "configurations")[1] == configurations.to_csv()

    def test_verify(self, mdesign, folder):
        code, out, _ = mdesign("runs", "verify", folder, "-n", 10)
        assert code == 0
        assert "10 of 120 experiments were run again, with the same results" in out
        assert digest(folder)[:16] in out

    @pytest.mark.parametrize("key", ["score", "outcome"])
    def test_verify_finds_what_was_changed(self, mdesign, folder, key):
        """By someone who knows how to make checksums."""
        record = read(folder / JOURNAL).record
        events = events_in((folder / JOURNAL).read_bytes())
        for event in events:
            if event["event"] == "experiment" and event["experiment"] == 60:
                event[key] = 7.5 if key == "score" else "0" * 16
        (folder / JOURNAL).write_bytes(journal_of(events))
        code, out, err = mdesign("runs", "verify", folder, "-n", 120)
        assert (code, out) == (1, "")
        assert f"digest of the first 120 experiments: expected {record.digest()}" in err
        events[-1]["digest"] = re.search(r"found ([0-9a-f]{64})", err)[1]
        (folder / JOURNAL).write_bytes(journal_of(events))
        code, out, err = mdesign("runs", "verify", folder, "-n", 120)
        assert (code, out) == (1, "")
        assert f"expected the digest {record.digest()}, as provenance.json says, found {events[-1]['digest']}" in err
        provenance = (folder / "provenance.json").read_text().replace(record.digest(), events[-1]["digest"])
        (folder / "provenance.json").write_text(provenance)
        code, out, err = mdesign("runs", "verify", folder, "-n", 120)
        assert (code, out) == (1, "")
        assert "experiment 60: expected" in err

    def test_verify_another_winner(self, mdesign, folder):
        (folder / "fsm.txt").write_text("--nstates 1 --s0 0 --rwm0 7\n")
        code, _, err = mdesign("runs", "verify", folder)
        assert code == 1
        assert "fsm.txt: expected configuration" in err

    def test_tables_of_nothing(self, tmp_path):
        with pytest.raises(RaceError, match=r"not a run folder: provenance\.json is missing"):
            experiments_table(tmp_path)


def with_iterations(stagnant, *, budget, options):
    """The record of a race of an experiment in each iteration, which have been so many iterations without a gain."""
    record = Record()
    record.begin({"budget": budget, "options": options})
    for k, n in enumerate(stagnant):
        one = ExperimentDone(experiment=k, iteration=k + 1, configuration=k, instance=0, seed=k, score=float(k))
        record.note(ConfigurationAdded(configuration=k, parent=None, values={}))
        record.note(one)
        summary = IterationEnded(
            iteration=k + 1,
            postselection=False,
            budget=1,
            used=1,
            configurations=1,
            instances=1,
            alive=1,
            elites=(k,),
            stagnant=n,
            note="",
        )
        record.note(summary)
    return record


@pytest.mark.parametrize(
    ("stagnant", "stops", "text"),
    [
        ([], False, ""),
        ([0, 0, 1, 0], False, ""),
        ([0, 0, 1, 2], False, "none since iteration 2 of 4: 2 experiments"),
        ([0, 0, 1, 2], True, "none since iteration 2 of 4: 2 experiments"),
        ([0, 0, 1, 2, 3], False, "none since iteration 2 of 5: 3 experiments"),
        (
            [0, 0, 1, 2, 3],
            True,
            "none since iteration 2 of 5: 3 experiments; the race stopped there, which saved 2 of 7",
        ),
    ],
)
def test_the_last_gain(stagnant, stops, text):
    record = with_iterations(stagnant, budget=7, options={"stop_when_stagnant": True} if stops else {})
    if stagnant:
        record.note(record.with_digest(RaceEnded(budget=7, experiments=len(stagnant), winner=0)))
    assert last_gain(record) == text
    assert iteration_notes(record) == ([f"Gain       {text}"] if text else [])


def test_of_many_iterations_the_first_and_the_last_are_told():
    record = with_iterations([0] * 40, budget=40, options={})
    names = [line.split()[0] for line in iterations_table(record.view)[1:]]
    assert names == [*map(str, range(1, 11)), "...", *map(str, range(21, 41))]
    del record.view.incumbents[-1]
    assert len(iterations_table(record.view)) == 1 + 10 + 1 + 20


def test_notes_fit_a_terminal():
    table = "a" * 60
    page = f"{table}\nNote       iteration 2: no gain in 6 iterations, since iteration 3, says mdesign\n"
    assert with_notes_wrapped(page, None) == page
    assert with_notes_wrapped(page, 50) == (
        f"{table}\nNote       iteration 2: no gain in 6 iterations,\n           since iteration 3, says mdesign\n"
    )


def test_rounding_is_no_difference():
    third = 1 / 3
    scores = [0.1, 0.2, 0.7, 1.1]
    assert difference([one + third for one in scores], scores) == "+0.333 ± 0"
    assert difference([one + third - third for one in scores], scores) == "+0 ± 0"
    assert difference([1.0, 2.0], [1.0, 1.0]) == "+0.5 ± 6.4"
    assert difference([1.0], [2.0]) == ""


@pytest.fixture(scope="module")
def raced(tmp_path_factory, mdesign_once):
    """The folder of a race long enough to learn something from."""
    folder = tmp_path_factory.mktemp("analysis") / "r"
    shorter = ["--set", "duration=10"]
    mdesign_once("race", "aggregation", "--budget", 400, "--method", "irace", *shorter, "-o", folder)
    return folder


class TestAnalysis:
    def test_importance_of_modules(self, mdesign, raced):
        code, out, err = mdesign("runs", "importance", raced)
        assert (code, err) == (0, "Finding what explains the scores ...\n")
        assert "of the variance between new ones can be predicted" in out
        table = pd.read_csv(io.StringIO(mdesign("runs", "importance", raced, "--csv")[1]), index_col="name")
        leading = table.iloc[0]
        assert out.partition(" gain\n")[2].startswith(f"{leading.name} ")
        assert leading.share > 2 * leading.error
        assert {"stop", "exploration", "black floor"} <= set(table.index)

    @pytest.mark.thorough
    def test_importance_of_parameters(self, mdesign, raced, tmp_path):
        raced = shutil.copytree(raced, tmp_path / "r")
        stop(raced, 200)  # as its time grows with the cube of the configurations
        code, out, _ = mdesign("runs", "importance", raced, "--of", "parameters", "--csv")
        assert code == 0
        table = pd.read_csv(io.StringIO(out), index_col="name")
        assert {"NumStates", "S0"} <= set(table.index)
        assert (table.error >= 0).all()
        page = mdesign("runs", "importance", raced, "--of", "parameters")[1]
        rows = page.partition(" gain\n")[2].splitlines()
        assert [row.split()[0] for row in rows[:-1]] == list(table.index[:20])
        assert rows[-1] == f"and {len(table) - 20} more, of at most {table.share.iloc[20]:.1%}: --csv has all"
        assert "-0.0%" not in page
        called = {name: re.search(rf"^{name} .*  (\d+ \(.*?\))  ", page, re.MULTILINE) for name in table.index[:20]}
        numbers = flavour_of("watermelon").numbered("behaviour")
        for name in [name for name in called if re.fullmatch(r"S\d", name)]:
            number = int(table.favours[name])
            assert called[name][1] == f"{number} ({numbers[number].name})"
        assert any(name.startswith("S") for name in called)

    def test_importance_of_a_race_of_another_version(self, mdesign, raced, tmp_path):
        """Nothing is run, so it need not be run as it was; ablation is refused."""
        folder = shutil.copytree(raced, tmp_path / "r")
        stop(folder, 300)
        expected = mdesign("runs", "importance", folder)
        assert expected[0] == 0
        provenance = (folder / "provenance.json").read_text()
        (folder / "provenance.json").write_text(provenance.replace('"kernels": "', '"kernels": "0', 1))
        assert mdesign("runs", "importance", folder) == expected
        code, _, err = mdesign("runs", "ablation", folder)
        assert code == 1
        assert "kernels: raced with 0" in err

    def test_importance_of_a_race_that_has_hardly_begun(self, mdesign, folder):
        stop(folder, 10)
        code, _, err = mdesign("runs", "importance", folder)
        assert code == 1
        assert "expected at least 30 configurations that were raced, found 11" in err

    def test_ablation_of_the_winner(self, mdesign, raced, tmp_path, monkeypatch):
        code, out, _ = mdesign("runs", "ablation", raced, "-n", 5, "--plot", tmp_path / "a.svg")
        assert code == 0
        assert "0     the winner" in out
        first = (tmp_path / "a.svg").read_bytes()
        assert b"<svg" in first
        assert "against the step before  against the start  p" in out
        monkeypatch.setenv("COLUMNS", "80")
        monkeypatch.setattr("sys.stdout.isatty", lambda: True)
        narrow = mdesign("runs", "ablation", raced, "-n", 5, "--plot", tmp_path / "a.svg")[1]
        assert (tmp_path / "a.svg").read_bytes() == first
        assert "against the step before" not in narrow
        head = next(line for line in narrow.splitlines() if line.startswith("step "))
        assert head.endswith("  against the start  p")
        assert narrow.splitlines()[-1] == out.splitlines()[-1]
        code, csv, _ = mdesign("runs", "ablation", raced, "-n", 5, "--csv", "-j", 1)
        table = pd.read_csv(io.StringIO(csv))
        assert list(table.step) == list(range(len(table)))
        assert table.fsm.iloc[-1].startswith("--nstates 1 ")
        assert table.difference[1:].to_numpy() == pytest.approx((table["mean"] - table["mean"][0])[1:].to_numpy())
        (tmp_path / "0.txt").write_text(table.fsm[0] + "\n")
        scores = json.loads(
            mdesign("evaluate", tmp_path / "0.txt", "--mission", raced / "mission.yaml", "-n", 10, "--json")[1]
        )["scores"]
        assert table["mean"][0] == pytest.approx(sum(scores[5:]) / 5)  # the first 5 were for choosing

    @pytest.mark.parametrize(
        ("costs", "p", "last"), [((1.0, 1.0), 0.9, 1), ((0.0, 0.1), 0.01, 1), ((2.0, 2.1), 0.01, 0)]
    )
    def test_what_suffices_may_be_no_machine_of_the_grammar(self, costs, p, last):
        """A state that lost its transitions; and one that is better without something suffices, too."""
        whole = parse(
            "--nstates 2 --s0 1 --n0 1 --n0x0 0 --c0x0 5 --p0x0 0.1 --s1 2 --att1 2 --n1 1 --n1x0 0 --c1x0 5 --p1x0 0.1"
        )
        less = without(whole, frozenset({(1, 0)}))
        task = SimpleNamespace(name="aggregation", columns=Designer.columns, start=lambda: {"flavour": "watermelon"})
        task.score, task.possible_scores = (lambda cost: -cost), ANY_SCORE
        steps = (
            Step(change="", variant=0, costs=(1.0, 1.2), p_value=math.nan),
            Step(change="without transition 1 -> 0", variant=1, costs=costs, p_value=p),
        )
        configurations = tuple(from_pfsm(pfsm) for pfsm in (whole, less))
        ablation = Ablation(task=task, start="the winner", steps=steps, configurations=configurations, simplifies=True)
        *_, says, fsm = ablation_page(ablation).splitlines()
        assert says == f"The last step that is not significantly worse than the winner is step {last}:"
        assert fsm == to_text((whole, less)[last])
        table = pd.read_csv(io.StringIO(ablation_csv(ablation)))
        assert list(table.fsm) == [to_text(whole), to_text(less)]

    def test_ablation_from_another_configuration(self, mdesign, raced):
        record = read(raced / JOURNAL).record
        first = record.iterations[1].elites[0]
        for options in (["--from", 0], ["--from-first"]):
            code, out, _ = mdesign("runs", "ablation", raced, *options, "-n", 2, "--csv")
            assert code == 0
            table = pd.read_csv(io.StringIO(out))
            assert table.change[0] == f"configuration {0 if options[0] == '--from' else first}"
            winner = to_text(to_pfsm(record.configurations[record.ends[-1].winner], "watermelon"))
            assert table.fsm.iloc[-1] == winner

    @pytest.mark.parametrize(
        ("options", "code", "words"),
        [
            (["--from", 99999], 1, "expected a configuration that was raced, found 99999"),
            (["--from", 1, "--from-first"], 2, "exclude each other"),
            (["--plot", "a.gif"], 2, "ends in .png or .svg"),
        ],
    )
    def test_what_cannot_be_ablated(self, mdesign, raced, options, code, words):
        found, out, err = mdesign("runs", "ablation", raced, *options)
        assert (found, out) == (code, "")
        assert words in err

    def test_a_race_that_has_not_ended(self, mdesign, folder):
        stop(folder, 30)
        code, _, err = mdesign("runs", "ablation", folder)
        assert code == 1
        assert "expected a race that has ended" in err


def test_whatever_is_rejected_or_fails_is_reported_once(capsys):
    """An experiment, a score that an evaluator has replaced, and a test; not those of the journal before."""
    where = {"configuration": 3, "instance": 0, "score": None, "failure": "broken"}
    failed = [
        ExperimentDone(experiment=5, iteration=1, seed=1, outcome="", **where),
        ScoreRevised(experiment=6, **where),
        events.TestDone(seed=1, **where),
    ]
    kept = []
    record = SimpleNamespace(experiments={}, tests={}, revised={}, iterations={})
    folder = SimpleNamespace(
        journal=SimpleNamespace(record=record), keep_failed=lambda event: kept.append(event) or "command.txt"
    )
    messages = _Messages(folder)
    for event in failed:
        messages.note(event)
    assert capsys.readouterr().err.splitlines() == [
        "Warning: configuration 3 is rejected: broken; see command.txt",
        "Warning: configuration 3 is rejected: broken",
        "Warning: configuration 3: test 0 failed: broken; see command.txt",
    ]
    assert kept == [failed[0], failed[2]]
    record.experiments[5], record.revised[6], record.tests[3, 0] = failed[0], {(3, 0): failed[1]}, failed[2]
    messages = _Messages(folder)
    for event in failed:
        messages.note(event)
    assert capsys.readouterr().err == ""


def test_a_race_that_cannot_begin_leaves_no_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def start():
        raise RaceError("no start")

    for _ in range(2):
        with pytest.raises(RaceError, match="no start"):
            new_folder(None, SimpleNamespace(name="mine", start=start), request=None, testing=None)
        assert list((tmp_path / "runs").iterdir()) == []
