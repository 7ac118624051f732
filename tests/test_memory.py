"""Where there is not enough memory: a sentence, no traceback, and no configuration that is rejected for it."""

import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from mercator_design import jit
from mercator_design.compiling import cache as kernel_cache
from mercator_design.errors import lack_of_memory
from mercator_design.modules.conditions import logistic
from mercator_design.race.executors.processes import ProcessExecutor
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.race.irace.target_runner import RunnerCall, Target, TargetFailed
from mercator_design.race.session.events import Measurement
from mercator_design.race.session.outcome import ExperimentFailed
from mercator_design.race.session.record import Record
from mercator_design.system import address_space
from tests.race.racing import measure, runner, undisturbed
from tests.tiers import takes_long

MDESIGN = [sys.executable, "-c", "from mercator_design.cli import main; main()"]
EVALUATE = ["evaluate", "--fsm-config", "--nstates 1 --s0 0 --rwm0 7", "--mission", "aggregation", "-n", "2", "-j", "2"]
RACE = ["race", "aggregation", "--budget", "60", "--method", "irace", "--set", "robots=2", "--set", "duration=3"]
BELOW = (300_000, 450_000, 475_000, 524_287)
SIZES = [*BELOW, *range(525_000, 1_200_001, 25_000)]


def limited(arguments, kib, cache=None):
    """A command that may have so much address space."""

    def limit():
        resource.setrlimit(resource.RLIMIT_AS, (kib * 1024, kib * 1024))

    environment = {**os.environ, **({"XDG_CACHE_HOME": str(cache), "NUMBA_CACHE_DIR": ""} if cache else {})}
    return subprocess.run(
        [*MDESIGN, *arguments], capture_output=True, text=True, check=False, preexec_fn=limit, env=environment
    )  # fmt: skip


@pytest.fixture(scope="module")
def race(tmp_path_factory):
    """The folder of a race."""
    folder = tmp_path_factory.mktemp("race") / "folder"
    subprocess.run([*MDESIGN, *RACE, "-o", folder], capture_output=True, check=True)
    return str(folder)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not limit address space")
class TestALimitOfAddressSpace:
    @pytest.mark.thorough
    @pytest.mark.parametrize("arguments", [EVALUATE, RACE, ["runs", "list"], ["validate", "aggregation"]])
    def test_in_which_libraries_have_no_room(self, tmp_path, monkeypatch, arguments):
        monkeypatch.chdir(tmp_path)
        for size in BELOW:
            done = limited(arguments, size)
            assert (done.returncode, done.stdout) == (1, "")
            assert done.stderr == (
                "Error: not enough memory: expected a limit of address space of 512 MiB at least, found "
                f"{size // 1024} MiB (ulimit -v)\n"
            )
            assert not list(tmp_path.iterdir())

    @pytest.mark.thorough
    def test_in_which_what_needs_no_libraries_runs(self):
        assert limited(["bundle", "--help"], 300_000).returncode == 0

    @takes_long
    @pytest.mark.thorough
    @pytest.mark.parametrize("is_cached", [True, False])
    @pytest.mark.parametrize("arguments", [EVALUATE, RACE, ["runs", "show"]])
    def test_of_any_size(self, tmp_path, monkeypatch, race, arguments, is_cached):
        monkeypatch.chdir(tmp_path)
        for size in SIZES:
            cache = None if is_cached else tmp_path / f"cache {size}"
            done = limited([*arguments, race] if arguments[0] == "runs" else arguments, size, cache)
            assert "Traceback" not in done.stderr, size
            assert done.returncode in (0, 1), (size, done.stderr)
            assert done.returncode == 0 or "Error: not enough memory" in done.stderr, size
        assert done.returncode == 0

    def test_nothing_is_loaded_or_compiled_in_too_little(self, monkeypatch):
        """LLVM would end this process."""

        loads = []
        monkeypatch.setattr(kernel_cache, "read_whole", loads.append)
        cache = kernel_cache.cache_of(lambda: None, Path("/"), "", lambda: None)
        context = jit._Entry(logistic)._entry.targetctx
        assert cache.load_overload((), context) is None
        assert len(loads) == 2  # again after waiting for another process
        used = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
        for more, what, tried in (
            (-used, "64 MiB of address space to load machine code", 0),
            (96 << 20, "320 MiB of address space to compile", 1),
        ):
            loads.clear()
            monkeypatch.setattr(resource, "getrlimit", lambda _, limit=used + more: (limit, limit))
            with pytest.raises(MemoryError, match=f"expected {what}, found .* MiB below the limit of"):
                cache.load_overload((), context)
            assert len(loads) == tried

    def test_blas_has_one_thread(self, monkeypatch):
        """Each would reserve memory."""
        monkeypatch.setenv("OPENBLAS_NUM_THREADS", "")
        monkeypatch.delenv("OPENBLAS_NUM_THREADS")
        address_space.prepare_for_libraries()
        assert "OPENBLAS_NUM_THREADS" not in os.environ
        monkeypatch.setattr(resource, "getrlimit", lambda _: (1 << 40, 1 << 40))
        address_space.prepare_for_libraries()
        assert os.environ["OPENBLAS_NUM_THREADS"] == "1"


def test_what_is_a_lack_of_memory():
    wrapped = ValueError("no")
    wrapped.__cause__ = MemoryError("all is full")
    assert lack_of_memory(wrapped) is wrapped.__cause__
    for error in (
        MemoryError(),
        OSError(12, os.strerror(12)),
        ImportError("x.so: failed to map segment from shared object"),
        RuntimeError("can't start new thread"),
    ):
        assert lack_of_memory(error) is error
    for error in (None, ValueError("memory"), OSError(2, "No such file"), RuntimeError("can't")):
        assert lack_of_memory(error) is None


class TestWorkers:
    """An experiment without memory stops a race, also one that rejects configurations that fail."""

    @pytest.mark.thorough
    @pytest.mark.parametrize("executor", [ThreadExecutor(1), ThreadExecutor(2), ProcessExecutor(2)])
    def test_it_stops_the_race_which_can_be_resumed(self, executor):
        def greedy(item):
            if item[1] % 5 == 4:
                return Measurement(len(bytearray(1 << 62)), "")
            return measure(item)

        record = Record()
        with executor, pytest.raises(ExperimentFailed, match="MemoryError"):
            runner(record, executor, function=greedy, on_failure="reject").finish()
        assert record.experiments
        assert all(one.score is not None for one in record.experiments.values())
        with ThreadExecutor(1) as again:
            runner(record, again).finish()
        assert record.digest() == undisturbed().digest()

    @pytest.mark.parametrize(("number", "error"), [(11, MemoryError), (12, MemoryError), (2, TargetFailed)])
    def test_of_a_target_runner(self, tmp_path, monkeypatch, number, error):
        def full(*_, **__):
            raise OSError(number, os.strerror(number))

        monkeypatch.setattr(subprocess, "Popen", full)
        call = RunnerCall(configuration=1, instance_id="1", seed=1, instance="i", arguments="")
        with pytest.raises(error):
            Target(runner=tmp_path / "r", folder=tmp_path)(call)
