"""Which links are used, where the frames then stand, and which fragments stay apart.

Links around a cycle must lead back to where they began. Where they do not, at least one is wrong; one that no other
cycle confirms is refused, the one with the least support first, and with it its rivals of similar support.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from mercator_design.arrays import Floats, Numbers
from mercator_design.mapping.frames.links import FrameLink
from mercator_design.mapping.loops import graph
from mercator_design.mapping.poses import compose, inverse, wrap

MAX_DISTANCE, MAX_ANGLE = 0.2, math.radians(3.0)
"""[m], [rad] By which the frames around a cycle of three links may miss; longer ones with the root of their length."""
MAX_CLOCK = 0.05
"""[s] By which the offsets of clocks around a cycle may disagree."""

_SIMILAR = 3.0
"""Two links of a cycle are rivals if their supports differ by a smaller factor."""


class Component(NamedTuple):
    """Fragments in one frame: that of the first one."""

    members: tuple[int, ...]
    frames: Floats  # (members, 3) of each in that of the first one
    offsets: Floats  # (members,) [s] of each clock ahead of the first one that is tied to it
    clocks: Numbers  # (members,) the same number for clocks that are tied to each other; 0: to that of the first one

    @property
    def known_offsets(self) -> Floats:
        """The offsets (members,) [s] ahead of the clock of the first one; nan where it is not known."""
        return np.where(self.clocks == 0, self.offsets, math.nan)


class Merge(NamedTuple):
    """How fragments are joined."""

    components: tuple[Component, ...]  # the largest first
    links: tuple[FrameLink, ...]  # all of them, with why those that are not used are refused


def merged(
    n: int, links: Sequence[FrameLink], robots: Sequence[int] | None = None, *, is_one_clock: bool = False
) -> Merge:
    """Join n fragments by their links.

    Fragments that no accepted link connects stay in components of their own.

    Args:
        n: How many fragments there are.
        links: Between them.
        robots: (n,) whose fragments they are: those of one robot have one clock; None: all are of different ones.
        is_one_clock: All robots have one clock.
    """
    checked = list(links)
    while (wrong := _inconsistent(n, checked)) is not None:
        for k, reason in wrong:
            checked[k] = checked[k].refused(reason)
    used = [link for link in checked if link.is_accepted]
    components = sorted(_components(n, used), key=lambda members: (-len(members), members))
    of_robots = list(range(n) if robots is None else robots)
    clocks = (np.zeros(n), np.zeros(n, np.int64)) if is_one_clock else _clocks(of_robots, used)
    return Merge(tuple(_solved(members, used, *clocks) for members in components), tuple(checked))


def _inconsistent(n: int, links: Sequence[FrameLink]) -> list[tuple[int, str]] | None:
    """The links to be refused next, and why; None if all cycles agree."""
    used = [k for k, link in enumerate(links) if link.is_accepted]
    cycles = _cycles(n, links, used)
    misses = [_miss(links, cycle) for cycle in cycles]
    confirmed = {k for cycle, miss in zip(cycles, misses, strict=True) if not miss for k, _ in cycle}
    bad = [(cycle, miss) for cycle, miss in zip(cycles, misses, strict=True) if miss]
    if not bad:
        return None
    # A link in several cycles that do not close is more likely to be the wrong one.
    blame: dict[int, int] = {}
    for cycle, _ in bad:
        for k, _ in cycle:
            blame[k] = blame.get(k, 0) + 1
    unconfirmed = {k for k in blame if k not in confirmed} or set(blame)
    most = max(blame[k] for k in unconfirmed)
    suspects = sorted((k for k in unconfirmed if blame[k] == most), key=lambda k: _rank(links[k]))
    worst = suspects[0]
    reason = next(miss for cycle, miss in bad if any(k == worst for k, _ in cycle))
    rivals = {k for cycle, _ in bad if any(k == worst for k, _ in cycle) for k, _ in cycle} & set(suspects)
    refused = [k for k in rivals if _similar(links[k], links[worst])]
    return [(k, reason) for k in sorted({worst, *refused})]


def _rank(link: FrameLink) -> tuple[int, float]:
    """Links by maps are weaker than given starts, and these than sightings."""
    return ("overlap", "maps", "start", "sightings").index(link.source), link.support


def _similar(first: FrameLink, second: FrameLink) -> bool:
    if first.source != second.source:
        return False
    low, high = sorted((first.support, second.support))
    return high < _SIMILAR * max(low, 1e-9)


def _cycles(n: int, links: Sequence[FrameLink], used: Sequence[int]) -> list[list[tuple[int, bool]]]:
    """All cycles of two and three links, and of each other link the cycle that it closes with the strongest tree.

    A cycle is its links with whether each is followed backwards.
    """
    of_pair: dict[tuple[int, int], list[int]] = {}
    for k in used:
        of_pair.setdefault((min(links[k].a, links[k].b), max(links[k].a, links[k].b)), []).append(k)
    found: list[list[tuple[int, bool]]] = []
    in_cycle: set[int] = set()

    def leg(k: int, start: int) -> tuple[int, bool]:
        return k, links[k].a != start

    for (a, _), same in of_pair.items():
        for first, second in combinations(same, 2):
            found.append([leg(first, a), (second, links[second].a == a)])
            in_cycle |= {first, second}
    for a, b, c in combinations(range(n), 3):
        for ab in of_pair.get((a, b), []):
            for bc in of_pair.get((b, c), []):
                for ac in of_pair.get((a, c), []):
                    found.append([leg(ab, a), leg(bc, b), leg(ac, c)])
                    in_cycle |= {ab, bc, ac}
    tree, parents = _spanning(n, links, used)
    for k in used:
        if k in tree or k in in_cycle:
            continue
        back = _path(links, parents, links[k].b, links[k].a)
        if back is not None:
            found.append([(k, False), *back])
    return found


def _spanning(n: int, links: Sequence[FrameLink], used: Sequence[int]) -> tuple[set[int], dict[int, tuple[int, int]]]:
    """The links of a spanning forest, the strongest first; and of each fragment its link to its parent, and this."""
    root = list(range(n))

    def top(i: int) -> int:
        while root[i] != i:
            i = root[i]
        return i

    tree: set[int] = set()
    for k in sorted(used, key=lambda k: _rank(links[k]), reverse=True):
        a, b = top(links[k].a), top(links[k].b)
        if a != b:
            root[b] = a
            tree.add(k)
    parents: dict[int, tuple[int, int]] = {}
    seen: set[int] = set()
    for start in range(n):
        if start in seen:
            continue
        seen.add(start)
        waiting = [start]
        for i in waiting:
            for k in sorted(tree):
                for one, other in ((links[k].a, links[k].b), (links[k].b, links[k].a)):
                    if one == i and other not in seen:
                        seen.add(other)
                        parents[other] = (k, i)
                        waiting.append(other)
    return tree, parents


def _path(
    links: Sequence[FrameLink], parents: dict[int, tuple[int, int]], start: int, end: int
) -> list[tuple[int, bool]] | None:
    """The way along the forest from one fragment to another; None if there is none."""

    def upwards(i: int) -> list[int]:
        nodes = [i]
        while nodes[-1] in parents:
            nodes.append(parents[nodes[-1]][1])
        return nodes

    first, second = upwards(start), upwards(end)
    common = next((i for i in first if i in second), None)
    if common is None:
        return None
    up, down = first[: first.index(common)], second[: second.index(common)]
    way = [(parents[i][0], links[parents[i][0]].a != i) for i in up]
    return way + [(parents[i][0], links[parents[i][0]].b != i) for i in reversed(down)]


def _miss(links: Sequence[FrameLink], cycle: Sequence[tuple[int, bool]]) -> str:
    """By how much a cycle does not close, if that is too much; else an empty text."""
    frame, clock = np.zeros(3), 0.0
    for k, backwards in cycle:
        link = links[k]
        frame = compose(frame, inverse(link.frame) if backwards else link.frame)
        if link.source == "sightings":
            clock += -link.offset if backwards else link.offset
    longer = math.sqrt(max(len(cycle), 3) / 3.0)
    distance, angle = math.hypot(frame[0], frame[1]), abs(float(wrap(frame[2])))
    if distance > MAX_DISTANCE * longer or angle > MAX_ANGLE * longer:
        return (
            f"the frames around a cycle of {len(cycle)} links miss by {distance:.2f} m and "
            f"{math.degrees(angle):.0f} degrees"
        )
    if all(links[k].source == "sightings" for k, _ in cycle) and abs(clock) > MAX_CLOCK:
        return f"the clocks around a cycle of {len(cycle)} links disagree by {1000.0 * abs(clock):.0f} ms"
    return ""


def _components(n: int, links: Sequence[FrameLink]) -> list[list[int]]:
    label = list(range(n))
    for link in links:
        a, b = label[link.a], label[link.b]
        label = [min(a, b) if one in (a, b) else one for one in label]
    return [[i for i in range(n) if label[i] == one] for one in sorted(set(label))]


def _solved(members: Sequence[int], links: Sequence[FrameLink], clocks: Floats, tied: Numbers) -> Component:
    """Frames with the least squares over all links between the members, weighted by their support.

    Links by maps have no part where sightings connect the same fragments. A radian counts as a metre: the robots see
    each other at about that distance.

    Args:
        members: The fragments.
        links: All that are used.
        clocks: (fragments,) [s] offsets of all fragments.
        tied: (fragments,) the clocks that are tied to each other have one number.
    """
    place = {member: k for k, member in enumerate(members)}
    inside = [replace(link, a=place[link.a], b=place[link.b]) for link in links if link.a in place]
    n = len(members)
    tree, parents = _spanning(n, inside, range(len(inside)))
    frames = np.zeros((n, 3))
    for i in _outwards(parents):
        k, parent = parents[i]
        link = inside[k]
        step = link.frame if link.b == i else inverse(link.frame)
        frames[i] = compose(frames[parent], step)
    by_sightings = _components(n, [link for link in inside if link.source == "sightings"])
    of = {i: number for number, group in enumerate(by_sightings) for i in group}
    edges = [
        link for k, link in enumerate(inside) if k in tree or link.source == "sightings" or of[link.a] != of[link.b]
    ]
    if len(edges) > len(tree):
        frames, _ = graph.optimise(frames, _graph_edges(edges))
    frames[:, 2] = wrap(frames[:, 2])
    own, labels = clocks[list(members)], tied[list(members)]
    _, first, numbers = np.unique(labels, return_index=True, return_inverse=True)
    order = np.argsort(np.argsort(first))  # numbered as they come
    return Component(tuple(members), frames, own - own[first][numbers], order[numbers])


def _graph_edges(links: Sequence[FrameLink]) -> graph.Edges:
    weights = np.array([max(link.support, 1e-3) for link in links])
    return graph.Edges(
        np.array([link.a for link in links]),
        np.array([link.b for link in links]),
        np.array([link.frame for link in links]),
        weights[:, np.newaxis, np.newaxis] * np.eye(3),
        np.zeros(len(links), np.bool_),
    )


def _outwards(parents: dict[int, tuple[int, int]]) -> list[int]:
    """The fragments that have a parent, each after it."""

    def depth(i: int) -> int:
        return 1 + depth(parents[i][1]) if i in parents else 0

    return sorted(parents, key=depth)


def _clocks(robots: Sequence[int], links: Sequence[FrameLink]) -> tuple[Floats, Numbers]:
    """Offsets [s] of the clocks of fragments with the least squares over sightings; and which are tied to each other.

    Of clocks that are not tied, the offsets say nothing.
    """
    edges = [link for link in links if link.source == "sightings"]
    rows = np.zeros((len(edges), max(robots, default=-1) + 1))
    for k, edge in enumerate(edges):
        rows[k, robots[edge.b]] += 1.0
        rows[k, robots[edge.a]] -= 1.0
    weights = np.sqrt([max(edge.support, 1e-3) for edge in edges])
    offsets = np.zeros(rows.shape[1])
    if edges:
        offsets = np.linalg.lstsq(rows * weights[:, None], weights * [edge.offset for edge in edges], rcond=None)[0]
    between_robots = [replace(edge, a=robots[edge.a], b=robots[edge.b]) for edge in edges]
    tied = np.zeros(rows.shape[1], np.int64)
    for number, group in enumerate(_components(rows.shape[1], between_robots)):
        tied[group] = number
    return offsets[list(robots)], tied[list(robots)]
