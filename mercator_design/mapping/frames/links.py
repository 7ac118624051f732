"""Links between fragments: how one frame stands in another, on what evidence, and whether that is enough.

A wrong frame ruins a map, a missing one only leaves two maps. So a link needs several independent reasons.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from mercator_design.arrays import Floats
from mercator_design.mapping.frames.evidence import Evidence, evidence
from mercator_design.mapping.frames.fragment import Fragment
from mercator_design.mapping.frames.voting import DISTINCT, FrameFit, candidates, pairs_of, refined
from mercator_design.mapping.poses import differ

MIN_VOTES = 30
MIN_SHARE = 0.85
MAX_SECOND = 0.5
"""Ratio of the second distinct frame's votes, times its share of hits, to those of the first."""
MIN_SPREAD = 0.5
"""[m] Of the sightings that agree: a robot that stands leaves the rotation open."""
MIN_DISTINCT = 15
"""Different places of both robots in the sightings that agree; those of robots that stand are one."""
MIN_HITS = 20

_SCAN_STEP = 0.5
"""[s] Between offsets of the clocks that are tried; the refinement reaches half of it."""
_SCANNED = 1500
"""Sightings of each robot that are used for these."""
_FEW_VOTES = 8
_REFINED = 8
"""Candidates that are refined."""
_REFINED_OF_OFFSET = 2
"""The same for each offset that is tried."""
_WEAK = 0.2
"""Share of the most votes, below which a frame is no rival."""
_EXAMINED = 6
"""Refined frames whose contradictions are counted."""


@dataclass(frozen=True)
class FrameLink:
    """How the frame of fragment b stands in that of fragment a."""

    a: int
    b: int
    frame: Floats  # (3,) of b in a
    source: Literal["sightings", "maps", "overlap", "start"]
    support: float  # the greater, the more evidence; comparable within a source
    offset: float = 0.0  # [s] b's clock less a's
    votes: int = 0  # sightings that agree
    second: float = 0.0  # the second frame's votes (or peak) over the first one's
    evidence: Evidence = Evidence(0, 0)
    residual: float = math.inf  # [m] rms of the sightings that agree
    spread: float = 0.0  # [m]
    distinct: int = 0
    refusal: str = ""  # why it is not used; empty: it is

    @property
    def is_accepted(self) -> bool:
        return not self.refusal

    def refused(self, reason: str) -> "FrameLink":
        return replace(self, refusal=reason)


def link_by_sightings(a: int, b: int, parts: Sequence[Fragment], clock_search: float) -> FrameLink | None:
    """The best frame of two fragments by sightings, accepted or refused; None if hardly any sightings agree on one.

    Args:
        a: The number of the first fragment.
        b: That of the second one.
        parts: The fragments.
        clock_search: [s] The offset of the clocks is searched between this and its negative; 0: they are the same.
    """
    first, second = parts[a], parts[b]
    if first.start - clock_search > second.end or second.start - clock_search > first.end:
        return None
    fits = _fits(first, second, 0.0, with_clock=clock_search > 0.0)
    link = _best(a, b, parts, fits)
    if clock_search > 0.0 and not (link and link.is_accepted and abs(link.offset) < 0.5 * _SCAN_STEP):
        steps = math.ceil(clock_search / _SCAN_STEP)
        thin_a, thin_b = _thinned(first), _thinned(second)
        scanned = [
            fit
            for k in range(-steps, steps + 1)
            for fit in _fits(thin_a, thin_b, k * _SCAN_STEP, with_clock=True, most=_REFINED_OF_OFFSET)
        ]
        again = [
            refined(first, second, fit.frame, fit.offset, with_clock=True) for fit in _distinct_fits(scanned)[:_REFINED]
        ]
        link = _best(a, b, parts, _distinct_fits([*fits, *again]))
    return link


def _best(a: int, b: int, parts: Sequence[Fragment], fits: list[FrameFit]) -> FrameLink | None:
    fits = [fit for fit in fits if fit.votes >= _FEW_VOTES]
    if not fits:
        return None
    strong = [fit for fit in fits if fit.votes >= _WEAK * fits[0].votes][:_EXAMINED]
    examined = [(fit, evidence(parts[a], parts[b], fit.frame, fit.offset)) for fit in strong]
    examined.sort(key=lambda one: -one[0].votes * one[1].share)
    fit, seen = examined[0]
    weight = fit.votes * seen.share
    others = [one.votes * beside.share for one, beside in examined[1:]]
    second = max(others, default=0.0) / max(weight, 1e-9)
    link = FrameLink(
        a,
        b,
        fit.frame,
        "sightings",
        weight,
        fit.offset,
        fit.votes,
        second,
        seen,
        fit.residual,
        fit.spread,
        fit.distinct,
    )
    return link.refused(_refusal(link))


def _refusal(link: FrameLink) -> str:
    """Why a link by sightings is not enough; empty if it is."""
    if link.votes < MIN_VOTES:
        return f"only {link.votes} sightings agree, expected {MIN_VOTES}"
    if link.evidence.hits < MIN_HITS:
        return f"the lidars looked at the other robot in only {link.evidence.hits} turns, expected {MIN_HITS}"
    if link.evidence.share < MIN_SHARE:
        return f"in {1.0 - link.evidence.share:.0%} of the turns the other robot is not where it should be"
    if link.second > MAX_SECOND:
        return f"a second frame has {link.second:.0%} of the votes"
    if link.spread < MIN_SPREAD:
        return f"the sightings that agree spread over {link.spread:.2f} m, which leaves the heading open"
    if link.distinct < MIN_DISTINCT:
        return f"the sightings that agree are of {link.distinct} different places, expected {MIN_DISTINCT}"
    return ""


def _fits(a: Fragment, b: Fragment, offset: float, *, with_clock: bool, most: int = _REFINED) -> list[FrameFit]:
    """Distinct refined frames, those with the most votes first."""
    raw = [one for one in candidates(pairs_of(a, b, offset), most) if one[1] >= 3]
    return _distinct_fits([refined(a, b, frame, offset, with_clock=with_clock) for frame, _ in raw])


def _distinct_fits(fits: list[FrameFit]) -> list[FrameFit]:
    """The fits without those that another one contains.

    Of frames that are not distinct the one with the least residual stays, if it has 90 % of the votes: with an offset
    of the clocks that is wrong by 0.25 s, as many pairs are near.
    """
    found: list[FrameFit] = []
    for fit in sorted(fits, key=lambda one: -one.votes):
        same = [k for k, other in enumerate(found) if not differ(fit.frame, other.frame, DISTINCT)]
        if not same:
            found.append(fit)
        elif fit.votes >= 0.9 * found[same[0]].votes and fit.residual < found[same[0]].residual:
            found[same[0]] = fit
    return found


def _thinned(fragment: Fragment) -> Fragment:
    n = len(fragment.sightings.times)
    if n <= _SCANNED:
        return fragment
    return fragment.with_sightings(np.linspace(0, n - 1, _SCANNED).astype(np.int64))
