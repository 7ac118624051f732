import contextlib
import gc
import os
import pwd
import signal
import sys
from functools import partial
from importlib import import_module
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # matrices are small: further threads would only wait, and disturb others

import pytest
from hypothesis import settings

from mercator_design import jit
from mercator_design.cli import main
from mercator_design.missions import plugins
from mercator_design.race.executors.executor import available_jobs
from tests.show.browser import browser

# A first example may compile a kernel, so its time says nothing.
settings.register_profile("project", deadline=None)
settings.load_profile("project")

# Programs under test start hundreds of times: without byte code, each would compile all that it imports.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# A race would end with seconds of drawing its report; tests of the report delete this.
os.environ["MDESIGN_NO_REPORT"] = "1"

# No test needs what it writes to survive a loss of power, and some would mostly wait for the disk.
os.fsync = lambda file: os.fstat(file) and None

_foreign = jit._foreign


def _of_users():
    """Kernels of tests and benchmarks do not count: so tests share compiled code with the programs that they start."""
    return [kernel for kernel in _foreign() if str(kernel.__module__).partition(".")[0] not in ("tests", "benchmarks")]


jit._foreign = _of_users

# Programs under test would inherit what is ignored here, as by nohup, and in the background of a shell.
signal.signal(signal.SIGINT, signal.default_int_handler)
for _number in (signal.SIGHUP, signal.SIGQUIT):
    signal.signal(_number, signal.SIG_DFL)


gc.disable()  # until all is collected

_HEAVY = ("scipy.stats", "pandas", "numba", "matplotlib.figure", "optuna.storages", "fastapi", "rdata")
"""What much of the collection imports."""


def pytest_sessionstart(session):
    """Each worker begins with other modules, so that it finds the byte code of the others instead of compiling all."""
    worker = os.environ.get("PYTEST_XDIST_WORKER", "").removeprefix("gw")
    if not worker or session.config.args_source is not pytest.Config.ArgsSource.TESTPATHS:
        return
    number, count = int(worker), int(os.environ["PYTEST_XDIST_WORKER_COUNT"])
    root = Path(__file__).parent
    tests = sorted(root.rglob("test_*.py"))
    for names in (_HEAVY, [".".join(path.relative_to(root.parent).with_suffix("").parts) for path in tests]):
        for name in names[number::count]:
            with contextlib.suppress(Exception):  # the collection tells it
                import_module(name)


def pytest_collection_finish():
    """What was collected stays until the end: no need to look through it each time for garbage."""
    gc.freeze()
    gc.enable()


def pytest_xdist_auto_num_workers():
    """Two more than processors: tests that depend on real time mostly wait, others for programs that they start."""
    return available_jobs() + 2


@pytest.hookimpl(tryfirst=True)  # before pytest-xdist reads the groups
def pytest_collection_modifyitems(items):
    """Tests that depend on real time do not compete with each other for processors; they take longest and begin."""
    for item in items:
        if item.get_closest_marker("timing"):
            item.add_marker(pytest.mark.xdist_group("timing"))
        elif together := item.get_closest_marker("together"):
            item.add_marker(pytest.mark.xdist_group(*together.args or [item.path.stem]))
    items.sort(key=lambda item: not item.get_closest_marker("timing"))


@pytest.fixture
def registries():
    """What a test adds to the objectives and floor dynamics is gone afterwards."""
    restore = plugins.snapshot()
    yield
    restore()


@pytest.fixture
def run_command(monkeypatch, capsys):
    """Run a command by its name and function, with arguments; gives exit code, stdout, stderr."""

    def run(name, main, *arguments):
        monkeypatch.setattr(sys, "argv", [name, *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            main()
        out, err = capsys.readouterr()
        return stop.value.code or 0, out, err

    return run


@pytest.fixture
def mdesign(run_command):
    """Run mdesign with arguments."""
    return partial(run_command, "mdesign", main)


@pytest.fixture(scope="session")
def mdesign_once():
    """Run mdesign with arguments, for what tests share; it must succeed."""

    def run(*arguments):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(sys, "argv", ["mdesign", *map(str, arguments)])
            with pytest.raises(SystemExit) as stop:
                main()
        assert not stop.value.code

    return run


@pytest.fixture(scope="session")
def chromium(tmp_path_factory):
    with browser(tmp_path_factory.mktemp("browser")) as page:
        yield page


@pytest.fixture(scope="module")
def page(chromium):
    """A page of the browser that all modules share."""
    yield chromium
    chromium.open("about:blank")  # which ends its event streams


@pytest.fixture
def homeless(monkeypatch):
    """This user has neither an account nor a home, as in a container that runs as any number."""

    def unknown(number):
        raise KeyError(number)

    monkeypatch.setattr(pwd, "getpwuid", unknown)
    for name in ("HOME", "NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "XDG_CONFIG_HOME", "XDG_RUNTIME_DIR"):
        monkeypatch.delenv(name, raising=False)
