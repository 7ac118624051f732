"""Where there is not enough memory: a sentence, no traceback, and no configuration that is rejected for it."""

import os
import resource
import subprocess
import sys

import pytest

from mercator_design import kernel_cache
from mercator_design.errors import lack_of_memory
from mercator_design.race.events import Measured
from mercator_design.race.executors import ProcessExecutor, ThreadExecutor
from mercator_design.race.record import Record
from mercator_design.race.runner import ExperimentFailed
from mercator_design.race.target import Call, Target, TargetFailed
from tests.race.racing import measure, runner, undisturbed

MDESIGN = [sys.executable, "-c", "from mercator_design.cli import main; main()"]
EVALUATE = ["evaluate", "--fsm-config", "--nstates 1 --s0 0 --rwm0 7", "--mission", "aggregation", "-n", "2", "-j", "2"]
RACE = ["race", "aggregation", "--budget", "60", "--method", "irace", "--set", "robots=2", "--set", "duration=3"]


def limited(arguments, kib):
    """A command that may have so much address space."""

    def limit():
        resource.setrlimit(resource.RLIMIT_AS, (kib * 1024, kib * 1024))

    return subprocess.run(
        [*MDESIGN, *arguments], capture_output=True, text=True, check=False, preexec_fn=limit
    )  # fmt: skip


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not limit address space")
@pytest.mark.parametrize(
    ("arguments", "sizes"),
    [
        pytest.param(EVALUATE, (300_000, 450_000)),
        pytest.param(EVALUATE, range(300_000, 1_200_001, 50_000), marks=pytest.mark.slow),
        pytest.param(RACE, range(300_000, 1_200_001, 50_000), marks=pytest.mark.slow),
    ],
)
def test_a_limit_of_address_space(tmp_path, monkeypatch, arguments, sizes):
    monkeypatch.chdir(tmp_path)
    for size in sizes:
        done = limited(arguments, size)
        assert "Traceback" not in done.stderr, size
        assert done.returncode in (0, 1), (size, done.stderr)
        assert done.returncode == 0 or "Error: not enough memory" in done.stderr, size


def test_no_room_to_compile(monkeypatch):
    """Where LLVM would end this process."""
    kernel_cache._check_room()
    monkeypatch.setattr(resource, "getrlimit", lambda _: (1 << 20, 1 << 20))
    with pytest.raises(
        MemoryError, match="expected 320 MiB of address space to compile, found 0 MiB below the limit of 1"
    ):
        kernel_cache._check_room()


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

    @pytest.mark.parametrize("executor", [ThreadExecutor(1), ThreadExecutor(2), ProcessExecutor(2)])
    def test_it_stops_the_race_which_can_be_resumed(self, executor):
        def greedy(item):
            if item[1] % 5 == 4:
                return Measured(len(bytearray(1 << 62)), "")
            return measure(item)

        record = Record()
        with executor, pytest.raises(ExperimentFailed, match="MemoryError"):
            runner(record, executor, function=greedy, on_failure="reject").run()
        assert record.experiments
        assert all(one.score is not None for one in record.experiments.values())
        with ThreadExecutor(1) as again:
            runner(record, again).run()
        assert record.digest() == undisturbed().digest()

    @pytest.mark.parametrize(("number", "error"), [(11, MemoryError), (12, MemoryError), (2, TargetFailed)])
    def test_of_a_target_runner(self, tmp_path, monkeypatch, number, error):
        def full(*_, **__):
            raise OSError(number, os.strerror(number))

        monkeypatch.setattr(subprocess, "Popen", full)
        call = Call(configuration=1, instance_id="1", seed=1, instance="i", arguments="")
        with pytest.raises(error):
            Target(runner=tmp_path / "r", folder=tmp_path)(call)
