"""Each objective on traces drawn by hand, and against a second, literal form of its definition."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from mercator_design import seeds
from mercator_design.errors import MissionError
from mercator_design.missions.arena import Arena, Box, Polygon
from mercator_design.missions.floor import Disc, Dynamics, Floor, HalfPlane, Tiles
from mercator_design.missions.mission import Objective
from mercator_design.missions.objectives import OBJECTIVES
from mercator_design.missions.objectives.coverage import (
    cell_age,
    cells_visited,
    coverage_outside_zones,
    surface_and_perimeter,
    surface_distance,
)
from mercator_design.missions.objectives.distances import distance_to, nearest_distance, pair_distance, path_length
from mercator_design.missions.objectives.groups import network_area, network_diameter, network_share
from mercator_design.missions.objectives.in_zones import (
    color_value,
    robots_evenly_in_zones,
    robots_in_emptiest_zone,
    robots_in_fullest_zone,
    robots_in_zone,
    zone_difference,
    zone_value,
    zones_in_color,
)
from mercator_design.missions.objectives.journeys import gate_crossings, trips
from mercator_design.missions.objectives.mapping import seen_area, seen_walls
from mercator_design.missions.objectives.signals import robots_where_told, stop_when_found, stop_when_told
from mercator_design.missions.plugins import limits_of
from mercator_design.missions.score_limits import ExperimentSize
from mercator_design.missions.trace import Trace, every_nth, not_measured
from mercator_design.missions.walls import PIECE, walls_above

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
    "cell_age": {"side": 4.0, "cells": 5},
    "cells_visited": {"side": 4.0, "cells": 50},
    "color_value": {"values": {"black": 1.0, "red": -0.5}, "when": "always"},
    "coverage_outside_zones": {"zones": ("spot",)},
    "distance_to": {"point": (1.0, -1.0)},
    "gate_crossings": {"width": 3.0},
    "nearest_distance": {},
    "network_area": {"link": 2.0},
    "network_diameter": {"link": 2.0},
    "network_share": {"zones": ("spot",), "link": 2.0},
    "pair_distance": {},
    "path_length": {},
    "robots_evenly_in_zones": {"zones": ("spot", "nest"), "when": "always", "share": True},
    "robots_in_emptiest_zone": {"zones": ("spot", "nest"), "when": "always", "share": True},
    "robots_in_fullest_zone": {"zones": ("spot", "nest"), "when": "always"},
    "robots_where_told": {"signal": "spot", "places": {"black": "nest", "white": "spot"}},
    "seen_area": {"side": 6.0, "cells": 30, "every": 5},
    "seen_walls": {"beams": 7, "every": 3, "reach": 2.0, "turning_cost": 0.1},
    "stop_when_found": {"zones": ("yolk",)},
    "stop_when_told": {"signal": "spot", "color": "white"},
    "surface_and_perimeter": {
        "square_center": (-0.6, 0.0),
        "square_side": 0.6,
        "circle_center": (0.6, 0.0),
        "circle_radius": 0.3,
    },
    "surface_distance": {"square_center": (0.0, 0.0), "square_side": 2.0},
    "trips": {"sources": ("spot", "other"), "nests": ("nest",), "values": {"other": -0.5}},
    "zone_difference": {"zones": ("spot", "nest"), "when": "always"},
    "zone_value": {"values": {"spot": 2.0, "yolk": 1.0, "nest": -0.5}, "outside": 0.25, "when": "always"},
    "zones_in_color": {"zones": ("tiles", "spot"), "color": "red", "when": "always"},
}

ROOM = Arena(walls=Polygon(vertices=((-3.0, -3.0), (3.0, -3.0), (3.0, 3.0), (-3.0, 3.0))), wall_height=0.3)
VALUES = {"green": 0.0, "red": 1.0, "yellow": 2.0}
GRID = {"side": 2.50001, "cells": 10}
ZONES = {"sources": ("spot", "other"), "nests": ("nest",)}


def trace(positions, floor=FLOOR, beams=((1.0, 0.0), (0.0, 0.5))):
    """Of positions (cycles + 1, robots, 2), the first being the start; each lidar's beams end at the same places."""
    positions = np.asarray(positions, dtype=float)

    def measure(device, /, every=1):
        assert device == "lidar_points"
        return positions[1:][every_nth(len(positions) - 1, every), :, np.newaxis] + np.array(beams)

    return Trace(
        poses=np.concatenate([positions, np.zeros((*positions.shape[:2], 1))], axis=2),
        states=np.zeros((len(positions) - 1, positions.shape[1]), dtype=np.int8),
        floor=floor.realise(seeds.generator(1, "floor")),
        zone_rows=floor.zone_rows(),
        control_period=0.1,
        measure=measure,
        walls=walls_above(ROOM, 0.154),
    )


def walk(*places):
    """One robot's trace."""
    return trace([[place] for place in places])


SPOT, OTHER, NEST, AWAY = (0.3, 0.0), (2.0, 0.1), (0.0, -2.5), (1.0, 1.0)


def test_of_tracked_robots_no_device_is_known():
    tracked = dataclasses.replace(walk(AWAY, SPOT), measure=not_measured)
    for measure in (lambda: tracked.measure("lidar"), lambda: tracked.measure("lidar", 10)):
        with pytest.raises(MissionError, match="lidar measured, and that was not recorded"):
            measure()


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

    @pytest.mark.parametrize(
        ("places", "expected"),
        [
            ([AWAY, OTHER, NEST], -2.0),
            ([AWAY, OTHER, SPOT, NEST, SPOT, NEST], -2.0 + 1.0),  # it kept what it had; a spot counts 1
            ([AWAY, SPOT, OTHER, NEST, NEST, OTHER, NEST], 1.0 - 2.0),
            ([AWAY, (0.0, 0.0), NEST], 1.0),  # on the spot and the yolk: the first of the list
        ],
    )
    def test_a_source_has_a_value(self, places, expected):
        found = trips(
            walk(*places), sources=("spot", "other", "yolk"), nests=("nest",), values={"other": -2, "yolk": 7}
        )
        assert found == expected
        assert isinstance(found, float)

    def test_each_tile_of_a_source_has_its_value(self):
        tiles = {"sources": ("other", "tiles"), "nests": ("nest",), "values": {"tiles": 0.5}}
        assert trips(walk(AWAY, (6.0, 0.0), NEST, (5.0, 0.0), NEST, OTHER, NEST), **tiles) == 0.5 + 0.5 + 1.0

    def test_every_robot_has_what_it_took(self):
        assert trips(trace([[AWAY, AWAY], [SPOT, OTHER], [NEST, NEST]]), **ZONES, values={"spot": 10.0}) == 11.0


class TestShares:
    ROBOTS = trace([[AWAY] * 4, [SPOT, SPOT, OTHER, AWAY], [SPOT, OTHER, OTHER, OTHER]])
    SPOTS = ("spot", "other")

    def test_of_all_robots(self):
        assert robots_in_zone(self.ROBOTS, zones=("spot",), share=True) == 0.25
        assert robots_in_zone(self.ROBOTS, zones=self.SPOTS, when="always", share=True) == 0.75 + 1.0

    def test_fullest_zone(self):
        assert robots_in_fullest_zone(self.ROBOTS, zones=self.SPOTS) == 3.0
        assert robots_in_fullest_zone(self.ROBOTS, zones=self.SPOTS, share=True) == 0.75
        assert robots_in_fullest_zone(self.ROBOTS, zones=self.SPOTS, when="always") == 2.0 + 3.0

    def test_emptiest_zone(self):
        assert robots_in_emptiest_zone(self.ROBOTS, zones=self.SPOTS) == 1.0
        assert robots_in_emptiest_zone(self.ROBOTS, zones=self.SPOTS, share=True) == 0.5
        assert robots_in_emptiest_zone(self.ROBOTS, zones=self.SPOTS, when="always") == 1.0 + 1.0
        half = trace([[AWAY] * 4, [SPOT, SPOT, OTHER, OTHER]])
        assert robots_in_emptiest_zone(half, zones=self.SPOTS, share=True) == 1.0

    def test_difference_of_two_zones(self):
        """Robots on spot and other: 2 and 1, then 1 and 3."""
        assert zone_difference(self.ROBOTS, zones=self.SPOTS) == 2.0
        assert zone_difference(self.ROBOTS, zones=self.SPOTS[::-1], share=True) == 0.5
        assert zone_difference(self.ROBOTS, zones=self.SPOTS, when="always") == 1.0 + 2.0
        assert zone_difference(self.ROBOTS, zones=self.SPOTS, when="always", share=True) == 0.25 + 0.5

    def test_difference_of_more_zones_is_of_the_fullest_and_the_emptiest(self):
        assert zone_difference(self.ROBOTS, zones=(*self.SPOTS, "nest"), when="always") == 2.0 + 3.0


class TestEvenly:
    """Ten robots on two zones, of which some are elsewhere: q is 5."""

    @pytest.mark.parametrize(
        ("spot", "other", "expected"),
        [(5, 5, 10), (4, 6, 8), (4, 5, 9), (5, 0, 5), (10, 0, 0), (7, 3, 6), (0, 0, 0)],
    )
    def test_against_the_formula(self, spot, other, expected):
        robots = trace([[AWAY] * 10, [SPOT] * spot + [OTHER] * other + [AWAY] * (10 - spot - other)])
        assert robots_evenly_in_zones(robots, zones=("spot", "other")) == expected
        assert robots_evenly_in_zones(robots, zones=("other", "spot"), share=True) == expected / 10

    def test_cycles_are_summed_and_the_quota_is_rounded_down(self):
        """Seven robots on three zones: q is 2; 2 2 3 counts 2 + 2 + 1, and 4 0 1 counts 0 + 0 + 1."""
        even, uneven = [SPOT] * 2 + [OTHER] * 2 + [NEST] * 3, [SPOT] * 4 + [NEST] + [AWAY] * 2
        robots = trace([[AWAY] * 7, even, uneven])
        assert robots_evenly_in_zones(robots, zones=("spot", "other", "nest"), when="always") == 5.0 + 1.0
        share = robots_evenly_in_zones(robots, zones=("spot", "other", "nest"), when="always", share=True)
        assert share == pytest.approx(6.0 / 6.0)

    def test_fewer_robots_than_zones_count_where_they_are_alone(self):
        zones = ("spot", "other", "nest")
        assert robots_evenly_in_zones(trace([[AWAY] * 2, [SPOT, OTHER]]), zones=zones, share=True) == 1.0
        assert robots_evenly_in_zones(trace([[AWAY] * 2, [SPOT, SPOT]]), zones=zones) == 0.0


class TestZoneValue:
    ROBOTS = trace([[SPOT] * 4, [SPOT, SPOT, NEST, AWAY], [(0.0, 0.0), AWAY, NEST, OTHER]])

    def test_values_are_added(self):
        """On the spot alone 2, on spot and yolk 2 + 5, in the nest -1."""
        values = {"spot": 2.0, "yolk": 5.0, "nest": -1.0}
        assert zone_value(self.ROBOTS, values=values) == 7.0 - 1.0
        assert zone_value(self.ROBOTS, values=values, when="always") == (2.0 + 2.0 - 1.0) + (7.0 - 1.0)

    def test_outside_is_for_robots_in_none_of_the_zones(self):
        """Rendezvous of Habanero: robots in a corner minus the others."""
        assert zone_value(self.ROBOTS, values={"nest": 1.0}, outside=-1.0) == 1.0 - 3.0
        assert zone_value(self.ROBOTS, values={"spot": 1.0, "yolk": 1.0}, outside=-0.5) == 2.0 - 1.5
        assert zone_value(self.ROBOTS, values={"nest": 0.0}, outside=-0.5, when="always") == -1.5 - 1.5


class TestCellsVisited:
    def test_a_cell_counts_from_the_cycle_of_its_first_visit(self):
        """Four cells of 1 m; one is visited in cycles 1 and 3, another in cycle 2, of four: 4 + 3 quarters."""
        robot = walk((9.0, 9.0), (0.5, 0.5), (-0.5, 0.5), (0.5, 0.5), (9.0, 9.0))
        assert cells_visited(robot, side=2.0, cells=2) == (4 + 3) / 4
        assert cells_visited(walk((0.5, 0.5), (9.0, 9.0)), side=2.0, cells=2) == 0.0

    def test_two_robots_in_one_cell_count_once(self):
        assert cells_visited(trace([[AWAY] * 2, [(0.1, 0.1), (0.2, 0.2)]]), side=2.0, cells=2) == 1 / 4


class TestDistancesFromPoints:
    """Mean distances have closed forms: over a square of side s from its centre s x 0.3826, over a disc r x 2 / 3."""

    FROM_CENTRE = (math.sqrt(2.0) + math.log(1.0 + math.sqrt(2.0))) / 6.0
    SPC = EVERY_PARAMETER["surface_and_perimeter"]

    def test_spc_of_nobody(self):
        worst = 0.85 / 0.08 + 0.6 / 0.06
        assert surface_and_perimeter(walk(AWAY, AWAY), **self.SPC) == pytest.approx(worst, rel=1e-12)
        assert surface_and_perimeter(walk(AWAY, (0.6, 0.0)), **self.SPC) == pytest.approx(worst, rel=1e-12)

    def test_spc_of_a_robot_in_the_square(self):
        expected = 0.6 * self.FROM_CENTRE / 0.08 + 10.0
        assert surface_and_perimeter(walk(AWAY, (-0.6, 0.0)), **self.SPC) == pytest.approx(expected, rel=1e-3)

    def test_spc_of_a_robot_on_the_line(self):
        """On the line itself the mean chord is 4 r / pi."""
        expected = 0.85 / 0.08 + 4.0 * 0.3 / math.pi / 0.06
        assert surface_and_perimeter(walk(AWAY, (0.9, 0.0)), **self.SPC) == pytest.approx(expected, rel=1e-3)
        for beside, counts in ((0.039, True), (-0.039, True), (0.041, False), (-0.041, False)):
            found = surface_and_perimeter(walk(AWAY, (0.9 + beside, 0.0)), **self.SPC)
            assert (found < 0.85 / 0.08 + 9.0) == counts

    def test_spd8(self):
        square = {"square_center": (0.6, 0.0), "square_side": 1.0}
        assert surface_distance(walk(AWAY, (-1.0, 0.0)), **square) == pytest.approx(67.0**2)
        found = surface_distance(walk(AWAY, (0.6, 0.0)), **square)
        assert found == pytest.approx((100.0 * self.FROM_CENTRE) ** 2, rel=1e-3)

    def test_cfa(self):
        """From the centre, points uniform in distance from it are R / 2 away in the mean."""
        zones = {"zones": ("other",)}
        assert coverage_outside_zones(walk(AWAY, (0.0, 0.0)), **zones) == pytest.approx((2.5 - 0.6) * 100.0, rel=1e-4)
        assert coverage_outside_zones(walk(AWAY, (2.0, 0.0)), **zones) == 0.0  # in the zone: nobody counts
        assert coverage_outside_zones(walk(AWAY, (90.0, 0.0)), **zones) == 0.0

    def test_the_error_is_as_said(self):
        """Against ten times as many points, for robots anywhere."""
        robots = seeds.generator(1, "test").uniform(-1.2, 1.2, (60, 2))
        along = -0.9 + 0.6 * (np.arange(400) + 0.5) / 400
        x, y = np.meshgrid(along, along + 0.6)
        own = robots[np.all(np.abs(robots - (-0.6, 0.0)) <= 0.3, axis=1)]
        distances = [np.hypot(x - a, y - b) for a, b in own]
        expected = np.mean(np.minimum.reduce(distances)) / 0.08
        spc = {**self.SPC, "circle_center": (9.0, 9.0)}
        assert len(own) > 1
        assert surface_and_perimeter(trace([robots, robots]), **spc) - 10.0 == pytest.approx(expected, rel=1e-3)


class TestDistances:
    ROBOTS = trace([[(0, 0)] * 3, [(0, 0), (3, 0), (0, 4)], [(0, 0), (1, 0), (3, 0)]])

    def test_pairs(self):
        assert pair_distance(self.ROBOTS) == (3 + 4 + 5) + (1 + 2 + 3)

    def test_nearest(self):
        assert nearest_distance(self.ROBOTS) == (3 + 3 + 4) + (1 + 1 + 2)
        assert nearest_distance(walk(AWAY, AWAY)) == 0.0

    def test_path(self):
        assert path_length(self.ROBOTS) == pytest.approx((0 + 3 + 4) + (0 + 2 + 5))

    def test_to_a_point(self):
        assert distance_to(self.ROBOTS, point=(0.0, -1.0)) == pytest.approx(1 + 10**0.5 + 5 + 1 + 2**0.5 + 10**0.5)


class TestGroups:
    def test_a_robot_alone_sees_a_disc(self):
        assert network_area(walk(AWAY, (0.013, 0.027))) == pytest.approx(math.pi * 0.25**2, abs=1e-3)

    def test_what_lies_beyond_the_arena_does_not_count(self):
        assert network_area(walk(AWAY, (5.0, 0.0))) == 0.0

    def test_only_the_largest_group_counts(self):
        lens = 2 * 0.25**2 * math.acos(0.3 / 0.5) - 0.15 * math.sqrt(4 * 0.25**2 - 0.3**2)
        pair = 2 * math.pi * 0.25**2 - lens
        robots = [(-0.6, 0.0), (-0.3, 0.0), (0.6, 0.0)]
        assert network_area(trace([robots, robots])) == pytest.approx(pair, abs=2e-3)

    def test_a_link_is_shorter_than_its_limit(self):
        apart = [(0.013, 0.027), (0.363, 0.027)]
        assert network_area(trace([apart, apart])) == pytest.approx(math.pi * 0.25**2, abs=1e-3)

    def test_of_two_groups_as_large_the_better_counts(self):
        """The right one lies half beyond the arena."""
        robots = [(1.2, 0.0), (-0.487, 0.027)]
        for order in (robots, robots[::-1]):
            assert network_area(trace([order, order])) == pytest.approx(math.pi * 0.25**2, abs=1e-3)

    def test_a_share_of_the_zone(self):
        """A robot in the middle of the spot (radius 0.5) sees (0.3 / 0.5)^2 of it, one outside nothing."""
        share = {"zones": ("spot",), "link": 0.3, "sight": 0.3}
        assert network_share(walk(AWAY, (0.0, 0.0), (0.0, 0.0)), **share) == pytest.approx(2 * 0.36, rel=0.02)
        assert network_share(walk(AWAY, (0.6, 0.0)), **share) == 0.0

    def test_robots_of_a_smaller_group_see_nothing_of_the_zone(self):
        robots = [(0.0, 0.0), (1.0, 0.0), (1.2, 0.0)]
        assert network_share(trace([robots, robots]), zones=("spot",)) == 0.0

    def test_diameter(self):
        chain = [(0.2 * i, 0.0) for i in range(5)]
        assert network_diameter(trace([chain, chain])) == 4.0
        bent = [(0.0, 0.0), (0.2, 0.0), (0.2, 0.2), (0.0, 0.2), (5.0, 5.0)]
        assert network_diameter(trace([bent, bent, chain])) == 1.0 + 4.0  # the diagonal is 0.283 m: a link
        assert network_diameter(trace([bent, bent]), link=0.25) == 2.0
        assert network_diameter(trace([[AWAY, SPOT], [AWAY, SPOT]])) == 0.0


class TestGate:
    @pytest.mark.parametrize(
        ("places", "expected"),
        [
            ([(0.0, 0.1), (0.0, 0.1), (0.0, -0.1)], 1),
            ([(0.0, 0.1), (0.0, -0.1), (0.0, -0.2)], 0),  # the start does not count
            ([(0.0, 0.1), (0.0, 0.1), (0.0, -0.1), (0.0, 0.1), (0.0, -0.1)], 1),
            ([(0.0, -0.1), (0.0, -0.1), (0.0, 0.1)], 0),  # not less than 0
            ([(0.0, 0.1), (0.0, 0.1), (0.3, -0.1)], 0),  # beside the gate
            ([(0.0, 0.1), (0.0, 0.1), (0.0, 0.0), (0.0, -0.1)], 0),
        ],
    )
    def test_one_robot(self, places, expected):
        assert gate_crossings(walk(*places), width=0.5) == expected

    def test_another_gate(self):
        robot = walk((1.0, 1.0), (0.9, 1.2), (1.1, 1.2))
        assert gate_crossings(robot, width=0.5, center=(1.0, 1.0), angle=0.0) == 1.0
        assert gate_crossings(robot, width=0.3, center=(1.0, 1.0), angle=0.0) == 0.0


class TestSeenArea:
    """In squares of 1 m, of a robot in the middle of one."""

    def test_squares_that_a_beam_crosses(self):
        robot = trace([[(0.5, 0.5)]] * 2, beams=[(3.0, 0.0)])
        assert seen_area(robot, side=10.0, cells=10) == 4.0
        assert seen_area(robot, side=10.0, cells=10, reach=1.0) == 2.0
        assert seen_area(robot, side=4.0, cells=4) == 2.0

    def test_beams_that_met_nothing_say_nothing(self):
        assert seen_area(trace([[(0.5, 0.5)]] * 2, beams=[(np.nan, np.nan)]), side=10.0, cells=10) == 0.0

    def test_what_was_seen_counts_once(self):
        places = [(0.5, 0.5), (0.5, 0.5), (1.5, 0.5), (-4.5, 0.5)]
        robot = trace([[place] for place in places], beams=[(1.0, 0.0)])
        assert seen_area(robot, side=10.0, cells=10, every=1) == 2.0 + 1.0 + 2.0
        assert seen_area(robot, side=10.0, cells=10, every=2) == 2.0 + 2.0
        assert seen_area(robot, side=10.0, cells=10, every=4) == 2.0


def in_room(*places, obstacles=(), **changes):
    """One robot's trace in ROOM, 6 m wide, with boxes in it."""
    room = dataclasses.replace(ROOM, obstacles=obstacles, **changes)
    return dataclasses.replace(walk(*places), walls=walls_above(room, 0.154))


class TestSeenWalls:
    def test_in_an_empty_room_many_beams_see_all_and_few_see_as_many_pieces(self):
        robot = in_room((0.5, 0.2), (0.5, 0.2))
        assert seen_walls(robot, beams=1000) == 1.0
        assert seen_walls(robot, beams=36) == 36 * PIECE / 24.0
        assert seen_walls(robot, beams=4, reach=2.6) == 1 / 240  # only the wall to the right is near enough

    def test_a_wall_hides_what_is_behind_it_until_a_robot_is_there(self):
        wall = Box(center=(0.0, 0.0), size=(0.1, 6.0), height=0.3)
        here, there = (-1.5, 0.0), (1.5, 0.0)
        assert seen_walls(in_room(here, here, obstacles=(wall,)), beams=1000) == pytest.approx(0.5)
        assert seen_walls(in_room(here, here, there, obstacles=(wall,)), beams=1000, every=1) == pytest.approx(1.0)
        low = dataclasses.replace(wall, height=0.08)
        assert seen_walls(in_room(here, here, obstacles=(low,)), beams=1000) == 1.0

    def test_looks_are_at_every_nth_cycle_and_the_last(self):
        robot = in_room((0.0, 0.0), (2.7, 0.0), (0.01, 0.03), (-2.7, 0.03))
        per_look = 4 / 240
        assert seen_walls(robot, beams=4, every=3) == per_look
        assert (
            seen_walls(robot, beams=4, every=2) == 2 * per_look - 2 / 240
        )  # both look at the same pieces to the sides
        assert seen_walls(robot, beams=4, every=1) > seen_walls(robot, beams=4, every=2)

    def test_turning_costs_what_the_mission_says(self):
        still = in_room((0.0, 0.0), (0.0, 0.0))
        turning = dataclasses.replace(still, poses=still.poses + np.array([[[0.0, 0.0, 0.0]], [[0.0, 0.0, 0.2]]]))
        assert seen_walls(turning, beams=1000, turning_cost=0.1) == pytest.approx(1.0 - 0.1 * 2.0)
        assert seen_walls(turning, beams=1000, turning_cost=1.0) == 0.0
        assert seen_walls(still, beams=1000, turning_cost=1.0) == 1.0

    @pytest.mark.parametrize("changes", [{"wall_height": 0.08}, None])
    def test_without_walls_it_has_no_score(self, changes):
        robot = walk(AWAY, AWAY) if changes is None else in_room(AWAY, AWAY, **changes)
        robot = robot if changes else dataclasses.replace(robot, walls=None)
        with pytest.raises(MissionError, match="needs walls or boxes that are higher than the robots' lidar"):
            seen_walls(robot)


def test_sides_that_nobody_can_see_are_not_open():
    """A box whose end is in a wall, and one that stands on the end of another."""
    boxes = (
        Box(center=(2.5, 0.0), size=(1.0, 0.2), height=0.3),  # touches the wall at x = 3
        Box(center=(1.9, 0.0), size=(0.2, 0.4), height=0.3),  # touches the first
    )
    walls = walls_above(dataclasses.replace(ROOM, obstacles=boxes), 0.154)
    assert walls.pieces.sum() == len(walls.is_open) == 2 * 12 + 2 * 6 + 240
    hidden = 2 + 2 + 2 + 2  # the first box's ends, what they cover of the second's side and of the wall
    assert np.count_nonzero(~walls.is_open) == hidden


class TestSignals:
    def test_stop_when_found(self):
        """Two robots, 4 cycles; one finds the yolk in the second, in which the other idles; then one moves once."""
        robots = trace(
            [
                [(1.0, 0.0), (3.0, 3.0)],
                [(0.5, 0.0), (3.1, 3.0)],
                [(0.0, 0.0), (3.1, 3.0)],
                [(0.0, 0.0), (3.2, 3.0)],
                [(0.0, 0.0), (3.2, 3.0)],
            ]
        )
        assert stop_when_found(robots, zones=("yolk",)) == 2 * 2 * 4 - 2 * 2 - 1 - 1

    def test_a_search_without_end(self):
        assert stop_when_found(walk(AWAY, AWAY, AWAY), zones=("yolk",)) == 2 * 2 - 2 - 2
        assert stop_when_found(walk(AWAY, SPOT, AWAY), zones=("yolk",)) == 2 * 2 - 2

    SIGNAL = Floor(
        zones=(
            HalfPlane(point=(0.0, 0.0), normal=(0.0, 1.0), color="gray", name="up"),
            HalfPlane(point=(0.0, 0.0), normal=(0.0, -1.0), color="gray", name="down"),
            Disc(center=(0.0, 0.0), radius=0.5, color="black", name="disc"),
        ),
        dynamics=(
            Dynamics(
                name="schedule",
                parameters={"zones": ("disc",), "times": (0.2, 0.4), "colors": ("white", "black"), "every": None},
            ),
        ),
    )

    def test_stop_when_told(self):
        """The disc is white in cycles 2 and 3 of four; the robot moves in 1, 3 and 4."""
        robot = trace([[(0, 1)], [(1, 1)], [(1, 1)], [(2, 1)], [(3, 1)]], floor=self.SIGNAL)
        assert stop_when_told(robot, signal="disc", color="white") == 3.0
        still = trace([[(0, 1)]] * 5, floor=self.SIGNAL)
        assert stop_when_told(still, signal="disc", color="white") == 2.0

    def test_where_told(self):
        """Up while the disc is black, in cycles 1 and 4, down while it is white."""
        places = {"black": "up", "white": "down"}
        up = trace([[(0, 1)]] * 5, floor=self.SIGNAL)
        assert robots_where_told(up, signal="disc", places=places) == 2.0
        obedient = trace([[(0, 1), (0, 1)], *[[(0, y), (1, 1)] for y in (1, -1, -1, 1)]], floor=self.SIGNAL)
        assert robots_where_told(obedient, signal="disc", places=places) == 4.0 + 2.0

    def test_colours_are_those_of_each_cycle(self):
        robot = trace([[(0, 0)]] * 5, floor=self.SIGNAL)
        assert color_value(robot, values={"black": 1.0, "white": 10.0}, when="always") == 22.0
        assert color_value(robot, values={"black": 1.0, "white": 10.0}) == 1.0
        assert zones_in_color(robot, zones=("disc", "up"), color="white", when="always") == 2.0
        assert zones_in_color(robot, zones=("disc", "up"), color="gray") == 1.0


def test_tiles_are_counted_one_by_one():
    assert zones_in_color(walk(AWAY, AWAY), zones=("tiles", "yolk"), color="red") == 2.0


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
    assert OBJECTIVES[name](trace(positions[:, ::-1]), **EVERY_PARAMETER[name]) == pytest.approx(score, rel=1e-12)


SPREAD = seeds.generator(3, "test").uniform(-3, 3, (50, 6, 2))
TOGETHER = np.zeros((50, 6, 2))
AT_REST = np.broadcast_to(SPREAD[0], SPREAD.shape)
JUMPS = np.where(np.arange(50)[:, np.newaxis, np.newaxis] % 2, SPOT, NEST) + np.zeros((50, 6, 2))


@pytest.mark.parametrize("name", OBJECTIVES)
def test_scores_are_within_their_limits(name):
    parameters = EVERY_PARAMETER[name]
    assert limits_of(OBJECTIVES[name]) is not None
    given = [parameters]
    if "when" in parameters:
        given += [parameters | {"when": when, **share} for when in ("end", "always") for share in _shares(name)]
    for one in given:
        objective = Objective(name=name, direction="maximise", parameters=one)
        for positions in (SPREAD, TOGETHER, AT_REST, JUMPS, SPREAD / 10):
            run = trace(positions)
            possible = objective.possible_scores(ExperimentSize(run.robots, run.cycles, run.floor, run.zone_rows))
            assert possible.has(objective(run)), (one, possible, objective(run))


def _shares(name):
    return ({"share": False}, {"share": True}) if name.startswith("robots_in") else ({},)


REACHED = {
    "robots_in_zone": ({"zones": ("spot",), "when": "always"}, TOGETHER),
    "robots_in_fullest_zone": ({"zones": ("spot", "nest"), "when": "end", "share": True}, TOGETHER),
    "stop_when_told": ({"signal": "spot", "color": "black"}, TOGETHER),
    "stop_when_found": ({"zones": ("spot",)}, TOGETHER + np.arange(50)[:, np.newaxis, np.newaxis].clip(0, 1) * 0.1),
    "robots_where_told": ({"signal": "spot", "places": {"black": "spot"}}, TOGETHER),
    "zones_in_color": ({"zones": ("tiles",), "color": "red", "when": "always"}, TOGETHER),
    "surface_distance": ({"square_center": (9.0, 9.0), "square_side": 1.0}, TOGETHER),
    "cell_age": ({"side": 1.0, "cells": 2}, TOGETHER + 9.0),
}


@pytest.mark.parametrize("name", REACHED)
def test_the_highest_score_is_possible(name):
    parameters, positions = REACHED[name]
    run = trace(positions)
    objective = Objective(name=name, direction="maximise", parameters=parameters)
    size = ExperimentSize(run.robots, run.cycles, run.floor, run.zone_rows)
    assert objective(run) == pytest.approx(objective.possible_scores(size).high, rel=1e-9)


@pytest.mark.parametrize(
    ("zones", "share", "high"),
    [
        (("spot", "other"), False, 3.0),  # apart
        (("spot", "other"), True, 1.0),
        (("spot", "yolk"), False, 6.0),  # one is within the other
        (("spot", "spot"), False, 6.0),
        (("spot", "nest"), False, 6.0),  # a half plane: who knows
    ],
)
def test_the_emptiest_zone_has_all_robots_only_if_zones_overlap(zones, share, high):
    objective = Objective(
        name="robots_in_emptiest_zone", direction="maximise", parameters={"zones": zones, "share": share}
    )
    run = trace(SPREAD)
    assert objective.possible_scores(ExperimentSize(6, run.cycles, run.floor, run.zone_rows)).high == high


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
