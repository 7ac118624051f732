"""Races on executors of `concurrent.futures`."""

import concurrent.futures
import contextlib
import importlib.metadata
import multiprocessing
import os
import signal
import sys

import pytest

from mercator_design.errors import RaceError
from mercator_design.race.executors import futures
from mercator_design.race.executors.bundles import Bundles
from mercator_design.race.executors.executor import ExecutorLost, Failed, Items, WorkerUnfit
from mercator_design.race.executors.futures import FuturesExecutor
from mercator_design.race.session.events import ExperimentDone
from mercator_design.race.session.record import Record
from tests.processes import wait_until
from tests.race.executor_conformance import Conformance, WorkersConformance
from tests.race.racing import runner, undisturbed
from tests.race.work import SLOW, Dies, process_of, square, survives

HERE = __name__


def threads():
    return concurrent.futures.ThreadPoolExecutor(2)


def spawned(max_workers=2):
    return concurrent.futures.ProcessPoolExecutor(max_workers, mp_context=multiprocessing.get_context("spawn"))


def broken():
    raise OSError("no network")


def no_executor():
    return 5


@pytest.fixture(autouse=True)
def short_bundles(monkeypatch):
    """Such that an item of `slow` is a task of its own."""
    monkeypatch.setattr("mercator_design.race.executors.bundles.BUNDLE", SLOW / 2)


class TestThreadPool(Conformance):
    @pytest.fixture(scope="class")
    @classmethod
    def make(cls):
        return lambda: FuturesExecutor(f"{HERE}:threads")


@pytest.mark.thorough
@pytest.mark.together
class TestProcessPools(WorkersConformance):
    @pytest.fixture(scope="class", params=[f"{HERE}:spawned", "joblib.externals.loky:ProcessPoolExecutor"])
    @classmethod
    def make(cls, request):
        return lambda: FuturesExecutor(request.param, 2)

    def test_the_death_of_a_worker_is_the_loss_of_the_executor(self, make):
        """And the race is resumed."""
        record = Record()
        with make() as executor:
            race = runner(record, executor)
            for event in race:
                if isinstance(event, ExperimentDone) and len(record.experiments) == 50:
                    break
            for child in list(executor._executor._processes.values()):
                os.kill(child.pid, signal.SIGKILL)
            with pytest.raises(ExecutorLost, match="running experiments are not recorded"):
                race.finish()
        assert 50 <= len(record.experiments) < 300
        assert not any(one.failure for one in record.experiments.values())
        with make() as executor:
            runner(record, executor).finish()
        assert record.digest() == undisturbed().digest()

    def test_an_experiment_that_kills_its_worker(self, make, tmp_path):
        with make() as executor, pytest.raises(ExecutorLost):
            list(executor.run(Dies(tmp_path, always=(0,)), range(1)))

    def test_signals_are_not_for_workers(self, make):
        with make() as executor:
            numbers = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]
            assert dict(executor.run(survives, numbers)) == dict.fromkeys(range(3), True)
            assert dict(executor.run(process_of, [0]))[0] != os.getpid()

    def test_after_an_error_nothing_is_waited_for(self, make):
        with contextlib.suppress(KeyboardInterrupt), make() as executor:
            assert dict(executor.run(square, [2])) == {0: 4}
            children = list(executor._executor._processes.values())
            raise KeyboardInterrupt
        for child in children:
            wait_until(lambda child=child: not child.is_alive())  # a thread of the executor may wait for it, too


class TestNames:
    @pytest.mark.parametrize(
        ("name", "message"),
        [
            ("fairies", r"expected threads, .*, found 'fairies'"),
            (":make", "found ':make'"),
            ("no.such.module:make", "executor no.such.module:make: cannot be imported: ModuleNotFoundError"),
            (f"{HERE}:nothing", "cannot be imported: AttributeError"),
            (f"{HERE}:HERE", "expected a function or class"),
            (f"{HERE}:broken", "cannot be made: OSError: no network"),
            (f"{HERE}:no_executor", "expected an executor of concurrent.futures"),
        ],
    )
    def test_those_that_name_no_executor_are_refused(self, name, message):
        with pytest.raises(RaceError, match=message):
            FuturesExecutor(name)

    def test_an_entry_point_is_one(self, monkeypatch):
        mine = importlib.metadata.EntryPoint("mine", f"{HERE}:threads", futures.GROUP)
        monkeypatch.setattr(futures, "entry_points", lambda group: [mine] if group == futures.GROUP else [])
        with FuturesExecutor("mine") as executor:
            assert executor.jobs == 2
            assert dict(executor.run(square, range(3))) == {0: 0, 1: 1, 2: 4}
        with pytest.raises(RaceError, match="entry points found: mine"):
            FuturesExecutor("yours")

    def test_a_module_may_be_in_the_current_folder(self, tmp_path, monkeypatch):
        (tmp_path / "my_cluster_of_tests.py").write_text(
            "from concurrent.futures import ThreadPoolExecutor\n\ndef four():\n    return ThreadPoolExecutor(4)\n"
        )
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr("sys.path", [*sys.path])
        with FuturesExecutor("my_cluster_of_tests:four") as executor:
            assert executor.jobs == 4

    def test_jobs_are_given_to_those_that_take_them(self):
        with FuturesExecutor("concurrent.futures:ThreadPoolExecutor", 3) as executor:
            assert executor.jobs == executor._executor._max_workers == 3
        with FuturesExecutor(f"{HERE}:threads", 5) as executor:
            assert (executor.jobs, executor._executor._max_workers) == (5, 2)


class Gone(concurrent.futures.ThreadPoolExecutor):
    """Its worker cannot be reached."""

    def submit(self, *_, **__):
        future = concurrent.futures.Future()
        future.set_exception(self.error)
        return future


class Unfit(Gone):
    error = ModuleNotFoundError("No module named 'mercator_design'")


class Shut(concurrent.futures.ThreadPoolExecutor):
    def submit(self, *_, **__):
        raise RuntimeError("cannot schedule new futures after shutdown")


@pytest.mark.parametrize(("name", "error"), [("Unfit", WorkerUnfit), ("Shut", ExecutorLost)])
def test_what_an_executor_cannot_run_is_no_failure_of_an_experiment(name, error):
    with FuturesExecutor(f"{HERE}:{name}", 1) as executor, pytest.raises(error, match=f"executor {HERE}:{name}"):
        list(executor.run(square, range(3)))


class TestBundles:
    """Of `n` items that are known and others that may come, for workers with two bundles each."""

    def items(self, n, more=10**6):
        left = [*range(n)]

        def make(place):
            if left:
                return left.pop(0)
            if place >= n + more:
                return None
            return -place

        return Items(make, lambda: len(left))

    def test_of_unknown_length_are_single(self):
        assert list(map(len, Bundles(self.items(100), seconds=0.2).draw(0, 8))) == [1] * 8

    def test_last_as_long_as_allowed_or_are_shares_of_what_is_left(self):
        bundles = Bundles(self.items(100), seconds=0.2)
        bundles.took(0.1, 10)
        first = bundles.draw(0, 8)
        assert list(map(len, first)) == [13] * 4 + [12] * 4
        assert sorted(place for bundle in first for place, _ in bundle) == [*range(100)]
        bundles = Bundles(self.items(1000), seconds=0.2)
        bundles.took(0.1, 10)
        assert list(map(len, bundles.draw(0, 8))) == [20] * 8
        assert list(map(len, bundles.draw(7, 8))) == [20]

    def test_what_is_not_asked_for_fills_workers_that_have_nothing(self):
        bundles = Bundles(self.items(2), seconds=0.2)
        bundles.took(0.1, 10)
        drawn = bundles.draw(0, 8)
        assert list(map(len, drawn)) == [1, 1, 2, 2]
        assert bundles.draw(4, 8) == []
        assert Bundles(self.items(0, more=0)).draw(0, 8) == []


def test_a_failure_is_one_of_its_item():
    with FuturesExecutor(f"{HERE}:threads") as executor:
        results = dict(executor.run(lambda x: 1 / x, range(3)))
    assert isinstance(results.pop(0), Failed)
    assert results == {1: 1.0, 2: 0.5}
