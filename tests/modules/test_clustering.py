"""Robots as clusters of lidar readings, on turns made by hand."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from mercator_design.jit import compiled
from mercator_design.modules.clustering import lidar_neighbours, neighbours_in_hits
from mercator_design.modules.reference import ReferenceModel

MODEL = ReferenceModel()
BEAMS = 719
STEP = 2 * math.pi / BEAMS
HEAD = 0.035


def found_in(ranges, model=MODEL, first_angle=-math.pi):
    """The robots found: (distance, bearing from -pi to pi), in the order of the turn."""
    room = [0.0] * BEAMS
    rows = room[:], room[:], room[:]
    n = lidar_neighbours(model, ranges, first_angle, 2 * math.pi / len(ranges), *rows)
    return [(d, math.atan2(y, x)) for d, x, y in list(zip(*rows, strict=True))[:n]]


def turn_with(*heads, first_angle=-math.pi, background=0.0, beams=BEAMS):
    """A turn that sees heads of 7 cm at (distance, bearing)."""
    ranges = [background] * beams
    for k in range(beams):
        for distance, bearing in heads:
            off = math.remainder(first_angle + 2 * math.pi / beams * k - bearing, 2 * math.pi)
            past = distance * math.sin(off)
            if abs(past) <= HEAD and math.cos(off) > 0:
                hit = distance * math.cos(off) - math.sqrt(HEAD**2 - past**2)
                ranges[k] = min(ranges[k], hit) if ranges[k] else hit
    return ranges


def one(distance, bearing):
    """What is expected of a head: the mean of what is seen of its front, within a beam of its bearing.

    The outermost readings differ so much that they may be left out on one side only, which shifts the mean by half a
    beam; the grid of the beams does as much.
    """
    return (pytest.approx(distance - 0.75 * HEAD, abs=0.25 * HEAD), pytest.approx(bearing, abs=1.5 * STEP))


@given(st.floats(0.2, 0.7), st.floats(-3.1, 3.1), st.floats(-10, 10))
def test_one_robot(distance, bearing, first_angle):
    assert found_in(turn_with((distance, bearing), first_angle=first_angle), first_angle=first_angle) == [
        one(distance, bearing)
    ]


@pytest.mark.parametrize("distance", [0.2, 0.4, 0.7])
@pytest.mark.parametrize("off", [-0.05, -0.02, -0.001, 0.0, 0.001, 0.02, 0.05])
def test_a_robot_behind_is_one_robot(distance, off):
    """Where the turn begins and ends. The original split it in two."""
    bearing = math.remainder(math.pi + off, 2 * math.pi)
    [(d, found)] = found_in(turn_with((distance, bearing)))
    assert d == one(distance, 0.0)[0]
    assert abs(math.remainder(found - bearing, 2 * math.pi)) < 1.5 * STEP


def test_a_cluster_over_the_end_of_the_turn_has_the_mean_of_all_its_readings():
    ranges = [0.5] * 4 + [0.0] * (BEAMS - 6) + [0.51] * 2
    [(distance, bearing)] = found_in(ranges)
    assert distance == pytest.approx((4 * 0.5 + 2 * 0.51) / 6)
    assert bearing == pytest.approx(-math.pi + 0.5 * STEP)  # of beams -2 to 3


def test_few_readings_on_both_sides_of_the_end_are_a_robot_together():
    assert len(found_in([0.5] * 3 + [0.0] * (BEAMS - 5) + [0.5] * 2)) == 1
    assert found_in([0.5] * 3 + [0.0] * (BEAMS - 4) + [0.5]) == []


def test_what_differs_over_the_end_of_the_turn_is_two_robots():
    ranges = [0.5] * 6 + [0.0] * (BEAMS - 12) + [0.53] * 6
    assert [d for d, _ in found_in(ranges)] == pytest.approx([0.5, 0.53])


def test_robots_side_by_side():
    """As near as bodies allow, at the same distance and one behind the other."""
    side_by_side = [(0.5, -0.29), (0.5, 0.29)]
    assert found_in(turn_with(*side_by_side)) == [one(*each) for each in side_by_side]
    one_behind = [(0.35, 0.0), (0.65, 0.25)]
    assert found_in(turn_with(*one_behind)) == [one(*each) for each in one_behind]


def test_a_robot_partly_hidden_by_another_is_still_another():
    near, far = (0.35, 0.0), (0.66, 0.13)
    found = found_in(turn_with(near, far))
    assert found[0] == one(*near)
    assert len(found) == 2
    assert 0.6 < found[1][0] < 0.66
    assert 0.1 < found[1][1] < 0.19


@pytest.mark.parametrize(("points", "robots"), [(4, 0), (5, 1)])
def test_few_readings_are_no_robot(points, robots):
    assert len(found_in([0.0] * 100 + [0.5] * points + [0.0] * (BEAMS - 100 - points))) == robots


@pytest.mark.parametrize(("distance", "robots"), [(0.0999, 0), (0.1, 1), (0.75, 1), (0.7501, 0)])
def test_readings_out_of_range_are_no_robot(distance, robots):
    assert len(found_in([0.0] * 100 + [distance] * 10 + [0.0] * (BEAMS - 110))) == robots


def test_nothing_is_nothing():
    assert found_in([0.0] * BEAMS) == []
    assert found_in([12.0] * BEAMS) == []
    assert found_in([0.0] * 300 + [0.5] + [0.0] * (BEAMS - 301)) == []


@pytest.mark.parametrize(("jump", "robots"), [(0.0199, 1), (0.0201, 2)])
def test_readings_join_by_distance(jump, robots):
    assert len(found_in([0.0] * 100 + [0.5] * 6 + [0.5 + jump] * 6 + [0.0] * (BEAMS - 112))) == robots


@pytest.mark.parametrize(("gap", "robots"), [(18, 1), (20, 2)])
def test_readings_join_by_angle(gap, robots):
    """10 degrees are 19.97 beams; readings out of range between them do not part them."""
    assert len(found_in([0.0] * 100 + [0.5] * 6 + [0.0] * gap + [0.5] * 6 + [9.0] * (BEAMS - 112 - gap))) == robots


def test_a_drifting_cluster_stays_one_as_each_reading_is_compared_with_the_one_before():
    ramp = [0.2 + 0.015 * k for k in range(20)]
    [(distance, _)] = found_in([0.0] * 100 + ramp + [0.0] * (BEAMS - 120))
    assert distance == pytest.approx(sum(ramp) / 20)


def test_walls_within_range_count_as_robots():
    """Which is why the arena must be in a larger room (the Mercator paper, 4.4)."""
    wall = [0.5 / math.cos(math.remainder(-math.pi + STEP * k, 2 * math.pi)) for k in range(BEAMS)]
    found = found_in([d if 0 < d < 0.75 else 0.0 for d in wall])
    assert len(found) == 1
    assert found[0][1] == pytest.approx(0.0, abs=STEP)
    [(distance, _)] = found_in([0.6] * BEAMS)
    assert distance == pytest.approx(0.6)


def test_the_constants_are_the_models():
    ranges = [0.0] * 100 + [0.9] * 3 + [0.95] * 3 + [0.0] * (BEAMS - 106)
    assert found_in(ranges) == []
    model = MODEL._replace(neighbour_range=1.0, cluster_points=3.0)
    assert [d for d, _ in found_in(ranges, model)] == pytest.approx([0.9, 0.95])
    assert len(found_in(ranges, model._replace(cluster_distance=0.06))) == 1
    assert len(found_in(ranges, model._replace(cluster_points=0.0, lidar_nearest=0.94))) == 1


def reference(ranges, model):
    """The robot's algorithm on the turn rolled to begin in a gap, so that nothing lies over its end."""
    n = len(ranges)
    kept = [k for k in range(n) if model.lidar_nearest <= ranges[k] <= model.neighbour_range]
    if not kept:
        return []
    clusters = [[kept[0]]]
    around = [*kept[1:], kept[0] + n]
    for k in around:
        last = clusters[-1][-1]
        near = abs(ranges[k % n] - ranges[last % n]) < model.cluster_distance
        if near and (k - last) * 2 * math.pi / n < model.cluster_angle:
            clusters[-1].append(k)
        else:
            clusters.append([k])
    last = clusters.pop()  # it holds the first reading for a second time
    if clusters and last[-1] == kept[0] + n and len(last) > 1:
        clusters[0] = [*last[:-1], *(k + n for k in clusters[0])]
    elif not clusters:
        clusters = [last[:-1]]
    return [
        (sum(ranges[k % n] for k in cluster) / len(cluster), sum(cluster) / len(cluster))
        for cluster in clusters
        if len(cluster) >= model.cluster_points
    ]


@given(
    st.lists(st.tuples(st.sampled_from([0.0, 0.3, 0.31, 0.315, 0.4, 0.9]), st.integers(1, 12)), min_size=1, max_size=20)
)
def test_any_turn_is_clustered_as_the_rule_says(runs):
    ranges = [distance for distance, length in runs for _ in range(length)]
    if len(ranges) < 8:
        ranges = (ranges * 8)[:8]
    assume(len(ranges) % 36)  # whose beams are exactly 10 degrees apart, or a part of it: rounding would decide
    found = found_in(ranges, first_angle=0.0)
    expected = reference(ranges, MODEL)
    assert len(found) == len(expected)
    for distance, place in expected:
        bearing = place * 2 * math.pi / len(ranges)
        assert any(
            distance == pytest.approx(d) and math.remainder(bearing - b, 2 * math.pi) == pytest.approx(0.0, abs=1e-9)
            for d, b in found
        )


def test_compiled_and_plain_forms_agree_to_the_last_bit():
    ranges = turn_with((0.5, 3.13), (0.4, 0.3), (0.7, -1.0))
    plain = [[0.0] * BEAMS for _ in range(3)]
    assert lidar_neighbours(MODEL, ranges, -math.pi, STEP, *plain) == 3
    for hits in (np.arange(BEAMS), np.flatnonzero(ranges)):
        rows = np.zeros((3, BEAMS))
        found = compiled(neighbours_in_hits)(MODEL, np.array(ranges), hits, len(hits), -math.pi, STEP, *rows)
        assert found == 3
        assert rows.tolist() == plain
