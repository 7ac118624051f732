"""Whatever stops a race, and wherever: resumed, it comes to the same end, and nothing that finished is run again."""

import fcntl
import gc
import itertools
import json
import os
import random
import subprocess
import sys
import time
import zlib
from types import SimpleNamespace

import pytest

from mercator_design.config.checked_lines import from_line, to_line
from mercator_design.errors import RaceError
from mercator_design.race import IteratedRace
from mercator_design.race.executors.executor import ExecutorStopped
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.race.session import evaluation, journal
from mercator_design.race.session.events import (
    BudgetExtended,
    ConfigurationAdded,
    ExperimentDone,
    Measurement,
    RaceEnded,
    ScoreRevised,
    SpeculativeDone,
    event_of,
)
from mercator_design.race.session.journal import Journal, Reading, is_locked, read
from mercator_design.race.session.outcome import ExperimentFailed
from mercator_design.race.session.record import Record
from tests.processes import started
from tests.race.lines import events_in, journal_of
from tests.race.racing import BUDGET, SPACE, measure, places, resumed, runner, undisturbed
from tests.tiers import cases, some

WHOLE = undisturbed()
EXPECTED = WHOLE.ends[-1].winner, WHOLE.digest()
RAN = len(WHOLE.experiments)


@pytest.fixture(scope="module")
def complete(tmp_path_factory):
    """A journal's bytes."""
    path = tmp_path_factory.mktemp("complete") / "journal.jsonl"
    assert resumed(path) == (*EXPECTED, RAN)
    return path.read_bytes()


def whole_experiments(data):
    return sum(b'"event":"experiment"' in line for line in data.splitlines(keepends=True) if line.endswith(b"\n"))


EVENT = {"event": "experiment", "experiment": 3, "score": 0.1 + 0.2, "failure": 'a "quoted" thing, "crc":"x"}'}


class TestLines:
    def test_there_and_back(self):
        assert from_line(to_line(EVENT).encode()) == EVENT

    def test_the_checksum_is_that_of_the_line_without_it(self):
        line, crc = to_line({"event": "end"}), zlib.crc32(b'{"event":"end"}')
        assert line == f'{{"event":"end","crc":"{crc:08x}"}}\n'
        assert json.loads(line)["event"] == "end"  # any JSON reader takes it

    def test_any_byte_that_differs_is_noticed(self):
        line = to_line(EVENT).encode()
        for place in range(len(line)):
            for other in (line[place] ^ 1, line[place] ^ 128):
                with pytest.raises(ValueError, match="expected"):
                    from_line(line[:place] + bytes([other]) + line[place + 1 :])

    def test_any_byte_that_is_missing_is_noticed(self):
        line = to_line(EVENT).encode()
        for place in range(len(line)):
            with pytest.raises(ValueError, match="expected"):
                from_line(line[:place])

    def test_what_is_no_number_is_never_written(self):
        with pytest.raises(ValueError, match="not JSON compliant"):
            to_line({"score": float("nan")})

    def test_brackets_within_brackets(self):
        text = b'{"event":' + b"[" * 100_000 + b"]" * 100_000
        with pytest.raises(ValueError, match="expected an event"):
            from_line(text + b',"crc":"%08x"}\n' % zlib.crc32(text + b"}"))


class TestResume:
    def test_a_finished_race_runs_nothing(self, tmp_path, complete):
        path = tmp_path / "journal.jsonl"
        path.write_bytes(complete)
        assert resumed(path) == (*EXPECTED, 0)
        assert path.read_bytes() == complete

    @pytest.mark.swept
    def test_cut_at_every_byte_of_its_last_lines(self, tmp_path):
        """Each byte of the end and the last experiment, of a small race.

        At each, what is read are the whole lines before it. Resumed is at some: around the ends of lines, and between.
        """
        path = tmp_path / "journal.jsonl"
        expected = resumed(path, budget=50)
        data = path.read_bytes()
        lines = data.splitlines(keepends=True)
        for length in some(range(len(data) - len(lines[-1]) - len(lines[-2]), len(data)), 60):
            path.write_bytes(data[:length])
            reading = read(path)
            assert (reading.lines, bool(reading.torn)) == (
                data[:length].count(b"\n"),
                not data[:length].endswith(b"\n"),
            )
            if length % 40 and b"\n" not in data[length - 2 : length + 2]:
                continue
            assert resumed(path, budget=50) == (*expected[:2], expected[2] - whole_experiments(data[:length]))
            assert path.read_bytes() == data

    def test_cut_at_random_bytes(self, tmp_path, complete):
        path = tmp_path / "journal.jsonl"
        draws = random.Random(1)
        for length in [0, 1, *(draws.randrange(len(complete)) for _ in range(6))]:
            path.write_bytes(complete[:length])
            assert resumed(path) == (*EXPECTED, RAN - whole_experiments(complete[:length]))

    @pytest.mark.parametrize("rubbish", [b"\0" * 4096, b"{", b"\xff\xfe\n", b'{"event":"end"}\n', b"\n\n\n"])
    def test_rubbish_at_the_end_is_cut_off_and_told(self, tmp_path, complete, rubbish):
        path = tmp_path / "journal.jsonl"
        lines = complete.splitlines(keepends=True)
        path.write_bytes(b"".join(lines[:50]) + rubbish)
        with Journal(path, new=False) as one:
            assert one.notes == [n for n in one.notes if "line 51: expected" in n and "cut off" in n]
            assert len(one.notes) == 1
        assert resumed(path)[:2] == EXPECTED

    def test_no_events_are_held_while_it_is_read(self, tmp_path, monkeypatch):
        """Those of a large race would take most of the memory of what only reads it."""
        path, n, alive = tmp_path / "journal.jsonl", 100, []
        with Journal(path, new=True) as new:
            new.begin({"budget": n})
            new.note(ConfigurationAdded(configuration=0, parent=None, values={}))
            for k in range(n):
                new.note(ExperimentDone(experiment=k, iteration=1, configuration=0, instance=k, seed=k, score=0.5))

        def counted(data):
            event = event_of(data)
            if isinstance(event, ExperimentDone) and event.experiment % 20 == 0:
                alive.append(sum(isinstance(one, ExperimentDone) for one in gc.get_objects()))
            return event

        monkeypatch.setattr(journal, "event_of", counted)
        reading, told = read(path), []
        assert len(reading.record.experiments) == n
        assert len(alive) == n // 20
        assert max(alive) - min(alive) < 5
        Reading(path).read_on(told.append)
        assert sum(isinstance(one, ExperimentDone) for one in told) == n

    def test_a_line_that_is_written_while_it_is_read_is_no_damage(self, tmp_path, complete, monkeypatch):
        path, lines = tmp_path / "journal.jsonl", complete.splitlines(keepends=True)
        path.write_bytes(b"".join(lines[:20])[:-30])

        def from_line_late(line):
            if not line.endswith(b"\n"):
                path.write_bytes(b"".join(lines[:22]))
            return from_line(line)

        monkeypatch.setattr(journal, "from_line", from_line_late)
        reading = read(path)
        assert reading.lines == 19
        assert reading.torn
        reading.read_on()
        assert (reading.lines, reading.torn) == (22, "")

    def test_damage_before_the_end_names_the_line_and_changes_nothing(self, tmp_path, complete):
        path = tmp_path / "journal.jsonl"
        lines = complete.splitlines(keepends=True)
        damaged = b"".join([*lines[:40], lines[40].replace(b'"instance":', b'"instance":1', 1), *lines[41:]])
        damaged = damaged if damaged != complete else b"".join([*lines[:40], b"x" + lines[40], *lines[41:]])
        path.write_bytes(damaged)
        with pytest.raises(
            RaceError, match=r"line 41: expected the checksum [0-9a-f]{8}, found.*Lines 1 to 40 are valid"
        ):
            Journal(path, new=False)
        assert path.read_bytes() == damaged
        path.write_bytes(b"".join(lines[:40]))  # as it says
        assert resumed(path)[:2] == EXPECTED

    def test_experiments_may_finish_in_any_order(self, tmp_path, complete):
        """As parallel workers finish them, and stopped in the middle of that."""
        path = tmp_path / "journal.jsonl"
        draws, shuffled = random.Random(1), []
        for event in events_in(complete)[:200]:
            if event["event"] == "experiment":
                after = next(k for k, one in enumerate(shuffled) if one.get("configuration") == event["configuration"])
                ended = [k for k, one in enumerate(shuffled) if one["event"] == "iteration"]
                shuffled.insert(draws.randint(max(after, *ended, 0) + 1, len(shuffled)), event)
            else:
                shuffled.append(event)
        data = journal_of(shuffled)
        assert data != b"".join(complete.splitlines(keepends=True)[:200])
        path.write_bytes(data)
        assert resumed(path) == (*EXPECTED, RAN - whole_experiments(data))

    def test_that_of_another_race_is_refused(self, tmp_path, complete):
        path = tmp_path / "journal.jsonl"
        path.write_bytes(complete)
        with pytest.raises(RaceError, match="another race, or of another version"):
            resumed(path, seed=2)

    def test_of_one_that_is_refused_nothing_is_written(self, tmp_path, complete):
        """Though its first batch has configurations that the journal does not have."""
        path = tmp_path / "journal.jsonl"
        lines = complete.splitlines(keepends=True)
        first = next(k for k, line in enumerate(lines) if b'"configuration"' in line)
        path.write_bytes(b"".join(lines[: first + 2]))
        with pytest.raises(RaceError, match="configuration 0: "):
            resumed(path, seed=2)
        with Journal(path, new=False) as one:
            assert [*one.record.configurations] == [0, 1]

    def test_an_experiment_too_many(self, tmp_path, complete):
        path = tmp_path / "journal.jsonl"
        path.write_bytes(complete)
        with Journal(path, new=False) as one:
            iteration = len(one.record.iterations) + 1
            one.note(
                ExperimentDone(experiment=9999, iteration=iteration, configuration=1, instance=0, seed=1, score=1.0)
            )
        with pytest.raises(RaceError, match=f"expected {RAN} experiments in all, found {RAN + 1}"):
            resumed(path)

    def test_what_is_there_twice(self, tmp_path, complete):
        """Or is missing, though all checksums are right."""
        path = tmp_path / "journal.jsonl"
        resumed(path, testing=evaluation.Testing(runs=3))
        whole = events_in(path.read_bytes())
        found = {}
        for place, event in enumerate(whole):
            kind = event["event"]
            if kind in {"configuration", "experiment"} and place % 10:  # enough of them
                continue
            for what, events in (
                ("doubled", [*whole[:place], event, *whole[place:]]),
                ("doubled later", [*whole, event]),
                ("missing", [*whole[:place], *whole[place + 1 :]]),
            ):
                if what == "doubled later" and place % 20:  # the same
                    continue
                path.write_bytes(journal_of(events))
                try:
                    read(path)
                except RaceError as error:
                    found.setdefault((kind, what), set()).add(f"{path}, line " in str(error))
                else:
                    found.setdefault((kind, what), set()).add(False)
        expected = {(kind, what): {True} for kind, what in found}
        assert found == expected | {("test", "missing"): {False}}  # each of which is run again
        assert {kind for kind, _ in found} == {"start", "configuration", "experiment", "iteration", "end", "test"}

    def test_more_that_is_there_twice(self):
        record = Record()
        record.begin({"budget": 5})
        record.note(ConfigurationAdded(configuration=0, parent=None, values={"x": 1}))
        for event in (
            SpeculativeDone(configuration=0, instance=1, score=1.0),
            ScoreRevised(experiment=3, configuration=0, instance=1, score=1.0),
        ):
            record.note(event)
            with pytest.raises(RaceError, match="configuration 0 on instance 1 is there twice"):
                record.note(event)

    @pytest.mark.parametrize(
        ("event", "words"),
        [
            ({"event": "start", "format": 2, "budget": 3}, "second start"),
            ({"event": "dance"}, "event: expected one of session, .*, found dance"),
            ({"event": ["end"]}, "event: expected one of session, .*, found ..end"),
            ({"event": "extend", "budget": BUDGET}, f"larger than {BUDGET}"),
            ({"event": "configuration", "configuration": 1}, "configuration.parent: missing key"),
            ({"event": "experiment", "experiment": 1}, "missing"),
        ],
    )
    def test_an_event_that_cannot_be(self, tmp_path, complete, event, words):
        path = tmp_path / "journal.jsonl"
        path.write_bytes(journal_of([*events_in(complete), event]))
        with pytest.raises(RaceError, match=f"line {complete.count(10) + 1}: .*{words}"):
            read(path)

    @pytest.mark.parametrize(
        ("line", "words"),
        [
            ({"event": "end", "budget": 1, "experiments": 1, "winner": 1}, "start of a race first"),
            ({"event": "start", "format": 7}, "start.format: expected 2, found 7: use the version"),
            ({"event": "start", "format": 2}, "start.budget: expected a whole number >= 1, found null"),
        ],
    )
    def test_a_file_that_is_no_journal(self, tmp_path, line, words):
        path = tmp_path / "journal.jsonl"
        path.write_bytes(journal_of([line]))
        with pytest.raises(RaceError, match=words):
            read(path)

    def test_a_journal_of_format_1(self, tmp_path):
        """Whose lines do not name those before them: it is refused by its format."""
        path = tmp_path / "journal.jsonl"
        path.write_text(to_line({"event": "start", "format": 1, "budget": 3}))
        with pytest.raises(RaceError, match=r"line 1: start\.format: expected 2, found 1: use the version"):
            read(path)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_killed_at_random_bytes(tmp_path, seed):
    command = [sys.executable, "-m", "tests.race.racing", str(tmp_path), str(seed), str(len(cases(6)))]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


class TestExtension:
    def test_the_race_goes_on_from_its_end(self):
        longer = undisturbed(budgets=(BUDGET, 500))
        assert RAN < len(longer.experiments) <= 500
        assert [longer.experiments[k] for k in range(RAN)] == [WHOLE.experiments[k] for k in range(RAN)]
        assert longer.ends[0] == WHOLE.ends[0]
        assert longer.ends[1].digest != WHOLE.ends[0].digest

    def test_when_it_is_asked_for_makes_no_difference(self, tmp_path, complete):
        longer = undisturbed(budgets=(BUDGET, 500))
        events = events_in(complete)
        for n in (1, 30, len(events) - 1, len(events)):
            path = tmp_path / f"{n}.jsonl"
            path.write_bytes(journal_of([*events[:n], {"event": "extend", "budget": 500}]))
            assert resumed(path)[:2] == (longer.ends[-1].winner, longer.digest())

    def test_cut_at_random_bytes(self, tmp_path):
        longer = undisturbed(budgets=(BUDGET, 400, 600))
        path = tmp_path / "journal.jsonl"
        with Journal(path, new=True) as one, ThreadExecutor(1) as executor:
            running = runner(one, executor)
            one.note(BudgetExtended(budget=400), BudgetExtended(budget=600))
            running.finish()
        data = path.read_bytes()
        draws = random.Random(1)
        first = len(b"".join(data.splitlines(keepends=True)[:3]))  # with the budgets
        for length in [draws.randrange(first, len(data)) for _ in range(3)]:
            path.write_bytes(data[:length])
            assert resumed(path)[:2] == (longer.ends[-1].winner, longer.digest())

    @pytest.mark.parametrize("more", [1, 5, 60, 3000])
    def test_by_little_or_much(self, more):
        race = IteratedRace(SPACE, budget=100, seed=3)
        rng = random.Random(1)
        for budget in (None, 100 + more):
            if budget:
                race.extend(budget)
            while batch := race.ask():
                race.tell([race.configurations[e.configuration]["x"] + rng.random() for e in batch])
        assert race.used <= 100 + more
        assert race.used > 100 + 0.9 * more - 3  # a single experiment may be too few for anything

    def test_more_budget_is_no_worse(self):
        """Most of 10 races, of fixed seeds, end at least as near the optimum with four times the budget."""
        better = 0
        for seed in range(10):
            longer = undisturbed(seed=seed, budgets=(100, 400))
            distance = []
            for end in longer.ends:
                x, y, rule = longer.configurations[end.winner].values()
                distance.append((x - 1.5) ** 2 + (y + 1) ** 2 + (rule != "fast"))
            better += distance[1] <= distance[0]
        assert better >= 7

    def test_before_its_end_or_by_nothing(self):
        race = IteratedRace(SPACE, budget=100, seed=3)
        with pytest.raises(RaceError, match="expected the race to have ended"):
            race.extend(200)
        while batch := race.ask():
            race.tell([race.configurations[e.configuration]["x"] for e in batch])
        with pytest.raises(RaceError, match="budget: expected a whole number, 101 or more, found 100"):
            race.extend(100)


class TestLock:
    def test_one_process_at_a_time(self, tmp_path, complete):
        path = tmp_path / "journal.jsonl"
        path.write_bytes(complete)
        with Journal(path, new=False) as one:
            one.open_session(jobs=1)
            assert is_locked(path)
            with pytest.raises(RaceError, match=f"process {os.getpid()} on .* is running this race"):
                Journal(path, new=False)
        assert not is_locked(path)
        Journal(path, new=False).__exit__(None, None, None)

    def test_the_lock_goes_with_its_process(self, tmp_path, complete):
        path = tmp_path / "journal.jsonl"
        path.write_bytes(complete)
        script = (
            "import sys, time; from pathlib import Path; from mercator_design.race.session.journal import Journal;"
            "j = Journal(Path(sys.argv[1]), new=False); print('has it', flush=True); time.sleep(600)"
        )
        with started(sys.executable, "-c", script, path, stdout=subprocess.PIPE) as process:
            assert process.stdout.readline() == "has it\n"
            with pytest.raises(RaceError, match="running this race"):
                Journal(path, new=False)
        assert resumed(path)[:2] == EXPECTED

    def test_a_file_system_without_locks(self, tmp_path, monkeypatch):
        def flock(*_):
            raise OSError(38, "Function not implemented")

        monkeypatch.setattr(fcntl, "flock", flock)
        with Journal(tmp_path / "journal.jsonl", new=True) as one:
            assert "has no locks" in one.notes[0]


class TestFullDisk:
    @pytest.mark.parametrize("written", [0, 1, 50])
    def test_the_journal_stays_whole(self, tmp_path, monkeypatch, written):
        """The disk takes so many bytes of a write, and then no more."""
        path = tmp_path / "journal.jsonl"
        write, count, lines = os.write, 0, 0

        def full(file, data):
            nonlocal count, lines
            count += 1
            if count < 100:
                lines += data.count(b"\n")
                return write(file, data)
            if written == 0:
                raise OSError(28, "No space left on device")
            return write(file, data[:written])

        monkeypatch.setattr(os, "write", full)
        with pytest.raises(RaceError, match=r"results cannot be written: No space left on device; .* resume the race"):
            resumed(path)
        monkeypatch.undo()
        reading = read(path)
        assert (reading.lines, reading.torn) == (lines, "")
        assert resumed(path) == (*EXPECTED, RAN - len(reading.record.experiments))

    def test_what_cannot_be_forced_to_the_disk(self, tmp_path, monkeypatch):
        """A network file system may tell only then that there is no room; the lines may be there nevertheless."""
        path = tmp_path / "journal.jsonl"
        monkeypatch.setattr(journal, "SYNC_EVERY", -1.0)
        fsync, count = os.fsync, 0

        def full(file):
            nonlocal count
            count += 1
            if count == 100:
                raise OSError(122, "Disk quota exceeded")
            fsync(file)

        monkeypatch.setattr(os, "fsync", full)
        with pytest.raises(RaceError, match=r"Disk quota exceeded; .* resume the race"):
            resumed(path)
        monkeypatch.undo()
        reading = read(path)
        assert reading.torn == ""
        assert resumed(path) == (*EXPECTED, RAN - len(reading.record.experiments))

    @pytest.mark.parametrize(
        ("before", "expected", "message"),
        [
            (None, RaceError, r"results cannot be written: Disk quota exceeded; .* resume the race"),
            (KeyError("the first"), KeyError, "the first"),
        ],
    )
    def test_what_cannot_be_forced_to_the_disk_at_the_end(self, tmp_path, monkeypatch, before, expected, message):
        def full(_):
            raise OSError(122, "Disk quota exceeded")

        def ended():
            with Journal(tmp_path / "journal.jsonl", new=True):
                monkeypatch.setattr(os, "fsync", full)
                if before is not None:
                    raise before

        with pytest.raises(expected, match=message):
            ended()

    def test_what_is_written_is_forced_to_the_disk_now_and_then(self, tmp_path, monkeypatch):
        monkeypatch.setattr(journal, "SYNC_EVERY", 0.01)
        synced, now = [], [1000.0]
        fsync = os.fsync
        monkeypatch.setattr(os, "fsync", lambda file: synced.append(now[0]) or fsync(file))
        monkeypatch.setattr(journal, "time", SimpleNamespace(monotonic=lambda: now[0], sleep=time.sleep))

        def slowly(item):
            now[0] += 0.001
            return measure(item)

        with Journal(tmp_path / "journal.jsonl", new=True) as one, ThreadExecutor(1) as executor:
            runner(one, executor, function=slowly).finish()
        assert len(synced) > 10
        assert min(b - a for a, b in itertools.pairwise(synced[1:-1])) >= 0.009


class TestFailures:
    @staticmethod
    def failing(item):
        (x, y, _), _ = item
        if x > 2:
            raise ArithmeticError("too far")
        return measure(item) if y < 0 else Measurement(float("nan" if x < 0 else "inf"), "")

    def test_they_stop_the_race_by_default_and_are_tried_again(self, tmp_path):
        path = tmp_path / "journal.jsonl"
        for _ in range(2):
            with Journal(path, new=not path.exists()) as one, ThreadExecutor(2) as executor:
                with pytest.raises(ExperimentFailed, match=r"configuration \d+, .* failed: ") as stop:
                    runner(one, executor, function=self.failing).finish()
                assert stop.value.finished.experiment not in one.record.experiments
                assert all(e.score is not None for e in one.record.experiments.values())
        assert resumed(path)[:2] == EXPECTED  # when they fail no more

    @pytest.mark.parametrize("jobs", [1, 3])
    def test_they_reject_their_configuration_if_that_is_wanted(self, tmp_path, jobs):
        path = tmp_path / "journal.jsonl"
        with Journal(path, new=True) as one, ThreadExecutor(jobs) as executor:
            running = runner(one, executor, function=self.failing, on_failure="reject")
            running.finish()
            failed = [e for e in one.record.experiments.values() if e.score is None]
            expected = "expected a score from -1e+100 to 1e+100"
            assert {e.failure for e in failed} == {
                "ArithmeticError: too far", f"{expected}, found nan", f"{expected}, found inf",
            }  # fmt: skip
            winner = one.record.configurations[one.record.ends[-1].winner]
            assert winner["x"] <= 2
            assert winner["y"] < 0
            per_configuration = {e.configuration for e in failed}
            assert len(per_configuration) == len(failed)  # not run again
            digest = one.record.digest()
        with Journal(path, new=False) as again, ThreadExecutor(1) as executor:
            runner(again, executor, function=None).finish()  # nothing is left to run
            assert again.record.digest() == digest

    def test_all_fail(self, tmp_path):
        def never(item):
            raise OSError("no")

        with ThreadExecutor(1) as executor, pytest.raises(RaceError, match="all were rejected"):
            runner(Record(), executor, function=never, on_failure="reject").finish()


def test_what_is_under_way_when_it_is_stopped_is_kept(tmp_path):
    """By several threads: all that was begun is in the journal."""
    path = tmp_path / "journal.jsonl"
    begun = []

    def counted(item):
        begun.append(item)
        time.sleep(0.002)
        return measure(item)

    with Journal(path, new=True) as one, ThreadExecutor(3) as executor:
        with pytest.raises(ExecutorStopped):
            runner(one, executor, function=counted, stopped=lambda: len(begun) > 100).finish()
        known = {*places(one.record)} | one.record.speculative.keys()
        assert len(known) == len(begun)
    assert resumed(path) == (*EXPECTED, len({*places(WHOLE)} - known))


class TestAhead:
    """Experiments that are run before the race asks for them, so that no worker is idle."""

    @staticmethod
    def raced(jobs):
        """A race whose experiments take a moment."""
        record, ran = Record(), []

        def slowly(item):
            ran.append(item)
            time.sleep(0.001 * (1 + item[1] % 3))
            return measure(item)

        with ThreadExecutor(jobs) as executor:
            runner(record, executor, function=slowly).finish()
        return record, ran

    def test_one_worker_never_does(self):
        record, ran = self.raced(1)
        assert record.speculative == {}
        assert len(ran) == RAN

    def test_several_do_and_it_makes_no_difference(self):
        record, ran = self.raced(6)
        assert record.speculative
        assert (record.ends[-1].winner, record.digest()) == EXPECTED
        assert len(ran) == len(set(ran))  # none runs twice
        assert len(ran) - RAN == len(record.speculative.keys() - {*places(record)}) < 0.25 * RAN

    def test_lookahead_predicts_what_is_asked_if_nothing_is_eliminated(self):
        race = IteratedRace(SPACE, budget=600, seed=1)
        assert race.lookahead(3) == []
        predicted = []
        for _ in range(3):  # before the first test
            batch = race.ask()
            assert predicted == batch[: len(predicted)]
            predicted = race.lookahead(len(batch))
            assert race.lookahead(2) == predicted[:2]
            assert predicted
            race.tell([0.0] * len(batch))

    def test_lookahead_stays_within_the_budget(self):
        race = IteratedRace(SPACE, budget=60, seed=1)
        while batch := race.ask():
            assert len(race.lookahead(1000)) <= max(race.budget - race.used - len(batch), 0)
            race.tell([race.configurations[e.configuration]["x"] for e in batch])


def test_the_digest_is_of_what_happened():
    other = undisturbed()
    other.experiments[5] = ExperimentDone(
        **{n: getattr(other.experiments[5], n) for n in ExperimentDone.__slots__} | {"score": 1e-9}
    )
    assert other.digest() != EXPECTED[1]
    other = undisturbed()
    other.ends[-1] = RaceEnded(budget=BUDGET, experiments=RAN, winner=EXPECTED[0] + 1)
    assert other.digest() != EXPECTED[1]
    assert undisturbed(seed=2).digest() != EXPECTED[1]


@pytest.mark.parametrize("word", ["experiments", 7, None])
def test_an_event_of_no_kind_is_refused(word):
    with pytest.raises(RaceError, match=f"event: expected one of session, .*, found {word}"):
        event_of({"event": word})
