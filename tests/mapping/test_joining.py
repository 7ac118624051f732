"""Frames by maps, and the joining of a swarm: robots that met, that never met, and in rooms that look alike."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from mercator_design.mapping.frames import joining
from mercator_design.mapping.frames.fragment import fragments
from mercator_design.mapping.frames.joining import join
from mercator_design.mapping.frames.map_matching import match_maps
from mercator_design.mapping.frames.walls import conflict, field_of, walls_of
from mercator_design.mapping.poses import between, interpolate, inverse, transform, wrap
from tests.mapping import worlds

pytestmark = pytest.mark.together

# A room like an L, of two robots that stay in its two arms.
L_ROOM = worlds.room([[0, 0], [4, 0], [4, 1.5], [2.2, 1.5], [2.2, 3], [0, 3]])


def tracks_in(walls, centres, duration=25.0, seed=3, size=(0.7, 0.6), **options):
    generator = np.random.default_rng(seed)
    ways = [worlds.Curve(generator, centre=centre, size=size, speed=0.25) for centre in centres]
    return [worlds.perfect_track(ways, k, walls, duration, 1, **options) for k in range(len(ways))]


def blind(track):
    """The same track without sightings: as of robots that never were in the arena together."""
    nothing = track.clusters._replace(
        **{name: getattr(track.clusters, name)[:0] for name in ("turns", "times", "points", "beams")}
    )
    return replace(track, clusters=nothing)


def walls_and_field(track):
    walls = walls_of(fragments(track), [np.zeros(3)])
    return walls, field_of(walls)


def test_a_field_is_high_on_walls_low_where_beams_went_and_0_where_nobody_looked():
    (track,) = tracks_in(worlds.polygon(4, 1.5), [(0.0, 0.0)])
    _, field = walls_and_field(track)
    start = interpolate(track.log.truth_times, track.log.truth, track.times[:1])[0]

    def at(x, y):
        return float(field.at(transform(inverse(start), np.array([[x, y]])))[0])

    assert at(1.5, 0.3) > 0.5
    assert at(0.0, 0.2) == pytest.approx(-0.25)
    assert at(1.9, 0.0) == 0.0
    assert at(99.0, 0.0) == 0.0


def test_maps_of_an_irregular_room_give_the_frame():
    tracks = tracks_in(L_ROOM, [(1.2, 0.75), (1.2, 1.8)])
    (walls, field), (other, _) = (walls_and_field(track) for track in tracks)
    match = match_maps(other, field, walls)
    assert match.refusal == ""
    error = match.frame - worlds.true_frame(tracks, 0, 1)
    assert np.abs(error[:2]).max() < 0.02
    assert abs(wrap(error[2])) < math.radians(0.5)


@pytest.mark.parametrize("walls", [worlds.polygon(12, 1.226), worlds.polygon(64, 1.25), worlds.polygon(4, 1.5)])
def test_maps_of_symmetric_rooms_are_refused(walls):
    tracks = tracks_in(walls, [(0.0, 0.0), (0.0, 0.0)])
    (own, field), (other, _) = (walls_and_field(track) for track in tracks)
    match = match_maps(other, field, own)
    assert "symmetric" in match.refusal


def test_a_wrong_frame_puts_walls_where_beams_went():
    tracks = tracks_in(L_ROOM, [(1.2, 0.75), (1.2, 1.8)])
    (_, field), (other, _) = (walls_and_field(track) for track in tracks)
    true = worlds.true_frame(tracks, 0, 1)
    assert conflict(other, field, true) < 0.05
    assert conflict(other, field, true + np.array([0.4, 0.0, 0.0])) > 0.2


def test_robots_that_met_are_joined_and_their_clocks_told():
    walls, centres = worlds.polygon(12, 1.226), [(0.0, 0.0)] * 2
    generator = np.random.default_rng(3)
    ways = [worlds.Curve(generator, centre=centre, size=(0.7, 0.6), speed=0.25) for centre in centres]
    tracks = [worlds.perfect_track(ways, k, walls, 25.0, 1, clock=(0.0, -0.8)[k]) for k in range(2)]
    joined = join(tracks)
    (component,) = joined.components
    error = between(worlds.true_frame(tracks, 0, 1), component.frames[1])
    assert np.abs(error).max() < 0.006
    (message,) = joined.messages
    assert re.fullmatch(r"The clock of robot 1 is 0.(79|80)\d s behind that of robot 0.", message)


def test_robots_that_never_met_in_a_symmetric_arena_stay_apart():
    tracks = [blind(track) for track in tracks_in(worlds.polygon(12, 1.226), [(0.0, 0.0)] * 2)]
    joined = join(tracks, clock_search=0.0)
    assert [one.members for one in joined.components] == [(0,), (1,)]
    assert joined.messages[0] == "2 separate maps: robot 0; robot 1."
    assert "robot 0 and robot 1 were not joined: a second frame of the maps is" in joined.messages[1]


def test_robots_that_never_met_are_joined_by_their_maps_where_these_are_clear():
    tracks = [blind(track) for track in tracks_in(L_ROOM, [(1.2, 0.75), (1.2, 1.8)])]
    joined = join(tracks, clock_search=0.0)
    (component,) = joined.components
    assert np.abs(between(worlds.true_frame(tracks, 0, 1), component.frames[1])).max() < 0.02
    assert "never met long enough; their maps agree in" in joined.messages[0]


def test_halves_of_a_symmetric_ring_stay_apart():
    # Each robot saw one half; the wrong frame, half a turn away, is the only one in which much fits.
    outer, inner = worlds.room([[-3, -2], [3, -2], [3, 2], [-3, 2]]), worlds.room([[-2, -1], [2, -1], [2, 1], [-2, 1]])
    walls = np.concatenate([outer, inner])
    tracks = tracks_in(walls, [(-2.5, 0.0), (2.5, 0.0)], size=(0.2, 1.0))
    joined = join([blind(track) for track in tracks], clock_search=0.0)
    assert len(joined.components) == 2
    assert any("open" in link.refusal for link in joined.links)


def with_start(track, error=(0.0, 0.0, 0.0)):
    log = track.log
    start = interpolate(log.truth_times, log.truth, log.odometry_times[:1])[0] + np.array(error)
    return replace(track, log=replace(log, start=start))


def test_given_starts_join_robots_that_never_met():
    tracks = [with_start(blind(track)) for track in tracks_in(worlds.polygon(12, 1.226), [(0.0, 0.0)] * 2)]
    (component,) = join(tracks, clock_search=0.0).components
    assert np.abs(between(worlds.true_frame(tracks, 0, 1), component.frames[1])).max() < 0.006


def test_starts_that_disagree_with_sightings_are_told_and_not_used():
    first, second = tracks_in(worlds.polygon(12, 1.226), [(0.0, 0.0)] * 2)
    tracks = [with_start(first), with_start(second, (0.5, 0.0, 0.0))]
    joined = join(tracks, clock_search=0.0)
    (component,) = joined.components
    assert np.abs(between(worlds.true_frame(tracks, 0, 1), component.frames[1])).max() < 0.006
    assert "the given starts disagree" in joined.messages[0]
    assert joined.started == frozenset()


def test_a_start_that_most_robots_contradict_is_not_used():
    tracks = tracks_in(worlds.polygon(12, 1.226), [(0.0, 0.0)] * 3, duration=15.0)
    joined = join([with_start(track, (0.5 * (k == 0), 0.0, 0.0)) for k, track in enumerate(tracks)], clock_search=0.0)
    assert len(joined.components) == 1
    assert joined.started == {1, 2}
    (refused,) = [link for link in joined.links if link.source == "start"]
    assert "0.50 m from there" in refused.refusal


def test_a_wrong_start_joins_nobody_wrongly():
    # The first two met, and one of their starts is wrong; which one nobody knows. The third met nobody.
    first, second = tracks_in(L_ROOM, [(1.2, 0.75)] * 2, duration=15.0)
    (third,) = tracks_in(L_ROOM, [(1.2, 1.8)], duration=15.0)
    tracks = [with_start(first, (0.5, 0.0, 0.0)), with_start(second), with_start(third)]
    joined = join(tracks, clock_search=0.0)
    assert joined.started == {2}
    for component in joined.components:
        for member, frame in zip(component.members, component.frames, strict=True):
            true = worlds.true_frame(tracks, component.members[0], member)
            assert np.abs(between(true, frame)).max() < 0.03


def test_starts_whose_walls_contradict_each_other_join_nobody():
    tracks = [blind(track) for track in tracks_in(worlds.polygon(4, 1.5), [(0.0, 0.0)] * 2)]
    joined = join([with_start(tracks[0]), with_start(tracks[1], (0.6, 0.0, 0.0))], clock_search=0.0)
    assert len(joined.components) == 2
    assert joined.started == frozenset()
    assert "the given starts disagree with what was seen" in joined.messages[0]


def test_maps_that_are_not_compared_are_told(monkeypatch):
    monkeypatch.setattr(joining, "MAX_MAPS", 2)
    (track,) = tracks_in(worlds.polygon(4, 1.5), [(0.0, 0.0)], duration=3.0)
    alone = [replace(blind(track), log=replace(track.log, name=f"robot {k}")) for k in range(3)]
    joined = join(alone, clock_search=0.0)
    assert len(joined.components) == 3
    assert "Maps 3 to 3 were not compared: at most 2 maps are." in joined.messages
    assert not any("too few walls" in message and "3" in message for message in joined.messages)


def test_the_order_of_robots_does_not_matter():
    tracks = tracks_in(worlds.polygon(12, 1.226), [(0.0, 0.0)] * 3, duration=15.0)
    forwards, backwards = join(tracks), join(tracks[::-1])
    one = between(forwards.components[0].frames[1], forwards.components[0].frames[2])
    other = between(backwards.components[0].frames[1], backwards.components[0].frames[0])
    assert one == pytest.approx(other, abs=1e-3)
