"""Each objective on traces drawn by hand, and against a second, literal form of its definition."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from mercator_design import seeds
from mercator_design.missions.floor import Disc, Floor, HalfPlane, Tiles
from mercator_design.missions.objectives import OBJECTIVES, cell_age, color_value, robots_in_zone, trips
from mercator_design.missions.trace import Trace

FLOOR = Floor(
    zones=(
        Disc(center=(0.0, 0.0), radius=0.5, color="black", name="spot"),
        Disc(center=(2.0, 0.0), radius=0.5, color="black", name="other"),
        Disc(center=(0.0, 0.0), radius=0.1, color="yellow", name="yolk"),
        HalfPlane(point=(0.0, -2.0), normal=(0.0, -1.0), color="white", name="nest"),
        Tiles(centers=((5.0, 0.0), (6.0, 0.0)), size=0.5, colors={"red": 2}, name="tiles"),
    )
)
EVERY_PARAMETER = {
    "robots_in_zone": {"zones": ("spot", "nest"), "when": "always"},
    "color_value": {"values": {"black": 1.0, "red": -0.5}, "when": "always"},
    "cell_age": {"side": 4.0, "cells": 5},
    "trips": {"sources": ("spot", "other"), "nests": ("nest",)},
}

VALUES = {"green": 0.0, "red": 1.0, "yellow": 2.0}
GRID = {"side": 2.50001, "cells": 10}
ZONES = {"sources": ("spot", "other"), "nests": ("nest",)}


def trace(positions, floor=FLOOR):
    """Of positions (cycles + 1, robots, 2), the first being the start."""
    positions = np.asarray(positions, dtype=float)
    return Trace(
        poses=np.concatenate([positions, np.zeros((*positions.shape[:2], 1))], axis=2),
        states=np.zeros((len(positions) - 1, positions.shape[1]), dtype=np.int8),
        floor=floor.realise(seeds.generator(1, "floor")),
        zone_rows=floor.zone_rows(),
        control_period=0.1,
    )


def walk(*places):
    """One robot's trace."""
    return trace([[place] for place in places])


SPOT, OTHER, NEST, AWAY = (0.3, 0.0), (2.0, 0.1), (0.0, -2.5), (1.0, 1.0)


class TestRobotsInZone:
    ROBOTS = trace([[SPOT, SPOT, AWAY], [SPOT, AWAY, AWAY], [AWAY, OTHER, SPOT], [(0.5, 0.0), NEST, OTHER]])

    def test_at_the_end_only_the_last_cycle_counts(self):
        assert robots_in_zone(self.ROBOTS, zones=("spot",)) == 1.0
        assert robots_in_zone(self.ROBOTS, zones=("spot", "other")) == 2.0
        assert robots_in_zone(self.ROBOTS, zones=("yolk",)) == 0.0

    def test_always_counts_every_cycle_but_not_the_start(self):
        assert robots_in_zone(self.ROBOTS, zones=("spot",), when="always") == 3.0
        assert robots_in_zone(self.ROBOTS, zones=("nest", "other"), when="always") == 3.0

    def test_overlapping_zones_count_a_robot_once_and_paint_does_not_matter(self):
        assert robots_in_zone(walk(AWAY, (0.0, 0.0)), zones=("spot", "yolk")) == 1.0
        assert robots_in_zone(walk(AWAY, (0.0, 0.0)), zones=("spot",)) == 1.0

    def test_tiles_are_one_zone(self):
        assert robots_in_zone(trace([[AWAY] * 3, [(5.0, 0.0), (6.2, 0.2), (5.5, 0.0)]]), zones=("tiles",)) == 2.0


class TestColorValue:
    def test_the_colour_on_top_counts(self):
        robots = trace([[AWAY] * 4, [(0.0, 0.0), SPOT, (5.0, 0.0), AWAY]])
        assert color_value(robots, values=VALUES) == 3.0
        assert color_value(robots, values={"black": 0.25, "gray": 10.0}) == 10.25

    def test_always(self):
        robot = walk((5.0, 0.0), (5.0, 0.0), (0.0, 0.0), AWAY)
        assert color_value(robot, values=VALUES) == 0.0
        assert color_value(robot, values=VALUES, when="always") == 3.0


class TestCellAge:
    """Numbers of GridExplorationLoopFunc of the ARGoS missions: 1200 cycles, 10 x 10 cells, 2.50001 m."""

    def still(self, *places):
        return trace(np.broadcast_to(np.array(places), (1201, len(places), 2)))

    def test_nobody_ever_comes(self):
        assert cell_age(self.still((9.0, 9.0)), **GRID) == 719_400.0

    def test_five_robots_that_never_move(self):
        five = [(0.1 + 0.25 * i, 0.1) for i in range(-2, 3)]
        assert cell_age(self.still(*five), **GRID) == 683_430.0
        assert cell_age(self.still(*[five[0]] * 5), **GRID) == 719_400.0 - 7_194.0

    def test_positions_just_below_the_grid_fall_into_the_first_cells(self):
        """An index is truncated towards zero, there as here."""
        visited = 719_400.0 - 7_194.0
        assert cell_age(self.still((-1.26, 0.1)), **GRID) == visited
        assert cell_age(self.still((0.1, -1.4)), **GRID) == visited
        assert cell_age(self.still((-1.6, 0.1)), **GRID) == 719_400.0
        assert cell_age(self.still((1.26, 0.1)), **GRID) == 719_400.0

    def test_the_start_is_no_visit(self):
        assert cell_age(walk((0.0, 0.0), AWAY, AWAY), side=1.0, cells=1) == 0.0 + 1.0

    @settings(max_examples=50, deadline=None)
    @given(
        hnp.arrays(float, st.tuples(st.integers(2, 30), st.integers(1, 4), st.just(2)), elements=st.floats(-3, 3)),
        st.floats(0.5, 5),
        st.integers(1, 6),
    )
    def test_against_the_definition_cycle_by_cycle(self, positions, side, cells):
        age, total = np.zeros((cells, cells)), 0.0
        for robots in positions[1:]:
            for x, y in robots:
                column, row = int(cells * (x / side + 0.5)), int(cells * (y / side + 0.5))
                if 0 <= column < cells and 0 <= row < cells:
                    age[row, column] = 0.0
            total += age.sum()
            age += 1.0
        assert cell_age(trace(positions), side=side, cells=cells) == pytest.approx(total / cells**2, rel=1e-12)


class TestTrips:
    @pytest.mark.parametrize(
        ("places", "expected"),
        [
            ([AWAY, SPOT, AWAY, NEST], 1),
            ([AWAY, SPOT, NEST, SPOT, NEST], 2),
            ([AWAY, SPOT, OTHER, NEST, NEST], 1),  # one thing at a time, delivered once
            ([AWAY, NEST, SPOT, AWAY], 0),
            ([SPOT, AWAY, NEST], 0),  # the start does not count
            ([AWAY, OTHER, SPOT], 0),
        ],
    )
    def test_one_robot(self, places, expected):
        assert trips(walk(*places), **ZONES) == expected

    def test_things_do_not_change_hands(self):
        assert trips(trace([[AWAY, AWAY], [SPOT, AWAY], [AWAY, NEST]]), **ZONES) == 0
        assert trips(trace([[AWAY, AWAY], [AWAY, NEST], [SPOT, AWAY]]), **ZONES) == 0
        assert trips(trace([[AWAY, AWAY], [SPOT, OTHER], [NEST, NEST]]), **ZONES) == 2

    def test_where_zones_overlap_the_source_wins(self):
        zones = {"sources": ("yolk",), "nests": ("spot",)}
        assert trips(walk(AWAY, (0.0, 0.0), (0.0, 0.0)), **zones) == 0
        assert trips(walk(AWAY, (0.0, 0.0), SPOT), **zones) == 1


def test_every_objective_is_tried_here():
    assert set(EVERY_PARAMETER) == set(OBJECTIVES)


@pytest.mark.parametrize("name", OBJECTIVES)
def test_the_contract(name):
    """A finite float, whatever the order of the robots, and the trace is left as it was."""
    positions = seeds.generator(2, "test").uniform(-3, 3, (50, 6, 2))
    before = trace(positions)
    score = OBJECTIVES[name](before, **EVERY_PARAMETER[name])
    assert isinstance(score, float)
    assert np.isfinite(score)
    assert np.array_equal(before.poses[..., :2], positions)
    assert OBJECTIVES[name](trace(positions[:, ::-1]), **EVERY_PARAMETER[name]) == score


def test_a_trace_must_fit_together():
    fitting = walk(AWAY, AWAY, AWAY)
    assert (fitting.cycles, fitting.robots) == (2, 1)
    with pytest.raises(ValueError, match=r"expected poses \(4, 1, 3\), found \(3, 1, 3\)"):
        Trace(
            poses=fitting.poses,
            states=np.zeros((3, 1), dtype=np.int8),
            floor=fitting.floor,
            zone_rows={},
            control_period=0.1,
        )
