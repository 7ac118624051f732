"""Zones, tiles and pictures; the plain and the compiled form of the kernels see the same floor."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from PIL import Image as Pillow

from mercator_design import seeds
from mercator_design.config.colours import COLOURS
from mercator_design.config.schema import FieldError
from mercator_design.errors import MissionError
from mercator_design.missions.floor import (
    Disc,
    Floor,
    HalfPlane,
    Image,
    PolygonZone,
    Rectangle,
    Ring,
    Tiles,
    rgb,
)
from mercator_design.missions.floor_kernels import colour_at, colours_at, zone_at, zone_contains
from mercator_design.missions.mission import load_mission
from mercator_design.missions.pictures import MAX_PIXELS
from mercator_design.missions.trace import Trace

RNG = seeds.generator(1, "floor")
ARROW = ((0.0, 1.0), (-1.0, -1.0), (0.0, -0.5), (1.0, -1.0))
CENTERS = tuple((x / 2, y / 2) for x in range(-2, 3) for y in range(-1, 2))


def table(*zones, **floor):
    return Floor(zones=zones, **floor).realise(seeds.generator(1, "floor"))


def contains(zone, x, y):
    return zone_contains(table(zone), 0, x, y)


class TestBorders:
    """The border belongs to a zone; just beyond does not."""

    def test_disc(self):
        disc = Disc(center=(0.0, 0.0), radius=0.5, color="black")
        assert contains(disc, 0.5, 0.0)
        assert contains(disc, 0.0, -0.5)
        assert contains(disc, 0.3, 0.4)
        assert not contains(disc, math.nextafter(0.5, 1), 0.0)
        assert not contains(disc, 0.4, 0.4)
        aside = Disc(center=(2.0, 1.0), radius=0.5, color="black")
        assert contains(aside, 2.5, 1.0)
        assert not contains(aside, 0.3, 0.4)

    def test_rectangle(self):
        rectangle = Rectangle(center=(0.0, 0.0), size=(1.0, 0.5), color="black")
        assert contains(rectangle, 0.5, 0.25)
        assert contains(rectangle, -0.5, -0.25)
        assert not contains(rectangle, 0.5, math.nextafter(0.25, 1))
        assert not contains(rectangle, math.nextafter(-0.5, -1), 0.0)
        aside = Rectangle(center=(1.0, 2.0), size=(1.0, 0.5), color="black")
        assert contains(aside, 1.5, 2.25)
        assert not contains(aside, 0.0, 0.0)

    def test_turned_rectangle(self):
        rectangle = Rectangle(center=(0.0, 0.0), size=(2.0, 0.2), angle=math.pi / 6, color="black")
        along = math.cos(math.pi / 6), math.sin(math.pi / 6)
        assert contains(rectangle, 0.99 * along[0], 0.99 * along[1])
        assert not contains(rectangle, 1.01 * along[0], 1.01 * along[1])
        assert not contains(rectangle, along[0], -along[1])
        assert contains(rectangle, -0.09 * along[1], 0.09 * along[0])
        assert not contains(rectangle, -0.11 * along[1], 0.11 * along[0])

    def test_ring(self):
        ring = Ring(center=(1.0, 0.0), radius=0.5, inner_radius=0.25, color="black")
        assert contains(ring, 1.5, 0.0)
        assert contains(ring, 1.0, -0.25)
        assert not contains(ring, 1.0, 0.2)
        assert not contains(ring, 1.4, 0.4)
        with pytest.raises(FieldError, match="inner_radius: expected less than the radius, 1 m"):
            Ring(center=(0.0, 0.0), radius=1.0, inner_radius=1.0, color="black")

    @pytest.mark.parametrize("vertices", [ARROW, ARROW[::-1]])
    def test_polygon(self, vertices):
        arrow = PolygonZone(vertices=vertices, color="black")
        for x, y in [*ARROW, (0.0, 0.0), (-0.5, 0.0), (0.5, -0.75), (-0.7, -0.8)]:
            assert contains(arrow, x, y), (x, y)
        for x, y in [(0.0, 1.01), (0.0, -0.51), (0.0, -1.0), (0.51, 0.0), (-2.0, -1.0), (2.0, -0.5), (-1.0, 1.0)]:
            assert not contains(arrow, x, y), (x, y)

    def test_several_polygons(self):
        shifted = tuple((x + 5.0, y) for x, y in ARROW)
        floor = table(PolygonZone(vertices=ARROW, color="red"), PolygonZone(vertices=shifted, color="blue"))
        assert [zone_at(floor, x, 0.0) for x in (0.0, 5.0, 2.5)] == [0, 1, -1]

    def test_a_polygon_must_be_simple(self):
        with pytest.raises(FieldError, match=r"vertices\[2\]: the side from here crosses or touches side 0"):
            PolygonZone(vertices=((0.0, 0.0), (1.0, 1.0), (1.0, 0.0), (0.0, 1.0)), color="red")

    def test_half_plane(self):
        nest = HalfPlane(point=(0.0, -0.6), normal=(0.0, -2.0), color="white")
        assert contains(nest, 5.0, -0.6)
        assert contains(nest, -3.0, -7.0)
        assert not contains(nest, 0.0, math.nextafter(-0.6, 0))


def test_later_zones_are_painted_over_earlier_ones_and_all_over_the_background():
    floor = table(
        Disc(center=(0.0, 0.0), radius=1.0, color="white"),
        Rectangle(center=(0.0, 0.0), size=(1.0, 1.0), color=(1, 2, 3)),
        background="blue",
    )
    assert colour_at(floor, 0.0, 0.0) == (1.0, 2.0, 3.0)
    assert colour_at(floor, 0.9, 0.0) == (255.0, 255.0, 255.0)
    assert colour_at(floor, 1.1, 0.0) == (0.0, 0.0, 255.0)
    assert [zone_at(floor, x, 0.0) for x in (0.0, 0.9, 1.1)] == [1, 0, -1]


def test_a_bare_floor_is_gray():
    assert colour_at(table(), 3.0, 4.0) == (127.0, 127.0, 127.0)


def test_colours():
    assert rgb("orange") == (255.0, 140.0, 0.0)
    assert rgb((1, 2, 3)) == (1.0, 2.0, 3.0)
    assert len(set(COLOURS.values())) == len(COLOURS)


class TestTiles:
    TILES = Tiles(centers=CENTERS, size=0.3, colors={"green": 5, "red": 4, "yellow": 6}, name="tiles")

    def test_each_instance_deals_the_same_colours_to_other_places(self):
        floor = Floor(zones=(self.TILES,))
        tables = [floor.realise(seeds.generator(seed, "floor")) for seed in range(5)]
        for each in tables:
            assert np.array_equal(each.zones[:, 1:3], CENTERS)
            colours = [tuple(row) for row in each.zones[:, 6:]]
            counts = [colours.count(COLOURS[name]) for name in ("green", "red", "yellow")]
            assert counts == [5, 4, 6]
        assert len({each.zones.tobytes() for each in tables}) == 5  # 630630 layouts; fixed seeds
        again = floor.realise(seeds.generator(0, "floor"))
        assert np.array_equal(again.zones, tables[0].zones)

    def test_every_tile_gets_every_colour_as_often_as_it_should(self):
        """Within 5.5 standard errors at each of 15 tiles: chance of failing by luck 6e-7."""
        rng = seeds.generator(3, "floor")
        reds = np.mean([[row[6:] == COLOURS["red"] for row in self.TILES.rows(rng, [])] for _ in range(4000)], axis=0)
        expected = 4 / 15
        assert np.all(np.abs(reds - expected) < 5.5 * math.sqrt(expected * (1 - expected) / 4000))

    def test_the_counts_must_fit(self):
        with pytest.raises(FieldError, match="colors: expected one tile for each center, found 3 for 2 centers"):
            Tiles(centers=CENTERS[:2], size=0.3, colors={"green": 3})


def test_names_stand_for_rows():
    floor = Floor(
        zones=(
            Disc(center=(0.0, 0.0), radius=1.0, color="white"),
            Tiles(centers=CENTERS[:3], size=0.1, colors={"red": 3}, name="tiles"),
            Disc(center=(0.0, 0.0), radius=1.0, color="white", name="spot"),
        )
    )
    assert floor.zone_rows() == {"tiles": (1, 2, 3), "spot": (4,)}
    assert len(floor.realise(RNG).zones) == 5
    with pytest.raises(FieldError, match=r"zones\[1\].name: two zones are called 'spot'"):
        Floor(zones=(floor.zones[2], floor.zones[2]))


def test_a_half_plane_needs_a_direction():
    with pytest.raises(FieldError, match="normal"):
        HalfPlane(point=(0.0, 0.0), normal=(0.0, 0.0), color="red")


class TestImage:
    @pytest.fixture
    def picture(self, tmp_path):
        """Two rows of three pixels."""
        pixels = np.arange(18, dtype=np.uint8).reshape(2, 3, 3)
        Pillow.fromarray(pixels).save(tmp_path / "floor.png")
        return tmp_path / "floor.png", pixels

    def test_the_first_row_is_the_top_and_the_first_column_the_left(self, picture):
        path, pixels = picture
        floor = table(image=Image(path=str(path), size=(3.0, 2.0), center=(10.0, 20.0)))
        for row in (0, 1):
            for column in (0, 1, 2):
                x, y = 10.0 - 1.0 + column, 20.0 + 0.5 - row
                assert colour_at(floor, x, y) == tuple(pixels[row, column])
        assert colour_at(floor, 11.5, 19.0) == tuple(pixels[1, 2])  # the border belongs to it
        assert colour_at(floor, 8.5, 21.0) == tuple(pixels[0, 0])
        assert colour_at(floor, 11.6, 20.0) == COLOURS["gray"]
        assert colour_at(floor, 10.0, 18.9) == COLOURS["gray"]

    def test_zones_are_painted_over_it(self, picture):
        disc = Disc(center=(0.0, 0.0), radius=0.1, color="red")
        floor = table(disc, image=Image(path=str(picture[0]), size=(3.0, 2.0)))
        assert colour_at(floor, 0.0, 0.0) == COLOURS["red"]
        assert colour_at(floor, 0.2, 0.1) != COLOURS["red"]

    def test_other_modes_become_rgb(self, tmp_path):
        Pillow.new("L", (4, 4), 99).save(tmp_path / "gray.png")
        Pillow.new("P", (4, 4), 0).save(tmp_path / "palette.bmp")
        assert Image(path=str(tmp_path / "gray.png"), size=(1.0, 1.0)).pixels[0, 0].tolist() == [99, 99, 99]
        assert Image(path=str(tmp_path / "palette.bmp"), size=(1.0, 1.0)).pixels.shape == (4, 4, 3)

    @pytest.mark.parametrize(
        ("name", "content", "message"),
        [
            ("missing.png", None, "no such file"),
            ("text.png", b"hello", "not a picture"),
            ("empty.png", b"", "not a picture"),
            ("page.eps", b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n", "not a picture"),
            ("x" * 300, None, "no such file"),
        ],
    )
    def test_a_file_that_is_no_picture(self, tmp_path, name, content, message):
        if content is not None:
            (tmp_path / name).write_bytes(content)
        with pytest.raises(FieldError, match=message):
            Image(path=str(tmp_path / name), size=(1.0, 1.0))

    def test_a_device_or_folder_is_not_opened(self, tmp_path):
        for path in ("/dev/zero", str(tmp_path)):
            with pytest.raises(FieldError, match="no such file"):
                Image(path=path, size=(1.0, 1.0))

    def test_a_broken_picture(self, picture):
        path, _ = picture
        path.write_bytes(path.read_bytes()[:45])
        with pytest.raises(FieldError, match="not a picture"):
            Image(path=str(path), size=(1.0, 1.0))

    @pytest.mark.parametrize("side", [5_000, 10_000, 20_000])
    def test_a_decompression_bomb(self, tmp_path, side):
        """A few bytes that claim to be many pixels; Pillow warns of the second, and refuses the third."""
        assert side * side > MAX_PIXELS
        (tmp_path / "bomb.ppm").write_bytes(b"P6 %d %d 255\n" % (side, side))
        with pytest.raises(FieldError, match=r"expected at most|exceeds limit"):
            Image(path=str(tmp_path / "bomb.ppm"), size=(1.0, 1.0))


_point = st.tuples(st.floats(-2, 2), st.floats(-2, 2))
_size = st.floats(0.01, 2)
_color = st.sampled_from(sorted(COLOURS)) | st.tuples(*[st.integers(0, 255)] * 3)
_angle = st.just(0.0) | st.floats(-10, 10)
_zone = (
    st.builds(Disc, center=_point, radius=_size, color=_color)
    | st.builds(Rectangle, center=_point, size=st.tuples(_size, _size), angle=_angle, color=_color)
    | st.builds(HalfPlane, point=_point, normal=st.tuples(st.floats(0.1, 1), st.floats(-1, 1)), color=_color)
    | st.builds(Ring, center=_point, radius=st.floats(1, 2), inner_radius=st.floats(0.1, 0.9), color=_color)
    | st.builds(PolygonZone, vertices=st.sampled_from([ARROW, ARROW[::-1]]), color=_color)
    | st.just(Tiles(centers=CENTERS, size=0.3, colors={"green": 10, "red": 5}))
)


@settings(deadline=None)  # the first example compiles
@given(st.lists(_zone, max_size=4), st.lists(_point, max_size=20), st.booleans())
@example([], [], True)
def test_the_compiled_form_sees_what_the_plain_one_sees(tmp_path_factory, zones, points, with_image):
    image = None
    if with_image:
        path = tmp_path_factory.getbasetemp() / "noise.png"
        if not path.exists():
            Pillow.effect_noise((16, 9), 80).save(path)
        image = Image(path=str(path), size=(2.5, 1.5), center=(0.3, -0.2))
    floor = Floor(zones=tuple(zones), image=image).realise(seeds.generator(5, "floor"))
    at = np.array(points).reshape(-1, 2)
    colors = colours_at(floor, at)
    assert colors.tolist() == [list(colour_at(floor, x, y)) for x, y in at]
    rows = tuple(range(0, len(floor.zones), 2))
    inside = inside_rows(floor, rows, at)
    assert inside.tolist() == [any(zone_contains(floor, row, x, y) for row in rows) for x, y in at]


def inside_rows(floor, rows, points):
    """Whether each of the points (n, 2) is in some of the rows' zones, as objectives ask."""
    poses = np.zeros((2, len(points), 3))
    poses[1, :, :2] = points
    states = np.zeros((1, len(points)), dtype=np.int8)
    trace = Trace(poses=poses, states=states, floor=floor, zone_rows={"here": rows}, control_period=0.1)
    return trace.inside(("here",), "end")[0]


@pytest.mark.thorough
def test_points_may_come_in_any_arrangement():
    floor = table(Disc(center=(0.0, 0.0), radius=1.0, color="red"))
    poses = RNG.uniform(-2, 2, (7, 5, 3))
    within = np.hypot(poses[1:, :, 0], poses[1:, :, 1]) <= 1.0
    assert np.array_equal(colours_at(floor, poses[1:, :, :2])[..., 1] == 0.0, within)
    trace = Trace(
        poses=poses.transpose(0, 2, 1).copy().transpose(0, 2, 1),
        states=np.zeros((6, 5), dtype=np.int8),
        floor=floor,
        zone_rows={"disc": (0,), "nothing": ()},
        control_period=0.1,
    )
    assert np.array_equal(trace.inside(("disc",), "always"), within)
    assert np.array_equal(trace.inside(("disc",), "end"), within[-1:])
    assert not trace.inside(("nothing",), "always").any()
    assert np.array_equal(trace.colors("always")[..., 1] == 0.0, within)


@pytest.mark.parametrize(
    ("key", "shape", "meant"),
    [
        ("floor.zones[0].shape", "circle", "disc"),
        ("floor.zones[0].shape", "Circle", "disc"),
        ("floor.zones[0].shape", "square", "rectangle"),
        ("floor.zones[0].shape", "box", "rectangle"),
        ("floor.zones[0].shape", "annulus", "ring"),
        ("floor.zones[0].shape", "grid", "tiles"),
        ("placement.shape", "circle", "disc"),
        ("placement.shape", "square", "rectangle"),
        ("arena.walls.shape", "rectangle", "polygon"),
        ("arena.walls.shape", "square", "regular_polygon"),
        ("arena.walls.shape", "circle", "regular_polygon"),
    ],
)
def test_other_words_for_shapes_are_pointed_at(key, shape, meant):
    with pytest.raises(MissionError) as found:
        load_mission("aggregation", [f"{key}={shape}"])
    assert f"found \"{shape}\"; did you mean '{meant}'?" in str(found.value)
