"""Walls, boxes, and which side of them a point is on."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mercator_design.loading import FieldError
from mercator_design.missions.arena import Arena, Box, Polygon, RegularPolygon

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


@given(st.lists(st.floats(0.2, 5), min_size=3, max_size=12), st.booleans())
def test_any_star_is_a_simple_polygon(radii, clockwise):
    angles = 2 * math.pi * np.arange(len(radii)) / len(radii)
    vertices = [(r * math.cos(a), r * math.sin(a)) for r, a in zip(radii, angles, strict=True)]
    arena = Arena(walls=Polygon(vertices=tuple(vertices[::-1] if clockwise else vertices)))
    assert arena.area > 0
    assert arena.contains(np.zeros((1, 2))).all()
    assert arena.contains(0.99 * np.array(vertices)).all()
    assert not arena.contains(1.01 * np.array(vertices)).any()


def test_boxes():
    upright = Box(center=(1.0, 2.0), size=(0.6, 0.2))
    turned = Box(center=(1.0, 2.0), size=(0.6, 0.2), angle=math.pi / 2)
    arena = Arena(walls=DODECAGON, obstacles=(upright, turned))
    assert np.allclose(arena.obstacles[0].corners(), [[0.7, 1.9], [1.3, 1.9], [1.3, 2.1], [0.7, 2.1]])
    assert np.allclose(arena.obstacles[1].corners(), [[1.1, 1.7], [1.1, 2.3], [0.9, 2.3], [0.9, 1.7]])
