"""A controller is measured on what it was designed for: what differs from that is refused, or told."""

import json
import shutil

import pytest
from PIL import Image as Pillow

from mercator_design.cli.origin import origin_of
from mercator_design.config import shipped
from mercator_design.errors import MissionError
from mercator_design.missions.mission import load_mission
from mercator_design.plugins import loading as plugins
from mercator_design.race.session.journal import read
from mercator_design.results.files import JOURNAL
from tests.tiers import some

pytestmark = pytest.mark.together

QUICK = ("--set", "robots=2", "--set", "duration=2")
SEED = 2
"""Of a race whose winner has no transition that never fires: a warning would tell of it."""


@pytest.fixture(scope="module")
def whole(mdesign_once, tmp_path_factory):
    """A folder with a mission of a user's own, mine.yaml, and the folder of a race on it."""
    folder, text = tmp_path_factory.mktemp("raced"), shipped.missions()["aggregation"].read_text()
    (folder / "mine.yaml").write_text(text.replace("duration: 120", "duration: 2").replace("robots: 3", "robots: 2"))
    mdesign_once("race", folder / "mine.yaml", "--budget", 60, "--seed", SEED, "-o", folder / "r")
    return folder


@pytest.fixture
def raced(whole, tmp_path):
    """The folder of a race on a mission of a user's own, mine.yaml beside it: a copy."""
    shutil.copytree(whole, tmp_path, dirs_exist_ok=True)
    return tmp_path / "r"


def slower(folder):
    """Give the robot model of a run folder half the speed."""
    file = folder / "robot_model.yaml"
    text = file.read_text()
    assert "maximum_speed: 0.3\n" in text
    file.write_text(text.replace("maximum_speed: 0.3\n", "maximum_speed: 0.15\n"))


class TestRobotModel:
    @pytest.mark.swept
    @pytest.mark.parametrize("verb", some([("evaluate", "-n", 2), ("record", "-o", "t.csv")], 1))
    def test_one_that_was_edited_is_refused(self, mdesign, raced, tmp_path, monkeypatch, verb):
        monkeypatch.chdir(tmp_path)
        name, *options = verb
        assert mdesign(name, raced / "fsm.txt", *options)[::2] == (0, "")
        slower(raced)
        code, out, err = mdesign(name, raced / "fsm.txt", *options)
        assert (code, out) == (3, "")
        assert "fsm.txt: the robot model mercator has changed since this was designed" in err
        assert f"give --robot-model {raced}/robot_model.yaml" in err
        assert mdesign(name, raced / "fsm.txt", *options, "--robot-model", raced / "robot_model.yaml")[::2] == (0, "")
        assert mdesign(name, raced / "fsm.txt", *options, "--set", "robot_model=mercator")[::2] == (0, "")

    def test_that_of_a_mission_that_is_given_is_reported(self, mdesign, raced, tmp_path):
        given = ("--mission", raced / "mission.yaml", "-n", 2)
        assert mdesign("evaluate", raced / "fsm.txt", *given)[::2] == (0, "")
        slower(raced)
        code, _, err = mdesign("evaluate", raced / "fsm.txt", *given)
        assert code == 0
        assert "Warning" in err
        assert "was designed for another version of the robot model mercator than the present mercator" in err
        assert mdesign("evaluate", raced / "fsm.txt", *given, "--cost")[2] == ""

    def test_a_file_without_its_digest_is_compared_as_far_as_can_be(self, mdesign, raced):
        """By the folder's provenance; else that is told."""
        file = raced / "fsm.txt"
        lines = file.read_text().splitlines(keepends=True)
        file.write_text("".join(line for line in lines if "robot model digest" not in line))
        evaluate = ("evaluate", file, "-n", 2)
        assert mdesign(*evaluate)[::2] == (0, "")
        unchecked = "fsm.txt: has no digest of its robot model: it cannot be checked whether mercator has changed"
        refused = "fsm.txt: the robot model mercator has changed since this was designed"
        (raced / "provenance.json").rename(raced / "p")
        code, _, err = mdesign(*evaluate)
        assert (code, err.count("\n"), err.count(unchecked)) == (0, 1, 1)
        slower(raced)
        (raced / "p").rename(raced / "provenance.json")
        code, out, err = mdesign(*evaluate)
        assert (code, out) == (3, "")
        assert refused in err
        assert mdesign(*evaluate, "--robot-model", raced / "robot_model.yaml")[::2] == (0, "")
        code, _, err = mdesign(*evaluate, "--mission", raced / "mission.yaml")
        assert (code, "than the present mercator" in err) == (0, True)
        (raced / "provenance.json").write_text("damaged")
        file.write_text("".join(line for line in lines if not line.startswith(("# robot model", "# maximum"))))
        code, _, err = mdesign(*evaluate)
        assert (code, unchecked in err) == (0, True)

    def test_a_line_without_a_header_says_nothing_of_it(self, mdesign, raced, tmp_path):
        (tmp_path / "bare.txt").write_text((raced / "fsm.txt").read_text().splitlines()[-1])
        assert mdesign("evaluate", tmp_path / "bare.txt", "--mission", raced / "mission.yaml", "-n", 2)[::2] == (0, "")

    def test_the_header_has_the_digest_of_the_journal(self, raced):
        start = json.loads((raced / "provenance.json").read_text())["race"]
        assert f"# robot model digest: {start['robot_model_digest']}\n" in (raced / "fsm.txt").read_text()


class TestMission:
    def test_one_that_was_edited_in_the_folder_is_refused(self, mdesign, raced):
        file = raced / "mission.yaml"
        file.write_text(file.read_text().replace("radius: 0.5", "radius: 0.4"))
        code, out, err = mdesign("evaluate", raced / "fsm.txt", "-n", 2)
        assert (code, out) == (3, "")
        assert f"{file} has changed since this was designed; to use it, give --mission" in err
        assert mdesign("evaluate", raced / "fsm.txt", "-n", 2, "--mission", file)[0] == 0

    def test_one_that_was_edited_and_is_not_needed_is_reported(self, mdesign, tmp_path):
        """A shipped mission is there without the copy in the folder."""
        assert mdesign("race", "aggregation", *QUICK, "--budget", 60, "--seed", SEED, "-o", tmp_path / "r")[0] == 0
        file, evaluate = tmp_path / "r" / "mission.yaml", ("evaluate", tmp_path / "r" / "fsm.txt", "-n", 2)
        found = mdesign(*evaluate)
        assert found[::2] == (0, "")
        file.write_text(file.read_text().replace("radius: 0.5", "radius: 0.4"))
        code, out, err = mdesign(*evaluate)
        assert (code, out) == found[:2]
        assert err.startswith(f"Warning: {file} has changed since this was designed; ")
        assert err.endswith("; aggregation is used\n")
        assert mdesign(*evaluate, "--cost")[::2] == (0, "")

    def test_one_that_is_given_and_goes_by_its_name_is_reported(self, mdesign, raced, tmp_path):
        given = ("evaluate", raced / "fsm.txt", "--mission", tmp_path / "mine.yaml", "-n", 2)
        assert mdesign(*given)[::2] == (0, "")
        assert mdesign(*given, "--set", "floor.zones[0].radius=0.4")[::2] == (0, "")
        (tmp_path / "mine.yaml").write_text((tmp_path / "mine.yaml").read_text().replace("radius: 0.5", "radius: 0.4"))
        code, _, err = mdesign(*given)
        assert code == 0
        assert "Warning" in err
        assert "was designed for another mission of the name mine" in err


class TestFloorImage:
    """The pixels belong to the mission; where their file lies does not matter."""

    @pytest.fixture
    def painted(self, tmp_path):
        """Write a mission whose floor is a picture of one colour."""

        def paint(folder, colour, name="floor.png"):
            (tmp_path / folder).mkdir(exist_ok=True)
            Pillow.new("RGB", (4, 4), colour).save(tmp_path / folder / name)
            text = shipped.missions()["aggregation"].read_text()
            image = f"floor:\n  image: {{path: {name}, size: [3, 3]}}"
            (tmp_path / folder / "painted.yaml").write_text(text.replace("floor:", image))
            return tmp_path / folder / "painted.yaml"

        return paint

    RACE = ("--budget", 60, "-j", 2, "--set", "robots=2", "--set", "duration=2")

    def test_its_digest_is_of_the_pixels(self, painted):
        black, same = painted("a", "black"), painted("b", "black", "other.bmp")
        assert load_mission(black) == load_mission(same)
        assert load_mission(black).digest == load_mission(same).digest
        before = load_mission(black)
        painted("a", (0, 0, 1))
        assert load_mission(black) != before
        assert load_mission(black).digest != before.digest
        moved = load_mission(same, ["floor.image.center=[0.1, 0]"])
        assert moved.digest != before.digest

    def test_a_run_folder_has_its_own_copy(self, mdesign, painted, tmp_path):
        """The same race in another folder has the same journal; repainting or deleting the original changes nothing."""
        first, second = painted("a", "black"), painted("b", "black")
        for mission, folder in ((first, "r"), (second, "s")):
            assert mdesign("race", mission, *self.RACE, "-o", tmp_path / folder)[0] == 0
        assert read(tmp_path / "r" / JOURNAL).record.digest() == read(tmp_path / "s" / JOURNAL).record.digest()
        painted("a", "red")
        (tmp_path / "b" / "floor.png").unlink()
        for folder in "rs":
            assert mdesign("race", "--resume", tmp_path / folder, "--budget", 90, "-j", 2)[0] == 0
            assert mdesign("runs", "verify", tmp_path / folder)[0] == 0
        assert read(tmp_path / "r" / JOURNAL).record.digest() == read(tmp_path / "s" / JOURNAL).record.digest()
        assert mission_of(tmp_path / "r").floor.image.pixels.max() == 0
        shutil.copytree(tmp_path / "r", tmp_path / "moved")
        found = [mdesign("evaluate", tmp_path / folder / "fsm.txt", "-n", 5, "--json") for folder in ("r", "moved")]
        assert found[0] == found[1]
        assert found[0][0] == 0

    def test_one_that_was_repainted_is_refused_or_told(self, mdesign, painted, tmp_path):
        mission = painted("a", "black")
        mdesign("race", mission, *self.RACE, "-o", tmp_path / "r")
        evaluate = ("evaluate", tmp_path / "r" / "fsm.txt", "-n", 2)
        painted("a", "red")
        code, _, err = mdesign(*evaluate, "--mission", mission)
        assert (code, "was designed for another mission of the name painted" in err) == (0, True)
        Pillow.new("RGB", (4, 4), "red").save(tmp_path / "r" / "floor.png")
        code, out, err = mdesign(*evaluate)
        assert (code, out) == (3, "")
        assert "mission.yaml has changed since this was designed" in err
        code, out, err = mdesign("race", "--resume", tmp_path / "r", "--budget", 90)
        assert (code, out) == (1, "")
        assert "mission_digest: raced with " in err

    def test_a_scenario_for_irace_has_its_own_copy_too(self, mdesign, painted, tmp_path):
        mission = painted("a", "black")
        assert mdesign("export", "irace", mission, "--budget", 300, "-o", tmp_path / "x")[0] == 0
        mission.unlink()
        (tmp_path / "a" / "floor.png").unlink()
        assert mission_of(tmp_path / "x").floor.image.pixels.max() == 0


def mission_of(folder):
    return load_mission(folder / "mission.yaml")


PLUGIN = """
from mercator_design import objective

with open(LOG, "a") as file:
    file.write("{}")

@objective
def nothing(trace) -> float:
    return float(trace.poses[-1, 0, 0])
"""


class TestPlugins:
    """A plugin that is not what it was is refused, or told, before any of it runs."""

    @pytest.fixture
    def mdesign_anew(self, mdesign):
        """Run mdesign as in a process of its own: what it loads is gone afterwards."""

        def run(*arguments):
            restore = plugins.snapshot()
            try:
                return mdesign(*arguments)
            finally:
                restore()

        return run

    @pytest.fixture
    def edited(self, mdesign_anew, tmp_path):
        """The folder of a race with a plugin, whose file has another version now."""
        file = tmp_path / "mine.py"
        file.write_text(PLUGIN.replace("LOG", repr(str(tmp_path / "ran"))).format("1"))
        objective = ("--set", "objective={name: nothing, direction: maximise}")
        race = ("race", "aggregation", *objective, *QUICK, "--plugin", file, "--budget", 60, "-o", tmp_path / "r")
        assert mdesign_anew(*race)[0] == 0
        file.write_text(PLUGIN.replace("LOG", repr(str(tmp_path / "ran"))).format("2"))
        return file

    def ran(self, file):
        """Which versions of it ran since this was asked before, in this order."""
        log = file.parent / "ran"
        found = log.read_text() if log.exists() else ""
        log.unlink(missing_ok=True)
        return found

    @pytest.mark.parametrize("headless", [False, True])
    def test_a_controller_s(self, edited, mdesign_anew, tmp_path, headless):
        fsm = tmp_path / "r" / "fsm.txt"
        if headless:  # so that the folder's provenance counts
            lines = fsm.read_text().splitlines(keepends=True)
            fsm.write_text("".join(line for line in lines if not line.startswith("# plugins")))
        self.ran(edited)
        for verb in (("evaluate", fsm, "-n", 2), ("record", fsm, "-o", tmp_path / "t.csv")):
            code, out, err = mdesign_anew(*verb, "--plugin", edited)
            assert (code, out, self.ran(edited)) == (3, "", "")
            assert f"{fsm}: mine.py has changed since this was designed; it was not run" in err
            code, _, err = mdesign_anew(*verb, "--plugin", tmp_path / "r" / "plugins" / "mine.py")
            assert (code, "mine.py" in err, self.ran(edited)) == (0, False, "1"), err
            code, _, err = mdesign_anew(*verb, "--plugin", edited, "--mission", tmp_path / "r" / "mission.yaml")
            assert (code, self.ran(edited)) == (0, "2")
            assert f"Warning: {fsm}: mine.py has changed since this was designed; the present version is used\n" in err

    def test_a_run_folder_s(self, edited, mdesign_anew, tmp_path):
        self.ran(edited)
        folder = tmp_path / "r"
        for verb in (("runs", "verify", folder), ("runs", "importance", folder), ("race", "--resume", folder)):
            code, out, err = mdesign_anew(*verb, "--plugin", edited)
            assert (code, out, self.ran(edited)) == (3, "", "")
            assert f"{edited}: expected a plugin of digest" in err
            assert "it was not run" in err

    def test_one_that_is_not_given_is_named_where_it_is(self, edited, mdesign_anew, tmp_path):
        folder = tmp_path / "r"
        code, _, err = mdesign_anew("evaluate", folder / "fsm.txt", "-n", 2)
        place = f"give --plugin {folder}/plugins/mine.py, or --mission"
        assert (code, err) == (3, f"Error: {folder}/fsm.txt: was designed with the plugin mine.py; {place}\n")
        shutil.copy(folder / "fsm.txt", tmp_path)
        code, _, err = mdesign_anew("evaluate", tmp_path / "fsm.txt", "-n", 2)
        place = "give that plugin with --plugin, or --mission"
        assert (code, err) == (3, f"Error: {tmp_path}/fsm.txt: was designed with the plugin mine.py; {place}\n")

    @pytest.mark.parametrize("name", ["x" * 300, "mine\0.py", "..", "../mine.py"])
    def test_the_name_of_no_file(self, tmp_path, name):
        (tmp_path / "plugins").mkdir()
        (tmp_path / "mine.py").touch()
        with pytest.raises(MissionError, match=r"fsm\.txt: was designed with the plugin .*; give that plugin with"):
            origin_of(tmp_path / "fsm.txt", {"plugins": f"{name} 0123"}).check_loaded()
