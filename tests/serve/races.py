"""Races of a service under test: processes that a test ends as it likes."""

import shutil
from dataclasses import fields

from mercator_design.race.session.journal import Journal
from mercator_design.serve.jobs.index import Index, IndexRow
from mercator_design.serve.jobs.job import Job, RaceRequest
from mercator_design.serve.jobs.operations import Operations
from mercator_design.serve.jobs.store import Store
from mercator_design.serve.jobs.supervisor import Supervisor
from mercator_design.serve.settings import SERVICE, ServiceSettings, UserLimits


def row_of(identity, owner="ann", *, state="queued", **given):
    """A row of the index with some of its fields, of those of its job, and of those of its request."""

    def of(kind, **usual):
        return kind(**usual | {one.name: given.pop(one.name) for one in fields(kind) if one.name in given})

    request = of(RaceRequest, mission="aac", budget=0)
    job = of(Job, id=identity, owner=owner, name="aac", direction="maximise", request=request, submitted="")
    return IndexRow(job=job, state=state, **given)


BUDGET = 60
"""Of the race that the fixture `raced` has run."""


class Process:
    """A process of a race that does what the test says."""

    def __init__(self):
        self.code, self.is_interrupted, self.is_killed = None, False, False

    def poll(self):
        return self.code

    def terminate(self):
        self.is_interrupted = True

    def kill(self):
        self.is_killed = True
        self.code = -9


class House:
    """The parts of a service without its processes: the test says what time it is and how much of the disk is free."""

    def __init__(self, data, raced, **settings):
        self.data, self.raced = data, raced
        self.limits = settings.pop("limits", UserLimits())
        self.settings = ServiceSettings(limits=self.limits, **settings)
        self.time, self.free = 0.0, 10**12
        self.processes, self.started = {}, []
        self.open()

    def open(self):
        """Begin, as after a start of the service."""
        self.store = Store(self.data)
        self.store.finish_deletions()
        self.index = Index(self.data / SERVICE / "index.sqlite")
        self.supervisor = Supervisor(
            self.store, self.index, self.settings, self._launch, clock=lambda: self.time, free=lambda: self.free
        )
        self.jobs = Operations(self.store, self.index, self.supervisor, self.limits)
        self.supervisor.reconcile()

    def crash(self):
        """Go without a word, and begin again; the processes of races are gone."""
        self.index.close()
        self.processes.clear()
        self.open()

    def submit(self, owner="ann", *, name="aggregation", budget=BUDGET, text=None, key="", **request):
        """The identity of a new job."""
        wanted = RaceRequest(mission="" if text else name, mission_text=text, budget=budget, **request)
        return self.jobs.submit(owner, name, "maximise", wanted, key).id

    def _launch(self, job):
        self.started.append(job.id)
        self.processes[job.id] = Process()
        return self.processes[job.id]

    def tick(self, seconds=1.0):
        self.time += seconds
        self.supervisor.tick()

    def row(self, identity):
        return self.index.get(identity)

    def state(self, identity):
        return self.row(identity).state

    def race(self, identity, *, lines=None):
        """Let a job have raced: to the end, or the first lines of its journal."""
        folder = self.store.run_folder(identity)
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(self.raced, folder)
        if lines is not None:
            journal = folder / "journal.jsonl"
            journal.write_bytes(b"".join(journal.read_bytes().splitlines(keepends=True)[:lines]))
            (folder / "fsm.txt").unlink()

    def end(self, identity, code=0):
        """End the process of a job."""
        self.processes[identity].code = code
        self.tick()

    def finish(self, identity):
        """Let a job have raced to the end."""
        self.race(identity)
        self.end(identity)


def locked(folder):
    """The journal of a run folder, locked as by a process that runs its race."""
    return Journal(folder / "journal.jsonl", new=False)
