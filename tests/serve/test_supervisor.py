"""Jobs over their lives: turns, stops, crashes, full disks, time limits."""

import errno
import json
import os
import shutil
import sqlite3
from collections import Counter
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from mercator_design.race.session.journal import Reading
from mercator_design.serve.jobs.operations import LimitReached, NotPossible
from mercator_design.serve.jobs.races import check_place
from mercator_design.serve.jobs.running_race import RunningRace
from mercator_design.serve.settings import UserLimits
from tests.serve.races import BUDGET, House, locked


def test_a_job_runs_to_its_end(house):
    job = house.submit()
    assert house.state(job) == "queued"
    house.tick()
    assert house.state(job) == "running"
    house.time += 10
    house.finish(job)
    row = house.row(job)
    assert (row.state, row.message, row.experiments) == ("finished", "", BUDGET)
    assert row.best is not None
    assert row.job.seconds == pytest.approx(11.0)
    assert row.job.ended
    assert house.started == [job]
    house.tick()
    assert house.started == [job]


def test_progress_is_in_the_row_while_it_runs(house):
    job = house.submit()
    house.tick()
    house.race(job, lines=40)
    house.tick(5)
    row = house.row(job)
    assert 0 < row.experiments < BUDGET
    assert (row.state, row.job.seconds) == ("running", 5.0)


def test_pause_and_resume(house):
    job = house.submit()
    house.tick()
    row = house.jobs.pause(job)
    assert (row.state, row.job.wish) == ("running", "pause")
    house.tick()
    assert house.processes[job].is_interrupted
    assert house.row(job).message == "stopping, to pause"
    house.end(job, 75)
    assert house.state(job) == "paused"
    house.tick(100)
    assert house.started == [job]
    assert house.jobs.resume(job).state == "queued"
    house.tick()
    assert house.started == [job, job]


def test_a_job_that_was_resumed_before_it_had_stopped_goes_on(house):
    job = house.submit()
    house.tick()
    house.jobs.pause(job)
    house.tick()
    house.jobs.resume(job)
    house.tick()
    assert (house.row(job).message, house.row(job).job.wish) == ("stopping, to go on", "run")
    house.end(job, 75)
    house.tick()
    assert house.started == [job, job]


def test_cancel(house):
    waiting, running = house.submit(), house.submit()
    house.jobs.cancel(waiting)
    assert house.state(waiting) == "cancelled"
    house.tick()
    house.jobs.cancel(running)
    house.tick()
    house.end(running, 75)
    row = house.row(running)
    assert (row.state, bool(row.job.ended)) == ("cancelled", True)
    assert house.jobs.cancel(running).job.ended == row.job.ended
    with pytest.raises(NotPossible, match="cannot resume a job that is cancelled"):
        house.jobs.resume(running)
    with pytest.raises(NotPossible, match="cannot extend a job that is cancelled"):
        house.jobs.change(running, budget=10**4)


def test_a_job_that_ends_while_it_is_cancelled_has_succeeded(house):
    job = house.submit()
    house.tick()
    house.jobs.cancel(job)
    house.finish(job)
    assert house.state(job) == "finished"


def test_a_process_that_does_not_stop_is_killed(house):
    job = house.submit()
    house.tick()
    house.jobs.pause(job)
    house.tick()
    house.tick(29)
    assert not house.processes[job].is_killed
    house.tick(2)
    assert house.processes[job].is_killed
    house.tick()
    assert house.state(job) == "paused"


def test_changes_of_a_job_do_not_read_its_journal(house):
    """It may be long, and other jobs wait meanwhile: what is new in it counts at the next turn."""
    job, done = house.submit(), house.submit("bob")
    house.tick()
    house.race(job, lines=40)
    house.tick()
    running = house.row(job)
    house.race(job, lines=60)
    house.jobs.pause(job)
    house.jobs.change(job, priority=3, shared=True)
    assert house.row(job).experiments == running.experiments
    house.tick()
    house.end(job, 75)
    house.tick()
    house.finish(done)
    before, ended = house.row(job), house.row(done)
    assert (before.state, before.job.request.priority, before.job.shared) == ("paused", 3, True)
    assert before.experiments > running.experiments
    assert ended.state == "finished"
    house.race(job, lines=80)
    house.race(done, lines=40)
    changed = replace(before, job=replace(before.job, request=replace(before.job.request, priority=1)))
    assert house.jobs.change(job, priority=1) == changed
    assert house.jobs.resume(job) == replace(changed, job=house.store.read(job), state="queued")
    assert house.jobs.cancel(job).state == "cancelled"
    assert house.jobs.change(done, shared=True) == replace(ended, job=replace(ended.job, shared=True))
    extended = house.jobs.change(done, budget=2 * BUDGET)
    assert extended == replace(ended, job=house.store.read(done), state="queued")
    assert (extended.job.request.budget, extended.job.shared, extended.job.ended) == (2 * BUDGET, True, "")


@pytest.mark.parametrize("by", ["pause", "kill", "crash"])
def test_a_report_that_was_interrupted_is_written_later(house, by):
    """The race has ended, and its process has not."""
    job = house.submit()
    house.tick()
    house.race(job)
    if by == "crash":
        house.crash()
    elif by == "kill":
        house.end(job, -9)
    else:
        house.jobs.pause(job)
        house.tick()
        house.end(job, 75)
        assert house.state(job) == "paused"
        house.jobs.resume(job)
    house.tick()
    assert house.started == [job, job]
    assert not house.row(job).job.ended
    house.end(job, 0)
    assert house.state(job) == "finished"
    assert house.row(job).job.ended


def test_a_report_that_takes_too_long_fails_its_job(furnished):
    house = furnished(limits=UserLimits(hours=1))
    job = house.submit()
    house.tick()
    house.race(job)
    house.tick(3700)
    house.end(job, 75)
    row = house.row(job)
    assert (row.state, row.message[:16]) == ("failed", "it has run for 1")


def test_extend_after_the_end(house):
    job = house.submit()
    house.tick()
    house.finish(job)
    with pytest.raises(NotPossible, match=f"expected a budget above {BUDGET}, found {BUDGET}"):
        house.jobs.change(job, budget=BUDGET)
    row = house.jobs.change(job, budget=2 * BUDGET)
    assert (row.state, row.job.request.budget, row.job.ended) == ("queued", 2 * BUDGET, "")
    house.tick()
    assert house.started == [job, job]


def test_extend_while_it_runs(house):
    """The race ends under the budget that it was started with, and goes on."""
    job = house.submit()
    house.tick()
    house.jobs.change(job, budget=2 * BUDGET)
    house.finish(job)
    assert house.state(job) in ("queued", "running")
    assert not house.row(job).job.ended
    house.tick()
    assert house.started == [job, job]


def test_an_extension_just_before_a_crash_is_kept(house):
    """The file of a job was written, and its row was not."""
    job = house.submit()
    house.tick()
    house.finish(job)
    row = house.row(job)
    house.jobs.change(job, budget=2 * BUDGET)
    house.index.put(row)
    house.crash()
    assert house.state(job) == "queued"


def test_the_same_for_what_was_resumed_and_shared(house):
    failed, shared = house.submit(), house.submit()
    house.tick()
    house.jobs.cancel(shared)
    house.end(failed, 1)
    rows = house.row(failed), house.row(shared)
    assert [row.state for row in rows] == ["failed", "cancelled"]
    house.jobs.resume(failed)
    house.jobs.change(shared, shared=True)
    house.index.put(*rows)
    house.crash()
    assert house.state(failed) == "queued"
    assert house.row(shared).job.shared


def test_a_failure_says_why(house):
    job = house.submit()
    house.tick()
    (house.store.folder(job) / "output.txt").write_text("Warning: hm\nError: it went wrong\nError: twice\n")
    house.end(job, 1)
    row = house.row(job)
    assert (row.state, row.message) == ("failed", "it went wrong; twice")
    assert row.job.ended
    house.jobs.resume(job)
    house.tick()
    house.end(job, 1)
    assert house.started == [job, job]


def test_a_process_that_ends_without_a_word_has_failed(house):
    job = house.submit()
    house.tick()
    house.end(job, 0)
    assert (house.state(job), house.row(job).message) == ("failed", "its process ended with code 0")


def test_three_deaths_without_progress(house):
    job = house.submit()
    for k in range(3):
        house.tick()
        assert len(house.started) == k + 1
        house.end(job, -9)
    assert (house.state(job), house.row(job).message) == ("failed", "its process was killed 3 times, by signal 9")
    house.jobs.resume(job)
    house.tick()
    house.end(job, -9)
    house.tick()
    assert len(house.started) == 5


def test_kills_by_the_service_do_not_count(house):
    job = house.submit()
    for _ in range(2):
        house.tick()
        house.jobs.pause(job)
        house.tick()
        house.tick(31)
        assert house.processes[job].is_killed
        house.tick()
        house.jobs.resume(job)
    house.tick()
    house.end(job, -9)
    assert house.state(job) in ("queued", "running")


def test_deaths_with_progress_do_not_count(house):
    job = house.submit()
    for k in range(5):
        house.tick()
        house.race(job, lines=20 + 10 * k)
        house.end(job, -9)
    house.tick()
    assert len(house.started) == 6


def test_crash_and_restart(house):
    done, half, waiting = house.submit("ann"), house.submit("bob"), house.submit("cid")
    house.tick()
    house.finish(done)
    house.tick()
    house.race(half, lines=30)
    house.crash()
    assert [house.state(one) for one in (done, half, waiting)] == ["finished", "queued", "queued"]
    house.tick()
    house.finish(house.started[-1])
    house.tick()
    house.finish(house.started[-1])
    assert [house.state(one) for one in (done, half, waiting)] == ["finished"] * 3
    assert house.started.count(done) == 1


def test_the_process_of_a_service_that_was_killed_is_waited_for(house):
    job = house.submit()
    house.tick()
    house.race(job, lines=30)
    with locked(house.store.run_folder(job)):
        house.crash()
        assert house.state(job) == "running"
        house.tick(10)
        assert house.started == [job]
        with pytest.raises(NotPossible, match="cannot delete a job that is running"):
            house.jobs.delete(job)
    house.tick(10)
    house.tick()
    assert house.started == [job, job]


def test_index_deleted_or_damaged(house):
    jobs = [house.submit(), house.submit()]
    house.tick()
    house.finish(jobs[0])
    rows = house.index.all()
    for damage in (b"", b"nonsense" * 1000, None):
        house.index.close()
        for file in house.data.glob(".service/index.sqlite*"):
            file.unlink()
        if damage is not None:
            (house.data / ".service/index.sqlite").write_bytes(damage)
        house.processes.clear()
        house.open()
        found = {row.id: (row.state, row.best, row.job.owner, row.job.submitted) for row in house.index.all()}
        assert found.keys() == {row.id for row in rows}
        assert found[jobs[0]][:2] == ("finished", rows[[row.id for row in rows].index(jobs[0])].best)


def test_disk_full_and_space_again(furnished):
    house = furnished(limits=UserLimits(free_disk=200))
    running, waiting = house.submit(), house.submit()
    house.tick()
    house.free = 10**8
    house.tick()
    assert house.processes[running].is_interrupted
    assert house.row(running).message == "stopping: the disk is nearly full"
    assert house.row(waiting).message == "waits until 200 MB are free on the disk"
    late = house.submit()
    assert house.row(late).message == "waits until 200 MB are free on the disk"
    house.end(running, 75)
    row = house.row(running)
    assert (row.state, row.message) == ("paused", "waits until 200 MB are free on the disk")
    house.tick(100)
    assert house.started == [running]
    house.free = 10**12
    house.tick(10)
    assert house.row(waiting).message == ""
    assert house.started == [running, running]


def test_races_are_looked_after_when_the_free_space_cannot_be_read(tmp_path, raced, caplog):
    class Unreadable(House):
        is_readable = True

        @property
        def free(self):
            if not self.is_readable:
                raise OSError(errno.EIO, "Input/output error")
            return 10**12

        @free.setter
        def free(self, _):
            pass

    house = Unreadable(tmp_path / "data", raced)
    job, other = house.submit(), house.submit()
    house.tick()
    house.is_readable = False
    house.finish(job)
    assert house.state(job) == "finished"
    assert house.started == [job, other]
    assert sum("Input/output error" in message for message in caplog.messages) == 1
    house.index.close()


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT])
def test_a_race_that_finds_the_disk_full_waits(house, number):
    job = house.submit()
    house.tick()
    (house.store.folder(job) / "output.txt").write_text(f"Error: x: results cannot be written: {os.strerror(number)}\n")
    house.end(job, 1)
    row = house.row(job)
    assert (row.state, row.message) == ("paused", "waits until there is space on the disk")
    house.tick()
    assert house.started == [job]
    house.tick(10)
    assert house.started == [job, job]


def test_the_end_of_a_race_is_noted_when_there_is_space(house, monkeypatch):
    """While it cannot be noted, other jobs are looked after."""
    house = House(house.data / "two", house.raced, races=2)
    first, second = house.submit("ann"), house.submit("bob")
    house.tick()

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("mercator_design.serve.records.write_text", full)
        house.race(first)
        for _ in range(5):
            house.end(first, 0)
        house.race(second, lines=30)
        house.tick()
        assert house.row(second).experiments > 0
        told = house.row(first)
        assert (told.state, told.message) == ("paused", "waits until there is space on the disk")
    house.tick()
    assert house.state(first) == "finished"
    house.index.close()


def test_a_submission_that_cannot_be_listed_is_not_kept(house, monkeypatch):
    def full(*_):
        raise sqlite3.OperationalError("database or disk is full")

    with monkeypatch.context() as patch:
        patch.setattr(house.index, "put", full)
        with pytest.raises(sqlite3.OperationalError):
            house.submit()
    assert house.store.ids() == []


def test_time_limit(furnished):
    house = furnished(limits=UserLimits(hours=1))
    job = house.submit()
    house.tick()
    house.tick(3590)
    assert not house.processes[job].is_interrupted
    house.tick(20)
    house.end(job, 75)
    row = house.row(job)
    assert row.state == "failed"
    assert row.message == "it has run for 1 h, the limit of this service; resume it to go on"
    house.jobs.resume(job)
    house.tick()
    house.tick(3000)
    assert not house.processes[job].is_interrupted


def test_the_time_limit_survives_a_crash(furnished):
    house = furnished(limits=UserLimits(hours=1))
    job = house.submit()
    house.tick()
    for _ in range(35):
        house.tick(100)
    assert house.row(job).job.seconds == 3500.0
    assert house.store.read(job).seconds == 3500.0
    house.crash()
    house.tick()
    house.tick(50)
    assert not house.processes[job].is_interrupted
    house.tick(100)
    assert house.processes[job].is_interrupted
    house.end(job, 75)
    assert house.state(job) == "failed"


def test_fair_share_between_users(furnished):
    house = furnished(races=1)
    ann = [house.submit("ann") for _ in range(3)]
    bob = [house.submit("bob") for _ in range(2)]
    urgent = house.submit("ann", priority=5)
    for _ in range(6):
        house.tick()
        house.finish(house.started[-1])
    assert house.started == [urgent, bob[0], ann[0], bob[1], ann[1], ann[2]]


def test_running_jobs_of_a_user_are_limited(furnished):
    house = furnished(races=3, limits=UserLimits(running=1))
    ann = [house.submit("ann") for _ in range(3)]
    bob = house.submit("bob")
    house.tick()
    assert sorted(house.started) == sorted([ann[0], bob])


def test_a_race_for_each_place(furnished):
    house = furnished(races=2)
    jobs = [house.submit() for _ in range(4)]
    house.tick()
    assert house.started == jobs[:2]
    house.finish(jobs[0])
    assert house.started == jobs[:3]


def test_idempotency(house):
    job = house.submit(key="k1")
    assert house.submit(key="k1") == job
    assert house.submit(key="k2") != job
    assert house.submit("bob", key="k1") != job
    with pytest.raises(NotPossible, match="the key k1 was used for another job"):
        house.submit(key="k1", budget=100)
    house.crash()
    assert house.submit(key="k1") == job


def test_jobs_of_a_user_are_limited(furnished):
    house = furnished(limits=UserLimits(jobs=2, budget=100))
    house.submit()
    job = house.submit()
    with pytest.raises(LimitReached, match="expected at most 2 jobs of ann that have not ended, found 2"):
        house.submit()
    house.submit("bob")
    house.jobs.cancel(job)
    house.submit()
    with pytest.raises(LimitReached, match="budget: expected at most 100, found 101"):
        house.submit("cid", budget=101)
    with pytest.raises(LimitReached, match="test_runs: expected at most 100, found 101"):
        house.submit(budget=60, test_runs=101)


def test_a_job_that_goes_on_is_within_the_limits(furnished):
    house = furnished(limits=UserLimits(jobs=1, disk=1))
    failed = house.submit(text="#" * 600_000)
    house.tick()
    house.end(failed, 1)
    other = house.submit(text="#" * 300_000)
    for goes_on in (lambda: house.jobs.resume(failed), lambda: house.jobs.change(failed, budget=2 * BUDGET)):
        with pytest.raises(LimitReached, match="expected at most 1 jobs of ann that have not ended, found 1"):
            goes_on()
    house.jobs.cancel(other)
    assert house.jobs.resume(failed).state == "queued"
    house.jobs.pause(failed)
    (house.store.run_folder(other)).mkdir()
    (house.store.run_folder(other) / "results.csv").write_text("#" * 200_000)
    for goes_on in (
        lambda: house.jobs.resume(failed),
        lambda: house.jobs.change(failed, budget=2 * BUDGET),
        lambda: house.jobs.check_disk("ann"),
    ):
        with pytest.raises(LimitReached, match="expected the jobs of ann to have at most 1 MB, found 1 MB"):
            goes_on()
    house.jobs.check_disk("bob")
    house.jobs.delete(other)
    assert house.jobs.resume(failed).state == "queued"


def test_a_job_that_is_submitted_while_the_disk_is_looked_at_counts(furnished, monkeypatch):
    house = furnished(limits=UserLimits(jobs=1))
    failed = house.submit()
    house.tick()
    house.end(failed, 1)
    with monkeypatch.context() as patch:
        patch.setattr(house.jobs, "check_disk", lambda _: house.submit())
        with pytest.raises(LimitReached, match="expected at most 1 jobs of ann that have not ended, found 1"):
            house.jobs.resume(failed)
    assert house.state(failed) == "failed"


def test_delete(house):
    running, done = house.submit(), house.submit()
    house.tick()
    with pytest.raises(NotPossible, match="cannot delete a job that is running"):
        house.jobs.delete(running)
    house.finish(running)
    house.jobs.delete(running)
    assert house.row(running) is None
    assert not house.store.run_folder(running).exists()
    house.crash()
    assert [row.id for row in house.index.all()] == [done]


def test_a_deletion_that_a_crash_has_interrupted_ends_at_the_next_start(house, monkeypatch):
    job = house.submit()
    house.tick()
    house.finish(job)
    with monkeypatch.context() as patch:
        patch.setattr(house.store, "_clear", lambda _: None)
        house.jobs.delete(job)
    assert house.store.run_folder(job).exists()
    house.crash()
    assert not house.store.run_folder(job).exists()
    assert house.index.all() == []
    assert [*house.data.glob(".service/jobs/*")] == []


def test_a_job_that_cannot_be_deleted_stays(house, monkeypatch):
    job = house.submit()
    house.tick()
    house.finish(job)
    before = house.state(job)

    def refused(_):
        raise OSError(errno.EACCES, "Permission denied")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "unlink", refused)
        with pytest.raises(OSError, match="Permission denied"):
            house.jobs.delete(job)
    assert house.store.read(job).owner == "ann"
    assert house.state(job) == before


def test_a_damaged_job_does_not_hold_up_others(furnished):
    house = furnished(races=2)
    waiting, running, other = house.submit("ann"), house.submit("bob"), house.submit("cid")
    (house.store.folder(waiting) / "job.json").write_text("{")
    house.tick()
    house.tick()
    assert (house.state(waiting), house.row(waiting).message) == ("failed", "the file of this job is damaged")
    assert sorted(house.started) == sorted([running, other])
    file = house.store.folder(running) / "job.json"
    before = file.read_text()
    file.write_text(json.dumps({"format": 2}))
    house.tick()
    house.finish(other)
    assert house.state(other) == "finished"
    file.write_text(before)
    house.finish(running)
    assert house.state(running) == "finished"
    house.crash()
    assert house.state(waiting) == "failed"


def test_a_job_that_is_damaged_while_it_runs_gives_its_place_to_others(house):
    damaged, other = house.submit(), house.submit()
    house.tick()
    (house.store.folder(damaged) / "job.json").write_text("{")
    house.tick()
    assert house.state(damaged) == "running"
    house.finish(damaged)
    house.tick()
    assert (house.state(damaged), house.row(damaged).message) == ("failed", "the file of this job is damaged")
    assert house.started == [damaged, other]


@pytest.mark.parametrize("is_read", [False, True])
def test_a_pipe_in_place_of_a_journal_holds_up_nothing(house, raced, is_read):
    folder = house.data / "old"
    shutil.copytree(raced, folder)
    if is_read:
        house.tick()
    (folder / "journal.jsonl").unlink()
    os.mkfifo(folder / "journal.jsonl")
    house.tick(10)
    assert house.state("old") == "failed"
    assert "found a folder, device or pipe" in house.row("old").message
    with pytest.raises(ValueError, match="expected the place of an event"):
        check_place(folder / "journal.jsonl", 100)


def test_a_damaged_journal_fails_its_job_alone(house):
    job = house.submit()
    house.race(job, lines=60)
    journal = house.store.run_folder(job) / "journal.jsonl"
    journal.write_bytes(journal.read_bytes().replace(b'"experiment"', b'"experimental"', 1))
    house.tick()
    row = house.row(job)
    assert row.state == "failed"
    assert "journal.jsonl, line" in row.message


def test_old_run_folders_are_shown(house, raced):
    shutil.copytree(raced, house.data / "old run")
    (house.data / "empty").mkdir()
    (house.data / "empty/journal.jsonl").touch()
    (house.data / "damaged").mkdir()
    first, _, third = (raced / "journal.jsonl").read_bytes().splitlines(keepends=True)[:3]
    (house.data / "damaged/journal.jsonl").write_bytes(first + b"?\n" + third)
    (house.data / "device").mkdir()
    (house.data / "device/journal.jsonl").mkdir()
    house.crash()
    rows = {row.id: row for row in house.index.all()}
    assert rows.keys() == {"old run", "damaged", "device"}
    old = rows["old run"]
    assert (old.state, old.job.owner, old.is_job, old.job.name) == ("finished", "", False, "aggregation")
    assert (old.experiments, old.job.request.budget, old.job.direction) == (BUDGET, BUDGET, "maximise")
    assert rows["damaged"].state == rows["device"].state == "failed"
    for operation in (house.jobs.pause, house.jobs.resume, house.jobs.cancel, house.jobs.delete):
        with pytest.raises(NotPossible, match="it is not a job of this service"):
            operation("old run")
    with pytest.raises(NotPossible, match="it is not a job of this service"):
        house.jobs.change("old run", budget=10**4)


def test_run_folders_come_run_and_go_while_the_service_runs(house, raced):
    folder = house.data / "new"
    shutil.copytree(raced, folder)
    journal = folder / "journal.jsonl"
    whole = journal.read_bytes()
    journal.write_bytes(b"".join(whole.splitlines(keepends=True)[:30]))
    with locked(folder):
        house.tick(5)
        assert house.state("new") == "running"
    house.tick(5)
    assert house.state("new") in ("paused", "failed")
    journal.write_bytes(whole)
    house.tick(5)
    assert house.state("new") == "finished"
    shutil.rmtree(folder)
    house.tick(5)
    assert house.row("new") is None


def test_races_of_others_are_read_on(house, raced, monkeypatch):
    """Also that of a job whose process a service that was killed has left."""
    read, read_on = Counter(), Reading.read_on

    def counted(reading):
        before = reading.length
        read_on(reading)
        read[reading.path.parent.name] += reading.length - before

    job = house.submit()
    house.tick()
    house.race(job, lines=30)
    shutil.copytree(raced, house.data / "other")
    lines = (raced / "journal.jsonl").read_bytes().splitlines(keepends=True)
    journals = [house.data / name / "journal.jsonl" for name in (job, "other")]
    journals[1].write_bytes(b"".join(lines[:30]))
    with locked(journals[0].parent), locked(journals[1].parent):
        monkeypatch.setattr(Reading, "read_on", counted)
        house.crash()
        for line in lines[30:40]:
            for journal in journals:
                with journal.open("ab") as file:
                    file.write(line)
            house.tick(5)
        length = sum(map(len, lines[:40]))
        assert read == {job: length, "other": length}
        journals[1].unlink()
        journals[1].write_bytes(b"".join(lines[:35]))
        house.tick(5)
        assert read["other"] == length + sum(map(len, lines[:35]))


def test_odd_names_of_run_folders_are_left_out(house, raced):
    shutil.copytree(raced, house.data / "a\nb")
    shutil.copytree(raced, house.data / ".hidden")
    house.crash()
    assert house.index.all() == []


def test_a_start_with_odd_values_is_damaged(house, raced):
    from mercator_design.config.checked_lines import to_line

    start = json.loads((raced / "journal.jsonl").read_text().splitlines()[0])
    start.pop("crc")
    for number, change in enumerate(
        ({"seed": 10**30}, {"name": "\ud800"}, {"name": None}, {"seed": None}, {"task": 3})
    ):
        folder = house.data / f"odd{number}"
        folder.mkdir()
        (folder / "journal.jsonl").write_text(to_line(start | change))
    house.crash()
    assert {row.id for row in house.index.all()} == {f"odd{number}" for number in range(5)}


class TestTimeLeft:
    """The remaining time, by the pace since the first experiment: before it, a race compiles."""

    @staticmethod
    def running(budget=100, n_before=0):
        status = SimpleNamespace(n_experiments=n_before)
        return RunningRace(None, None, status, None, unsaved_since=0.0, budget=budget, n_before=n_before)

    def test_it_is_that_of_the_pace_since_the_first_experiment(self):
        run = self.running(n_before=5)
        assert run.left(60.0) is None  # it compiles
        run.status.n_experiments = 10
        assert run.left(61.0) is None
        run.status.n_experiments = 19
        assert run.left(62.0) is None  # too few to tell
        run.status.n_experiments = 30
        assert run.left(63.0) == 70 * 2.0 / 20
        run.status.n_experiments = 100
        assert run.left(70.0) == 0.0
