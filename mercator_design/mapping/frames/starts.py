"""Given starts: which of them agree with what was seen, and the links that these make.

A start that somebody typed may be wrong, and which one of two that disagree nobody knows. So of the starts of robots
that sightings connect only those count that most of these agree on; and of starts of robots that never met, none whose
walls would stand where the beams of another one went.
"""

from collections.abc import Callable, Sequence
from itertools import combinations
from typing import NamedTuple

from mercator_design.arrays import Floats
from mercator_design.mapping.frames.consistency import MAX_ANGLE, MAX_DISTANCE, Component
from mercator_design.mapping.frames.fragment import Fragment
from mercator_design.mapping.frames.links import FrameLink
from mercator_design.mapping.poses import between, compose, differ, inverse


class Starts(NamedTuple):
    """The starts that are used."""

    links: tuple[FrameLink, ...]  # between fragments with given starts, also those that are refused
    used: frozenset[int]  # the fragments whose starts count


def starts_of(
    parts: Sequence[Fragment], components: Sequence[Component], checked: Callable[[FrameLink], FrameLink]
) -> Starts:
    """The given starts of robots that agree with what was seen.

    Args:
        parts: The fragments.
        components: How sightings connect them.
        checked: A link, refused if walls speak against it.
    """
    frames = {
        number: compose(part.track.log.start, inverse(part.beginning))
        for number, part in enumerate(parts)
        if part.track.log.start is not None and len(part.turns) and part.turns[0] == 0
    }
    refused: list[FrameLink] = []
    sides: list[list[int]] = []  # of each component with starts, those that its sightings agree with
    for component in components:
        agreed, against = _agreed(frames, component)
        sides += [agreed] if agreed else []
        refused += against

    def link(a: int, b: int) -> FrameLink:
        return FrameLink(a, b, between(frames[a], frames[b]), "start", 1.0)

    links = {(one[0], other[0]): checked(link(one[0], other[0])) for one, other in combinations(sides, 2)}
    left = [one[0] for one in sides]
    while wrong := [pair for pair, one in links.items() if not one.is_accepted and set(pair) <= set(left)]:
        blame = {k: sum(k in pair for pair in wrong) for k in left}
        most = max(blame.values())
        refused += [links[pair] for pair in wrong if any(blame[k] == most for k in pair)]
        left = [k for k in left if blame[k] < most]
    used = frozenset(k for one in sides if one[0] in left for k in one)
    return Starts((*(links[left[0], k] for k in left[1:]), *refused), used)


def _agreed(frames: dict[int, Floats], component: Component) -> tuple[list[int], list[FrameLink]]:
    """The members whose starts most of the given ones agree on; and links of the others, refused."""
    own = {member: at for member, at in zip(component.members, component.frames, strict=True) if member in frames}
    limits = MAX_DISTANCE, MAX_ANGLE

    def agree(a: int, b: int) -> bool:
        return not differ(between(frames[a], frames[b]), between(own[a], own[b]), limits)

    best = max(([b for b in own if agree(a, b)] for a in own), key=len, default=[])
    if 2 * len(best) <= len(own):
        best = []
    wrong = [k for k in own if k not in best]
    against = []
    for k in wrong:
        other = best[0] if best else next(one for one in wrong if one != k)
        a, b = min(k, other), max(k, other)
        seen, given = between(own[a], own[b]), between(frames[a], frames[b])
        away = between(seen, given)
        reason = f"by sightings the other one is {float((away[0] ** 2 + away[1] ** 2) ** 0.5):.2f} m from there"
        against.append(FrameLink(a, b, given, "start", 1.0, refusal=reason))
    unique = {(one.a, one.b): one for one in against}
    return best, list(unique.values())
