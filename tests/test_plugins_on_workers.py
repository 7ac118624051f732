"""Workers run the plugins that a race began with, whatever becomes of their files, and refuse all else."""

import os
import signal

import pytest

from mercator_design.designer import Designer
from mercator_design.errors import MissionError
from mercator_design.fsm import parse
from mercator_design.missions.mission import load_mission
from mercator_design.plugins import loading as plugins
from mercator_design.plugins.loading import load_plugin
from mercator_design.plugins.sources import read_plugin
from mercator_design.race.executors.dask import DaskExecutor
from mercator_design.race.executors.executor import WorkerUnfit, in_order
from mercator_design.race.executors.processes import ProcessExecutor
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.sim.simulate import Simulator
from tests.race.work import process_of
from tests.tiers import some

OBJECTIVE = """
from mercator_design import objective

@objective
def constant(trace) -> float:
    return 1.0
"""
WITH_HELPERS = """
from mercator_design import objective

@objective
def constant(trace) -> float:
    from parts.values import value  # when it is called
    return value()
"""
DYNAMIC = """
from dataclasses import dataclass

from mercator_design import Zone, dynamic, jittable, objective

@dataclass(frozen=True)
class Bag:
    least: float

@objective
def constant(trace, *, bag: Bag) -> float:
    return bag.least + float(trace.floor.zones[0, 3])

@jittable
def shrink(floor, table, poses, time):
    floor.zones[int(table[0, 0]), 3] *= 0.5

@dynamic(change=shrink)
def shrinking(site, *, zone: Zone):
    return [(float(site.of((zone,))[0]), 0.0)]
"""
STAY = parse("--nstates 1 --s0 1")
ITEMS = [(STAY, seed) for seed in range(1, 5)]


@pytest.fixture(autouse=True)
def no_tests_on_workers(monkeypatch, registries):
    """Kernels of tests, which a worker does not know, do not count; what a test loads is gone afterwards.

    Experiments are so short that plain Python takes less time for them than to load compiled code.
    """
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")


def function_of(*overrides):
    """What runs experiments of a race with the objective `constant`."""
    objective = "objective={name: constant, direction: maximise}"
    given = ["robots=1", "duration=0.5", *(overrides or (objective,))]
    return Designer(Simulator(load_mission("aggregation", given)), budget=60, seed=1).function


def scores(executor, function):
    return [one.score for one in in_order(executor, function, ITEMS)]


class TestProcesses:
    @pytest.mark.thorough
    def test_an_edited_plugin_is_run_as_it_was_with_what_it_imports(self, tmp_path):
        """Also by the worker that takes the place of one that was killed; and here, when it is imported later."""
        (tmp_path / "my.py").write_text(WITH_HELPERS)
        (tmp_path / "parts").mkdir()
        (tmp_path / "parts" / "values.py").write_text("from .more import number\ndef value():\n    return number\n")
        (tmp_path / "parts" / "more.py").write_text("number = 7.0\n")
        load_plugin(tmp_path / "my.py")
        function = function_of()
        with ProcessExecutor(1) as executor:
            (process,) = in_order(executor, process_of, [0])
            results = executor.run(function, ITEMS)
            assert next(results)[1].score == 7.0
            (tmp_path / "my.py").write_text(OBJECTIVE)
            (tmp_path / "parts" / "more.py").write_text("number = 1000.0\n")
            os.kill(process, signal.SIGKILL)
            assert {one.score for _, one in results} == {7.0}
            (tmp_path / "my.py").unlink()
            assert scores(executor, function) == [7.0] * 4  # as tests of the winner, which are handed out anew
        with ThreadExecutor(1) as executor:
            assert scores(executor, function) == [7.0] * 4

    def test_its_kernels_and_classes_too(self, tmp_path):
        (tmp_path / "my.py").write_text(DYNAMIC)
        load_plugin(tmp_path / "my.py")
        objective = "objective={name: constant, direction: maximise, bag: {least: 3}}"
        function = function_of(objective, "floor.dynamics=[{name: shrinking, zone: spot}]")
        (tmp_path / "my.py").unlink()
        with ProcessExecutor(1) as executor:
            assert scores(executor, function) == [3.5] * 4


@pytest.mark.timing
class TestDask:
    @pytest.fixture
    def cluster(self):
        distributed = pytest.importorskip("distributed")
        with distributed.LocalCluster(
            n_workers=1, threads_per_worker=2, processes=True, dashboard_address=":0"
        ) as cluster:
            yield cluster

    def race(self, cluster, plugin):
        """The scores of a race that knows no plugin of before, as in a new process, on the same workers."""
        restore = plugins.snapshot()
        try:
            load_plugin(plugin)
            with DaskExecutor(cluster.scheduler_address) as executor:
                return scores(executor, function_of())
        finally:
            restore()

    def test_an_edited_plugin_is_not_run_in_its_old_form(self, cluster, tmp_path):
        (tmp_path / "my.py").write_text(OBJECTIVE)
        for _ in range(2):
            assert self.race(cluster, tmp_path / "my.py") == [1.0] * 4
        (tmp_path / "my.py").write_text(OBJECTIVE.replace("1.0", "1000.0"))
        with pytest.raises(WorkerUnfit, match=r"a worker \(process ") as error:
            self.race(cluster, tmp_path / "my.py")
        assert "my.py: another plugin of that name (digest " in str(error.value)
        assert "start this process anew" in str(error.value)


class TestFiles:
    """What belongs to a plugin."""

    def test_its_digest_is_of_all_that_it_imports_from_its_folder(self, tmp_path):
        (tmp_path / "my.py").write_text(
            "import helper, json, numpy, nowhere\nfrom pack.inner import thing, deep\n" + OBJECTIVE
        )
        (tmp_path / "json.py").write_text("raise ValueError")  # the standard library goes first
        (tmp_path / "numpy.py").write_text("raise ValueError")  # and what is installed
        (tmp_path / "other.py").write_text("x = 1")  # is not imported
        (tmp_path / "helper.py").write_text("def late():\n    import last\n")
        (tmp_path / "last.py").write_text("import helper")
        (tmp_path / "pack" / "inner").mkdir(parents=True)
        (tmp_path / "pack" / "__init__.py").write_text("")
        (tmp_path / "pack" / "inner" / "deep.py").write_text("from ..side import y\n")
        (tmp_path / "pack" / "side.py").write_text("y = 1\n")
        plugin = read_plugin(tmp_path / "my.py")
        assert set(plugin.files) == {
            "my.py",
            "helper.py", "last.py", "pack/__init__.py", "pack/inner/__init__.py", "pack/inner/deep.py", "pack/side.py",
        }  # fmt: skip
        (tmp_path / "other.py").write_text("x = 2")
        assert read_plugin(tmp_path / "my.py").digest == plugin.digest
        (tmp_path / "pack" / "side.py").write_text("y = 2\n")
        assert read_plugin(tmp_path / "my.py").digest != plugin.digest

    def test_modules_of_one_name_are_not_mixed_up(self, tmp_path):
        for folder, value in (("a", 1.0), ("b", 2.0)):
            (tmp_path / folder / "parts").mkdir(parents=True)
            (tmp_path / folder / f"{folder}.py").write_text(WITH_HELPERS.replace("constant", folder))
            (tmp_path / folder / "parts" / "values.py").write_text(f"def value():\n    return {value}\n")
        load_plugin(tmp_path / "a" / "a.py")
        with pytest.raises(MissionError, match=r"b.py: its file parts/values.py differs from that of another plugin"):
            load_plugin(tmp_path / "b" / "b.py")
        assert list(plugins.loaded_plugins()) == ["a.py"]
        function = function_of("objective={name: a, direction: maximise}")
        assert function(ITEMS[0]).score == 1.0

    def test_what_was_loaded_is_not_what_was_edited_since(self, tmp_path):
        (tmp_path / "my.py").write_text(OBJECTIVE)
        load_plugin(tmp_path / "my.py")
        load_plugin(tmp_path / "my.py")
        (tmp_path / "my.py").write_text(OBJECTIVE.replace("1.0", "2.0"))
        with pytest.raises(MissionError, match="another plugin of that name"):
            load_plugin(tmp_path / "my.py")


class TestRunFolder:
    @pytest.fixture
    def raced(self, mdesign, tmp_path):
        """The folder of a race with a plugin that imports from its folder; nothing of it is loaded any more."""
        (tmp_path / "my.py").write_text(WITH_HELPERS)
        (tmp_path / "parts").mkdir()
        (tmp_path / "parts" / "values.py").write_text("def value():\n    return 7.0\n")
        restore = plugins.snapshot()
        code, _, err = mdesign(
            "race", "aggregation", "--budget", 60, "--plugin", tmp_path / "my.py", "--set", "robots=1",
            "--set", "duration=0.5", "--set", "objective={name: constant, direction: maximise}", "-o", tmp_path / "r",
        )  # fmt: skip
        assert code == 0, err
        restore()
        return tmp_path / "r"

    def test_it_has_all_that_belongs_to_a_plugin(self, mdesign, raced, tmp_path):
        (tmp_path / "my.py").unlink()
        (tmp_path / "parts" / "values.py").write_text("def value():\n    return 1000.0\n")
        code, out, err = mdesign("runs", "verify", raced)
        assert code == 0, err
        assert "with the same results" in out

    @pytest.mark.swept
    @pytest.mark.parametrize("file", some(["my.py", "parts/values.py"], 1))
    @pytest.mark.parametrize("verb", [("race", "--resume"), ("runs", "verify"), ("runs", "ablation")])
    def test_a_plugin_that_is_not_what_it_was_is_not_run(self, mdesign, raced, tmp_path, verb, file):
        mark = tmp_path / "it ran"
        (raced / "plugins" / file).write_text(f"open({str(mark)!r}, 'w').close()\n" + (tmp_path / file).read_text())
        code, out, err = mdesign(*verb, raced)
        assert (code, out) == (3, "")
        assert "plugins/my.py: expected a plugin of digest " in err
        assert "it was not run" in err
        assert not mark.exists()
