import pytest
from starlette.testclient import TestClient

from mercator_design.serve.http.app import guarded
from mercator_design.serve.jobs.processes import Launcher
from mercator_design.serve.service import Service


class IdleProcess:
    """The process of a race that does nothing until it is stopped."""

    def __init__(self):
        self.code = None

    def poll(self):
        return self.code

    def interrupt(self):
        self.code = 75

    def kill(self):
        self.code = -9


@pytest.fixture(scope="module")
def idle_races():
    """Jobs that are started do nothing."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Launcher, "__call__", lambda *_: IdleProcess())
        yield


@pytest.fixture(scope="module")
def service(tmp_path_factory, idle_races):
    """A service without users, whose races do nothing; the tests of a module share it."""
    with Service(tmp_path_factory.mktemp("service") / "runs") as running:
        yield running


@pytest.fixture(scope="module")
def client(service):
    """A program on the machine of the service."""
    with TestClient(guarded(service), base_url="http://localhost") as one:
        yield one
