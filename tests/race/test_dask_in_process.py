"""The rules of races on Dask, on a cluster in this process; test_dask.py has worker processes and their deaths."""

import functools
import logging
import threading

import click
import pytest

from mercator_design.cli.races.executors import executor_of
from mercator_design.cli.races.race import race
from mercator_design.errors import RaceError
from mercator_design.race.executors import dask
from mercator_design.race.executors.dask import DaskExecutor
from mercator_design.race.executors.executor import ExecutorLost, WorkerUnfit
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.race.session.events import ExperimentDone
from mercator_design.race.session.record import Record
from tests.processes import wait_until
from tests.race.executor_conformance import Conformance
from tests.race.racing import runner, undisturbed
from tests.race.work import Refused, begins, square

pytestmark = pytest.mark.together


@pytest.fixture
def cluster(request):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=getattr(request, "param", 1),
        threads_per_worker=1,
        processes=False,
        dashboard_address=":0",
        silence_logs=logging.CRITICAL,
    ) as cluster:
        yield cluster


@pytest.fixture
def executor(cluster):
    with DaskExecutor(cluster.scheduler_address) as executor:
        yield executor


class TestConformance:
    """Some of it: work that ends the program would end these workers."""

    test_every_item_has_its_result = Conformance.test_every_item_has_its_result
    test_what_fails_is_reported = Conformance.test_what_fails_is_reported_and_hurts_nothing_else
    test_items_that_end_early = Conformance.test_items_that_end_early
    test_a_race_is_the_same = Conformance.test_a_race_is_the_same


def end(cluster, _):
    cluster.close()


def close_client(_, executor):
    executor._client.close()


class TestLoss:
    @pytest.mark.parametrize("on_failure", ["stop", "reject"])
    @pytest.mark.parametrize("lose", [end, close_client])
    def test_of_a_cluster_is_no_failure_of_an_experiment(self, cluster, lose, on_failure):
        record = Record()
        with DaskExecutor(cluster.scheduler_address) as executor:
            race = runner(record, executor, on_failure=on_failure)
            for event in race:
                if isinstance(event, ExperimentDone) and len(record.experiments) == 50:
                    break
            lose(cluster, executor)
            with pytest.raises(ExecutorLost, match="lost the Dask cluster"):
                race.finish()
        assert not any(one.failure for one in record.experiments.values())
        with ThreadExecutor(1) as executor:
            runner(record, executor).finish()
        assert record.digest() == undisturbed().digest()

    def test_of_tasks_that_someone_cancels_is_none_either(self, cluster, tmp_path):
        def restart():
            wait_until((tmp_path / "began").exists)
            with cluster.get_client() as client:
                client.restart(wait_for_workers=False)

        thread = threading.Thread(target=restart)
        with DaskExecutor(cluster.scheduler_address) as executor:
            thread.start()
            with pytest.raises(ExecutorLost, match="lost the Dask cluster"):
                list(executor.run(functools.partial(begins, tmp_path), [0]))
            (tmp_path / "go").touch()
            thread.join()

    def test_what_dask_itself_cannot_run_is_not_one_either(self, cluster, monkeypatch):
        monkeypatch.setattr(dask, "_call_all", Refused())
        unfit = pytest.raises(WorkerUnfit, match=r"the scheduler or a worker cannot run this race: .*another version")
        with DaskExecutor(cluster.scheduler_address) as executor, unfit:
            list(executor.run(square, range(3)))

    def test_of_workers_with_results_that_nobody_has_fetched(self, cluster, monkeypatch):
        """A race that waits for their workers is told so, and can be stopped."""
        monkeypatch.setattr(dask, "CHECK_EVERY", 0.05)
        (worker,) = cluster.workers.values()

        async def leave(*_, **__):
            await worker.close(executor_wait=False)

        worker.handlers["get_data"] = leave
        with DaskExecutor(cluster.scheduler_address, announce=lambda _: executor.stop()) as executor:
            assert list(executor.run(square, range(2))) == []


def test_dask_logs_nothing(monkeypatch):
    """It would log tracebacks when a scheduler ends."""
    distributed = pytest.importorskip("distributed")
    loggers = [logging.getLogger(name) for name in ("distributed", "distributed.client", "tornado.application")]
    for logger in loggers:
        monkeypatch.setattr(logger, "level", logging.WARNING)
    with (
        distributed.LocalCluster(n_workers=0, processes=False, dashboard_address=":0") as cluster,
        click.Context(race),
        executor_of("dask", None, cluster.scheduler_address, None),
    ):
        assert not any(logger.isEnabledFor(logging.ERROR) for logger in loggers)


def test_no_worker_is_there(monkeypatch):
    """It is told, and nothing waits any longer once all is to stop."""
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(dask, "CHECK_EVERY", 0.05)
    told = []

    def announce(what):
        told.append(what)
        executor.stop()

    with distributed.LocalCluster(n_workers=0, dashboard_address=":0") as cluster:
        with DaskExecutor(cluster.scheduler_address, announce=announce) as executor:
            assert list(executor.run(square, range(3))) == []
        assert told == [f"{cluster.scheduler_address}: no worker is connected; the race waits for one"]


def test_nobody_there():
    pytest.importorskip("distributed")
    with pytest.raises(RaceError, match=r"tcp://127.0.0.1:9: nobody answers .*expected a Dask scheduler there"):
        DaskExecutor("tcp://127.0.0.1:9", timeout=0.5)
