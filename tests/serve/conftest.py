import subprocess
from datetime import UTC, datetime, timedelta

import pytest
from starlette.testclient import TestClient

from mercator_design.serve.app import guarded
from mercator_design.serve.jobs.processes import Launcher
from mercator_design.serve.service import Service
from mercator_design.serve.settings import ServiceSettings
from mercator_design.serve.workers.pool import WorkerPool
from tests.processes import LIMIT
from tests.serve.races import BUDGET, House
from tests.serve.serving import serving
from tests.serve.still import ANN, BOB, still


class IdleProcess:
    """The process of a race that does nothing until it is stopped."""

    def __init__(self):
        self.code = None

    def poll(self):
        return self.code

    def terminate(self):
        self.code = 75

    def kill(self):
        self.code = -9


class Clock:
    """A time that stands still until a test changes it."""

    def __init__(self):
        self.seconds = 0.0

    def __call__(self):
        return self.seconds

    def now(self):
        return datetime(2030, 1, 1, tzinfo=UTC) + timedelta(seconds=self.seconds)


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture(scope="session")
def certificate(tmp_path_factory):
    """A certificate and its key, and another key with a passphrase."""
    folder = tmp_path_factory.mktemp("tls")
    names = (folder / "cert.pem", folder / "key.pem")
    new = ("openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", "2")
    subject = ("-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost")
    subprocess.run([*new, *subject, "-out", names[0], "-keyout", names[1]], check=True, capture_output=True)
    locked = ("openssl", "ec", "-aes256", "-passout", "pass:x", "-in", names[1], "-out", folder / "locked.pem")
    subprocess.run(locked, check=True, capture_output=True)
    return names


class SharedPool:
    """A pool that outlives its services."""

    def __init__(self, pool):
        self.run = pool.run

    def check_extensions(self):
        pass

    def close(self):
        pass


@pytest.fixture(scope="session", autouse=True)
def shared_workers(tmp_path_factory):
    """Services with the usual settings share one worker, slow to start; it has time on a busy machine."""
    usual = ServiceSettings()
    limits = (usual.workers, usual.worker_seconds, usual.worker_memory, usual.extensions)
    pool = WorkerPool(1, LIMIT, usual.worker_memory, usual.extensions, tmp_path_factory.mktemp("workers"))

    def pool_of(*given):
        return SharedPool(pool) if given[:-1] == limits else WorkerPool(*given)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mercator_design.serve.service.WorkerPool", pool_of)
        patch.setattr("mercator_design.serve.workers.pool.MAX_WAIT", LIMIT)
        yield
    pool.close()


@pytest.fixture(scope="module")
def idle_races():
    """Jobs that are started do nothing."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Launcher, "__call__", lambda *_: IdleProcess())
        yield


@pytest.fixture(scope="module")
def plain_races():
    """Races run in plain Python: when they are short, that takes less time than to load compiled code."""
    launch = Launcher.__call__

    def launch_plain(launcher, job):
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("NUMBA_DISABLE_JIT", "1")
            return launch(launcher, job)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Launcher, "__call__", launch_plain)
        yield


@pytest.fixture(scope="module")
def service(tmp_path_factory, idle_races):
    """A service without users, whose races do nothing; the tests of a module share it."""
    with Service(tmp_path_factory.mktemp("service") / "runs") as running:
        yield running


@pytest.fixture(scope="module")
def address(service):
    """The address of the service, for browsers."""
    with serving(guarded(service)) as one:
        yield one


@pytest.fixture(scope="module")
def client(service):
    """A program on the machine of the service."""
    with TestClient(guarded(service), base_url="http://localhost") as one:
        yield one


@pytest.fixture(scope="session")
def raced(mdesign_once, tmp_path_factory):
    """The run folder of a small race that has ended."""
    folder = tmp_path_factory.mktemp("raced") / "old"
    mission = ("aggregation", "--set", "duration=2", "--set", "robots=2")
    mdesign_once("race", *mission, "--budget", BUDGET, "--jobs", "1", "-o", folder, "--quiet")
    return folder


@pytest.fixture
def house(tmp_path, raced):
    """The parts of a service, without processes."""
    house = House(tmp_path / "data", raced)
    yield house
    house.index.close()


@pytest.fixture
def furnished(tmp_path, raced):
    """Makes a house with settings."""
    made = []

    def make(**settings):
        made.append(House(tmp_path / f"data{len(made)}", raced, **settings))
        return made[-1]

    yield make
    for house in made:
        house.index.close()


@pytest.fixture(scope="module")
def quiet(tmp_path_factory, raced):
    """A service whose jobs move only when a test says so; the tests of a module share it."""
    with still(tmp_path_factory.mktemp("still") / "runs", raced) as found:
        yield found


@pytest.fixture
def ann(quiet):
    """A user."""
    with quiet.client(ANN) as client:
        yield client


@pytest.fixture
def bob(quiet):
    """Another user."""
    with quiet.client(BOB) as client:
        yield client
