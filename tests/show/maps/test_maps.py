"""Maps in the formats of other programs, and the command that makes them."""

import contextlib
import csv
import errno
import gzip
import io
import json
import re
from dataclasses import replace

import numpy as np
import pytest
import yaml
from click.testing import CliRunner
from PIL import Image

from mercator_design.cli import cli
from mercator_design.errors import MercatorError
from mercator_design.mapping import poses
from mercator_design.mapping.merit.occupancy import distances_to
from mercator_design.mapping.plan.occupancy import occupancy_of
from mercator_design.mapping.plan.plans import messages_of, plans_of
from mercator_design.mapping.swarm import map_swarm
from mercator_design.show.maps import folder, formats
from mercator_design.show.maps.folder import write_maps
from mercator_design.show.maps.page import growing
from mercator_design.show.maps.picture import magnification_of
from mercator_design.show.maps.summary import text
from mercator_design.sim.robot_model import load_robot_model
from tests.mapping import analytic

pytestmark = pytest.mark.together


@pytest.fixture(scope="module")
def log():
    return analytic.log(seconds=12.0)


@pytest.fixture(scope="module")
def plan(log):
    start = poses.interpolate(log.truth_times, log.truth, log.odometry_times[:1])[0]
    (plan,) = plans_of(map_swarm([replace(log, name="robot <1>", start=start)]))
    return plan


def test_the_map_of_ros(plan):
    """As map_server reads it: the first row of the picture is the last one of y, and 205 is unknown."""
    grid = plan.occupancy
    levels = np.asarray(Image.open(io.BytesIO(formats.pgm_of(grid))))
    assert set(np.unique(levels)) == {0, 205, 254}
    described = yaml.safe_load(formats.yaml_of(grid, "map.pgm"))
    assert described["image"] == "map.pgm"
    share = (255 - levels) / 255
    occupied, free = share > described["occupied_thresh"], share < described["free_thresh"]
    assert (levels[occupied] == 0).all()
    assert (levels[free] == 254).all()
    rows, columns = np.nonzero(occupied)
    y = described["origin"][1] + (len(levels) - 1 - rows + 0.5) * described["resolution"]
    x = described["origin"][0] + (columns + 0.5) * described["resolution"]
    assert np.median(distances_to(analytic.ROOM, np.column_stack([x, y]))) < 0.05


def test_ways_in_the_format_of_tum(plan):
    (way,) = plan.ways
    rows = np.loadtxt(io.StringIO(formats.tum_of(replace(way, offset=0.5))))
    assert rows.shape == (len(way.turns), 8)
    assert rows[:, 0] == pytest.approx(way.times - 0.5, abs=1e-6)
    assert rows[:, 1:3] == pytest.approx(way.poses[:, :2], abs=1e-5)
    assert np.hypot(rows[:, 6], rows[:, 7]) == pytest.approx(1.0)
    turned = 2 * np.arctan2(rows[:, 6], rows[:, 7]) - way.poses[:, 2]
    assert np.cos(turned) == pytest.approx(1.0)


def test_walls_as_geojson(plan):
    found = json.loads(formats.geojson_of(plan))
    kinds = [one["properties"]["kind"] for one in found["features"]]
    assert kinds.count("wall") == len(plan.lines) > 4
    assert kinds.count("way") == 1
    assert found["features"][0]["geometry"]["type"] == "LineString"
    assert np.allclose(found["features"][0]["geometry"]["coordinates"], plan.lines[0].reshape(2, 2), atol=1e-4)


def test_pieces_as_csv(plan):
    header, *rows = csv.reader(io.StringIO(formats.surfels_csv(plan.pieces)))
    assert header == ["x", "y", "normal_x", "normal_y", "points"]
    assert np.array(rows, float)[:, :2] == pytest.approx(plan.pieces[:, :2], abs=1e-4)


def test_keyframes_with_their_covariances(plan):
    header, *rows = csv.reader(io.StringIO(formats.keyframes_csv(plan)))
    (way,) = plan.ways
    assert header == ["robot", "time", "x", "y", "yaw", "x_x", "x_y", "y_y", "x_yaw", "y_yaw", "yaw_yaw"]
    assert len(rows) == len(way.keyframes) > 5
    values = np.array([row[1:] for row in rows], float)
    assert values[:, 1:4] == pytest.approx(way.keyframe_poses, abs=1e-5)
    assert values[:, 5] == pytest.approx(way.covariances[:, 0, 1], rel=1e-3)
    assert (values[:, [4, 6, 9]] > 0.0).all()


def test_ellipses_are_magnified_until_they_can_be_seen(plan):
    (way,) = plan.ways
    assert magnification_of(plan) in {10.0, 20.0, 50.0, 100.0}
    wide = replace(plan, ways=(replace(way, covariances=1e6 * way.covariances),))
    assert magnification_of(wide) == 1.0
    unknown = replace(plan, ways=(replace(way, covariances=0.0 * way.covariances),))
    assert magnification_of(unknown) == 1.0


def test_a_folder(plan, tmp_path):
    """Two maps have files of their own, and a robot's name is no path."""
    found = write_maps(tmp_path / "a" / "b", [plan, plan], ["Two maps."], "a caption")
    names = sorted(file.name for file in (tmp_path / "a" / "b").iterdir())
    ends = [tuple(name.split(".")) for name in names]
    first = [("keyframes", "csv"), ("map", "pgm"), ("map", "png"), ("map", "yaml"), ("robot-1", "tum")]
    first += [("surfels", "csv"), ("walls", "geojson")]
    second = [(f"{stem}-2", suffix) for stem, suffix in first]
    assert sorted(ends) == sorted([*first, *second, ("report", "html"), ("summary", "json")])
    assert json.loads((tmp_path / "a" / "b" / "summary.json").read_text()) == found
    with Image.open(tmp_path / "a" / "b" / "map.png") as picture:
        assert min(picture.size) > 300
    said = text(found)
    assert "map 2: 1 robot" in said
    assert "Two maps." in said
    assert "error of turns" in said
    assert "error over 1 m" in said
    assert "F1 of occupied cells: 0.9" in said


def test_files_of_an_earlier_map_are_removed_and_no_others(plan, tmp_path):
    write_maps(tmp_path, [plan, plan], [])
    (tmp_path / "mine-2.tum").write_text("")
    write_maps(tmp_path, [plan], [])
    assert [file.name for file in tmp_path.iterdir() if "-2." in file.name] == ["mine-2.tum"]
    assert (tmp_path / "robot-1.tum").exists()


def test_a_full_disk_leaves_the_earlier_map_as_it_was(plan, tmp_path, monkeypatch):
    write_maps(tmp_path / "map", [plan], ["The first one."])
    before = {path.name: path.read_bytes() for path in (tmp_path / "map").iterdir()}
    real = folder.replacing

    @contextlib.contextmanager
    def filling_up(path):
        if path.name == "report.html":
            raise OSError(errno.ENOSPC, "No space left on device")
        with real(path) as file:
            yield file

    monkeypatch.setattr(folder, "replacing", filling_up)
    for target in ("map", "new"):
        with pytest.raises(OSError, match="No space left"):
            write_maps(tmp_path / target, [plan], ["The second one."])
    assert {path.name: path.read_bytes() for path in (tmp_path / "map").iterdir()} == before
    assert not (tmp_path / "new").exists()


def test_names_of_robots_that_differ_little_are_different_files(plan, tmp_path):
    """Also where a file system does not tell upper from lower case, or a robot's name looks like that of a map."""
    (way,) = plan.ways
    first = replace(plan, ways=tuple(replace(way, name=name) for name in ("Twin", "twin", "twin (2)", "x" * 300)))
    second = replace(plan, ways=(replace(way, name="twin"),))
    files = [path.split("/")[-1] for path in write_maps(tmp_path, [first, second], [])["files"] if ".tum" in path]
    assert files == ["Twin.tum", "twin-2.tum", "twin-2-2.tum", f"{'x' * 60}.tum", "twin-2-3.tum"]
    assert all((tmp_path / name).exists() for name in files)


def test_messages_do_not_list_thousands_of_moments(plan):
    (way,) = plan.ways
    track = way.track
    torn = replace(track, segments=np.arange(len(track.times)), times=np.cumsum(np.full(len(track.times), 20.0)))
    lost, gaps = messages_of([torn, replace(track, times=np.concatenate([track.times[:-1], track.times[-1:] + 90]))])
    assert re.search(r"was lost 20.0, 40.0, 60.0, 80.0, 100.0 and \d+ more s after", lost)
    assert gaps.endswith("s on.")


def test_a_note_of_a_log_and_turns_of_one_time_are_told(log):
    at_once = [turn._replace(times=np.full(len(turn.times), turn.middle)) for turn in log.turns[:3]]
    noted = replace(log, turns=at_once, notes=("its last line is cut, and left out.",))
    said = messages_of(map_swarm([noted]).tracks)
    assert said[0] == "robot: its last line is cut, and left out."
    assert "all beams of a turn have one time" in said[1]


def test_no_log_is_overwritten(carmen, tmp_path):
    (tmp_path / "map").mkdir()
    linked = tmp_path / "map" / "log.tum"
    linked.symlink_to(carmen)
    done = CliRunner().invoke(cli, ["map", str(carmen), "-o", str(tmp_path / "map")])
    assert done.exit_code == 2
    assert "log.tum: expected another file than the one that is read" in done.output


def test_a_grid_without_end_is_refused(plan):
    with pytest.raises(MercatorError, match=r"expected at most 1e\+08; use a coarser --resolution"):
        occupancy_of(plan.ways, 1e-5)


def test_walls_appear_when_they_are_first_seen(plan):
    """In the order of time, so that a viewer can stop at the first that is later."""
    replay = growing(plan, load_robot_model("mercator"), "a map")
    assert replay is not None
    strokes = np.array(replay["header"]["map"])
    assert len(strokes) > 0.9 * len(plan.pieces)
    assert (np.diff(strokes[:, 4]) >= 0).all()
    assert strokes[0, 4] < strokes[-1, 4] <= replay["header"]["cycles"]
    assert distances_to(analytic.ROOM, 0.5 * (strokes[:, :2] + strokes[:, 2:4])).max() < 0.03
    assert np.hypot(*(strokes[:, 2:4] - strokes[:, :2]).T) == pytest.approx(0.05, abs=0.002)
    assert 0.003 < plan.looks.residual < 0.007  # the noise is uniform, +-1 cm: 5.8 mm rms


def test_the_page_needs_nothing_else(plan, tmp_path):
    found = write_maps(tmp_path, [plan], ["A <b>sentence</b>."], "mdesign map log")
    page = (tmp_path / "report.html").read_text()
    assert "A &lt;b&gt;sentence&lt;/b&gt;." in page
    assert "data:image/png;base64," in page
    assert "mdesign map log" in page
    assert "robot &lt;1&gt;" in page
    assert f"{100 * found['maps'][0]['robots'][0]['matched']:.1f} %" in page
    assert re.search(r'(?:src|href)="(?!data:|#)', page) is None


def test_figures_of_merit_where_the_truth_is_known(plan, tmp_path):
    truth = write_maps(tmp_path, [plan], [])["maps"][0]["truth"]
    assert truth["ate"]["turns"]["rmse"] < 0.004
    assert {name: one["pairs"] > 0 for name, one in truth["relative"].items()} == {"turn": True, "metre": True}
    assert [one["cell"] for one in truth["cells"]] == [0.05, 0.025]
    assert truth["cells"][0]["f1"] > 0.9
    shares = truth["coverage"]["shares"]
    assert (np.diff(shares) >= 0.0).all()
    assert 0.2 < shares[1] < shares[-1] == truth["coverage"]["share"]
    assert shares[-1] > 0.7  # the room's far sides of boxes are not seen
    page = (tmp_path / "report.html").read_text()
    assert "walls in the map [%]" in page
    assert "over 1 m" in page


def test_without_the_truth_there_are_no_figures_of_merit(plan, tmp_path):
    (way,) = plan.ways
    blind = replace(way, track=replace(way.track, log=replace(way.log, truth=None, truth_times=None)))
    found = write_maps(tmp_path, [replace(plan, ways=(blind,))], [])
    assert found["maps"][0]["truth"] is None
    assert "true poses" not in (tmp_path / "report.html").read_text()
    assert "error" not in text(found)


@pytest.mark.parametrize("turns", [0, 1])
def test_logs_of_hardly_anything(log, turns, tmp_path):
    swarm = map_swarm([replace(log, turns=log.turns[:turns])])
    found = write_maps(tmp_path, plans_of(swarm), [])
    assert len(found["maps"]) == turns
    assert (tmp_path / "report.html").exists()
    assert (tmp_path / "walls.geojson").exists() == bool(turns)
    assert all(one["walls"] > 3.0 for one in found["maps"])


def test_a_log_without_walls(log, tmp_path):
    blind = [one._replace(ranges=0 * one.ranges) for one in log.turns]
    found = write_maps(tmp_path, plans_of(map_swarm([replace(log, turns=blind)])), [])
    assert found["maps"][0]["walls"] == found["maps"][0]["occupied_cells"] == 0
    assert (tmp_path / "map.png").exists()


def carmen_of(log):
    """The log of a robot as lines of CARMEN, ahead half only; times of the middle of a turn."""
    lines = ["# CARMEN Logfile"]
    for turn in log.turns:
        ahead = np.abs(turn.angles) <= np.pi / 2
        angles, ranges = turn.angles[ahead][::-1], turn.ranges[ahead][::-1]
        even = np.interp(np.linspace(-np.pi / 2, np.pi / 2, 361), angles, ranges)
        x, y, theta = [np.interp(turn.middle, log.odometry_times, log.odometry[:, k]) for k in range(3)]
        pose = f"{x} {y} {theta}"
        readings = " ".join(f"{one:.3f}" for one in even)
        lines.append(f"FLASER 361 {readings} {pose} {pose} {turn.middle} host {turn.middle}")
    return "\n".join(lines) + "\n"


@pytest.fixture
def carmen(tmp_path):
    still = lambda t: np.column_stack([0.1 * np.asarray(t), 0 * np.asarray(t), 0 * np.asarray(t)])  # noqa: E731
    path = tmp_path / "log.gz"
    path.write_bytes(gzip.compress(carmen_of(analytic.log(pose_at=still, seconds=6.0, lost=0.0)).encode()))
    return path


def run(*arguments):
    return CliRunner().invoke(cli, ["map", *map(str, arguments)], catch_exceptions=False)


def test_the_command(carmen, tmp_path):
    done = run(carmen, "-o", tmp_path / "map", "--start", "1,2,90", "--resolution", "0.1", "-q")
    assert done.exit_code == 0
    assert done.stdout.startswith("map: 1 robot, ")
    assert done.stdout.endswith(f"{tmp_path / 'map'}\n")
    assert done.stderr == ""
    first = np.loadtxt(tmp_path / "map" / "log.tum")[0]
    assert first[1:3] == pytest.approx([1.0, 2.0], abs=0.05)
    assert first[6] == pytest.approx(np.sqrt(0.5), abs=0.01)
    assert json.loads((tmp_path / "map" / "summary.json").read_text())["maps"][0]["resolution"] == 0.1


def test_the_same_log_gives_the_same_files(carmen, tmp_path):
    for name in "ab":
        run(carmen, "-o", tmp_path / name, "-q")
    for file in ("map.pgm", "walls.geojson", "surfels.csv", "log.tum"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_json(carmen, tmp_path):
    done = run(carmen, "-o", tmp_path / "map", "--json", "-q")
    assert json.loads(done.stdout) == json.loads((tmp_path / "map" / "summary.json").read_text())


def test_mistakes(carmen, tmp_path):
    def fails(*arguments):
        try:
            done = run(*arguments, "-o", tmp_path / "map")
        except Exception as error:  # noqa: BLE001 - the command line prints it
            return str(error)
        return done.output

    (tmp_path / "text").write_text("no log")
    assert "text: expected a log" in fails(tmp_path / "text")
    assert "nothing: cannot be read" in fails(tmp_path / "nothing")
    assert "expected --start once for each of 1 robots, found 2" in fails(carmen, *["--start", "0,0,0"] * 2)
    lines = gzip.decompress(carmen.read_bytes()).replace(b"FLASER 361 ", b"FLASER 9999 ", 1)
    (tmp_path / "broken").write_bytes(lines)
    assert "broken:2: expected 9999 numbers (readings), found " in fails(tmp_path / "broken")
    (tmp_path / "cut").write_bytes(carmen.read_bytes()[:-200])
    assert "cut: cannot be read" in fails(tmp_path / "cut")
