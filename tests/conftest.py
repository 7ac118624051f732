import os
import pwd
import signal
import sys
from functools import partial

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # matrices are small: further threads would only wait, and disturb others

import pytest

from mercator_design import jit
from mercator_design.cli import main
from mercator_design.plugins import loading as plugins
from tests.show.browser import browser

pytest_plugins = ["tests.tiers"]

# A race would end with seconds of drawing its report; tests of the report delete this.
os.environ["MDESIGN_NO_REPORT"] = "1"

_foreign = jit._foreign


def _of_users():
    """Kernels of tests and benchmarks do not count: a race begun by a test goes on in a program, and the reverse."""
    return [kernel for kernel in _foreign() if str(kernel.__module__).partition(".")[0] not in ("tests", "benchmarks")]


jit._foreign = _of_users

# Programs under test would inherit what is ignored here, as by nohup, and in the background of a shell.
signal.signal(signal.SIGINT, signal.default_int_handler)
for _number in (signal.SIGHUP, signal.SIGQUIT):
    signal.signal(_number, signal.SIG_DFL)


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
