"""The tutorial's behaviour, condition and flavour: raced, replayed, bundled, run on a twin; and from a wheel."""

import ensurepip
import importlib
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from mercator_design.fleet.bundle import bundle
from mercator_design.missions.mission import load_mission
from mercator_design.modules.flavour import load_flavour
from mercator_design.modules.reference import Readings
from mercator_design.plugins.loading import load_plugin
from mercator_design.robot.logs.log import replay
from mercator_design.sim.simulate import Simulator
from mercator_design.software.controller import Controller
from mercator_design.software.files import fsm_file_text, parse_software, read_fsm
from tests.plugins.walls import FLAVOUR, LINE, PLUGIN, write
from tests.processes import LIMIT
from tests.robot.ways import in_time
from tests.twin.processes import twin

pytestmark = [pytest.mark.thorough, pytest.mark.usefixtures("registries")]
WHEEL = {
    "own_walls-1.dist-info/METADATA": "Metadata-Version: 2.1\nName: own-walls\nVersion: 1\n",
    "own_walls-1.dist-info/WHEEL": "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
    "own_walls-1.dist-info/entry_points.txt": "[mercator_design.plugins]\nwalls = own_walls\n",
    "own_walls/__init__.py": "from own_walls.modules import wall_near\n",
    "own_walls/modules.py": PLUGIN,
    "own_walls/flavours/walls.yaml": FLAVOUR,
}
QUICK = ("--budget", "60", "--set", "robots=2", "--set", "duration=2", "-j", "1", "-o", "out")


def mdesign(folder, *arguments):
    command = [sys.executable, "-m", "mercator_design", *map(str, arguments)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def raced(folder, plugin, flavour):
    """Race, evaluate, replay, explain; the run folder and its copies suffice."""
    mdesign(folder, "race", "aggregation", "--flavour", flavour, "--plugin", plugin, *QUICK)
    copy = next(path for path in sorted((folder / "out" / "plugins").iterdir()))
    scores = mdesign(folder, "evaluate", "out/fsm.txt", "-n", 2, "-j", 1, "--json", "--plugin", copy)
    assert mdesign(folder, "evaluate", "out/fsm.txt", "-n", 2, "-j", 1, "--json", "--plugin", plugin) == scores
    mdesign(folder, "replay", "out/fsm.txt", "--plugin", plugin, "-o", "replay.html")
    assert (folder / "replay.html").stat().st_size > 10_000
    mdesign(folder, "race", "--resume", "out", "--budget", 70, "-j", 1)


@pytest.mark.timing
def test_from_a_race_to_a_twin(tmp_path):
    in_time(lambda number: from_a_race_to_a_twin(tmp_path / str(number)))


def from_a_race_to_a_twin(folder):
    folder.mkdir()
    write(folder)
    raced(folder, "walls.py", "walls.yaml")
    load_plugin(folder / "walls.py")
    load_flavour(str(folder / "walls.yaml"))
    run_on_twin(folder)
    decisions = [decision for _, decision in replay(folder / "log.jsonl")]
    assert len(decisions) >= 10
    assert not any(decision.differs for decision in decisions)
    assert decisions[0].state == 0  # wall following


def run_on_twin(folder):
    """Run a PFSM of the flavour, which is loaded, on a twin: bundle and run folder have all that it needs."""
    own = parse_software(LINE, "walls")  # the winner may have no state of the plugin
    (folder / "out" / "fsm.txt").write_text(fsm_file_text(own, {}))
    (folder / "mercator-robot.pyz").write_bytes(bundle())
    with twin(folder, 1):
        command = [sys.executable, "mercator-robot.pyz", "run", "out/fsm.txt", "--robot", "0/robot.yaml"]
        command += ["--duration", "1.5", "--seed", "1", "-o", "log.jsonl"]
        without = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        done = subprocess.run(
            command, cwd=folder, env=without, capture_output=True, text=True, timeout=LIMIT, check=False
        )
        assert done.returncode == 0, done.stderr


def test_robots_decide_as_the_simulator(tmp_path):
    """From the readings and draws of a simulation, plain Python goes through the same states, with the same wheels."""
    write(tmp_path)
    load_plugin(tmp_path / "walls.py")
    load_flavour(str(tmp_path / "walls.yaml"))
    (tmp_path / "line.txt").write_text(LINE)
    own = read_fsm(tmp_path / "line.txt", "walls").software
    mission = load_mission("aggregation", ["robots=4", "duration=60"])
    history = Simulator(mission).run(own, 3, record=True).history
    visited = set()
    for robot in range(4):
        controller = Controller(own)
        for cycle, (readings, draws) in enumerate(
            zip(history.readings[:, robot], history.draws[:, robot], strict=True)
        ):
            visited.add(controller.state)
            actions = controller.step(Readings(*readings.tolist()), draws.tolist())
            assert np.array_equal([actions.left, actions.right], history.wheels[cycle, robot])
            assert controller.state == history.states[cycle, robot]
    assert visited == {0, 1}


@pytest.mark.timing
def test_from_a_wheel(tmp_path, monkeypatch):
    wheel = tmp_path / "own_walls-1-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        for name, text in WHEEL.items():
            archive.writestr(name, text)
        record = "".join(f"{name},,\n" for name in [*WHEEL, "own_walls-1.dist-info/RECORD"])
        archive.writestr("own_walls-1.dist-info/RECORD", record)
    site = tmp_path / "site-packages"
    bundled = [*Path(ensurepip.__file__).parent.glob("_bundled/pip-*.whl")]  # an environment of uv has no pip
    pip = [bundled[0] / "pip"] if bundled else ["-m", "pip"]
    install = [sys.executable, *pip, "install", "--no-index", "--no-deps", "--target", site, wheel]
    subprocess.run([*map(str, install)], check=True, capture_output=True)
    monkeypatch.setenv("PYTHONPATH", str(site))
    monkeypatch.syspath_prepend(site)
    importlib.invalidate_caches()
    in_time(lambda number: from_a_wheel(tmp_path / str(number)))


def from_a_wheel(folder):
    folder.mkdir()
    raced(folder, "walls", "walls")
    copy = folder / "out" / "plugins" / "own_walls"
    assert {path.name for path in copy.rglob("*.*")} == {"__init__.py", "modules.py", "walls.yaml"}
    load_plugin("walls")
    run_on_twin(folder)
    replayed = [sys.executable, "mercator-robot.pyz", "replay", "log.jsonl", "--plugin"]
    for plugin in ("walls", copy):  # the one that is installed, and its copy
        done = subprocess.run(
            [*replayed, str(plugin)], cwd=folder, capture_output=True, text=True, timeout=LIMIT, check=False
        )
        assert (done.returncode, "differ" in done.stderr) == (0, False), done.stderr
        mdesign(folder, "replay", "log.jsonl", "--plugin", plugin, "-o", f"{Path(plugin).name}.html")
    (copy / "modules.py").write_text(PLUGIN + "\n")
    changed = "has modules of the plugin own_walls, which has changed since this was designed"
    for code, words, command in (
        (1, changed, ["replay", "log.jsonl", "--plugin", "out/plugins/own_walls"]),
        (3, "own_walls: expected a plugin of digest", ["run", "out/fsm.txt"]),
    ):
        done = subprocess.run(
            [sys.executable, "mercator-robot.pyz", *command], cwd=folder, capture_output=True, text=True, check=False
        )
        assert (done.returncode, done.stderr.count("\n"), words in done.stderr) == (code, 1, True), done.stderr
    listed = mdesign(folder, "flavours", "list")
    assert "walls" not in listed
    assert "walls" in mdesign(folder, "flavours", "list", "--plugin", "walls")
