"""What holds of everything that runs experiments: one class of tests for all, and what some of them can besides."""

import contextlib
import functools
import importlib.util
import logging
import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from mercator_design.errors import MissionError, RaceError
from mercator_design.race.running import dask_executor
from mercator_design.race.running.dask_executor import BUNDLE, DaskExecutor
from mercator_design.race.running.events import ExperimentDone
from mercator_design.race.running.executors import (
    ExecutorStopped,
    Failed,
    ProcessExecutor,
    ThreadExecutor,
    WorkerUnfit,
    in_order,
)
from mercator_design.race.running.record import Record
from tests.race.racing import measure, runner, undisturbed
from tests.race.test_target import gone

needs_jobqueue = pytest.mark.skipif(
    importlib.util.find_spec("dask_jobqueue") is None,  # importing it here would take SIGINT from pytest
    reason="dask_jobqueue is not installed",
)


def square(x):
    time.sleep(0.01 * (x % 3 == 0))
    return x * x


def slow(x):
    """Too slow for several to be handed to a worker at once."""
    time.sleep(0.6 * BUNDLE)
    return x


def fails(x):
    if x == 3:
        raise MissionError("three is not allowed")
    if x == 4:
        return 1 / 0
    if x == 5:
        raise Stubborn(lambda: None)
    return x


class Stubborn(Exception):  # noqa: N818
    """Cannot be carried to another process."""


class Leave(BaseException):
    """As a library may have it."""


class Mute(Exception):  # noqa: N818
    """Cannot say what is wrong."""

    def __str__(self):
        raise ValueError


def leaves(x):
    """Raises what would end a program."""
    match x:
        case 1:
            sys.exit(0)
        case 2:
            raise KeyboardInterrupt
        case 3:
            raise Leave("now")
        case 4:
            raise Mute
    return x


class Dies:
    """Kills its process at some items: always, or as long as a file is not there."""

    def __init__(self, folder, *, always):
        self.folder = folder
        self.always = always

    def __call__(self, x):
        if x in self.always:
            os.kill(os.getpid(), signal.SIGKILL)
        mark = self.folder / str(x)
        if x == 2 and not mark.exists():
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return x


class DiesLate(Dies):
    """When others wait for the same worker."""

    def __call__(self, x):
        time.sleep(0.3)
        return super().__call__(x)


class Hangs(Dies):
    """The same, but it never ends."""

    def __call__(self, x):
        mark = self.folder / str(x)
        if x in self.always or (x == 2 and not mark.exists()):
            with mark.open("a") as marks:
                marks.write("hangs\n")
            time.sleep(600)
        return x


@pytest.fixture
def make(request):
    return request.getfixturevalue("dask") if request.param == "dask" else request.param


@contextlib.contextmanager
def local_cluster():
    distributed = pytest.importorskip("distributed")
    import dask

    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 2}),  # another worker takes seconds to start
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=logging.CRITICAL
        ) as cluster,
        kept_alive(cluster),
    ):
        yield cluster


@contextlib.contextmanager
def kept_alive(cluster):
    """Start a worker when there has been none for some seconds: Dask gives up one that dies while it starts."""
    over = threading.Event()

    def watch():
        since = time.monotonic()
        while not over.wait(0.5):
            if cluster.scheduler.workers:
                since = time.monotonic()
            elif time.monotonic() - since > 10.0:
                cluster.scale(len(cluster.worker_spec) + 1)
                since = time.monotonic()

    thread = threading.Thread(target=watch)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


@pytest.fixture(scope="module")
def cluster():
    with local_cluster() as cluster:
        yield cluster


@pytest.fixture
def dask(cluster):
    return lambda: DaskExecutor(cluster.scheduler_address)


THREADS = [pytest.param(lambda n=n: ThreadExecutor(n), id=f"{n} threads") for n in (1, 2, 5)]
PROCESSES = [pytest.param(lambda n=n: ProcessExecutor(n), id=f"{n} processes") for n in (1, 2)]


@pytest.mark.parametrize("make", [*THREADS, *PROCESSES, "dask"], indirect=True)
class TestConformance:
    def test_every_item_has_its_result(self, make):
        with make() as executor:
            for _ in range(2):  # and the executor can be used again
                assert dict(executor.run(square, range(50))) == {k: k * k for k in range(50)}
            assert list(executor.run(square, [])) == []
            assert in_order(executor, square, range(7)) == [0, 1, 4, 9, 16, 25, 36]

    def test_what_fails_is_told_and_hurts_nothing_else(self, make):
        with make() as executor:
            results = dict(executor.run(fails, range(8)))
            failed = {k: result for k, result in results.items() if isinstance(result, Failed)}
            assert {k: failure.reason.partition(":")[0] for k, failure in failed.items()} == {
                3: "MissionError", 4: "ZeroDivisionError", 5: "Stubborn",
            }  # fmt: skip
            assert isinstance(failed[3].error, MissionError)
            assert str(failed[3].error) == "three is not allowed"
            assert {k: result for k, result in results.items() if k not in failed} == {k: k for k in (0, 1, 2, 6, 7)}
            with pytest.raises(MissionError, match="three is not allowed"):
                in_order(executor, fails, range(4))

    def test_what_would_end_the_program_is_a_failure_too(self, make):
        with make() as executor:
            for _ in range(2):  # and no thread or worker is missing afterwards
                results = dict(executor.run(leaves, range(8)))
                failed = {k: result.reason for k, result in results.items() if isinstance(result, Failed)}
                assert failed == {1: "SystemExit: 0", 2: "KeyboardInterrupt", 3: "Leave: now", 4: "Mute"}
                assert {k: result for k, result in results.items() if k not in failed} == {k: k for k in (0, 5, 6, 7)}
            with pytest.raises(RaceError, match="an experiment failed: SystemExit: 0"):
                in_order(executor, leaves, range(2))

    def test_items_are_drawn_when_there_is_room(self, make):
        drawn = []

        def items():
            for k in range(12):
                drawn.append(k)
                yield k

        with make() as executor:
            for done, _ in enumerate(executor.run(slow, items()), start=1):
                assert len(drawn) - done <= 2 * executor.jobs

    def test_there_may_be_nothing_to_run_until_something_has_finished(self, make):
        todo, found = [0], []

        def items():
            while len(found) < 20:
                yield todo.pop() if todo else None

        with make() as executor:
            for _, result in executor.run(square, items()):
                found.append(result)
                todo.append(len(found))
        assert found[:20] == [k * k for k in range(20)]

    def test_items_that_end_early(self, make):
        """What is under way is still given."""
        stopped = False

        def items():
            for k in range(100):
                if stopped:
                    return
                drawn.add(k)
                yield k

        drawn, found = set(), set()
        with make() as executor:
            for k, _ in executor.run(slow, items()):
                found.add(k)
                stopped = len(found) > 10
        assert found == drawn
        assert len(found) < 40

    def test_a_caller_that_goes_away(self, make):
        with contextlib.suppress(RaceError), make() as executor:
            next(executor.run(square, range(1000)))
            raise RaceError("enough")
        with make() as executor:
            results = executor.run(square, range(1000))
            next(results)
            results.close()
            assert dict(executor.run(fails, range(3))) == {0: 0, 1: 1, 2: 2}  # not what was under way before

    def test_a_race_is_the_same(self, make):
        expected = undisturbed()
        record = Record()
        with make() as executor:
            runner(record, executor).finish()
        assert record.digest() == expected.digest()
        assert record.ends == expected.ends

    def test_a_race_that_is_stopped_keeps_what_was_under_way(self, make):
        record = Record()
        with make() as executor, pytest.raises(ExecutorStopped):
            runner(record, executor, stopped=lambda: len(record.experiments) > 50).finish()
        assert 50 < len(record.experiments) < 70
        with make() as executor:
            runner(record, executor).finish()
        assert record.digest() == undisturbed().digest()


def refuse():
    raise ValueError("another version")


class Refused:
    def __call__(self, x):
        return x

    def __reduce__(self):
        return refuse, ()


@pytest.mark.parametrize("make", [*PROCESSES, "dask"], indirect=True)
def test_a_worker_that_cannot_run_it_is_no_failure_of_an_experiment(make):
    with make() as executor:
        with pytest.raises(
            WorkerUnfit, match=r"a worker \(process .* cannot run this race: ValueError: another version"
        ):
            list(executor.run(Refused(), range(5)))
        assert in_order(executor, square, range(3)) == [0, 1, 4]


def test_functions_of_a_script_reach_processes(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        """
from mercator_design.race.running.executors import ProcessExecutor, in_order

def square(x):
    return x * x

if __name__ == "__main__":
    with ProcessExecutor(2) as executor:
        print(in_order(executor, square, range(5)), in_order(executor, lambda x: square(x) + 1, range(3)))
"""
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout == "[0, 1, 4, 9, 16] [1, 2, 5]\n"


class TestProcesses:
    def test_a_worker_that_dies_costs_a_repetition(self, tmp_path):
        with ProcessExecutor(2) as executor:
            assert dict(executor.run(Dies(tmp_path, always=()), range(6))) == {k: k for k in range(6)}
        assert (tmp_path / "2").exists()

    def test_what_kills_all_its_workers_is_given_up(self, tmp_path):
        with ProcessExecutor(2) as executor:
            results = dict(executor.run(Dies(tmp_path, always=(1, 4)), range(6)))
        assert {k for k, result in results.items() if isinstance(result, Failed)} == {1, 4}
        assert results[1].reason.startswith("its worker process died, 3 times: ")
        assert {results[k] for k in (0, 2, 3, 5)} == {0, 2, 3, 5}

    def test_what_takes_too_long(self, tmp_path):
        """Once, which may be an accident; and again. No time passes but when something hangs."""

        def clock():
            return 1000.0 * sum(len(file.read_text().splitlines()) for file in tmp_path.iterdir())

        with ProcessExecutor(1, timeout=500.0, clock=clock) as executor:
            results = dict(executor.run(Hangs(tmp_path, always=(4,)), range(6)))
        assert {k for k, result in results.items() if isinstance(result, Failed)} == {4}
        assert {results[k] for k in range(6) if k != 4} == {0, 1, 2, 3, 5}
        assert results[4].reason == "took longer than 500 s, 2 times"

    def test_no_worker_is_left(self):
        with ProcessExecutor(2) as executor:
            workers = set(in_order(executor, process_of, range(10)))
        assert all(map(gone, workers))

    def test_signals_are_for_the_main_process(self):
        with ProcessExecutor(1) as executor:
            numbers = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]
            assert in_order(executor, survives, numbers) == [True, True, True]

    def test_workers_end_when_their_main_process_is_killed(self, tmp_path):
        script = tmp_path / "script.py"
        script.write_text(
            """
import os, time
from mercator_design.race.running.executors import ProcessExecutor

def work(seconds):
    print(os.getpid(), flush=True)
    time.sleep(seconds)

if __name__ == "__main__":
    with ProcessExecutor(2) as executor:
        list(executor.run(work, [600, 600]))
"""
        )
        with subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, text=True) as process:
            workers = [int(process.stdout.readline()) for _ in range(2)]
            process.kill()
        assert len(set(workers)) == 2
        try:
            assert all(map(gone, workers))
        finally:
            for worker in workers:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(worker, signal.SIGKILL)


class TestDask:
    @pytest.fixture
    def dask(self):
        """Of a cluster of its own: where workers died in one test after the other, in the end none was replaced."""
        with local_cluster() as cluster:
            yield lambda: DaskExecutor(cluster.scheduler_address)

    def test_a_worker_that_dies_costs_a_repetition(self, dask, tmp_path):
        with dask() as executor:
            assert dict(executor.run(Dies(tmp_path, always=()), range(6))) == {k: k for k in range(6)}

    def test_what_kills_all_its_workers_is_given_up(self, dask, tmp_path):
        with dask() as executor:
            results = dict(executor.run(Dies(tmp_path, always=(4,)), range(6)))
        assert {k for k, result in results.items() if isinstance(result, Failed)} == {4}
        assert results[4].reason == "its workers died"

    def test_those_that_were_on_the_same_worker_are_innocent(self, dask, tmp_path):
        with dask() as executor:
            results = dict(executor.run(DiesLate(tmp_path, always=(0,)), range(6)))
        assert {k for k, result in results.items() if isinstance(result, Failed)} == {0}
        assert {results[k] for k in range(1, 6)} == set(range(1, 6))

    def test_one_of_many_that_were_handed_out_together_kills_its_workers(self, dask, tmp_path):
        with dask() as executor:
            results = dict(executor.run(Dies(tmp_path, always=(150,)), range(300)))
        assert {k for k, result in results.items() if isinstance(result, Failed)} == {150}
        assert {results[k] for k in range(300) if k != 150} == set(range(300)) - {150}

    def test_quick_ones_are_handed_out_together(self, dask, monkeypatch):
        with dask() as executor:
            handed_out = []
            submit = executor._client.submit
            monkeypatch.setattr(
                executor._client, "submit", lambda *given, **how: (handed_out.append(given), submit(*given, **how))[1]
            )
            assert in_order(executor, int, range(1000)) == list(range(1000))
        assert len(handed_out) < 200

    def test_a_worker_is_killed_in_the_middle_of_a_race(self, dask):
        record = Record()
        with dask() as executor:
            for event in runner(record, executor):
                if isinstance(event, ExperimentDone) and len(record.experiments) == 50:
                    os.kill(min(executor.run(process_of, [0]))[1], signal.SIGKILL)
        assert record.digest() == undisturbed().digest()

    def test_no_worker_is_there(self, monkeypatch):
        """It is told, and nothing waits any longer once all is to stop."""
        distributed = pytest.importorskip("distributed")
        monkeypatch.setattr(dask_executor, "LOOK_EVERY", 0.05)
        told = []

        def announce(what):
            told.append(what)
            executor.stop()

        with distributed.LocalCluster(n_workers=0, dashboard_address=":0") as cluster:
            with DaskExecutor(cluster.scheduler_address, announce=announce) as executor:
                assert list(executor.run(square, range(3))) == []
            assert told == [f"{cluster.scheduler_address}: no worker is connected; the race waits for one"]

    def test_nobody_there(self):
        pytest.importorskip("distributed")
        with pytest.raises(RaceError, match=r"tcp://127.0.0.1:9: expected a Dask scheduler there"):
            DaskExecutor("tcp://127.0.0.1:9", timeout=0.5)

    @needs_jobqueue
    def test_slurm_s_script(self, tmp_path):
        command = [sys.executable, str(Path(__file__).parents[2] / "docs" / "slurm.py"), "--dry-run"]
        done = subprocess.run(
            [*command, "--cores", "8", "--partition", "short"], capture_output=True, text=True, check=True, cwd=tmp_path
        )
        lines = done.stdout.splitlines()
        assert {"#SBATCH -p short", "#SBATCH --cpus-per-task=8", "#SBATCH --requeue"} <= set(lines)
        assert re.search(r"dask_worker tcp://\S+ .*--nthreads 1 .*--nworkers 8 --nanny", lines[-1])

    @needs_jobqueue
    @pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
    def test_slurm_s_jobs_end_with_what_asked_for_them(self, tmp_path, number):
        for name, does in {"sbatch": 'echo "Submitted batch job 7"', "scancel": 'echo "$@" >> cancelled'}.items():
            (tmp_path / name).write_text(f"#!/bin/sh\n{does}\n")
            (tmp_path / name).chmod(0o755)
        command = [sys.executable, str(Path(__file__).parents[2] / "docs" / "slurm.py"), "--jobs", "1", "--cores", "1"]
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path,
            env={**os.environ, "PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"},
        ) as process:  # fmt: skip
            assert "1 jobs of 1 workers are asked for" in process.stdout.readline()
            process.send_signal(number)
            _, told = process.communicate(timeout=60)
        assert process.returncode == 128 + number
        assert "Traceback" not in told
        assert (tmp_path / "cancelled").read_text() == "7\n"


def process_of(_):
    return os.getpid()


def begins(folder, _):
    """Takes half a minute, unless it is let go."""
    (folder / "began").touch()
    end = time.monotonic() + 30
    while not (folder / "go").exists() and time.monotonic() < end:
        time.sleep(0.01)
    if time.monotonic() >= end:
        (folder / "ended").touch()


def survives(number):
    os.kill(os.getpid(), number)
    return True


@pytest.mark.parametrize("jobs", [1, 2])
def test_ctrl_c_interrupts_who_waits_for_threads(jobs):
    """A signal is for the main thread: no experiment fails by it."""
    let_go = threading.Event()

    def interrupting(_):
        os.kill(os.getpid(), signal.SIGINT)
        let_go.wait(60)

    with pytest.raises(KeyboardInterrupt), ThreadExecutor(jobs) as executor:
        list(executor.run(interrupting, range(3)))
    let_go.set()


@pytest.mark.parametrize("make", [lambda: ThreadExecutor(1), lambda: ProcessExecutor(1)])
def test_a_signal_ends_a_wait_that_it_does_not_interrupt(make, tmp_path):
    """As one does that comes just before the wait: here another thread takes it."""

    def terminated(*_):
        raise Terminated

    class Terminated(BaseException):
        pass

    def take():
        while not (tmp_path / "began").exists():
            time.sleep(0.01)
        time.sleep(0.2)
        signal.pthread_kill(threading.get_ident(), signal.SIGUSR1)

    usual, thread = signal.signal(signal.SIGUSR1, terminated), threading.Thread(target=take)
    try:
        with make() as executor:
            thread.start()
            with pytest.raises(Terminated):
                list(executor.run(functools.partial(begins, tmp_path), [0]))
            (tmp_path / "go").touch()
        thread.join()
    finally:
        signal.signal(signal.SIGUSR1, usual)
    assert not (tmp_path / "ended").exists()


def test_one_that_was_not_entered_says_so():
    """It would wait for ever."""
    with pytest.raises(RuntimeError, match="expected to be entered"):
        list(ThreadExecutor(1).run(square, [1]))


def test_one_job_runs_nothing_ahead():
    drawn = []

    def items():
        for k in range(5):
            drawn.append(k)
            yield k

    with ThreadExecutor(1) as executor:
        for done, _ in enumerate(executor.run(square, items()), start=1):
            assert len(drawn) == done


def test_threads_run_at_once():
    barrier = threading.Barrier(3, timeout=30)
    with ThreadExecutor(3) as executor:
        assert len(in_order(executor, lambda _: barrier.wait(), range(3))) == 3


def test_measuring_in_a_race_is_a_pure_function():
    item = ((1.0, 2.0, "fast"), 5)
    assert measure(item) == measure(item)
