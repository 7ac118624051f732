import contextlib
import importlib.util
import json
import logging
import os
import queue
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from mercator_design.race.executors import bundles, dask
from mercator_design.race.executors.dask import DaskExecutor
from mercator_design.race.executors.executor import Failed, WorkerUnfit, in_order
from mercator_design.race.session.events import ExperimentDone
from mercator_design.race.session.record import Record
from tests.processes import LIMIT, started, wait_until
from tests.race.executor_conformance import WorkersConformance
from tests.race.racing import runner, undisturbed
from tests.race.work import SLOW, Dies, DiesLate, DiesLoading, compiles, process_of, square, task_of

pytestmark = pytest.mark.timing

needs_jobqueue = pytest.mark.skipif(
    importlib.util.find_spec("dask_jobqueue") is None,  # importing it here would take SIGINT from pytest
    reason="dask_jobqueue is not installed",
)


@contextlib.contextmanager
def local_cluster(n_workers, allowed_failures=1):
    distributed = pytest.importorskip("distributed")
    import dask

    config = {
        "distributed.scheduler.allowed-failures": allowed_failures,
        "distributed.worker.multiprocessing-method": "forkserver",  # workers do not import Dask anew
        # A local cluster ends what replaces a dead worker if it has not registered until then.
        "distributed.deploy.lost-worker-timeout": "1 hour",
    }
    with (
        dask.config.set(config),
        distributed.LocalCluster(
            n_workers=n_workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address=":0",
            silence_logs=logging.CRITICAL,
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
            elif time.monotonic() - since > 30.0:
                cluster.scale(len(cluster.worker_spec) + 1)
                since = time.monotonic()

    thread = threading.Thread(target=watch)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


class TestConformance(WorkersConformance):
    @pytest.fixture(scope="class")
    @classmethod
    def make(cls):
        with local_cluster(2) as cluster:
            yield lambda: DaskExecutor(cluster.scheduler_address)

    @pytest.fixture(autouse=True)
    def short_bundles(self, monkeypatch):
        """Such that an item of `slow` is a task of its own."""
        monkeypatch.setattr(bundles, "BUNDLE", SLOW / 2)

    def test_quick_ones_are_handed_out_together(self, executor, monkeypatch):
        monkeypatch.setattr(bundles, "BUNDLE", LIMIT)
        assert len(set(in_order(executor, task_of, range(500)))) < 100

    def test_a_worker_is_killed_in_the_middle_of_a_race(self, executor):
        record = Record()
        for event in runner(record, executor):
            if isinstance(event, ExperimentDone) and len(record.experiments) == 50:
                os.kill(min(executor.run(process_of, [0]))[1], signal.SIGKILL)
        assert record.digest() == undisturbed().digest()


class TestDeaths:
    """Each on a cluster of its own: where workers died in one test after the other, in the end none was replaced.

    The parameters are the number of workers, and how often Dask itself repeats a task. Each death costs the seconds in
    which another worker starts.
    """

    @pytest.fixture
    def dask(self, request):
        with local_cluster(*request.param) as cluster, DaskExecutor(cluster.scheduler_address) as executor:
            yield executor

    @pytest.mark.parametrize("dask", [(1, 1)], indirect=True)
    def test_a_worker_that_dies_costs_a_repetition_and_what_kills_all_is_given_up(self, dask, tmp_path):
        """It ran again where it had killed once; those that waited for the same worker are not affected."""
        results = dict(dask.run(DiesLate(tmp_path, always=(0,)), range(6)))
        assert results[0].reason == "its workers died"
        assert {k: results[k] for k in range(1, 6)} == {k: k for k in range(1, 6)}
        assert (tmp_path / "2").exists()

    @pytest.mark.parametrize("dask", [(1, 0)], indirect=True)
    def test_one_of_many_that_were_handed_out_together_kills_its_workers(self, dask, tmp_path):
        results = dict(dask.run(Dies(tmp_path, always=(50,)), range(100)))
        assert {k for k, result in results.items() if isinstance(result, Failed)} == {50}
        assert {results[k] for k in range(100) if k != 50} == set(range(100)) - {50}


def test_a_connection_that_is_lost_and_not_closed(tmp_path, monkeypatch):
    """As of a machine that hangs: the race is told so, and can be stopped."""
    monkeypatch.setattr(dask, "SILENCE", 0.1)
    file, told = tmp_path / "scheduler.json", []

    def announce(what):
        told.append(what)
        executor.stop()

    command = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--port", "0", "--no-dashboard"]
    with started(*command, "--scheduler-file", file, stderr=subprocess.DEVNULL) as process:
        wait_until(file.exists)
        with DaskExecutor(str(file), announce=announce) as executor:
            process.send_signal(signal.SIGSTOP)
            assert list(executor.run(square, range(3))) == []
    assert told == [f"{file}: the scheduler does not answer; the race waits for it"]


class TestUnfit:
    """Workers that die as they load a function."""

    def test_no_experiment_is_the_cause(self):
        unfit = pytest.raises(WorkerUnfit, match="workers die before they have run anything")
        with local_cluster(1, 0) as cluster, DaskExecutor(cluster.scheduler_address) as executor, unfit:
            list(executor.run(DiesLoading(), range(2)))


def test_workers_that_compile_say_so_while_they_run():
    said = queue.SimpleQueue()
    with local_cluster(1) as cluster, DaskExecutor(cluster.scheduler_address, announce=said.put) as executor:
        assert dict(executor.run(compiles, range(3))) == {k: k for k in range(3)}
        assert said.get(timeout=LIMIT) == "1 worker compiles, which may take a minute"


@needs_jobqueue
def test_slurm_s_script(tmp_path):
    command = [sys.executable, str(Path(__file__).parents[2] / "docs" / "slurm.py"), "--dry-run"]
    done = subprocess.run(
        [*command, "--cores", "8", "--partition", "short"], capture_output=True, text=True, check=True, cwd=tmp_path
    )
    lines = done.stdout.splitlines()
    assert {"#SBATCH -p short", "#SBATCH --cpus-per-task=8", "#SBATCH --requeue"} <= set(lines)
    assert re.search(r"dask_worker tcp://\S+ .*--nthreads 1 .*--nworkers 8 --nanny", lines[-1])


@needs_jobqueue
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_slurm_s_jobs_end_with_what_asked_for_them(tmp_path, number):
    """Until then one that SLURM no longer knows is replaced."""
    programs = {
        "sbatch": 'echo x >> submitted; echo "Submitted batch job $(wc -l < submitted)"',
        "squeue": "tail -n +2 submitted | grep -n x | cut -d : -f 1 | sed s/^1$/2/",  # not job 1
        "scancel": 'echo "$@" >> cancelled',
    }
    for name, does in programs.items():
        (tmp_path / name).write_text(f"#!/bin/sh\n{does}\n")
        (tmp_path / name).chmod(0o755)
    command = [sys.executable, str(Path(__file__).parents[2] / "docs" / "slurm.py"), "--jobs", "1", "--cores", "1"]
    path = f"{tmp_path}{os.pathsep}{os.environ['PATH']}"
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    environment = {**os.environ, "PATH": path}
    with started(*command, "--check", "1", cwd=tmp_path, env=environment, **streams) as process:
        assert "1 jobs of 1 workers are asked for" in process.stdout.readline()
        assert json.loads((tmp_path / "scheduler.json").read_text())["address"].startswith("tcp://")
        assert process.stdout.readline() == "jobs that have ended are replaced: 1\n"
        wait_until(lambda: len((tmp_path / "submitted").read_text()) == 2 * len("x\n"))
        process.send_signal(number)
        _, told = process.communicate(timeout=LIMIT)
    assert process.returncode == 128 + number
    assert "Traceback" not in told
    assert (tmp_path / "cancelled").read_text() == "2\n"
    assert not (tmp_path / "scheduler.json").exists()
