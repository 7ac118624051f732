"""All frames of a swarm: links by sightings, then by given starts and by maps, as far as they agree."""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from mercator_design.arrays import Flags, Floats
from mercator_design.mapping.frames.consistency import Component, Merge, merged
from mercator_design.mapping.frames.fragment import Fragment, bent, fragments, keyframes_of
from mercator_design.mapping.frames.links import FrameLink, link_by_sightings
from mercator_design.mapping.frames.map_matching import match_maps
from mercator_design.mapping.frames.overlap import overlap
from mercator_design.mapping.frames.persistence import furniture
from mercator_design.mapping.frames.starts import starts_of
from mercator_design.mapping.frames.walls import Field, Walls, conflict, field_of, open_share, walls_of, walls_seen
from mercator_design.mapping.poses import compose, inverse
from mercator_design.mapping.track import Track

MAX_CONFLICT = 0.15
"""Share of one map's walls that may lie where the beams of the other one's robot went through."""

MAX_OPEN = 0.09
"""Share of the border of a map behind which nobody looked. Of halves of a ring, the wrong answer is the only one."""

MAX_MAPS = 12
"""Separate maps that are compared with each other, the largest first."""


@dataclass(frozen=True)
class Joined:
    """The fragments of a swarm and where they stand."""

    parts: tuple[Fragment, ...]
    robots: tuple[int, ...]  # of each part: the number of its track
    furniture: tuple[Flags, ...]  # of each track: which of its clusters (s,) are furniture
    components: tuple[Component, ...]  # the members are numbers of parts
    links: tuple[FrameLink, ...]
    started: frozenset[int]  # the parts whose given starts are used
    messages: tuple[str, ...]  # sentences on what was joined and what was not


def join(tracks: Sequence[Track], clock_search: float = 3.0, report: Callable[[float], None] | None = None) -> Joined:
    """Find the frames of robots.

    Args:
        tracks: One of each robot.
        clock_search: [s] The clocks of robots differ by at most this; 0: they are one clock.
        report: Called with the share that is done.
    """
    found = [part for track in tracks for part in fragments(track)]
    standing = [furniture(part) for part in found]
    parts = [part.with_sightings(~flags) for part, flags in zip(found, standing, strict=True)]
    maps = _Maps(parts)
    links = _links_by_sightings(parts, maps, clock_search, report)
    robots = [next(k for k, track in enumerate(tracks) if track.log is part.track.log) for part in parts]
    merge_all = functools.partial(merged, len(parts), robots=robots, is_one_clock=clock_search == 0.0)
    starts = starts_of(parts, merge_all(links).components, lambda link: _checked_by_walls(link, maps))
    merge = _joined_by_maps(parts, merge_all([*links, *starts.links]), merge_all)
    messages = _messages(parts, merge)
    of_tracks = [np.zeros(len(track.clusters.times), dtype=np.bool_) for track in tracks]
    for part, robot, flags in zip(found, robots, standing, strict=True):
        of_tracks[robot][part.sightings.rows[flags]] = True
    return Joined(tuple(parts), tuple(robots), tuple(of_tracks), merge.components, merge.links, starts.used, messages)


def _links_by_sightings(
    parts: Sequence[Fragment], maps: "_Maps", clock_search: float, report: Callable[[float], None] | None
) -> list[FrameLink]:
    pairs = [(a, b) for a, b in combinations(range(len(parts)), 2) if not parts[a].is_of_robot(parts[b])]
    found = []
    for done, (a, b) in enumerate(pairs):
        link = link_by_sightings(a, b, parts, clock_search)
        if link is not None:
            found.append(_checked_by_walls(link, maps) if link.is_accepted else link)
        if report:
            report((done + 1) / len(pairs))
    return found


class _Maps:
    """The walls and fields of fragments, each made once."""

    def __init__(self, parts: Sequence[Fragment]) -> None:
        self._parts = parts
        self.walls: Callable[[int], Walls] = functools.cache(lambda k: walls_of([parts[k]], [np.zeros(3)]))
        self.field: Callable[[int], Field] = functools.cache(lambda k: field_of(self.walls(k)))


def _checked_by_walls(link: FrameLink, maps: _Maps) -> FrameLink:
    """The link, refused if the walls of one robot stand where the other one's beams went through."""
    if min(len(maps.walls(link.a).points), len(maps.walls(link.b).points)) == 0:
        return link
    share = max(
        conflict(maps.walls(link.b), maps.field(link.a), link.frame),
        conflict(maps.walls(link.a), maps.field(link.b), inverse(link.frame)),
    )
    if share <= MAX_CONFLICT:
        return link
    return link.refused(f"{share:.0%} of the walls that one saw stand where the other one's beams went through")


class _ByMaps(NamedTuple):
    """How two components stand by their maps."""

    link: FrameLink | None  # None: one of them has hardly any walls
    bent: Floats | None = None  # (k, 3) keyframes of the first one and then of the second one, in the first one's frame


def _joined_by_maps(parts: list[Fragment], merge: Merge, merge_all: Callable[[list[FrameLink]], Merge]) -> Merge:
    """Join components by their maps, the best match first, until none is accepted; changes parts that loops bend."""
    tried: dict[tuple[tuple[int, ...], tuple[int, ...]], _ByMaps] = {}
    while True:
        pairs = list(combinations(merge.components[:MAX_MAPS], 2))
        for first, second in pairs:
            if (first.members, second.members) not in tried:
                tried[first.members, second.members] = _by_maps(parts, first, second)
        current = [(first, second, tried[first.members, second.members]) for first, second in pairs]
        links = [(one, link) for one in current if (link := one[2].link) is not None]
        accepted = [(one, link) for one, link in links if link.is_accepted]
        known = [link for link in merge.links if link.is_accepted or link.source not in ("maps", "overlap")]
        if not accepted:
            return Merge(merge.components, (*known, *(link for _, link in links)))
        (first, second, found), best = max(accepted, key=lambda one: (one[1].source == "maps", one[1].support))
        if found.bent is not None:
            members = (*first.members, *second.members)
            at = np.concatenate([first.frames, compose(best.frame, second.frames)])
            for member, part in zip(members, bent([parts[k] for k in members], at, found.bent), strict=True):
                parts[member] = part
        merge = merge_all([*known, best])  # it closes no cycle, so it is used


def _by_maps(parts: Sequence[Fragment], first: Component, second: Component) -> _ByMaps:
    keyframes = [keyframes_of([parts[k] for k in one.members], one.frames) for one in (first, second)]
    walls = [walls_seen(one) for one in keyframes]
    if min(len(one.points) for one in walls) == 0:
        return _ByMaps(None)
    field, of_second = field_of(walls[0]), field_of(walls[1])
    match = match_maps(walls[1], field, walls[0])
    if match is None:
        return _ByMaps(None)
    # The longest fragments stand for their components.
    link = FrameLink(first.members[0], second.members[0], match.frame, "maps", match.score, second=match.second)
    unseen = max(open_share(field), open_share(of_second))
    share = max(conflict(walls[1], field, match.frame), conflict(walls[0], of_second, inverse(match.frame)))
    if match.refusal:
        link = link.refused(match.refusal)
    elif unseen > MAX_OPEN:
        reason = f"{unseen:.0%} of the border of one map is open: two halves of a symmetric arena would fit as well"
        link = link.refused(reason)
    elif share > MAX_CONFLICT:
        link = link.refused(f"{share:.0%} of the walls of one map stand where beams went through in the other one")
    if link.is_accepted or (found := overlap(keyframes[0], keyframes[1], match.peaks)) is None:
        return _ByMaps(link)
    link = replace(link, frame=found.frame, source="overlap", support=found.scans, second=found.second)
    return _ByMaps(link.refused(found.refusal), found.poses)


def _messages(parts: Sequence[Fragment], merge: Merge) -> tuple[str, ...]:
    """Sentences on links without sightings, clocks that differ, and reasons for separate maps."""
    said = []
    for link in merge.links:
        names = f"{parts[link.a].name} and {parts[link.b].name}"
        if link.is_accepted and link.source == "maps":
            said.append(f"{names} never met long enough; their maps agree in {link.support:.0%} of the walls.")
        elif link.is_accepted and link.source == "overlap":
            said.append(
                f"{names} never met long enough; their maps share a part: {link.support:.0f} scans of one are found in "
                "the other one."
            )
        elif link.source == "start" and not link.is_accepted:
            said.append(f"{names}: the given starts disagree with what was seen, so they are not used: {link.refusal}.")
    said += _on_clocks(parts, merge)
    if len(merge.components) > 1:
        groups = [", ".join(parts[k].name for k in one.members) for one in merge.components]
        said.append(f"{len(groups)} separate maps: {'; '.join(groups)}.")
        label = {k: number for number, one in enumerate(merge.components) for k in one.members}
        for link in merge.links:
            if label[link.a] != label[link.b] and link.refusal and link.source != "start":
                said += [f"{parts[link.a].name} and {parts[link.b].name} were not joined: {link.refusal}."]
        linked = {(label[link.a], label[link.b]) for link in merge.links}
        linked |= {(b, a) for a, b in linked}
        if len(merge.components) > MAX_MAPS:
            said.append(
                f"Maps {MAX_MAPS + 1} to {len(merge.components)} were not compared: at most {MAX_MAPS} maps are."
            )
        for a, b in combinations(range(min(len(merge.components), MAX_MAPS)), 2):
            if (a, b) not in linked:
                said.append(
                    f"Maps {a + 1} and {b + 1}: the robots never saw each other, and the maps have too few walls."
                )
    return tuple(said)


def _on_clocks(parts: Sequence[Fragment], merge: Merge) -> list[str]:
    """Sentences on the clocks of robots that differ from that of the first one in their map, or are not known."""
    said: dict[str, None] = {}  # once for all parts of a robot
    for component in merge.components:
        first = parts[component.members[0]]
        for member, offset in zip(component.members, component.known_offsets, strict=True):
            name = parts[member].track.log.name
            if np.isnan(offset):
                said[f"How far the clock of {name} is ahead of that of {first.track.log.name} is not known."] = None
            elif abs(offset) > 0.01 and not parts[member].is_of_robot(first):
                side = "ahead of" if offset > 0.0 else "behind"
                said[f"The clock of {name} is {abs(offset):.3f} s {side} that of {first.track.log.name}."] = None
    return list(said)
