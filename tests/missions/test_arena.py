"""Walls, boxes, and which side of them a point is on."""

import math
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mercator_design.config.schema import FieldError
from mercator_design.missions.arena import Arena, Box, Polygon, RegularPolygon, _crossing, check_polygon, walls_meet

DODECAGON = RegularPolygon(sides=12, apothem=1.226)
L_SHAPE = ((0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0), (1.0, 2.0), (0.0, 2.0))


def test_the_dodecagon_of_the_mercator_missions():
    """Its walls stand at multiples of 30 degrees, 1.226 m from the centre; area 12 tan(15 deg) a^2."""
    arena = Arena(walls=DODECAGON)
    corners = arena.corners()
    middles = (corners + np.roll(corners, 1, axis=0)) / 2
    angles = np.radians(np.arange(0, 360, 30))
    assert np.allclose(middles, 1.226 * np.column_stack([np.cos(angles), np.sin(angles)]))
    assert arena.area == pytest.approx(12 * math.tan(math.radians(15)) * 1.226**2)


@given(st.integers(3, 360), st.floats(0.01, 100), st.floats(-10, 10))
def test_a_regular_polygon_lies_between_its_circles(sides, apothem, rotation):
    walls = RegularPolygon(sides=sides, apothem=apothem, rotation=rotation)
    corners = walls.corners()
    assert corners.shape == (sides, 2)
    assert Arena(walls=walls).area > math.pi * apothem**2
    angles = np.linspace(0, 2 * math.pi, 50)
    circle = apothem * np.column_stack([np.cos(angles), np.sin(angles)])
    assert Arena(walls=walls).contains(0.999 * circle).all()
    assert not Arena(walls=walls).contains(1.001 * circle / math.cos(math.pi / sides)).any()
    first = (corners[0] + corners[-1]) / 2
    assert first == pytest.approx([apothem * math.cos(rotation), apothem * math.sin(rotation)], abs=1e-9 * apothem)


@pytest.mark.parametrize("vertices", [L_SHAPE, L_SHAPE[::-1]])
def test_corners_run_counter_clockwise_from_the_first(vertices):
    arena = Arena(walls=Polygon(vertices=vertices))
    assert arena.area == pytest.approx(3.0)
    assert tuple(arena.corners()[0]) == vertices[0]
    assert arena.corners().flags.c_contiguous
    points = np.array([[0.5, 0.5], [1.5, 0.5], [0.5, 1.5], [1.5, 1.5], [-0.1, 0.5], [0.5, 2.1], [3.0, 1.0]])
    assert arena.contains(points).tolist() == [True, True, True, False, False, False, False]


@pytest.mark.parametrize(
    ("vertices", "field"),
    [
        ([(0, 0), (1, 1), (1, 0), (0, 1)], "vertices[2]"),  # a bow tie
        ([(0, 0), (2, 0), (2, 2), (1, 0), (0, 2)], "vertices[2]"),  # a corner touches the first wall
        ([(0, 0), (2, 0), (1, 0), (1, 1)], "vertices[1]"),  # back along the same wall
        ([(0, 0), (1, 0), (1, 0), (1, 1)], "vertices[2]"),  # the same corner twice
        ([(0, 0), (1, 0), (1, 1), (0, 0)], "vertices[3]"),  # closed by hand
        (
            [(0, 0), (3, 0), (3, 3), (2, 3), (2, 0), (1, 0), (1, 1), (0, 1)],
            "vertices[3]",
        ),  # along the first wall
        ([(0, 0), (1, 0), (2, 0)], "vertices[2]"),  # a line
        ([(0, 0), (1, 0), (1, 1e-4), (1, 1)], "vertices[1]"),  # a wall too short to have a direction
        ([(0, 0), (0.01, 0), (0.005, 1e-4)], "vertices"),  # no area to speak of
        ([(0, 0), (1, 0)], "vertices"),
    ],
)
def test_walls_that_are_no_simple_polygon(vertices, field):
    with pytest.raises(FieldError) as caught:
        Polygon(vertices=tuple(vertices))
    assert caught.value.field == field


def side(a, b, p):
    turn = (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
    return (turn > 0) - (turn < 0)


def within(a, b, p):
    return side(a, b, p) == 0 and all(min(a[k], b[k]) <= p[k] <= max(a[k], b[k]) for k in (0, 1))


def meets(a, b, c, d):
    """Whether two segments between points of whole numbers touch, by the textbook."""
    if side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0:
        return True
    return within(a, b, c) or within(a, b, d) or within(c, d, a) or within(c, d, b)


GRID_POLYGON = st.lists(st.tuples(st.integers(0, 4), st.integers(0, 4)), min_size=3, max_size=7, unique=True)


@given(GRID_POLYGON)
def test_walls_cross_where_the_textbook_says(vertices):
    n = len(vertices)
    walls = [(vertices[k], vertices[(k + 1) % n]) for k in range(n)]
    crossings = []
    for i, (a, b) in enumerate(walls):
        for j, (c, d) in list(enumerate(walls))[i + 1 :]:
            if {a, b} & {c, d}:  # they share a corner, and must leave it in two directions
                ends = [p for p in (a, b, c, d) if [a, b, c, d].count(p) == 1]
                corner = ({a, b} & {c, d}).pop()
                crossed = within(corner, ends[0], ends[1]) or within(corner, ends[1], ends[0])
            else:
                crossed = meets(a, b, c, d)
            if crossed:
                crossings.append((i, j))
    assert _crossing(np.array(vertices, dtype=float)) == (crossings[0] if crossings else None)


@given(GRID_POLYGON, GRID_POLYGON)
def test_walls_of_two_polygons_meet_where_the_textbook_says(first, second):
    sides = [[(each[k - 1], each[k]) for k in range(len(each))] for each in (first, second)]
    expected = any(meets(*one, *other) for one in sides[0] for other in sides[1])
    assert walls_meet(np.array(first, dtype=float), np.array(second, dtype=float)) == expected


def test_many_corners_are_checked_in_a_moment():
    angles = 2 * math.pi * np.arange(360) / 360
    vertices = [(math.cos(a), math.sin(a)) for a in angles]
    start = time.process_time()
    for _ in range(70):
        check_polygon(vertices, side="side")
    assert time.process_time() - start < 3  # it takes 0.7 s; wall by wall it took 7


@given(st.lists(st.floats(0.2, 5), min_size=3, max_size=12), st.booleans())
def test_any_star_is_a_simple_polygon(radii, clockwise):
    angles = 2 * math.pi * np.arange(len(radii)) / len(radii)
    vertices = [(r * math.cos(a), r * math.sin(a)) for r, a in zip(radii, angles, strict=True)]
    arena = Arena(walls=Polygon(vertices=tuple(vertices[::-1] if clockwise else vertices)))
    assert arena.area > 0
    assert arena.contains(np.zeros((1, 2))).all()
    assert arena.contains(0.99 * np.array(vertices)).all()
    assert not arena.contains(1.01 * np.array(vertices)).any()
    x, y = np.linspace(-5, 5, 23), np.linspace(-5, 5, 17)
    assert (
        arena.contains_grid(x, y).ravel() == arena.contains(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))
    ).all()


def test_boxes():
    upright = Box(center=(1.0, 2.0), size=(0.6, 0.2))
    turned = Box(center=(1.0, 2.0), size=(0.6, 0.2), angle=math.pi / 2)
    arena = Arena(walls=DODECAGON, obstacles=(upright, turned))
    assert np.allclose(arena.obstacles[0].corners(), [[0.7, 1.9], [1.3, 1.9], [1.3, 2.1], [0.7, 2.1]])
    assert np.allclose(arena.obstacles[1].corners(), [[1.1, 1.7], [1.1, 2.3], [0.9, 2.3], [0.9, 1.7]])
