"""Which links join fragments: cycles must close, and no merge is better than a wrong one."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mercator_design.mapping.frames.consistency import merged
from mercator_design.mapping.frames.links import FrameLink
from mercator_design.mapping.poses import between

POSES = np.array([[0.0, 0.0, 0.0], [1.0, 0.2, 1.0], [-0.5, 1.0, -2.0], [0.3, -1.0, 3.0], [2.0, 2.0, 0.5]])


def link(a, b, *, support=100.0, error=(0.0, 0.0, 0.0), offset=0.0, source="sightings"):
    return FrameLink(a, b, between(POSES[a], POSES[b]) + np.array(error), source, support, offset)


def refused(merge):
    return [(one.a, one.b) for one in merge.links if not one.is_accepted]


def frames_agree(merge, tolerance=1e-6):
    for component in merge.components:
        first = POSES[component.members[0]]
        for member, frame in zip(component.members, component.frames, strict=True):
            difference = between(frame, between(first, POSES[member]))
            if np.abs(difference).max() > tolerance:
                return False
    return True


def test_fragments_without_links_stay_apart():
    merge = merged(3, [link(0, 2)])
    assert [one.members for one in merge.components] == [(0, 2), (1,)]
    assert frames_agree(merge)


def test_a_refused_link_joins_nothing():
    merge = merged(2, [link(0, 1).refused("only 3 sightings agree")])
    assert [one.members for one in merge.components] == [(0,), (1,)]
    assert merge.links[0].refusal == "only 3 sightings agree"


def test_frames_follow_links_in_both_directions():
    merge = merged(5, [link(1, 0), link(1, 2), link(3, 2), link(3, 4)])
    assert [one.members for one in merge.components] == [(0, 1, 2, 3, 4)]
    assert frames_agree(merge)


def test_small_errors_are_shared_by_support():
    merge = merged(3, [link(0, 1), link(1, 2), link(0, 2, error=(0.03, 0.0, 0.0))])
    (component,) = merge.components
    assert 0.0 < component.frames[2][0] - POSES[2][0] < 0.03
    assert refused(merge) == []


def test_the_link_with_least_support_of_a_cycle_is_refused():
    merge = merged(3, [link(0, 1, support=900), link(1, 2, support=700), link(0, 2, support=50, error=(1.0, 0, 0))])
    assert refused(merge) == [(0, 2)]
    assert "cycle of 3 links miss by 1.00 m" in merge.links[2].refusal
    assert frames_agree(merge)


def test_rivals_of_similar_support_are_all_refused():
    merge = merged(3, [link(0, 1, support=90), link(1, 2, support=80), link(0, 2, support=70, error=(0, 0, 1.0))])
    assert len(merge.components) == 3


def test_a_confirmed_link_stays():
    # Of four robots, all triangles with 0-3 fail; the others confirm each other, whatever its support is.
    links = [link(a, b, support=50) for a, b in ((0, 1), (0, 2), (1, 2), (1, 3), (2, 3))]
    merge = merged(4, [*links, link(0, 3, support=1000, error=(0.5, 0.5, 0.5))])
    assert refused(merge) == [(0, 3)]
    assert frames_agree(merge)


def test_a_long_cycle_is_checked():
    ring = [link(k, k + 1, support=1000) for k in range(4)]
    merge = merged(5, [*ring, link(0, 4, support=20, error=(0.0, 0.9, 0.0))])
    assert refused(merge) == [(0, 4)]
    assert "cycle of 5 links" in merge.links[-1].refusal


def test_two_links_of_a_pair_must_agree():
    merge = merged(2, [link(0, 1, support=500), link(0, 1, support=10, error=(1.0, 0, 0), source="maps")])
    assert [one.source for one in merge.links if one.is_accepted] == ["sightings"]


def test_clocks_come_from_least_squares_over_pairs():
    clocks = [0.0, 0.5, -1.2, 0.3]
    links = [link(a, b, offset=clocks[b] - clocks[a] + 0.001 * (a - b)) for a in range(4) for b in range(a + 1, 4)]
    (component,) = merged(4, links).components
    assert component.offsets == pytest.approx(clocks, abs=0.004)


def test_clocks_without_sightings_are_not_known():
    (component,) = merged(3, [link(0, 1, offset=0.4), link(1, 2, source="maps")]).components
    assert component.known_offsets[:2].tolist() == pytest.approx([0.0, 0.4])
    assert math.isnan(component.known_offsets[2])


def test_parts_of_one_robot_have_one_clock():
    # Parts 1 and 3 are of one robot; part 3 is in a map with others only by its walls.
    links = [link(0, 1, offset=0.4), link(2, 3, source="maps"), link(0, 2, offset=-0.1)]
    component = merged(4, links, robots=[0, 1, 2, 1]).components[0]
    assert component.known_offsets.tolist() == pytest.approx([0.0, 0.4, -0.1, 0.4])


def test_clocks_are_tied_by_robots_that_met_in_another_map():
    components = merged(4, [link(0, 1, offset=0.4), link(2, 3, source="maps")], robots=[0, 1, 0, 1]).components
    assert [one.known_offsets.tolist() for one in components] == [pytest.approx([0.0, 0.4])] * 2


def test_clocks_that_are_one_are_known():
    (component,) = merged(2, [link(0, 1, source="maps")], is_one_clock=True).components
    assert component.known_offsets.tolist() == [0.0, 0.0]


def test_clocks_of_robots_that_met_are_tied_also_beside_the_first_one():
    links = [link(0, 1, source="maps"), link(1, 2, offset=0.3)]
    (component,) = merged(3, links).components
    assert component.clocks.tolist() == [0, 1, 1]
    assert component.offsets.tolist() == pytest.approx([0.0, 0.0, 0.3])


def test_clocks_that_disagree_are_refused():
    links = [link(0, 1, support=900, offset=0.1), link(1, 2, support=900, offset=0.1), link(0, 2, support=50)]
    merge = merged(3, links)
    assert refused(merge) == [(0, 2)]
    assert "disagree by 200 ms" in merge.links[2].refusal


@given(st.integers(0, 2**31))
def test_one_wrong_link_among_all_pairs_never_moves_a_frame(seed):
    generator = np.random.default_rng(seed)
    links = []
    pairs = [(a, b) for a in range(5) for b in range(a + 1, 5)]
    wrong = int(generator.integers(len(pairs)))
    for k, (a, b) in enumerate(pairs):
        error = generator.normal(0.0, (0.003, 0.003, 0.001))
        if k == wrong:
            error = (*generator.uniform(0.4, 2.0, 2), generator.uniform(-math.pi, math.pi))
        links.append(link(a, b, support=float(generator.uniform(30, 3000)), error=error))
    merge = merged(5, links)
    assert refused(merge) == [pairs[wrong]]
    assert frames_agree(merge, 0.03)
