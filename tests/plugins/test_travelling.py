"""Own modules go to workers as they were when a race began; versions other than those of a design are refused."""

import pytest

from mercator_design.designer import Designer
from mercator_design.errors import RobotError
from mercator_design.missions.mission import load_mission
from mercator_design.modules.flavour import load_flavour
from mercator_design.modules.reference import ReferenceModel
from mercator_design.plugins import loading
from mercator_design.plugins.loading import load_plugin
from mercator_design.race.executors.dask import DaskExecutor
from mercator_design.race.executors.executor import WorkerUnfit, in_order
from mercator_design.race.executors.processes import ProcessExecutor
from mercator_design.robot.logs.events import RunStarted
from mercator_design.robot.logs.log import controller_of, understanding
from mercator_design.sim.simulate import Simulator
from mercator_design.software.files import fsm_file_text, parse_software
from tests.plugins.walls import FLAVOUR, LINE, PLUGIN, write

pytestmark = pytest.mark.usefixtures("registries")
OBJECTIVE = "objective={name: pair_distance, direction: minimise}"
SHORT = ("robots=2", "duration=2")
EDITED = PLUGIN.replace("0.6 if", "0.2 if")
"""Robots turn more sharply while they look for a wall."""


@pytest.fixture(autouse=True)
def plain(monkeypatch):
    """Experiments are so short that plain Python takes less time for them than to load compiled code."""
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")


@pytest.fixture
def anew(mdesign):
    """Run mdesign as in a process of its own: what it loads is gone afterwards."""

    def run(*arguments):
        restore = loading.snapshot()
        try:
            return mdesign(*arguments)
        finally:
            restore()

    return run


@pytest.fixture
def designed(tmp_path):
    """A folder with fsm.txt, the flavour and the plugin beside it, and another version of the plugin, walls.py."""
    restore = loading.snapshot()
    write(tmp_path)
    load_plugin(tmp_path / "walls.py")
    load_flavour(str(tmp_path / "walls.yaml"))
    (tmp_path / "r" / "plugins").mkdir(parents=True)
    header = {"mission": "aggregation", "plugins": f"walls.py {loading.loaded_plugins()['walls.py']}"}
    (tmp_path / "r" / "fsm.txt").write_text(fsm_file_text(parse_software(LINE, "walls"), header))
    restore()
    (tmp_path / "r" / "flavour.yaml").write_text(FLAVOUR)
    (tmp_path / "walls.py").rename(tmp_path / "r" / "plugins" / "walls.py")
    (tmp_path / "walls.py").write_text(EDITED)
    return tmp_path


def sets(*given):
    return [word for each in given for word in ("--set", each)]


VERBS = [
    ("evaluate", "r/fsm.txt", "-n", 1, "-j", 1, *sets(*SHORT)),
    ("record", "r/fsm.txt", "-o", "x.csv", *sets(*SHORT)),
    ("fsm", "explain", "r/fsm.txt"),
    ("fsm", "show", "r/fsm.txt", "-o", "x.svg"),
    ("fsm", "diff", "r/fsm.txt", "r/fsm.txt"),
]


class TestEdited:
    @pytest.mark.parametrize("verb", VERBS, ids=lambda verb: " ".join(verb[:2]))
    def test_is_refused_unless_the_flavour_is_given(self, anew, designed, monkeypatch, verb):
        """As an objective's plugin is, unless the mission is given."""
        monkeypatch.chdir(designed)
        changed = "r/fsm.txt: walls.py has changed since this was designed"
        code, out, err = anew(*verb, "--plugin", "walls.py")
        assert (code, out) == (3, "")
        advice = "give --plugin r/plugins/walls.py, or --flavour to use its modules as they are now"
        assert err == f"Error: {changed}; it was not run; {advice}\n"
        code, _, err = anew(*verb, "--plugin", "walls.py", "--flavour", "walls.yaml")
        assert code == 0, err
        assert f"Warning: {changed}; the present version is used\n" in err
        assert anew(*verb, "--plugin", "r/plugins/walls.py")[0] == 0

    def test_a_given_mission_is_not_enough(self, anew, designed, monkeypatch):
        monkeypatch.chdir(designed)
        code, _, err = anew(*VERBS[0], "--mission", "aggregation", "--plugin", "walls.py")
        assert (code, "it was not run; give --plugin r/plugins/walls.py" in err) == (3, True)

    def test_deploy_refuses_it_before_it_calls_any_robot(self, anew, designed, monkeypatch):
        monkeypatch.chdir(designed)
        monkeypatch.setenv("PATH", "/nonexistent")
        (designed / "robots.yaml").write_text("robots: [{name: r1, host: r1}]\n")
        deploy = ("deploy", "r/fsm.txt", "--robots", "robots.yaml", "--plugin")
        code, out, err = anew(*deploy, "walls.py")
        assert (code, out, "walls.py has changed since this was designed; it was not run" in err) == (3, "", True)
        assert "no such program here" in anew(*deploy, "r/plugins/walls.py")[1]

    def test_a_flavour_is_used_with_a_warning_if_it_is_given(self, anew, designed, monkeypatch):
        monkeypatch.chdir(designed)
        (designed / "r" / "flavour.yaml").write_text(FLAVOUR + "limits: {states: 2}\n")
        explain = ("fsm", "explain", "r/fsm.txt", "--plugin", "r/plugins/walls.py")
        code, _, err = anew(*explain)
        assert code == 3
        assert "the flavour walls has changed since this was designed: expected digest " in err
        assert err.endswith("; give it as it was then, or --flavour to use all modules as they are now\n")
        changed = "r/fsm.txt: the flavour walls has changed since this was designed; the present one is used"
        code, _, err = anew(*explain, "--flavour", "r/flavour.yaml")
        assert (code, err) == (0, f"Warning: {changed}\n")

    def test_files_that_a_verb_writes_are_not_read(self, anew, designed, monkeypatch):
        monkeypatch.chdir(designed)
        (designed / "x.svg").write_bytes(b"\xff" * 5_000_000)
        assert anew("fsm", "show", "r/fsm.txt", "-o", "x.svg", "--plugin", "r/plugins/walls.py")[0] == 0


class TestRunFolder:
    """Nothing but `--plugin` runs a plugin to show a race; without it, the rest is shown."""

    @pytest.fixture
    def raced(self, anew, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        write(tmp_path)
        race = ("race", "aggregation", "--flavour", "walls.yaml", "--plugin", "walls.py", "--budget", 60, "-o", "r")
        code, _, err = anew(*race, "--method", "random", "--no-report", "-j", 1, *sets("robots=1", "duration=0.5"))
        assert code == 0, err
        return tmp_path

    def test_is_shown(self, anew, raced):
        winner = (raced / "r" / "fsm.txt").read_text().splitlines()[-1]
        missing = "control software has modules of a plugin; give --plugin r/plugins/walls.py"
        code, out, err = anew("runs", "show", "r")
        assert (code, err) == (0, "")
        assert out.endswith(f"Not shown: r: {missing}\n")
        assert anew("runs", "show", "r", "--plugin", "walls.py")[1].endswith(f"\n{winner}\n")
        table = ("runs", "show", "r", "--csv", "configurations")
        assert anew(*table)[::2] == (3, f"Error: r: {missing}\n")
        assert winner in anew(*table, "--plugin", "walls.py")[1]
        (raced / "walls.py").write_text(EDITED)
        code, _, err = anew("runs", "show", "r", "--plugin", "walls.py")
        assert (code, "walls.py: expected a plugin of digest" in err) == (3, True)

    def test_is_reported_without_a_plugin_that_is_gone(self, anew, raced):
        (raced / "r" / "plugins" / "walls.py").unlink()
        code, _, err = anew("report", "r")
        assert code == 0, err
        assert "r/plugins/walls.py: no such file" in (raced / "r" / "report.html").read_text()


def function_of(folder):
    """What runs experiments of a race, and control software for it."""
    load_plugin(folder / "walls.py")
    load_flavour(str(folder / "walls.yaml"))
    simulator = Simulator(load_mission("aggregation", [*SHORT, OBJECTIVE]))
    items = [(parse_software(LINE, "walls"), seed) for seed in range(1, 4)]
    return Designer(simulator, budget=60, seed=1, flavour="walls").function, items


def scores(executor, function, items):
    return [one.score for one in in_order(executor, function, items)]


class TestWorkers:
    def test_processes_run_them_as_they_were(self, tmp_path):
        write(tmp_path)
        function, items = function_of(tmp_path)
        here = [function(item).score for item in items]
        (tmp_path / "walls.py").write_text(EDITED)
        (tmp_path / "walls.yaml").unlink()
        with ProcessExecutor(1) as executor:
            assert scores(executor, function, items) == here

    @pytest.mark.timing
    def test_dask_runs_them_and_refuses_another_version(self, tmp_path):
        distributed = pytest.importorskip("distributed")
        write(tmp_path)

        def race(cluster):
            restore = loading.snapshot()
            try:
                function, items = function_of(tmp_path)
                with DaskExecutor(cluster.scheduler_address) as executor:
                    return scores(executor, function, items), [function(item).score for item in items]
            finally:
                restore()

        with distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=True, dashboard_address=":0"
        ) as cluster:
            for _ in range(2):
                found, here = race(cluster)
                assert found == here
            (tmp_path / "walls.py").write_text(EDITED)
            with pytest.raises(WorkerUnfit, match=r"walls\.py: another plugin of that name \(digest "):
                race(cluster)
            (tmp_path / "walls.py").write_text(PLUGIN)
            (tmp_path / "walls.yaml").write_text(FLAVOUR + "limits: {states: 2}\n")
            with pytest.raises(WorkerUnfit, match="another flavour is called walls already"):
                race(cluster)


class TestLogs:
    def test_of_another_version_are_refused_in_clear_words(self, tmp_path):
        """The message is that of files of control software, not of a damaged log."""
        write(tmp_path)
        function_of(tmp_path)
        header = {"module plugins": "walls.py 0123456789abcdef"}
        given = {"control_period": 0.1, "reference_model": ReferenceModel()}
        start = RunStarted(robot="r", fsm=LINE, flavour="walls", header=header, **given)
        with pytest.raises(RobotError) as caught, understanding(tmp_path / "log.jsonl"):
            controller_of(start)
        start = f"{tmp_path}/log.jsonl: the start of the log: has modules of the plugin walls.py, which has changed"
        assert str(caught.value).startswith(start)
        assert str(caught.value).endswith("give it as it was then")
