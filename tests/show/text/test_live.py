"""Progress as plain lines and as events, and following a race by its journal; all without real time."""

import fcntl
import json
import os
import re
import shutil
from types import SimpleNamespace

import pytest

from mercator_design.errors import RaceError
from mercator_design.race.elimination.summary import Elite, Progress
from mercator_design.race.session import evaluation, events
from mercator_design.race.session.events import ExperimentDone, IterationEnded
from mercator_design.race.session.journal import read
from mercator_design.race.session.view import RaceView
from mercator_design.results.files import JOURNAL
from mercator_design.show.text.progress import Display, RaceDisplay
from mercator_design.show.text.watching import follow
from tests.race.lines import events_in
from tests.test_architecture import ROOT

pytestmark = pytest.mark.together

RACE = ["race", "aggregation", "--budget", "20", "--method", "random", "-j", "1", "--test-runs", "3"]
QUICK = ["--set", "robots=2", "--set", "duration=3"]


class Clock:
    now = 100.0

    def __call__(self):
        return self.now


def experiment(number):
    return ExperimentDone(experiment=number, iteration=1, configuration=1, instance=1, seed=1, score=2.8)


class TestPlainLines:
    @pytest.fixture
    def clock(self):
        return Clock()

    @pytest.fixture
    def view(self):
        return RaceView(500)

    @pytest.fixture
    def display(self, clock, view):
        best = Elite(configuration=31, mean=-2.8, sd=0.414, n_results=15)
        at = Progress(iteration=2, iterations=9, alive=17, used=0, budget=500, best=best)
        task = SimpleNamespace(name="\x1b[31mred\n\u202e", score=lambda cost: -cost, cost=lambda score: -score)
        tests = evaluation.Testing(runs=5, elites=2)
        view.live = lambda: at
        return RaceDisplay(task, view, tests, "plain", plan=at, clock=clock)

    @pytest.fixture
    def note(self, display, view):
        def note(event):
            view.note(event)
            display.note(event)

        return note

    def test_at_least_every_30_seconds(self, display, note, clock, capsys):
        for number in range(100):
            clock.now += 0.29
            note(experiment(number))
        assert capsys.readouterr().err == ""
        clock.now += 1.1
        display.line.print_if_due()  # nothing happens, but time goes on
        display.line.print_if_due()
        assert capsys.readouterr().err == (
            "\\x1b[31mred\\n\\u202e: iteration 2/9, 17 alive, best 2.8 in the race (15 runs, sd 0.414), "
            "97/500 experiments, 3.4/s, 0:01:57 left\n"
        )

    def test_at_the_end_of_an_iteration_and_for_tests(self, note, clock, capsys):
        clock.now += 10.0
        numbers = {"iteration": 2, "budget": 100, "used": 50, "configurations": 20, "instances": 5, "alive": 4}
        for postselection in (False, True):
            note(IterationEnded(**numbers, elites=(31, 7), stagnant=0, note="", postselection=postselection))
        note(events.TestDone(configuration=31, instance=0, seed=1, score=1.0))
        lines = capsys.readouterr().err.splitlines()
        assert [line.partition(": ")[2].partition(",")[0] for line in lines] == [
            "iteration 2 ended",
            "final race ended",
            "testing",
        ]
        assert ", 1/10 experiments" in lines[-1]

    def test_what_was_known_does_not_count_for_the_rate(self, capsys, clock):
        display = Display("evaluating", 100, "plain", clock=clock)
        display.known = 50
        clock.now += 40.0
        display.show(50)
        display.show(60)
        clock.now += 40.0
        display.show(60)
        assert capsys.readouterr().err.splitlines() == [
            "evaluating, 50/100 experiments",
            "evaluating, 60/100 experiments, 0.12/s, 0:05:20 left",
        ]

    @pytest.mark.parametrize("mode", ["none", "rich", "plain"])
    def test_modes(self, mode, capsys):
        with Display("x", 10, mode) as display:
            display.show(3)
        err = capsys.readouterr().err
        assert ("\x1b" in err) == (mode == "rich")
        assert bool(err) == (mode == "rich")


@pytest.fixture(scope="module")
def raced(tmp_path_factory, mdesign_once):
    """The folder of a race."""
    folder = tmp_path_factory.mktemp("live") / "r"
    mdesign_once(*RACE, *QUICK, "-o", folder)
    return folder


def streamed(folder):
    """What --json-lines is to print."""
    return [event for event in events_in((folder / JOURNAL).read_bytes()) if event["event"] not in ("session", "stop")]


class TestJsonLines:
    def test_the_events_of_the_journal(self, mdesign, tmp_path):
        code, out, err = mdesign(*RACE, *QUICK, "-o", tmp_path / "r", "--json-lines", "--quiet")
        assert code == 0
        assert [json.loads(line) for line in out.splitlines()] == streamed(tmp_path / "r")
        assert err.startswith("Mission    aggregation")
        assert "\nWritten    " in err

    def test_a_resumed_race_has_all_events(self, mdesign, raced, tmp_path):
        shutil.copytree(raced, tmp_path / "r")
        code, out, err = mdesign("race", "--resume", tmp_path / "r", "--json-lines", "--progress", "plain")
        assert code == 0
        found = [json.loads(line) for line in out.splitlines()]
        assert found[0] == streamed(raced)[0]
        kinds = {"configuration", "experiment", "iteration", "end"}
        kept = [event for event in streamed(raced) if event["event"] in kinds]
        assert [event for event in found if event["event"] in kinds] == kept
        assert "aggregation: iteration 1 ended" in err

    def test_the_documented_events_are_those_of_the_code(self):
        text = (ROOT / "docs" / "reference" / "run-folder.md").read_text()
        rows = re.findall(r"^\| `(\w+)` \| (.+?) \|", text.partition("## Events")[2], re.MULTILINE)
        documented = {name: tuple(re.findall(r"`(\w+)`", keys)) for name, keys in rows}
        del documented["event"], documented["start"]
        assert documented == {name: kind.__slots__ for name, kind in events._KINDS.items()}


class Elsewhere:
    """Another process, which does a step of its own whenever the watcher sleeps."""

    def __init__(self, folder, steps):
        self.journal = folder / JOURNAL
        self.steps = iter(steps)
        self._lock = None

    def __call__(self, seconds):
        next(self.steps)()

    def write(self, data):
        def append():
            with self.journal.open("ab") as file:
                file.write(data)

        return append

    def lock(self):
        self._lock = os.open(self.journal, os.O_RDONLY)
        fcntl.flock(self._lock, fcntl.LOCK_EX)

    def unlock(self):
        os.close(self._lock)


class TestWatching:
    def test_from_before_the_beginning_to_the_end(self, raced, tmp_path, capsys):
        lines = (raced / JOURNAL).read_bytes().splitlines(keepends=True)
        folder, heard = tmp_path / "r", []
        process = Elsewhere(folder, [])

        def begin():
            folder.mkdir()
            for name in ("mission.yaml", "robot_model.yaml", "provenance.json"):
                (folder / name).write_bytes((raced / name).read_bytes())
            process.journal.touch()
            process.lock()

        def resume():
            os.truncate(process.journal, sum(map(len, lines[:20])))  # a resumed race cuts off what is torn
            process.lock()

        process.steps = iter(
            [
                begin,
                process.write(lines[0][:40]),
                process.write(lines[0][40:] + b"".join(lines[1:20]) + lines[20][:30]),
                lambda: None,
                process.unlock,
                lambda: None,
                resume,
                process.write(b"".join(lines[20:-1])),
                process.unlock,  # during the tests
                process.lock,
                process.write(lines[-1]),
                process.unlock,
            ]
        )
        follow(folder, "plain", announce=heard.append, sleep=process)
        assert next(process.steps, None) is None
        n_first = sum(b'"event":"experiment"' in line for line in lines[:20])
        n_all = len(read(raced / JOURNAL).record.experiments)
        assert heard == [
            f"{folder}: no race has begun here yet; waiting for it",
            f"{folder}: the race stopped after {n_first} experiments; waiting for: mdesign race --resume {folder}",
            f"{folder}: the tests stopped after {n_all} experiments; waiting for: mdesign race --resume {folder}",
        ]
        assert "aggregation: iteration 1 ended, " in capsys.readouterr().err

    def test_the_page_at_the_end(self, raced, mdesign):
        code, out, err = mdesign("watch", raced, "--quiet")
        assert (code, err) == (0, "")
        assert (out.splitlines()[0], "Winner" in out) == ("Mission    aggregation, for robot mercator", True)

    def test_a_journal_that_is_another_one_now(self, raced, tmp_path):
        (tmp_path / JOURNAL).write_bytes((raced / JOURNAL).read_bytes())
        reading = read(tmp_path / JOURNAL)
        (tmp_path / JOURNAL).write_bytes(b"")
        with pytest.raises(RaceError, match=r"expected at least \d+ bytes, as before, found fewer"):
            reading.read_on()
