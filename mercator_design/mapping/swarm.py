"""From the logs of a swarm to its maps: front end, loop closures, frames between robots, joint refinement."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mercator_design import seeds
from mercator_design.arrays import Flags, Floats, Numbers
from mercator_design.mapping.frames.consistency import Component
from mercator_design.mapping.frames.fragment import Fragment, bent, fragments, keyframes_of
from mercator_design.mapping.frames.joining import Joined, join
from mercator_design.mapping.frames.links import FrameLink
from mercator_design.mapping.front.lag import track_of
from mercator_design.mapping.joint.refinement import Refined, refine
from mercator_design.mapping.joint.uncertainty import SAMPLES, uncertainty_of
from mercator_design.mapping.logs import RobotLog
from mercator_design.mapping.loops.closures import ROUNDS, close_loops, closed
from mercator_design.mapping.poses import compose, inverse
from mercator_design.mapping.track import Track

Report = Callable[[str, float], None]
"""Called with what is being done, and the share of it that is done."""

_WIDE = 8.0
"""[m] Across a robot's way: in smaller arenas the map that the front end keeps closes the loops."""
_SPARSE_STEP = 0.3
"""[m] Between turns of a log that is sparse."""


@dataclass(frozen=True)
class SwarmMap:
    """The ways of robots in common frames. What could not be joined has a map of its own."""

    tracks: tuple[Track, ...]  # poses of a segment are in the frame of its map
    maps: tuple[
        Numbers, ...
    ]  # of each track: (segments,) the number of its map, the largest first; -1: too short for one
    offsets: tuple[
        Floats, ...
    ]  # of each track: (segments,) [s] its clock is ahead of that of the first one in the map; nan: not known
    furniture: tuple[Flags, ...]  # of each track: (s,) which of its small clusters are furniture
    links: tuple[FrameLink, ...]  # between fragments, also those that were refused
    messages: tuple[str, ...]
    covariances: tuple[Floats, ...]  # of each track: (k, 3, 3) of its keyframes, as of joint.uncertainty
    frame_covariances: tuple[Floats, ...]  # of each track: (segments, 3, 3) against the first one in the map

    @property
    def n_maps(self) -> int:
        return int(max((one.max(initial=-1) for one in self.maps), default=-1)) + 1

    def turns_of(self, number: int) -> list[tuple[int, Numbers]]:
        """The tracks of a map, and their turns (n,) in it."""
        found = []
        for track, of_segment in enumerate(self.maps):
            turns = np.flatnonzero(of_segment[self.tracks[track].segments] == number)
            if len(turns):
                found.append((track, turns))
        return found


def map_swarm(
    logs: Sequence[RobotLog], *, clock_search: float = 3.0, seed: int = 0, report: Report | None = None
) -> SwarmMap:
    """Map what the robots of a swarm saw.

    Args:
        logs: One of each robot.
        clock_search: [s] The clocks of the robots differ by at most this; 0: they are one clock.
        seed: Of the pairs of keyframes that are compared.
        report: Called as the work goes on.
    """
    say = report or (lambda _stage, _share: None)
    generator = seeds.generator(seed, "map")
    tracks = []
    for number, log in enumerate(logs):
        track = track_of(log, advance=_advance(say, number, len(logs), len(log.turns)))
        if _needs_loops(track):
            say("loops", number / len(logs))
            track = close_loops(track, lambda one: refined_track(one, generator))
        tracks.append(track)
    joined = join(tracks, clock_search, lambda share: say("frames", share))
    return _refined(tracks, joined, generator, say)


def _advance(say: Report, number: int, logs: int, turns: int) -> Callable[[int], None]:
    return lambda turn: say("turns", (number + (turn + 1) / turns) / logs)


def _part(say: Report, stage: str, number: int, parts: int) -> Callable[[float], None]:
    return lambda share: say(stage, (number + share) / parts)


def refined_track(track: Track, generator: np.random.Generator) -> Track:
    """A track with each of its segments refined by itself, and the scale of its odometry."""
    found, scales = track.keyframes.poses.copy(), []
    for part in fragments(track, min_turns=1):
        result = refine([part], np.zeros((1, 3)), np.zeros(1), generator)
        found[track.keyframes.segments == part.segment] = result.poses[0]
        scales.append((result.lengths[0], result.scales[0]))
    scale = max(scales, default=(0.0, track.scale))[1]
    return replace(track.with_keyframes(found), scale=scale)


def _needs_loops(track: Track) -> bool:
    if len(track.poses) < 2:
        return False
    steps = np.hypot(*np.diff(track.poses[:, :2], axis=0).T)
    return bool(np.median(steps) > _SPARSE_STEP or np.ptp(track.poses[:, :2], axis=0).max() > _WIDE)


def _refined(tracks: Sequence[Track], joined: Joined, generator: np.random.Generator, say: Report) -> SwarmMap:
    number_of = joined.robots
    found = [track.keyframes.poses.copy() for track in tracks]
    without_keyframes: list[tuple[int, int, Floats]] = []
    maps = [np.full(track.n_segments, -1) for track in tracks]
    offsets = [np.full(track.n_segments, math.nan) for track in tracks]
    scales = [(0.0, track.scale) for track in tracks]  # each with the length of the way that tells it
    covariances = [np.zeros((len(track.keyframes.turns), 3, 3)) for track in tracks]
    frames = [np.zeros((track.n_segments, 3, 3)) for track in tracks]
    for number, component in enumerate(joined.components):
        parts = [joined.parts[k] for k in component.members]
        if any(link.source == "overlap" and link.is_accepted and link.a in component.members for link in joined.links):
            say("loops", 1.0)
            parts = _closed(parts, component, generator)
        result = refine(
            parts,
            component.frames,
            component.offsets,
            generator,
            clocks=component.clocks,
            samples=SAMPLES,
            report=_part(say, "keyframes", number, len(joined.components)),
        )
        frame = _given_frame(joined, component.members, result)
        uncertain = uncertainty_of([compose(frame, poses) for poses in result.poses], result.motions)
        for part, k, *spread in zip(parts, component.members, *uncertain, strict=True):
            covariances[number_of[k]][tracks[number_of[k]].keyframes.segments == part.segment] = spread[0]
            frames[number_of[k]][part.segment] = spread[1]
        for part, k, poses, place in zip(parts, component.members, result.poses, component.frames, strict=True):
            own = number_of[k]
            found[own][tracks[own].keyframes.segments == part.segment] = compose(frame, poses)
            maps[own][part.segment] = number
            if len(poses) == 0:
                without_keyframes.append((own, part.segment, compose(frame, place)))
        for part, k, offset in zip(parts, component.members, component.known_offsets, strict=True):
            offsets[number_of[k]][part.segment] = offset
        for k, *scale in zip(component.members, result.lengths, result.scales, strict=True):
            scales[number_of[k]] = max(scales[number_of[k]], (scale[0], scale[1]))
    changed = [
        replace(track.with_keyframes(poses), scale=scale)
        for track, poses, (_, scale) in zip(tracks, found, scales, strict=True)
    ]
    for own, segment, place in without_keyframes:  # a lidar that sees no walls: others saw the robot
        turns = changed[own].segments == segment
        changed[own].poses[turns] = compose(place, changed[own].poses[turns])
    return SwarmMap(
        *(tuple(changed), tuple(maps), tuple(offsets), joined.furniture, joined.links, joined.messages),
        *(tuple(covariances), tuple(frames)),
    )


def _closed(parts: Sequence[Fragment], component: Component, generator: np.random.Generator) -> list[Fragment]:
    """The parts of a component, whose maps share no more than a part, with loops closed within and between them."""
    found = list(parts)
    for number, one in enumerate(ROUNDS[1:]):
        if number:
            result = refine(found, component.frames, component.offsets, generator, clocks=component.clocks)
            found = bent(found, component.frames, np.concatenate(result.poses))
        found = bent(found, component.frames, closed(keyframes_of(found, component.frames), one))
    return found


def _given_frame(joined: Joined, members: Sequence[int], result: Refined) -> Floats:
    """Where the frame of a component stands, so that the first robot whose given start is used is there."""
    for k, poses in zip(members, result.poses, strict=True):
        part = joined.parts[k]
        if k in joined.started and len(poses):
            first = compose(poses[0], compose(inverse(part.keyframes.poses[0]), part.beginning))
            return compose(np.asarray(part.track.log.start, float), inverse(first))
    return np.zeros(3)
