import contextlib
import functools
import os
import signal
import subprocess
import sys
import threading
import time

import joblib
import pytest

from mercator_design.race.executors.executor import CORES_OF_JOB, Failed, Items, WorkerUnfit, available_jobs, in_order
from mercator_design.race.executors.processes import ProcessExecutor
from mercator_design.race.executors.threads import ThreadExecutor
from tests.processes import LIMIT, started, wait_until
from tests.race.executor_conformance import Conformance, WorkersConformance
from tests.race.racing import measure
from tests.race.test_target import gone
from tests.race.work import Dies, DiesLoading, Hangs, begins, process_of, square, survives
from tests.tiers import some


class TestAvailableJobs:
    """A scheduler's variables limit the number of cores that are used, and do not raise it."""

    @pytest.fixture(autouse=True)
    def machine(self, monkeypatch):
        monkeypatch.setattr(joblib, "cpu_count", lambda: 64)
        for name in CORES_OF_JOB:
            monkeypatch.delenv(name, raising=False)

    @pytest.mark.parametrize("name", CORES_OF_JOB)
    def test_each_counts(self, monkeypatch, name):
        monkeypatch.setenv(name, "4")
        assert available_jobs() == 4
        assert ThreadExecutor().jobs == ProcessExecutor().jobs == 4
        monkeypatch.setenv(name, "1000")
        assert available_jobs() == 64

    def test_the_least_counts(self, monkeypatch):
        monkeypatch.setenv("SLURM_CPUS_ON_NODE", "32")
        monkeypatch.setenv("SLURM_CPUS_PER_TASK", "8")
        assert available_jobs() == 8

    @pytest.mark.parametrize("value", ["", "0", "-1", "many", "4(x2)", "\u00b2"])
    def test_what_is_no_number_is_ignored(self, monkeypatch, value):
        monkeypatch.setenv("SLURM_CPUS_PER_TASK", value)
        assert available_jobs() == 64


class TestThreads(Conformance):
    @pytest.fixture(scope="class", params=[1, 2, 5])
    @classmethod
    def make(cls, request):
        return lambda: ThreadExecutor(request.param)


class Walk:
    """Makes two steps of each item, and keeps which."""

    def __init__(self):
        self.steps_made = []

    def in_steps(self, item):
        self.steps_made.append(("prepare", item))
        yield
        self.steps_made.append(("finish", item))
        return item

    def __call__(self, item):
        self.steps_made += [("prepare", item), ("finish", item)]
        return item

    def groups(self):
        """The items whose steps were made together."""
        found = []
        for step, item in self.steps_made:
            if step == "finish":
                found[-1].append(item)
            elif not found or found[-1]:
                found.append([])
        return found


class NoGenerator:
    in_steps = 1000

    def __call__(self, item):
        return item


class TestGroups:
    """Of short items, in one thread; no time passes but by `clock`."""

    @pytest.mark.parametrize(
        ("seconds", "sizes"), [(0, [1, 8, 8, 8, 7, 4, 2, 1, 1]), (0.02, [1, 2, 2, 2]), (1, [1, 1])]
    )
    def test_they_last_at_most_a_twentieth_of_a_second_and_get_smaller_in_the_end(self, seconds, sizes):
        walk, n = Walk(), 40

        def clock():
            return seconds * sum(step == "finish" for step, _ in walk.steps_made)

        with ThreadExecutor(1, clock=clock) as executor:
            assert list(executor.run(walk, range(n))) == [(k, k) for k in range(n)]
        groups = walk.groups()
        assert [k for group in groups for k in group] == list(range(n))
        assert list(map(len, groups))[: len(sizes)] == sizes

    def test_an_item_that_is_not_known_yet_ends_one(self):
        walk = Walk()

        todo = [0, 1, 2, 3, None, 5, 6]

        def make(_):
            if not todo:
                raise StopIteration
            return todo.pop(0)

        with ThreadExecutor(1, clock=lambda: 0.0) as executor:
            results = list(executor.run(walk, Items(make, lambda: 100)))
        assert results == [(k, k) for k in (0, 1, 2, 3, 5, 6)]
        assert walk.groups() == [[0], [1, 2, 3], [5, 6]]

    def test_steps_that_cannot_begin_are_a_failure(self):
        with ThreadExecutor(1) as executor:
            ((_, found),) = executor.run(NoGenerator(), [5])
        assert isinstance(found, Failed)

    def test_others_run_one_by_one(self):
        began = []

        def items():
            for k in range(5):
                began.append(k)
                yield k

        with ThreadExecutor(1, clock=lambda: 0.0) as executor:
            for done, _ in enumerate(executor.run(square, items()), start=1):
                assert len(began) == done


@pytest.mark.swept
@pytest.mark.together
class TestProcesses(WorkersConformance):
    @pytest.fixture(scope="class", params=some([2, 1], 1))
    @classmethod
    def make(cls, request):
        return lambda: ProcessExecutor(request.param)


class TestWorkers:
    def test_one_that_dies_costs_a_repetition_and_what_kills_all_is_given_up(self, tmp_path):
        """It ran again where it had killed once; others are not affected."""
        with ProcessExecutor(2) as executor:
            results = dict(executor.run(Dies(tmp_path, always=(4,)), range(6)))
        assert results[4].reason.startswith("its worker process died, 3 times: ")
        assert {k: results[k] for k in range(6) if k != 4} == {k: k for k in range(6) if k != 4}
        assert (tmp_path / "2").exists()

    @pytest.mark.thorough
    def test_those_that_die_as_they_load_a_function_fail_no_experiment(self):
        unfit = pytest.raises(WorkerUnfit, match="workers die before they have run anything")
        with ProcessExecutor(1) as executor, unfit:
            list(executor.run(DiesLoading(), range(2)))

    @pytest.mark.thorough
    def test_one_that_dies_while_it_is_idle_is_replaced(self):
        with ProcessExecutor(1) as executor:
            found = executor.run(process_of, iter(range(3)))
            _, worker = next(found)
            (pool,) = executor._workers
            os.kill(worker, signal.SIGKILL)
            end = time.monotonic() + LIMIT
            while pool._flags.broken is None and time.monotonic() < end:
                time.sleep(0.01)
            ((_, second), (_, third)) = found
        assert second == third != worker

    @pytest.mark.thorough
    def test_what_takes_too_long(self, tmp_path):
        """Once, which may be an accident; and again. No time passes but when it hangs, during the hand-out."""

        def clock():
            return 1000.0 * sum(len(file.read_text().splitlines()) for file in tmp_path.iterdir())

        class Slow(ProcessExecutor):
            def _submit(self, *arguments):
                begin = clock()
                future = super()._submit(*arguments)
                wait_until(lambda: future.done() or clock() > begin)
                return future

        with Slow(1, timeout=500.0, clock=clock) as executor:
            results = dict(executor.run(Hangs(tmp_path, always=(4,)), range(6)))
        assert {k for k, result in results.items() if isinstance(result, Failed)} == {4}
        assert {results[k] for k in range(6) if k != 4} == {0, 1, 2, 3, 5}
        assert results[4].reason == "took longer than 500 s, 2 times"

    def test_signals_are_not_for_it_and_it_ends_with_its_executor(self):
        with ProcessExecutor(1) as executor:
            numbers = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]
            assert in_order(executor, survives, numbers) == [True, True, True]
            workers = set(in_order(executor, process_of, range(2)))
        assert all(map(gone, workers))

    @pytest.mark.thorough
    def test_workers_end_when_their_main_process_is_killed(self, tmp_path):
        script = tmp_path / "script.py"
        script.write_text(
            """
import os, time
from mercator_design.race.executors.processes import ProcessExecutor

def work(seconds):
    print(os.getpid(), flush=True)
    time.sleep(seconds)

if __name__ == "__main__":
    with ProcessExecutor(2) as executor:
        list(executor.run(work, [600, 600]))
"""
        )
        with started(sys.executable, script, stdout=subprocess.PIPE) as process:
            workers = [int(process.stdout.readline()) for _ in range(2)]
        assert len(set(workers)) == 2
        try:
            assert all(map(gone, workers))
        finally:
            for worker in workers:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(worker, signal.SIGKILL)


@pytest.mark.thorough
def test_functions_of_a_script_reach_processes(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        """
from mercator_design.race.executors.executor import in_order
from mercator_design.race.executors.processes import ProcessExecutor

def square(x):
    return x * x

if __name__ == "__main__":
    with ProcessExecutor(1) as executor:
        print(in_order(executor, square, range(5)), in_order(executor, lambda x: square(x) + 1, range(3)))
"""
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True, timeout=LIMIT)
    assert done.stdout == "[0, 1, 4, 9, 16] [1, 2, 5]\n"


@pytest.mark.parametrize("jobs", [1, 2])
def test_ctrl_c_interrupts_who_waits_for_threads(jobs):
    """A signal is for the main thread: no experiment fails by it."""
    let_go = threading.Event()

    def interrupting(item):
        if item == 0:  # one signal: a second one might come when the test is over
            os.kill(os.getpid(), signal.SIGINT)
        let_go.wait(LIMIT)

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


def test_threads_end_if_not_all_can_start(monkeypatch):
    began = []

    def start(thread, usual=threading.Thread.start):
        if len(began) == 2:
            raise RuntimeError("can't start new thread")
        began.append(thread)
        usual(thread)

    monkeypatch.setattr(threading.Thread, "start", start)
    executor = ThreadExecutor(4)
    with pytest.raises(RuntimeError, match="can't start"):
        executor.__enter__()
    for thread in began:
        thread.join(LIMIT)
    assert not any(thread.is_alive() for thread in began)


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
    barrier = threading.Barrier(3, timeout=LIMIT)
    with ThreadExecutor(3) as executor:
        assert len(in_order(executor, lambda _: barrier.wait(), range(3))) == 3


def test_measuring_in_a_race_is_a_pure_function():
    item = ((1.0, 2.0, "fast"), 5)
    assert measure(item) == measure(item)
