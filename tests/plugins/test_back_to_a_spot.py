"""The example with odometry: raced and replayed, and on a twin through the same states as in simulation."""

import itertools
import subprocess
import sys

import pytest

from benchmarks.twin_perception import decisions
from mercator_design.fleet.bundle import bundle
from mercator_design.missions.mission import load_mission
from mercator_design.modules.flavour import load_flavour
from mercator_design.modules.reference import LED_COLOURS
from mercator_design.plugins.loading import load_plugin
from mercator_design.robot.logs.log import replay
from mercator_design.sim.simulate import Simulator
from mercator_design.software.files import fsm_file_text, read_fsm
from tests.plugins import spots
from tests.plugins.test_worked_example import mdesign, raced
from tests.processes import LIMIT
from tests.robot.ways import in_time
from tests.twin.processes import twin

pytestmark = [pytest.mark.thorough, pytest.mark.usefixtures("registries")]
AT_THE_SPOT = "placement={shape: poses, poses: [[0, 0, 0.5]]}"
BACK = [(0, "off"), (0, "red"), (1, "off")]
"""State and LEDs, as they follow each other, until it has come back."""


@pytest.fixture
def folder(tmp_path):
    spots.write(tmp_path)
    load_plugin(tmp_path / "spots.py")
    load_flavour(str(tmp_path / "spots.yaml"))
    return tmp_path


def ways(states, colours):
    """State and LEDs, as they follow each other."""
    names = [*LED_COLOURS]
    return [pair for pair, _ in itertools.groupby((int(s), names[c]) for s, c in zip(states, colours, strict=True))]


def test_the_plugin_is_short(folder):
    assert len((folder / "spots.py").read_text().splitlines()) <= 40


def test_it_races_and_replays(folder):
    raced(folder, "spots.py", "spots.yaml")
    shown = ("--flavour", "spots.yaml", "--plugin", "spots.py", "--mission", "aggregation", "-o", "own.html")
    mdesign(folder, "replay", "spots.txt", *shown)
    assert (folder / "own.html").stat().st_size > 10_000


@pytest.mark.timing
def test_a_robot_goes_back_as_in_simulation(folder):
    own = read_fsm(folder / "spots.txt", "spots").software
    mission = load_mission("aggregation", ["robots=1", "duration=12", AT_THE_SPOT])
    history = Simulator(mission).run(own, 3).history
    assert ways(history.states[:, 0], history.led_colours[:, 0])[:3] == BACK
    (folder / "mercator-robot.pyz").write_bytes(bundle())
    (folder / "fsm.txt").write_text(fsm_file_text(own, {}))
    (folder / "plugins").mkdir()
    (folder / "spots.py").rename(folder / "plugins" / "spots.py")
    (folder / "spots.yaml").rename(folder / "flavour.yaml")
    in_time(lambda number: goes_back(folder, str(number)))


def goes_back(folder, twin_folder):
    log = folder / f"{twin_folder}.jsonl"
    with twin(folder / twin_folder, 1, "--set", AT_THE_SPOT):
        command = [sys.executable, "mercator-robot.pyz", "run", "fsm.txt", "--robot", f"{twin_folder}/0/robot.yaml"]
        command += ["--duration", "9", "--seed", "1", "-o", log]
        done = subprocess.run(
            [*map(str, command)], cwd=folder, capture_output=True, text=True, timeout=LIMIT, check=False
        )
        assert done.returncode == 0, done.stderr
    cycles = [decision for _, decision in replay(log)]
    assert not any(decision.differs for decision in cycles)
    found = decisions(log)
    assert found.cycles == found.states == found.wheels == len(cycles)
    assert found.changes >= 1
    assert ways([each.next_state for each in cycles], [int(each.actions.led_colour) for each in cycles])[:3] == BACK
