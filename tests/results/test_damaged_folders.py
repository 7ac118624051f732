"""Run folders that were damaged or written by strangers: clear errors, and nothing different after resume."""

import contextlib
import itertools
import json
import os
import random
import re
import shlex
import shutil
import signal
import sys
import time
from datetime import UTC, datetime
from pathlib import Path

import pytest

import mercator_design
from mercator_design.designer import Designer
from mercator_design.errors import MercatorError, RaceError
from mercator_design.missions.mission import load_mission
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.race.session import journal
from mercator_design.race.session.journal import Journal
from mercator_design.race.session.runner import RaceRun
from mercator_design.results import folder as run_folder
from mercator_design.results import tables
from mercator_design.results.analysis.importance import race_importance
from mercator_design.results.files import JOURNAL, read_journal, read_provenance, restored
from mercator_design.results.folder import RunFolder
from mercator_design.results.provenance import Request
from mercator_design.results.verification import verify
from mercator_design.show.text.runs import run_summary, runs_json, runs_table
from mercator_design.sim.simulate import Simulator
from tests.processes import LIMIT, started
from tests.race.damage import WRONG, damaged
from tests.race.lines import events_in, journal_of
from tests.tiers import cases, some

pytestmark = pytest.mark.together

MDESIGN = [sys.executable, "-c", "from mercator_design.cli import main; main()"]
RACE = ["race", "aggregation", "--budget", "60", "--method", "irace", "--set", "robots=2", "--set", "duration=3"]
RESULTS = ("fsm.txt", "results.csv", "mission.yaml", "robot_model.yaml")


@pytest.fixture(scope="module")
def whole(tmp_path_factory, mdesign_once):
    """The folder of a race that nothing stopped."""
    folder = tmp_path_factory.mktemp("runs") / "whole"
    mdesign_once(*RACE, "-o", folder, "--test-runs", 2)
    return folder


def resumed(path):
    """Run the race of a folder to its end; gives its digest and its tests."""
    with RunFolder.reopen(path) as folder, ThreadExecutor(1) as executor:
        result = RaceRun(folder.task, executor, folder.journal, testing=folder.testing).finish()
        folder.finish(result, seconds=1.0)
        return folder.journal.record.digest(), folder.journal.record.tests


def looks_at(path):
    """Whatever reads a run folder; each either does or raises a MercatorError. Gives what these say."""
    said = []

    def verified():
        with ThreadExecutor(1) as executor:
            verify(path, restored(path), 2, executor)

    for look in (
        lambda: runs_table(path.parent),
        lambda: json.loads(runs_json(path.parent)),
        lambda: run_summary(path),
        lambda: tables.experiments_table(path).to_csv(),
        lambda: tables.configurations_table(path).to_csv(),
        lambda: tables.tests_table(path).to_csv(),
        lambda: race_importance(path),
        verified,
    ):
        try:
            look()
        except MercatorError as error:
            said.append(str(error))
    return said


def damaged_provenance(text, draws):
    """JSON in which something is wrong, or bytes that are no JSON."""
    if draws.random() < 0.2:
        place = draws.randrange(len(text))
        return text[:place] + draws.choice(("", "\0", '"', "[" * 5000, "\x80")) + text[place + 1 :]
    data = json.loads(text)
    here = data
    while True:
        key = draws.choice([*here])
        if not isinstance(here[key], dict) or not here[key] or draws.random() < 0.4:
            break
        here = here[key]
    what = draws.choice(("wrong", "wrong", "wrong", "remove", "add"))
    if what == "remove":
        del here[key]
    elif what == "add":
        here["more"] = draws.choice(WRONG)
    else:
        here[key] = draws.choice(WRONG)
    return json.dumps(data)


def check(seeds, whole, tmp_path):
    expected = read_journal(whole).record
    data, provenance = (whole / JOURNAL).read_bytes(), (whole / "provenance.json").read_text()
    lines = data.splitlines(keepends=True)
    for seed in seeds:
        draws = random.Random(seed)
        folder = tmp_path / f"{seed}" / "r"
        shutil.copytree(whole, folder)
        part = data if draws.random() < 0.5 else b"".join(lines[: draws.randrange(2, len(lines))])
        done = "provenance"
        if draws.random() < 0.2:
            (folder / "provenance.json").write_text(damaged_provenance(provenance, draws))
        else:
            part, done = damaged(part, draws)
        (folder / JOURNAL).write_bytes(part)
        for name in ("fsm.txt", "results.csv"):
            (folder / name).unlink()
        looks_at(folder)
        try:
            digest, tests = resumed(folder)
        except MercatorError:
            pass
        else:
            assert digest == expected.digest(), (seed, done)
            assert tests == expected.tests or done == "provenance", (seed, done)  # which says what is tested
            for name in RESULTS:
                assert (folder / name).read_bytes() == (whole / name).read_bytes() or done == "provenance", (seed, done)
        shutil.rmtree(folder.parent)


@pytest.mark.swept
def test_damaged_journals(whole, tmp_path):
    check(some(cases(150), 8), whole, tmp_path)


class TestDamage:
    """One of each kind, with what is said."""

    @staticmethod
    def change(folder, change):
        """Change the events of a folder's journal, and give all valid checksums again."""
        events = events_in((folder / JOURNAL).read_bytes())
        change(events)
        (folder / JOURNAL).write_bytes(journal_of(events))

    @pytest.fixture
    def folder(self, whole, tmp_path):
        shutil.copytree(whole, tmp_path / "r")
        return tmp_path / "r"

    @pytest.mark.parametrize("kind", ["start", "session", "configuration", "experiment", "iteration", "end"])
    def test_a_missing_line_is_found_by_all(self, mdesign, folder, kind):
        lines = (folder / JOURNAL).read_bytes().splitlines(keepends=True)
        places = [k for k, line in enumerate(lines) if f'"event":"{kind}"'.encode() in line]
        del lines[places[len(places) // 2]]
        (folder / JOURNAL).write_bytes(b"".join(lines))
        for words in (["show"], ["verify"], ["importance"], ["ablation"], ["show", "--csv", "configurations"]):
            code, out, err = mdesign("runs", words[0], folder, *words[1:])
            assert (code, out) == (1, "")
            assert "lines are missing, were added, or are out of order" in err
            assert f"{folder / JOURNAL}, line" in err
        assert mdesign("race", "--resume", folder)[0] == 1
        assert "damaged" in mdesign("runs", "list", folder.parent)[1]

    def test_the_last_lines_are_missing(self, mdesign, folder, whole):
        """Which only the provenance shows; the race goes on from there."""
        lines = (folder / JOURNAL).read_bytes().splitlines(keepends=True)
        (folder / JOURNAL).write_bytes(b"".join(lines[:40]))
        said = "expected the end of the race after 60 experiments, as provenance.json says, found none after"
        code, out, _ = mdesign("runs", "show", folder)
        assert code == 0
        assert said in out
        code, out, err = mdesign("runs", "verify", folder)
        assert (code, out) == (1, "")
        assert said in err
        again = shutil.copytree(folder, folder.with_name("again"))
        code, _, err = mdesign("race", "--resume", again)
        assert (code, err.count(f"Note: {again / JOURNAL}: {said}")) == (0, 1)
        assert "Note: " not in mdesign("race", "--resume", again)[2]
        assert resumed(folder) == (read_journal(whole).record.digest(), read_journal(whole).record.tests)

    @pytest.mark.parametrize(
        ("event", "key", "value", "words"),
        [
            ("configuration", "values", [], "configuration.values: expected a mapping of keys, found a list of 0"),
            ("configuration", "values", {"S0": None}, "configuration.values.S0: expected text or a whole number or a"),
            ("configuration", "parent", 99, "configuration 0: its parent: expected a configuration that is in the"),
            ("experiment", "configuration", 99, "experiment: expected a configuration that is in the journal before"),
            ("experiment", "score", "2.5", 'experiment.score: expected a number or null, found "2.5"'),
            ("experiment", "score", float("inf"), "experiment.score: expected a number or null, found Infinity"),
            ("experiment", "score", None, "expected either a score or why it failed, found both or neither"),
            ("experiment", "instance", -1, "experiment.instance: expected a whole number >= 0, found -1"),
            ("experiment", "seed", 10**30, "experiment.seed: expected a whole number >= 0, found 1000"),
            ("experiment", "extra", 1, "experiment.extra: unknown key"),
            ("iteration", "elites", [], "iteration.elites: expected a list of at least 1, found a list of 0"),
            ("iteration", "elites", [99], "an elite: expected a configuration that has a score, found 99"),
            ("end", "winner", 99, "the winner: expected a configuration that has a score, found 99"),
            ("end", "experiments", 59, "end.experiments: expected 60"),
            ("end", "digest", "0", "digest of the first 60 experiments: expected 0, found"),
            ("session", "host", 5, "session.host: expected text, found 5"),
            ("test", "seed", True, "test.seed: expected a whole number >= 0, found true"),
            ("start", "budget", "60", 'start.budget: expected a whole number >= 1, found "60"'),
            ("start", "flavour", 3, "start: flavour: expected text, found 3"),
        ],
    )
    def test_lines_with_valid_checksums(self, mdesign, folder, event, key, value, words):
        def change(events):
            next(one for one in events if one["event"] == event)[key] = value
            if event == "start":
                del events[-3:]  # with the end, whose digest would show it

        self.change(folder, change)
        for verb in ("show", "verify"):
            code, out, err = mdesign("runs", verb, folder)
            assert (code, out) == (1, "")
            assert re.search(words, err), err
            assert str(folder / JOURNAL) in err
        assert mdesign("race", "--resume", folder)[0] == 1
        assert "damaged" in mdesign("runs", "list", folder.parent)[1]

    def test_a_configuration_that_is_none_of_the_grammar(self, mdesign, folder):
        def change(events):
            del events[-3:]
            for one in events:
                if one["event"] == "configuration":
                    one["values"] = {"NumStates": 77}

        self.change(folder, change)
        for words in (["show", "--csv", "configurations"], ["importance"]):
            code, out, err = mdesign("runs", words[0], folder, *words[1:])
            assert (code, out) == (1, "")
            assert "parameter 'NumStates': expected" in err

    @pytest.mark.parametrize(
        ("way", "value", "words"),
        [
            (["testing"], [3], "testing: expected a mapping of keys or null, found a list of 1"),
            (["testing", "runs"], 0, "testing.runs: expected a whole number >= 1, found 0"),
            (["race"], 5, "race: expected a mapping of keys, found 5"),
            (["race", "seed"], "1", 'race: seed: expected a whole number >= 0, found "1"'),
            (["race", "plugins"], [], "race: plugins: expected a mapping of keys, found a list of 0"),
            (["race", "options", "mu"], 5.0, "options.mu: raced with 5.0 by"),
            (["request", "set"], "robots=2", "request.set: expected a list"),
            (["libraries"], {"numpy": 1}, "libraries.numpy: expected text, found 1"),
            (["cores"], "2", "cores: expected a whole number >= 0 or null"),
            (["more"], 1, "more: unknown key"),
        ],
    )
    def test_provenance(self, mdesign, folder, way, value, words):
        data = json.loads((folder / "provenance.json").read_text())
        here = data
        for key in way[:-1]:
            here = here[key]
        here[way[-1]] = value
        (folder / "provenance.json").write_text(json.dumps(data))
        code, out, err = mdesign("race", "--resume", folder)
        assert (code, out) == (1, "")
        assert re.search(words, err), err
        assert str(folder) in err
        assert mdesign("runs", "show", folder)[0] == 0  # what the journal says


class TestStrangers:
    """What a stranger's folder says does not steer a terminal."""

    EVIL = "\x1b[2J\x1b]0;owned\x07 \x9b31m \u202e \r\nState      finished"

    def test_texts_of_a_journal(self, mdesign, whole, tmp_path):
        folder = tmp_path / "runs" / "r"
        shutil.copytree(whole, folder)

        def change(events):
            del events[-3:]
            for one in events:
                for key in ("host", "time", "executor", "note", "name", "robot_model", "outcome"):
                    if key in one:
                        one[key] = self.EVIL
                if one["event"] == "experiment" and one["experiment"] > 50:
                    one["failure"], one["score"] = self.EVIL, None

        TestDamage.change(folder, change)
        for words in (["list", folder.parent], ["list", folder.parent, "--json"], ["show", folder], ["verify", folder]):
            _, out, err = mdesign("runs", *words)
            assert is_harmless(out + err)
        for table in ("experiments", "configurations", "tests"):
            assert is_harmless(mdesign("runs", "show", folder, "--csv", table)[1])
        out = mdesign("runs", "show", folder)[1]
        assert len([line for line in out.splitlines() if line.startswith("State ")]) == 1
        assert "\\x1b[2J" in out

    def test_texts_of_files(self, mdesign, tmp_path):
        file = tmp_path / "m.yaml"
        text = mdesign("missions", "show", "aggregation")[1]
        text = re.sub("(?m)^description:.*$", lambda _: f"description: {json.dumps(self.EVIL)}\n# \u202e", text)
        file.write_text(text)
        assert "\\u001b" in text
        for words in (["missions", "show", file, "--set", "robots=3"], ["validate", file]):
            code, out, err = mdesign(*words)
            assert code == 0
            assert is_harmless(out + err)
        assert mdesign("missions", "show", file)[1] == text  # to make another file of

    def test_a_file_that_is_shown_on_a_terminal(self, mdesign, tmp_path):
        file = tmp_path / "m.yaml"
        file.write_text(mdesign("missions", "show", "aggregation")[1] + "# \u202e\n")
        assert "\u202e" not in on_terminal(["missions", "show", str(file)])


def is_harmless(text):
    return all(line.isprintable() for line in text.split("\n"))


def on_terminal(arguments):
    """What a command prints on a terminal."""
    ours, theirs = os.openpty()
    with started(*MDESIGN, *arguments, stdout=theirs, stderr=theirs, stdin=theirs) as process:
        os.close(theirs)
        said = b""
        with contextlib.suppress(OSError):  # which Linux says at the end
            while data := os.read(ours, 65536):
                said += data
        process.wait(timeout=LIMIT)
    os.close(ours)
    assert process.returncode == 0
    return said.decode()


def test_results_are_printed_by_one_function():
    """Which makes them printable."""
    package = Path(mercator_design.__file__).parent
    others = {
        str(file.relative_to(package))
        for file in package.rglob("*.py")
        if re.search(r"\b(click\.s?echo|print)\(", file.read_text())
    }
    # The second one prints numbers, over and over in one line; the last one prints JSON to a file.
    assert others == {"command.py", "robot/cli/record.py", "twin/folder.py"}


class TestStarts:
    """A process that was killed when a race began."""

    @staticmethod
    def designer():
        return Designer(
            Simulator(load_mission("aggregation", ["robots=2", "duration=3"])), budget=60, seed=1, method="irace"
        )

    @staticmethod
    def killed(path, designer, number):
        """Make a folder in a process that is killed before it does something to a file; gives whether it was."""
        child = os.fork()
        if child == 0:
            left = number

            def count():
                nonlocal left
                left -= 1
                if left == 0:
                    os.kill(os.getpid(), signal.SIGKILL)

            def hook(event, arguments):
                in_folder = event.startswith("os.") or event == "open"
                if event == "fcntl.flock" or (in_folder and str(arguments[0]).startswith(str(path))):
                    count()

            write = os.write
            os.write = lambda *arguments: (count(), write(*arguments))[1]
            os.fsync = lambda _: count()
            sys.addaudithook(hook)
            try:
                RunFolder.create(path, designer, request=Request(method="irace"))
            finally:
                os._exit(0)
        return os.WIFSIGNALED(os.waitpid(child, 0)[1])

    @pytest.mark.thorough
    def test_killed_at_each_early_moment(self, mdesign, tmp_path, whole):
        """It is resumed, or begun again in its folder; and never another way than these two."""
        designer, number, ways = self.designer(), 0, []
        while True:
            number += 1
            path = tmp_path / str(number)
            if not self.killed(path, designer, number):
                break
            assert mdesign("runs", "list", tmp_path)[0] == 0
            code, out, err = mdesign("runs", "show", path)
            assert (code, err) == (0, "") or "not a run folder" in err or "cannot be read: No such file" in err
            if (path / "provenance.json").exists():
                ways.append("resume")
                with pytest.raises(RaceError, match="expected a new or empty folder"):
                    RunFolder.create(path, designer, request=Request(method="irace"))
                folder = RunFolder.reopen(path)
            else:
                ways.append("again")
                code, out, err = mdesign("race", "--resume", path)
                assert (code, out) == (1, "")
                assert f"begin it again with -o {path}" in err or "not a run folder: provenance.json is missing" in err
                folder = RunFolder.create(path, designer, request=Request(method="irace"))
            with folder:
                assert folder.journal.record.start["seed"] == 1
            assert {file.name for file in path.iterdir()} == {
                JOURNAL, "provenance.json", "mission.yaml", "robot_model.yaml",
            }  # fmt: skip
            if ways.count(ways[-1]) == 1:
                assert resumed(path)[0] == read_journal(whole).record.digest()
        assert {*ways} == {"resume", "again"}
        assert len(ways) > 10

    def test_one_that_has_begun_and_lost_its_provenance(self, mdesign, tmp_path, whole):
        """Both ways of going on name the command that begins it again; the journal stays."""
        path = shutil.copytree(whole, tmp_path / "a b")
        (path / "provenance.json").unlink()
        (path / JOURNAL).write_bytes((path / JOURNAL).read_bytes()[:20_000])
        before = (path / JOURNAL).read_bytes()
        again = [
            "race",
            f"{path}/mission.yaml",
            "--budget",
            "60",
            "--seed",
            "1",
            "--flavour",
            "watermelon",
            "--method",
            "irace",
        ]
        for words in (["race", "--resume", path], [*again, "-o", path]):
            code, out, err = mdesign(*words)
            assert (code, out) == (1, "")
            assert "a race has begun here, but its provenance.json is missing" in err
            assert f"in another folder with: {shlex.join(['mdesign', *again])} -o ANOTHER\n" in err
        assert (path / JOURNAL).read_bytes() == before
        assert mdesign(*again, "-o", tmp_path / "c")[0] == 0
        assert read_journal(tmp_path / "c").record.digest() == read_journal(whole).record.digest()
        code, _, err = mdesign(*again, "-o", tmp_path / "c")
        assert (code, f"found files in it: a race; resume it with --resume {tmp_path}/c" in err) == (1, True)

    def test_an_empty_journal_with_a_race_under_way(self, tmp_path):
        with Journal(tmp_path / JOURNAL, new=True), pytest.raises(RaceError, match="is running this race"):
            RunFolder.create(tmp_path, self.designer(), request=Request(method="irace"))

    def test_what_is_no_empty_journal_stays(self, tmp_path):
        (tmp_path / JOURNAL).write_text("mine")
        with pytest.raises(RaceError, match="expected a new or empty folder"):
            RunFolder.create(tmp_path, self.designer(), request=Request(method="irace"))
        assert (tmp_path / JOURNAL).read_text() == "mine"


@pytest.mark.parametrize("times", [range(4_000_000_000, -1, -40_000_000), (0, 2**33, 1, 2**34, 10**9)])
def test_a_clock_that_jumps(mdesign, whole, tmp_path, monkeypatch, times):
    """Backwards, decades ahead, to its beginning: what it says is for people."""
    told = itertools.cycle(times)
    monkeypatch.setattr(time, "time", lambda: float(next(told)))
    for module in (journal, run_folder):
        monkeypatch.setattr(
            module, "now", lambda: datetime.fromtimestamp(next(told), UTC).isoformat(timespec="seconds")
        )
    path = tmp_path / "runs" / "r"
    with RunFolder.create(path, TestStarts.designer(), request=Request(method="irace")) as folder:
        folder.journal.open_session("threads", 1)
        folder.test(read_provenance(whole).testing)
    with ThreadExecutor(1) as executor, RunFolder.reopen(path) as folder:
        folder.journal.open_session("threads", 1)
        result = RaceRun(folder.task, executor, folder.journal, testing=folder.testing).finish()
        folder.finish(result, seconds=1.0)
        assert folder.journal.record.digest() == read_journal(whole).record.digest()
    os.utime(path / JOURNAL, (next(told), next(told)))
    for words in (["list", path.parent], ["show", path], ["verify", path, "-n", 2]):
        assert mdesign("runs", *words)[0] == 0
