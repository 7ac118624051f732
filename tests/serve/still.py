"""A service whose jobs move only when a test says so, and its users without a login."""

import contextlib
import shutil
from dataclasses import replace

import pytest
from starlette.testclient import TestClient

from mercator_design.race.session.journal import now
from mercator_design.serve.accounts.users import User
from mercator_design.serve.app import application
from mercator_design.serve.jobs.job import RaceRequest
from mercator_design.serve.jobs.processes import Launcher
from mercator_design.serve.jobs.supervisor import Supervisor
from mercator_design.serve.service import Service
from tests.serve.machines import As
from tests.serve.races import BUDGET, Process

ANN, BOB, ROOT = User("ann"), User("bob"), User("root", is_admin=True)


class Still:
    """The service, its application, and processes that do nothing."""

    def __init__(self, service, raced):
        self.service, self.raced, self.processes = service, raced, {}
        self.app = application(service)

    def client(self, user):
        return TestClient(As(self.app, user), base_url="http://localhost", raise_server_exceptions=False)

    def submit(self, owner="ann", *, budget=BUDGET, text=None, name="aggregation", **request):
        wanted = RaceRequest(mission="" if text else "aggregation", mission_text=text, budget=budget, **request)
        return self.service.jobs.submit(owner, name, "maximise", wanted).id

    def show(self, job, *, in_job=(), **changes):
        """Change fields of a row, and of the job in it; the job itself stays."""
        row = self.service.index.get(job)
        self.service.index.change(job, job=replace(row.job, **dict(in_job)), **changes)

    def folder(self, job):
        return self.service.store.run_folder(job)

    def race(self, job, *, lines=None):
        """Let a job have raced: to the end, or the first lines of its journal."""
        shutil.rmtree(self.folder(job), ignore_errors=True)
        shutil.copytree(self.raced, self.folder(job))
        if lines is not None:
            journal = self.folder(job) / "journal.jsonl"
            journal.write_bytes(b"".join(journal.read_bytes().splitlines(keepends=True)[:lines]))
            (self.folder(job) / "fsm.txt").unlink()
        elif job not in self.processes:
            self.service.store.update(job, ended=now())
        self.service.supervisor.refresh(job)

    def append(self, job, lines):
        """Add as many lines of the race to a job's journal as it has not."""
        journal = self.folder(job) / "journal.jsonl"
        whole, known = (self.raced / "journal.jsonl").read_bytes(), journal.stat().st_size
        more = whole[known:].splitlines(keepends=True)[:lines]
        with journal.open("ab") as file:
            file.writelines(more)
        return len(more)

    def tick(self):
        self.service.supervisor.tick()


@contextlib.contextmanager
def still(data, raced):
    """A still service on a data folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Supervisor, "start", Supervisor.reconcile)
        patch.setattr(Supervisor, "stop", lambda _: None)
        found = []
        patch.setattr(Launcher, "__call__", lambda _, job: found[0].processes.setdefault(job.id, Process()))
        with Service(data) as service:
            found.append(Still(service, raced))
            yield found[0]
