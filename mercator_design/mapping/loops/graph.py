"""A pose graph: poses that agree best with measured motions between them, some of which may be wrong.

Edges that may be wrong get the weights of Geman and McClure by graduated non-convexity (Yang et al., 2020): the cost
begins convex, and becomes the robust one while the poses follow.
"""

from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse import linalg

from mercator_design.arrays import Flags, Floats, Numbers
from mercator_design.mapping import poses

CHI_SQUARE = 11.3
"""The squared error that a right edge exceeds once in a hundred times: chi-square with 3 degrees of freedom."""

_USUAL_STEP = 0.67, 0.38  # [m], [rad] between scans of logs with few of them
_STEPS = 3  # of Gauss and Newton, at each degree of convexity
_FIRST_STEPS = 5
_LAST_ROUNDS = 30  # of weights and steps when the cost is the robust one, at most
_SETTLED_WEIGHT = 1e-4
_SETTLED = 1e-6  # [m, rad]


class Edges(NamedTuple):
    """Measured motions."""

    starts: Numbers  # (e,) poses from which
    ends: Numbers  # (e,) poses to which
    motions: Floats  # (e, 3) the end's pose relative to the start's
    information: Floats  # (e, 3, 3) inverse covariances of these
    may_be_wrong: Flags  # (e,)

    def __add__(self, other: "Edges") -> "Edges":  # type: ignore[override]
        return Edges(*(np.concatenate(both) for both in zip(self, other, strict=True)))


def chain(found: Floats, place: float = 0.03, heading: float = 0.0087) -> Edges:
    """Edges between consecutive poses (n, 3).

    Args:
        found: The poses.
        place: [m] standard deviation of a motion of `_USUAL_STEP`; that of others grows with the root of their length.
        heading: [rad] likewise.
    """
    starts, motions = np.arange(len(found) - 1), poses.between(found[:-1], found[1:])
    far, turned = np.hypot(motions[:, 0], motions[:, 1]), np.abs(motions[:, 2])
    share = np.clip(np.maximum(far / _USUAL_STEP[0], turned / _USUAL_STEP[1]), 0.02, 1.0)
    information = np.diag([place**-2, place**-2, heading**-2]) / share[:, np.newaxis, np.newaxis]
    return Edges(starts, starts + 1, motions, information, np.zeros(len(starts), bool))


def ways(found: Floats, numbers: Numbers) -> Edges:
    """Edges between the consecutive poses (n, 3) of each way, which are numbered (n,) in rising order.

    Weak ones hold a way at the one before it, as the poses stand.
    """
    edges = chain(found)
    is_between = numbers[1:] != numbers[:-1]
    edges.information[is_between] = np.diag([1.0, 1.0, 25.0])
    return edges


def errors(found: Floats, edges: Edges) -> Floats:
    """Errors (e, 3) of the edges: the motion between two poses less the measured one."""
    left = poses.between(found[edges.starts], found[edges.ends]) - edges.motions
    left[:, 2] = poses.wrap(left[:, 2])
    return left


def squared_errors(found: Floats, edges: Edges) -> Floats:
    """Squared errors (e,) in units of their variance."""
    left = errors(found, edges)
    return np.asarray(np.einsum("ei,eij,ej->e", left, edges.information, left))


def jacobians(found: Floats, edges: Edges) -> tuple[Floats, Floats]:
    """Derivatives (e, 3, 3) of the errors by the start's and by the end's pose."""
    start, end = found[edges.starts], found[edges.ends]
    c, s = np.cos(start[:, 2]), np.sin(start[:, 2])
    x, y = (end - start)[:, 0], (end - start)[:, 1]
    zero, one = np.zeros_like(c), np.ones_like(c)
    by_start = [[-c, -s, c * y - s * x], [s, -c, -s * y - c * x], [zero, zero, -one]]
    by_end = [[c, s, zero], [-s, c, zero], [zero, zero, one]]
    return np.moveaxis(np.array(by_start), 2, 0), np.moveaxis(np.array(by_end), 2, 0)


def optimise(found: Floats, edges: Edges) -> tuple[Floats, Floats]:
    """The poses (n, 3) that agree best with the edges, and the weights (e,) of these, from 0 to 1.

    The first pose is fixed. Every pose must hang on the others by edges that are right.
    """
    weights = np.ones(len(edges.starts))
    found, doubtful = _relaxed(found, edges, weights, _FIRST_STEPS), edges.may_be_wrong
    if not doubtful.any():
        return found, weights
    convexity = max(2.0 * float(squared_errors(found, edges)[doubtful].max()) / CHI_SQUARE, 1.0)
    rounds = 0
    while rounds < _LAST_ROUNDS:
        limit, before = convexity * CHI_SQUARE, weights.copy()
        weights[doubtful] = (limit / (limit + squared_errors(found, edges)[doubtful])) ** 2
        found = _relaxed(found, edges, weights, _STEPS)
        if convexity == 1.0:
            rounds += 1
            if np.abs(weights - before).max() < _SETTLED_WEIGHT:
                break
        convexity = max(convexity / 2.0, 1.0)
    return found, weights


def _relaxed(found: Floats, edges: Edges, weights: Floats, steps: int) -> Floats:
    """The poses after some steps of Gauss and Newton."""
    found, n = found.copy(), len(found)
    if n < 2:
        return found
    sides = np.array([edges.starts, edges.ends])
    block = np.arange(3)
    rows = (3 * sides[:, np.newaxis, :, np.newaxis, np.newaxis] + block[:, np.newaxis]).repeat(2, axis=1)
    columns = (3 * sides[np.newaxis, :, :, np.newaxis, np.newaxis] + block).repeat(2, axis=0)
    rows, columns = np.broadcast_arrays(rows, columns)
    for _ in range(steps):
        left, slopes = errors(found, edges), np.array(jacobians(found, edges))
        weighted = weights[:, np.newaxis, np.newaxis] * edges.information
        blocks = np.einsum("aeki,ekl,belj->abeij", slopes, weighted, slopes, optimize=True)
        right = np.zeros((n, 3))
        for side, slope in zip(sides, slopes, strict=True):
            np.add.at(right, side, -np.einsum("eki,ekl,el->ei", slope, weighted, left, optimize=True))
        matrix = sparse.csc_matrix((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=(3 * n, 3 * n))
        step = linalg.splu(matrix[3:, 3:].tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve(
            right.ravel()[3:]
        )
        found[1:] += step.reshape(-1, 3)
        if np.abs(step).max() < _SETTLED:
            break
    return found
