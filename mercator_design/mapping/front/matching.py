"""Point-to-line ICP of a turn against a map of surfels, with the odometry as a prior.

Minimises sum w (n . (T p - q))^2 / sigma^2 + (T - T0)' P (T - T0) over the pose T and the bend: how far the robot
turned more during the turn of the lidar than its odometry says, which moves a point by its age. `w` is the weight of
Geman and McClure. What walls leave undetermined (along a corridor, around the centre of a circle) is left to the prior.
"""

import math
from typing import NamedTuple

import numpy as np

from mercator_design.arrays import Floats
from mercator_design.jit import compiled, jittable
from mercator_design.mapping.front.scans import Scan
from mercator_design.mapping.front.surfels import SurfelGrid, SurfelMap, nearest

_AGREEMENT = 0.8  # product of the normals of a point and a surfel that match
_SMALL = 1e-4  # [m, rad] of a step after which another one would change nothing
_DEGENERATE = 0.005  # of the largest eigenvalue: walls do not determine such a direction
_SWEEPS = 12  # of Jacobi's rotations, at most


class MatchSearch(NamedTuple):
    """How ICP searches, from the first to the last iteration."""

    iterations: int = 15  # at most
    first_reach: float = 0.25  # [m] of a point to its surfel
    last_reach: float = 0.08  # [m]
    first_scale: float = 0.10  # [m] of residuals, in the weight
    last_scale: float = 0.02  # [m]
    sigma: float = 0.02  # [m] standard deviation of a point
    bend: float = 0.02  # [rad] standard deviation of the bend; 0: it stays 0


class Match(NamedTuple):
    """A turn that was matched."""

    pose: Floats  # (3,)
    bend: float  # [rad]
    share: float  # of the points that have a surfel in the last iteration
    residual: float  # [m] rms of these points' distances
    information: Floats  # (3, 3) of the points about the pose, degenerate directions left out; without the prior
    ratio: float  # smallest / largest eigenvalue of the information on the place


@jittable
def diagonalise(a: Floats, vectors: Floats) -> None:
    """Make a symmetric matrix (3, 3) diagonal in place, by Jacobi's rotations; `vectors` gets columns: eigenvectors."""
    for i in range(3):
        for j in range(3):
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(_SWEEPS):
        if abs(a[0, 1]) + abs(a[0, 2]) + abs(a[1, 2]) <= 1e-13 * (abs(a[0, 0]) + abs(a[1, 1]) + abs(a[2, 2])):
            return
        for p in range(2):
            for q in range(p + 1, 3):
                if a[p, q] == 0.0:
                    continue
                angle = 0.5 * math.atan2(2.0 * a[p, q], a[q, q] - a[p, p])
                c, s = math.cos(angle), math.sin(angle)
                for k in range(3):
                    x, y = a[k, p], a[k, q]
                    a[k, p], a[k, q] = c * x - s * y, s * x + c * y
                for k in range(3):
                    x, y = a[p, k], a[q, k]
                    a[p, k], a[q, k] = c * x - s * y, s * x + c * y
                    x, y = vectors[k, p], vectors[k, q]
                    vectors[k, p], vectors[k, q] = c * x - s * y, s * x + c * y


@jittable
def drop_degenerate(normal: Floats, gradient: Floats, scratch: Floats) -> None:
    """Remove the directions that points do not determine from their normal equations.

    A direction is an eigenvector of the upper left (3, 3) part, in metres and radians about the robot.

    Args:
        normal: (n, n), n >= 3, the matrix of the equations; changed.
        gradient: (n,) their right side; changed.
        scratch: (6, 3).
    """
    a, vectors = scratch[:3], scratch[3:]
    for i in range(3):
        for j in range(3):
            a[i, j] = normal[i, j]
    diagonalise(a, vectors)
    largest = max(a[0, 0], a[1, 1], a[2, 2])
    n = len(gradient)
    for which in range(3):
        if a[which, which] >= _DEGENERATE * largest:
            continue
        along = 0.0
        for i in range(3):
            along += vectors[i, which] * gradient[i]
        for i in range(3):
            gradient[i] -= along * vectors[i, which]
        for j in range(n):  # project columns, then rows
            along = 0.0
            for i in range(3):
                along += vectors[i, which] * normal[i, j]
            for i in range(3):
                normal[i, j] -= along * vectors[i, which]
        for j in range(n):
            along = 0.0
            for i in range(3):
                along += vectors[i, which] * normal[j, i]
            for i in range(3):
                normal[j, i] -= along * vectors[i, which]


@jittable
def solve(a: Floats, b: Floats) -> None:
    """Solve a x = b by Cholesky's method for a positive definite matrix (n, n); both are overwritten, x is in b."""
    n = len(b)
    for j in range(n):
        for k in range(j):
            a[j, j] -= a[j, k] * a[j, k]
        a[j, j] = math.sqrt(max(a[j, j], 1e-300))
        for i in range(j + 1, n):
            for k in range(j):
                a[i, j] -= a[i, k] * a[j, k]
            a[i, j] /= a[j, j]
    for i in range(n):
        for k in range(i):
            b[i] -= a[i, k] * b[k]
        b[i] /= a[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            b[i] -= a[k, i] * b[k]
        b[i] /= a[i, i]


@jittable
def add_points(
    grid: SurfelGrid,
    state: Floats,
    points: Floats,
    normals: Floats,
    ages: Floats,
    reach: float,
    scale: float,
    normal: Floats,
    gradient: Floats,
) -> tuple[int, float]:
    """Add the normal equations of a turn's points, in units of their variance.

    Args:
        grid: The map.
        state: (4,) pose [m, m, rad] and bend [rad].
        points: (n, 2) [m] in the robot's frame.
        normals: (n, 2).
        ages: (n,) the points' times in the turn, -0.5 to 0.5.
        reach: [m] of a point to its surfel.
        scale: [m] of residuals, in the weight.
        normal: (4, 4) to which the matrix is added.
        gradient: (4,) to which the right side is added.

    Returns:
        How many points have a surfel, and the sum of their squared distances [m^2].
    """
    matched, total = 0, 0.0
    square = scale * scale
    for k in range(len(points)):
        theta = state[2] + state[3] * ages[k]
        c, s = math.cos(theta), math.sin(theta)
        ax, ay = c * points[k, 0] - s * points[k, 1], s * points[k, 0] + c * points[k, 1]
        mx, my = c * normals[k, 0] - s * normals[k, 1], s * normals[k, 0] + c * normals[k, 1]
        found = nearest(grid, state[0] + ax, state[1] + ay, mx, my, reach, _AGREEMENT)
        if found < 0:
            continue
        nx, ny = grid.rows[found, 2], grid.rows[found, 3]
        r = nx * (state[0] + ax - grid.rows[found, 0]) + ny * (state[1] + ay - grid.rows[found, 1])
        matched, total = matched + 1, total + r * r
        w = square / (square + r * r)
        w *= w
        turning = ny * ax - nx * ay
        row = (nx, ny, turning, turning * ages[k])
        for i in range(4):
            gradient[i] -= w * row[i] * r
            for j in range(4):
                normal[i, j] += w * row[i] * row[j]
    return matched, total


@jittable
def match_points(
    grid: SurfelGrid,
    predicted: Floats,
    deviations: Floats,
    search: MatchSearch,
    points: Floats,
    normals: Floats,
    ages: Floats,
    state: Floats,
    scratch: Floats,
    found: Floats,
) -> None:
    """Match a turn.

    Args:
        grid: The map.
        predicted: (3,) pose.
        deviations: (3,) [m, m, rad] standard deviations of the prediction.
        search: How to search.
        points: (n, 2) [m] in the robot's frame.
        normals: (n, 2).
        ages: (n,) the points' times in the turn.
        state: (4,) receives the pose and the bend; begins with the prediction.
        scratch: (15, 4).
        found: (13,) receives share, residual [m], ratio of eigenvalues, iterations, and the information (3, 3).
    """
    normal, gradient, square, part = scratch[:4], scratch[4], scratch[5:9], scratch[9:15, :3]
    for i in range(3):
        state[i] = predicted[i]
    state[3] = 0.0
    variance = search.sigma * search.sigma
    for iteration in range(search.iterations):
        done = iteration / max(search.iterations - 1, 1)
        reach = search.first_reach * (search.last_reach / search.first_reach) ** done
        scale = search.first_scale * (search.last_scale / search.first_scale) ** done
        for i in range(4):
            gradient[i] = 0.0
            for j in range(4):
                normal[i, j] = 0.0
        matched, total = add_points(grid, state, points, normals, ages, reach, scale, normal, gradient)
        for i in range(4):
            gradient[i] /= variance
            for j in range(4):
                normal[i, j] /= variance
        mean, spread = (
            0.5 * (normal[0, 0] + normal[1, 1]),
            math.hypot(0.5 * (normal[0, 0] - normal[1, 1]), normal[0, 1]),
        )
        drop_degenerate(normal, gradient, part)
        found[0], found[1] = matched / max(len(points), 1), math.sqrt(total / max(matched, 1))
        found[2], found[3] = max(mean - spread, 0.0) / max(mean + spread, 1e-300), iteration + 1
        for i in range(3):
            for j in range(3):
                found[4 + 3 * i + j] = normal[i, j]
        for i in range(4):
            for j in range(4):
                square[i, j] = normal[i, j]
        for i in range(3):
            weight = 1.0 / (deviations[i] * deviations[i])
            square[i, i] += weight
            gradient[i] += weight * (predicted[i] - state[i])
        weight = 1.0 / max(search.bend * search.bend, 1e-18)
        square[3, 3] += weight
        gradient[3] -= weight * state[3]
        solve(square, gradient)
        for i in range(4):
            state[i] += gradient[i]
        if math.hypot(gradient[0], gradient[1]) < _SMALL and abs(gradient[2]) < _SMALL:
            break


class Matcher:
    """Matches turns against maps, in scratch of its own."""

    def __init__(self) -> None:
        self._state, self._scratch, self._found = np.zeros(4), np.zeros((15, 4)), np.zeros(13)

    def match(
        self, surfels: SurfelMap, predicted: Floats, deviations: Floats, scan: Scan, search: MatchSearch
    ) -> Match:
        """Match a prepared turn; `deviations` (3,) [m, m, rad] are those of the predicted pose."""
        return self.match_points(surfels, predicted, deviations, (scan.points, scan.normals, scan.ages), search)

    def match_points(
        self,
        surfels: SurfelMap,
        predicted: Floats,
        deviations: Floats,
        points: tuple[Floats, Floats, Floats],
        search: MatchSearch,
    ) -> Match:
        """As `match`; `points` are points, normals and ages."""
        state, found = self._state, self._found
        compiled(match_points)(surfels.grid, predicted, deviations, search, *points, state, self._scratch, found)
        share, residual, ratio = found[:3].tolist()
        return Match(state[:3].copy(), float(state[3]), share, residual, found[4:].reshape(3, 3).copy(), ratio)
