"""Pictures of missions: what is where, in which file, and that there is one of each shipped mission."""

import xml.etree.ElementTree as ET

import matplotlib as mpl
import numpy as np
import pytest
from PIL import Image

from docs import gallery
from mercator_design.config import shipped
from mercator_design.missions.mission import load_mission, parse_mission
from mercator_design.results.experiments.preview import preview_of
from mercator_design.show.pictures.preview import draw_preview, save_preview
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.simulate import Simulator
from tests.tiers import some

LABYRINTH = """
schema: 1
robots: 2
duration: 10
arena:
  walls: {shape: polygon, vertices: [[-2, -1], [2, -1], [2, 1.5], [0, 1.5], [0, 0.5], [-2, 0.5]]}
  obstacles: [{center: [0.5, 0], size: [0.05, 0.8], angle: 0.4}]
  room: {shape: polygon, vertices: [[-2.3, -1.2], [2.3, -1.2], [2.3, 1.9], [-2.3, 1.9]]}
floor:
  background: white
  zones:
    - {name: nest, shape: half_plane, point: [-1.5, 0], normal: [-1, 0], color: blue}
    - {name: cache, shape: disc, center: [1.5, -0.5], radius: 0.3, color: red}
    - {name: two, shape: tiles, size: 0.1, centers: [[1, 1], [1.5, 1]], colors: {green: 2}}
lights:
  - {position: [50, 3, 2], intensity: 4}
  - {position: [-1, 1, 0.2], intensity: 4, seen_by: [0]}
placement: {shape: rectangle, size: [1, 0.9], center: [-0.6, -0.4]}
objective: {name: robots_in_zone, zones: [nest, cache], direction: maximise}
"""


pytestmark = pytest.mark.together


THIN = """
schema: 1
robots: 1
duration: 10
arena: {walls: {shape: polygon, vertices: VERTICES}}
floor: {background: white, zones: [{name: nest, shape: disc, center: [0, 0], radius: 0.2, color: black}]}
placement: {shape: disc, radius: 0.1}
objective: {name: robots_in_zone, zones: [nest], direction: maximise}
"""


@pytest.mark.parametrize(("x", "y"), [(900, 0.3), (0.3, 900)])
def test_a_thin_arena(x, y, tmp_path):
    vertices = str([[-x, -y], [x, -y], [x, y], [-x, y]])
    simulator = Simulator(parse_mission(THIN.replace("VERTICES", vertices), name="thin"))
    save_preview(tmp_path / "thin.png", preview_of(simulator, seed=1))


@pytest.fixture(scope="module")
def labyrinth():
    return Simulator(parse_mission(LABYRINTH, name="labyrinth"))


@pytest.fixture(scope="module")
def drawn(labyrinth):
    """Its picture, of the instance of seed 1."""
    return draw_preview(preview_of(labyrinth, seed=1))


def floor_pixel(axes, x, y):
    """The colour that is drawn at a place of the floor."""
    (image,) = axes.images
    left, right, bottom, top = image.get_extent()
    pixels = np.asarray(image.get_array())
    row, column = (top - y) / (top - bottom) * len(pixels), (x - left) / (right - left) * pixels.shape[1]
    return tuple(int(channel) for channel in pixels[int(row), int(column)])


def texts(axes):
    return {text.get_text(): text.get_position() for text in axes.texts}


def outlines(axes):
    """The corners of all polygons drawn, each without its repeated first corner."""
    return [patch.get_xy()[:-1] for patch in axes.patches]


def test_the_floor_is_where_the_mission_says(drawn):
    (axes,) = drawn.axes
    assert floor_pixel(axes, -1.9, 0.0) == (0, 0, 255)
    assert floor_pixel(axes, -1.4, 0.0) == (255, 255, 255)
    assert floor_pixel(axes, 1.5, -0.25) == (255, 0, 0)
    assert floor_pixel(axes, 1.5, -0.15) == (255, 255, 255)
    assert floor_pixel(axes, 1.5, 1.0) == (0, 255, 0)


def test_walls_obstacles_and_room_are_drawn(labyrinth, drawn):
    arena = labyrinth.mission.arena
    for corners in (arena.corners(), arena.obstacles[0].corners(), arena.room.corners()):
        assert any(len(each) == len(corners) and np.allclose(each, corners) for each in outlines(drawn.axes[0]))


@pytest.mark.parametrize("seed", [1, 2])
def test_robots_stand_where_the_instance_has_them(labyrinth, drawn, seed):
    found = outlines((drawn if seed == 1 else draw_preview(preview_of(labyrinth, seed=seed))).axes[0])
    poses = labyrinth.instance(seed).swarm.poses
    body = load_robot_model("mercator").body
    for x, y, heading in poses[:, :3]:
        turn = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
        front_left = np.array([x, y]) + turn @ [0.5 * body.length, 0.5 * body.width]
        assert any(np.allclose(each[0], front_left) for each in found)


def test_bodies_have_their_shape():
    box, disc = (load_robot_model(name).body.outline() for name in ("mercator", "epuck"))
    assert box.max(axis=0) == pytest.approx([0.143, 0.143])
    assert len(box) == 4
    radius = load_robot_model("epuck").body.radius
    assert np.hypot(*disc.T) == pytest.approx(np.full(len(disc), radius))


def test_zones_and_lights_are_named(drawn):
    (axes,) = drawn.axes
    found = texts(axes)
    assert found["cache"] == pytest.approx((1.5, -0.5), abs=0.05)
    assert found["nest"] == pytest.approx((-1.75, -0.25), abs=0.3)
    assert "two" not in found  # in two pieces
    assert {"light, 2 m high\nat (50, 3) m", "light, 0.2 m high\nfor robots 0"} <= set(found)
    (near,) = [marks.get_offsets()[0] for marks in axes.collections if np.allclose(marks.get_offsets()[0], [-1, 1])]
    assert axes.get_xlim()[0] < near[0]
    assert axes.get_xlim()[1] < 10


def test_a_light_that_is_off_is_hollow_and_says_so():
    lights = "lights=[{position: [0.5, 0, 1], intensity: 0}, {position: [-0.5, 0, 1], intensity: 2}]"
    (axes,) = draw_preview(preview_of(Simulator(load_mission("aggregation", [lights])), seed=1)).axes
    filled = {
        tuple(marks.get_offsets()[0]): len(marks.get_facecolors()) > 0
        for marks in axes.collections
        if not hasattr(marks, "levels")
    }
    assert filled == {(0.5, 0.0): False, (-0.5, 0.0): True}
    says = {text.get_text(): tuple(text.xy) for text in axes.texts if text.get_text().startswith("light")}
    assert says == {"light, off": (0.5, 0.0), "light, 1 m high": (-0.5, 0.0)}


def start_area(axes, what="start area"):
    """The corners of the border of the start area, or of something else, if it is drawn."""
    points = [
        path.vertices
        for contour in axes.collections
        if contour.get_label() == f"_{what}"
        for path in contour.get_paths()
    ]
    return np.vstack(points) if points else None


def test_the_reach_of_centres_keeps_from_walls_and_what_is_out_of_reach_is_hatched():
    box = "arena.obstacles=[{center: [0.4, 0], size: [0.02, 2]}]"
    mission = load_mission(
        "aggregation",
        [
            "arena.walls={shape: polygon, vertices: [[-1, -1], [1, -1], [1, 1], [-1, 1]]}",
            box,
            "placement={shape: rectangle, center: [-0.4, 0], size: [1, 1]}",
        ],
    )
    figure = draw_preview(preview_of(Simulator(mission), seed=1))
    reach, hidden = (start_area(figure.axes[0], what) for what in ("reach of centres", "out of reach"))
    assert reach.min(axis=0) == pytest.approx([-0.857, -0.857], abs=0.03)
    assert reach.max(axis=0) == pytest.approx([0.247, 0.857], abs=0.03)
    assert hidden.min(axis=0) == pytest.approx([0.41, -1], abs=0.03)
    assert hidden.max(axis=0) == pytest.approx([1, 1], abs=0.03)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "start area",
        "reach of centres",
        "out of reach",
    ]


def test_where_all_is_in_reach_nothing_is_hatched(drawn):
    assert start_area(drawn.axes[0], "out of reach") is None
    assert [text.get_text() for text in drawn.legends[0].get_texts()] == ["start area", "reach of centres"]


def test_the_start_area_is_the_placements_within_the_walls(drawn):
    area = start_area(drawn.axes[0])
    assert area.min(axis=0) == pytest.approx([-1.1, -0.85], abs=0.05)
    assert area.max(axis=0) == pytest.approx([-0.1, 0.05], abs=0.05)
    wide = Simulator(load_mission("aggregation", ["placement.radius=9"]))
    assert np.hypot(*start_area(draw_preview(preview_of(wide, seed=1)).axes[0]).T).max() == pytest.approx(
        1.226, abs=0.06
    )


def test_the_start_area_has_its_corners(drawn):
    """Of the rectangle, within 1 cm in an arena of 4 m."""
    area = start_area(drawn.axes[0])
    for corner in ((-1.1, -0.85), (-0.1, -0.85), (-1.1, 0.05), (-0.1, 0.05)):
        assert np.linalg.norm(area - corner, axis=1).min() < 0.01


def test_the_title_is_as_in_yaml():
    figure = draw_preview(preview_of(Simulator(load_mission("aac", ["objective.share=true"])), seed=1))
    assert any("when: always; share: true" in text.get_text() for text in figure.texts)


def test_the_title_has_no_parameter_without_a_value():
    figure = draw_preview(preview_of(Simulator(load_mission("foraging")), seed=1))
    assert any(text.get_text().endswith("nests: nest") for text in figure.texts)


def test_fixed_poses_have_no_start_area():
    mission = load_mission("aggregation", ["placement={shape: poses, poses: [[0, 0, 0], [0.5, 0, 1], [-0.5, 0, 2]]}"])
    assert start_area(draw_preview(preview_of(Simulator(mission), seed=1)).axes[0]) is None


def test_a_start_area_too_small_to_draw():
    mission = load_mission("aggregation", ["robots=1", "placement.radius=0.001"])
    assert start_area(draw_preview(preview_of(Simulator(mission), seed=1)).axes[0]) is None


@pytest.mark.parametrize("size", [(8.0, 0.6), (0.6, 8.0), (0.5, 0.5), (300.0, 200.0)])
def test_any_shape_fits_with_metres_alike_along_both_axes(size):
    x, y = size
    corners = f"[[0, 0], [{x}, 0], [{x}, {y}], [0, {y}]]"
    mission = load_mission(
        "aggregation",
        [
            "robots=1",
            f"arena.walls={{shape: polygon, vertices: {corners}}}",
            f"placement={{shape: poses, poses: [[{x / 2}, {y / 2}, 0]]}}",
        ],
    )
    figure = draw_preview(preview_of(Simulator(mission), seed=1))
    (axes,) = figure.axes
    box, (width, height) = axes.get_position(original=True), figure.get_size_inches()
    drawn = np.array([box.width * width, box.height * height])
    shown = np.array([np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim())])
    assert drawn[0] / shown[0] == pytest.approx(drawn[1] / shown[1])
    assert 0.0 < box.x0 < box.x1 < 1.0
    assert 0.0 < box.y0 < box.y1 < 1.0
    ticks = [axis.get_major_locator()() for axis in (axes.xaxis, axes.yaxis)]
    assert all(len(each) < 22 for each in ticks)  # half an inch or more from one to the next


@pytest.fixture(scope="module")
def files(tmp_path_factory, labyrinth):
    """Pictures of the instance of seed 1, by ending."""
    folder = tmp_path_factory.mktemp("pictures")
    found = {suffix: folder / f"a{suffix}" for suffix in (".PNG", ".svg")}
    for file in found.values():
        save_preview(file, preview_of(labyrinth, seed=1))
    assert sorted(folder.iterdir()) == sorted(found.values())
    return found


class TestFiles:
    @pytest.mark.swept
    @pytest.mark.parametrize("suffix", some([".PNG", ".svg"], 1))
    def test_the_same_to_the_last_byte_whatever_the_users_style(self, files, tmp_path, labyrinth, suffix):
        with mpl.rc_context({"font.size": 20.0, "lines.linewidth": 9.0, "text.usetex": True}):
            save_preview(tmp_path / f"b{suffix}", preview_of(labyrinth, seed=1))
            assert mpl.rcParams["font.size"] == 20.0
        assert files[suffix].read_bytes() == (tmp_path / f"b{suffix}").read_bytes()

    @pytest.mark.swept
    @pytest.mark.parametrize("suffix", some([".PNG", ".svg"], 1))
    def test_another_instance_is_another_picture(self, files, tmp_path, labyrinth, suffix):
        save_preview(tmp_path / f"c{suffix}", preview_of(labyrinth, seed=2))
        assert files[suffix].read_bytes() != (tmp_path / f"c{suffix}").read_bytes()

    def test_they_are_what_they_are_called(self, files):
        with Image.open(files[".PNG"]) as picture:
            assert picture.format == "PNG"
            assert picture.width == 736
            assert picture.getpixel((2, 2))[:3] == (255, 255, 255)
        text = files[".svg"].read_text()
        assert ET.fromstring(text).tag.endswith("svg")  # noqa: S314 - our own
        assert "<dc:date>" not in text


class TestGallery:
    def test_the_gallery_shows_every_shipped_mission(self):
        assert gallery.GALLERY.read() == gallery.gallery(list(shipped.missions())), "run python docs/gallery.py"

    def test_every_shipped_mission_has_a_picture_and_no_other_has(self):
        assert {file.stem for file in gallery.PICTURES.iterdir()} == set(shipped.missions())
        assert sum(file.stat().st_size for file in gallery.PICTURES.iterdir()) < 2_000_000

    @pytest.mark.swept
    @pytest.mark.parametrize("name", some(shipped.missions(), 1))
    def test_it_is_drawn_as_the_mission_is_now(self, name, tmp_path):
        """But for the edges of letters and lines, in which versions of the libraries may differ."""
        gallery.draw(name, tmp_path / "now.png")
        with Image.open(tmp_path / "now.png") as now, Image.open(gallery.PICTURES / f"{name}.png") as kept:
            assert now.size == kept.size
            coarse = [np.asarray(picture.convert("RGB").reduce(8), int) for picture in (now, kept)]
        assert np.mean(np.abs(coarse[0] - coarse[1]).max(axis=-1) > 48) < 0.005, "run python docs/gallery.py"
