"""Files that parameters of a plugin's functions name: their contents belong to the mission."""

import shutil
from pathlib import Path

import pytest

from mercator_design.config import shipped
from mercator_design.errors import MissionError
from mercator_design.fsm.text import parse
from mercator_design.missions.mission import load_mission
from mercator_design.plugins.loading import load_plugin
from mercator_design.race.session.journal import read
from mercator_design.results.files import JOURNAL
from mercator_design.sim.simulate import Simulator

PLUGIN = '''
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, NamedTuple

from mercator_design import FilePath, dynamic, jittable, objective

File = Annotated[str, FilePath()]


class Weighted(NamedTuple):
    file: File
    weight: float = 1.0


@objective
def worth(
    trace, *, one: File, more: tuple[File, ...] = (), by_name: Mapping[str, Weighted] = {}, last: File | None = None,
    model: Annotated[str, FilePath(unless_name=True)] = "none",
) -> float:
    """What files say, and a little of where a robot is."""
    weighted = [float(Path(each.file).read_text()) * each.weight for each in by_name.values()]
    others = [float(Path(each).read_text()) for each in (one, *more, *([last] if last else []))]
    assert model == "none"
    return sum(weighted) + sum(others) + 1e-9 * float(trace.poses[-1, 0, 0])


@jittable
def stay(floor, table, poses, time):
    pass


@dynamic(change=stay)
def staying(site, *, numbers: File):
    return [tuple(map(float, Path(numbers).read_text().split()))]
'''
OBJECTIVE = (
    "objective: {name: worth, direction: maximise, one: data/one, more: [data/two, data/one], "
    "by_name: {a: {file: data/three, weight: 100}}, last: data/four}\n"
)
QUICK = ("--set", "robots=2", "--set", "duration=0.2")


@pytest.fixture
def plugin(tmp_path, registries, monkeypatch):
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")  # its kernel would be compiled for each copy
    file = tmp_path / "p.py"
    file.write_text(PLUGIN)
    load_plugin(file)
    return file


@pytest.fixture
def written(tmp_path):
    """Write a mission and its files to a folder."""

    def write(folder):
        (tmp_path / folder / "data").mkdir(parents=True)
        for number, name in enumerate(("one", "two", "three", "four"), start=1):
            (tmp_path / folder / "data" / name).write_text(f"{number}")
        text = shipped.missions()["aggregation"].read_text().partition("objective:")[0]
        text = text.replace("\nfloor:\n", "\nfloor:\n  dynamics: [{name: staying, numbers: data/one}]\n")
        assert "staying" in text
        (tmp_path / folder / "m.yaml").write_text(text + OBJECTIVE)
        return tmp_path / folder / "m.yaml"

    return write


def score(mission):
    return Simulator(load_mission(mission, ["duration=1"])).run(parse("--nstates 1 --s0 1"), 1).score


@pytest.mark.usefixtures("plugin")
class TestContents:
    def test_they_are_in_the_digest_and_paths_are_not(self, written):
        one, other = written("a"), written("b")
        assert load_mission(one).digest == load_mission(other).digest
        assert score(one) == pytest.approx(1 + 2 + 1 + 300 + 4)
        digests = {load_mission(one).digest}
        for name in ("one", "two", "three", "four"):
            (other.parent / "data" / name).write_text("7")
            digests.add(load_mission(other).digest)
        assert len(digests) == 5

    def test_what_was_read_is_what_is_run(self, written):
        """Whatever becomes of the files; and nobody changes the copy by mistake."""
        mission = load_mission(written("a"), ["duration=1"])
        shutil.rmtree(Path(mission.objective.parameters["one"]).parent)
        outcome = Simulator(mission).run(parse("--nstates 1 --s0 1"), 1)
        assert outcome.score == pytest.approx(308)

    @pytest.mark.parametrize(
        ("change", "words"),
        [
            (lambda data: (data / "two").unlink(), r"more\[0\]: no such file: /\S+/data/two"),
            (lambda data: (data / "one").write_bytes(bytes(17 << 20)), "one: expected at most 16384 KiB, found a"),
            (lambda data: ((data / "four").unlink(), (data / "four").mkdir()), "last: expected a file, found a folder"),
        ],
    )
    def test_one_that_cannot_be_read(self, written, change, words):
        mission = written("a")
        change(mission.parent / "data")
        with pytest.raises(MissionError, match=words):
            load_mission(mission)

    def test_a_mission_without_any_keeps_its_digest(self):
        assert load_mission("aggregation").digest == "d821a0b46dddb11f"


@pytest.mark.thorough
def test_a_run_folder_has_its_own_copies(mdesign, plugin, written, tmp_path):
    """The race goes on and is verified and measured by them, by threads and processes."""
    for folder, executor in (("a", "threads"), ("b", "processes")):
        race = ("race", written(folder), "--plugin", plugin, *QUICK, "--budget", 20, "--executor", executor, "-j", 2)
        assert mdesign(*race, "-o", tmp_path / folder / "r")[0] == 0
        shutil.rmtree(tmp_path / folder / "data")
    a, b = tmp_path / "a" / "r", tmp_path / "b" / "r"
    assert read(a / JOURNAL).record.digest() == read(b / JOURNAL).record.digest()
    copies = {path.relative_to(a).as_posix() for path in (a / "files").glob("*/*")}
    assert {Path(path).name for path in copies} == {"one", "two", "three", "four"}
    assert load_mission(a / "mission.yaml").files.keys() == copies  # functions are given the same names
    shutil.move(a, tmp_path / "moved")
    for verb in (("race", "--resume", tmp_path / "moved", "--budget", 24), ("runs", "verify", tmp_path / "moved")):
        assert mdesign(*verb)[0] == 0
    assert mdesign("evaluate", tmp_path / "moved" / "fsm.txt", "--plugin", plugin, "-n", 2)[0] == 0
    assert mdesign("export", "irace", b / "mission.yaml", "--plugin", plugin, "-o", tmp_path / "x")[0] == 0
    assert load_mission(tmp_path / "x" / "mission.yaml").digest == load_mission(b / "mission.yaml").digest
    (copy,) = (b / "files").glob("*/three")
    copy.write_text("4")
    code, out, err = mdesign("race", "--resume", b, "--budget", 24)
    assert (code, out) == (1, "")
    assert "mission_digest: raced with " in err
    code, out, err = mdesign("evaluate", b / "fsm.txt", "--plugin", plugin, "-n", 2)
    assert (code, out) == (3, "")
    assert "mission.yaml has changed since this was designed" in err
