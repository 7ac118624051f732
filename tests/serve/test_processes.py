"""The processes that run the races of jobs."""

import os
import sys
from pathlib import Path

import pytest

from mercator_design.serve.jobs.processes import Launcher, last_messages
from mercator_design.serve.jobs.store import OUTPUT
from tests.processes import wait_until
from tests.race.test_dask import local_cluster


def test_a_race_has_its_own_group_in_the_session_of_the_service(house, tmp_path, monkeypatch):
    """So Ctrl-C does not reach it, and it leaves the processor to the service."""
    python = tmp_path / "python"
    python.write_text('#!/bin/sh\nread -r line < /proc/$$/stat\necho "$line" >&2\n', encoding="ascii")
    python.chmod(0o700)
    monkeypatch.setattr(sys, "executable", str(python))
    job = house.store.read(house.submit())
    process = Launcher(house.store, house.settings, 1)(job)
    wait_until(lambda: process.poll() is not None)
    identity, _, _, _, group, session, *_ = last_messages(house.store.folder(job.id) / OUTPUT).split()
    assert group == identity != str(os.getpgrp())
    assert session == str(os.getsid(0))


def test_its_arguments_do_not_say_where_the_data_are(house, monkeypatch, tmp_path):
    (python := tmp_path / "python").write_text("#!/bin/sh\npwd >&2\n", encoding="ascii")
    python.chmod(0o700)
    monkeypatch.setattr(sys, "executable", str(python))
    job = house.store.read(house.submit(text="name: x\n"))
    launch = Launcher(house.store, house.settings, 1)
    process = launch(job)
    wait_until(lambda: process.poll() is not None)
    _, mission, _, run, *_ = arguments = launch.command(job)
    assert not any(str(house.data) in one for one in arguments)
    place = Path(last_messages(house.store.folder(job.id) / OUTPUT).strip())
    assert (place / mission).read_text() == "name: x\n"
    assert place / run == house.store.run_folder(job.id)


@pytest.mark.timing
def test_a_cluster_runs_the_experiments(furnished, raced, monkeypatch):
    """The race is that of one machine."""
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")  # experiments take less time than to load compiled code
    with local_cluster(1) as cluster:
        house = furnished(scheduler=cluster.scheduler_address)
        job = house.store.read(house.submit(set=("duration=2", "robots=2")))
        process = Launcher(house.store, house.settings, 1)(job)
        wait_until(lambda: process.poll() is not None)
    output, run = house.store.folder(job.id) / OUTPUT, house.store.run_folder(job.id)
    assert process.poll() == 0, last_messages(output)
    assert (run / "results.csv").read_bytes() == (raced / "results.csv").read_bytes()
    assert '"executor": "dask"' in (run / "provenance.json").read_text()
