"""Normal equations of relative poses, and their product with a vector. Kernels.

All that is known of two keyframes i and j is on the pose `rho` of i in the frame of j. It has an information matrix
(3, 3) and a gradient (3,) of a small motion of i in its own frame. A small motion of j is one of i by the adjoint of
rho's inverse, backwards. So a factor is the same thing whether it comes from points, odometry or a sighting.
"""

import math

import numpy as np
from numpy.typing import NDArray

from mercator_design.arrays import Floats, Numbers
from mercator_design.jit import jittable
from mercator_design.mapping.front.matching import drop_degenerate
from mercator_design.mapping.poses import relative
from mercator_design.mapping.track import Points

N_BINS = 360
"""Number of bins of the bearings of a keyframe's points."""
_MAX_BINS = 10
"""Bins to each side in which a nearest point is searched."""
_AGREEMENT = 0.8
"""Product of the normals of points that match."""


@jittable
def add_point_factors(
    poses: Floats,
    pairs: Numbers,
    points: Points,
    normals: Points,
    first: Numbers,
    bins: NDArray[np.int32],
    most: int,
    gate: float,
    scale: float,
    sigma: float,
    least: float,
    scratch: Floats,
    information: Floats,
    gradients: Floats,
) -> int:
    """Fill in the factors of pairs of keyframes whose points lie on the same walls, and count those that hold.

    Minimised is, over the points p of i and the nearest points q with normals n of j, the sum of
    w (n . (rho p - q))^2 / sigma^2, with the weight of Geman and McClure. Directions that the walls leave open are left
    out: in a round room the noise of the normals would hold them.

    Args:
        poses: (k, 3) of all keyframes.
        pairs: (m, 2) i and j.
        points: (p, 2) of all keyframes, each one's in the order of their bearings.
        normals: (p, 2).
        first: (k + 1,) the first point of each keyframe.
        bins: (k, N_BINS + 1) the first point of each bearing, counted from the keyframe's first one.
        most: So many points of a keyframe are used at most; each then counts more.
        gate: [m] between points that match.
        scale: [m] of residuals, in the weight.
        sigma: [m] standard deviation of a point.
        least: Share of the points that must match.
        scratch: (10, 3).
        information: (m, 3, 3) filled; 0 where too few points match.
        gradients: (m, 3) filled: the negative gradient.
    """
    held = 0
    normal, gradient, part = scratch[:3], scratch[3], scratch[4:10]
    for m in range(len(pairs)):
        i, j = pairs[m, 0], pairs[m, 1]
        x, y, theta = relative(poses[j], poses[i])
        c, s = math.cos(theta), math.sin(theta)
        for a in range(3):
            gradient[a] = 0.0
            for b in range(3):
                normal[a, b] = 0.0
        n = first[i + 1] - first[i]
        stride = max(1, (n + most - 1) // most)
        used, matched = 0, 0
        for k in range(first[i] + m % stride, first[i + 1], stride):
            used += 1
            px, py = points[k, 0], points[k, 1]
            mx, my = c * normals[k, 0] - s * normals[k, 1], s * normals[k, 0] + c * normals[k, 1]
            qx, qy = x + c * px - s * py, y + s * px + c * py
            found = nearest_point(points, normals, first[j], bins, j, qx, qy, mx, my, gate)
            if found < 0:
                continue
            matched += 1
            nx, ny = normals[found, 0], normals[found, 1]
            r = nx * (qx - points[found, 0]) + ny * (qy - points[found, 1])
            w = scale * scale / (scale * scale + r * r)
            w *= w
            ux, uy = c * nx + s * ny, c * ny - s * nx  # the normal in i's frame
            row = (ux, uy, uy * px - ux * py)
            for a in range(3):
                gradient[a] -= w * row[a] * r
                for b in range(3):
                    normal[a, b] += w * row[a] * row[b]
        weight = 0.0
        if used > 0 and matched >= least * used and matched >= 10:
            held += 1
            weight = n / (used * sigma * sigma)
            drop_degenerate(normal, gradient, part)
        for a in range(3):
            gradients[m, a] = weight * gradient[a]
            for b in range(3):
                information[m, a, b] = weight * normal[a, b]
    return held


@jittable
def nearest_point(
    points: Points,
    normals: Points,
    start: int,
    bins: NDArray[np.int32],
    j: int,
    x: float,
    y: float,
    nx: float,
    ny: float,
    gate: float,
) -> int:
    """The nearest point of keyframe j to a place in its frame, within the gate and with a similar normal; -1: none."""
    distance = max(math.hypot(x, y), 1e-6)
    middle = math.floor((math.atan2(y, x) / (2.0 * math.pi) + 0.5) * N_BINS)
    reach = min(_MAX_BINS, 1 + int(gate / distance * N_BINS / (2.0 * math.pi)))
    best, found = gate * gate, -1
    for b in range(middle - reach, middle + reach + 1):
        one = b % N_BINS
        for k in range(start + bins[j, one], start + bins[j, one + 1]):
            dx, dy = points[k, 0] - x, points[k, 1] - y
            away = dx * dx + dy * dy
            if away < best and normals[k, 0] * nx + normals[k, 1] * ny > _AGREEMENT:
                best, found = away, k
    return found


@jittable
def add_motion_factors(
    poses: Floats, pairs: Numbers, motions: Floats, deviations: Floats, information: Floats, gradients: Floats
) -> None:
    """Fill in the factors of measured motions from j to i.

    Args:
        poses: (k, 3)
        pairs: (m, 2) i and j.
        motions: (m, 3) the measured rho.
        deviations: (m, 3) [m, m, rad] their standard deviations.
        information: (m, 3, 3) filled.
        gradients: (m, 3) filled.
    """
    for m in range(len(pairs)):
        error = relative(motions[m], relative(poses[pairs[m, 1]], poses[pairs[m, 0]]))
        for a in range(3):
            weight = 1.0 / (deviations[m, a] * deviations[m, a])
            for b in range(3):
                information[m, a, b] = weight if a == b else 0.0
            gradients[m, a] = -weight * error[a]


@jittable
def add_sighting_factors(
    poses: Floats,
    pairs: Numbers,
    seen: Floats,
    places: Floats,
    sigma: float,
    scale: float,
    information: Floats,
    gradients: Floats,
) -> None:
    """Fill in the factors of heads that i saw where the robot of j was, with the weight of Geman and McClure.

    Args:
        poses: (k, 3)
        pairs: (m, 2) i and j.
        seen: (m, 2) [m] heads in i's frame.
        places: (m, 2) [m] places of the seen robots in j's frame.
        sigma: [m] standard deviation.
        scale: [m] of residuals, in the weight.
        information: (m, 3, 3) filled.
        gradients: (m, 3) filled.
    """
    for m in range(len(pairs)):
        x, y, theta = relative(poses[pairs[m, 1]], poses[pairs[m, 0]])
        c, s = math.cos(theta), math.sin(theta)
        px, py = seen[m, 0], seen[m, 1]
        dx, dy = x + c * px - s * py - places[m, 0], y + s * px + c * py - places[m, 1]
        rx, ry = c * dx + s * dy, c * dy - s * dx  # in i's frame
        w = scale * scale / (scale * scale + rx * rx + ry * ry)
        w *= w / (sigma * sigma)
        information[m, 0, 0], information[m, 0, 1], information[m, 0, 2] = w, 0.0, -w * py
        information[m, 1, 0], information[m, 1, 1], information[m, 1, 2] = 0.0, w, w * px
        information[m, 2, 0], information[m, 2, 1] = -w * py, w * px
        information[m, 2, 2] = w * (px * px + py * py)
        gradients[m, 0], gradients[m, 1], gradients[m, 2] = -w * rx, -w * ry, -w * (px * ry - py * rx)


@jittable
def set_up(
    poses: Floats,
    pairs: Numbers,
    information: Floats,
    gradients: Floats,
    inverses: Floats,
    blocks: Floats,
    right: Floats,
) -> None:
    """Fill in what the method of conjugate gradients needs of all factors.

    Args:
        poses: (k, 3)
        pairs: (m, 2)
        information: (m, 3, 3)
        gradients: (m, 3)
        inverses: (m, 3) filled: the poses of j in i's frame.
        blocks: (k, 3, 3) filled: the diagonal of the matrix.
        right: (k, 3) filled: the right side.
    """
    for k in range(len(poses)):
        for a in range(3):
            right[k, a] = 0.0
            for b in range(3):
                blocks[k, a, b] = 0.0
    for m in range(len(pairs)):
        i, j = pairs[m, 0], pairs[m, 1]
        x, y, theta = relative(poses[i], poses[j])
        inverses[m, 0], inverses[m, 1], inverses[m, 2] = x, y, theta
        c, s = math.cos(theta), math.sin(theta)
        g = (gradients[m, 0], gradients[m, 1], gradients[m, 2])
        back = (c * g[0] + s * g[1], c * g[1] - s * g[0], y * g[0] - x * g[1] + g[2])
        adjoint = ((c, -s, y), (s, c, -x), (0.0, 0.0, 1.0))
        for a in range(3):
            right[i, a] += g[a]
            right[j, a] -= back[a]
            for b in range(3):
                blocks[i, a, b] += information[m, a, b]
                for u in range(3):
                    for v in range(3):
                        blocks[j, a, b] += adjoint[u][a] * information[m, u, v] * adjoint[v][b]


@jittable
def multiply(pairs: Numbers, information: Floats, inverses: Floats, vector: Floats, product: Floats) -> None:
    """Fill in the product of the matrix of all factors with a vector (k, 3); arguments are those of `set_up`."""
    for k in range(len(vector)):
        for a in range(3):
            product[k, a] = 0.0
    for m in range(len(pairs)):
        i, j = pairs[m, 0], pairs[m, 1]
        x, y, theta = inverses[m, 0], inverses[m, 1], inverses[m, 2]
        c, s = math.cos(theta), math.sin(theta)
        turned = vector[j, 2]
        dx = vector[i, 0] - (c * vector[j, 0] - s * vector[j, 1] + y * turned)
        dy = vector[i, 1] - (s * vector[j, 0] + c * vector[j, 1] - x * turned)
        dt = vector[i, 2] - turned
        fx = information[m, 0, 0] * dx + information[m, 0, 1] * dy + information[m, 0, 2] * dt
        fy = information[m, 1, 0] * dx + information[m, 1, 1] * dy + information[m, 1, 2] * dt
        ft = information[m, 2, 0] * dx + information[m, 2, 1] * dy + information[m, 2, 2] * dt
        product[i, 0] += fx
        product[i, 1] += fy
        product[i, 2] += ft
        product[j, 0] -= c * fx + s * fy
        product[j, 1] -= c * fy - s * fx
        product[j, 2] -= y * fx - x * fy + ft


@jittable
def invert_blocks(blocks: Floats) -> None:
    """Replace symmetric matrices (k, 3, 3) by their inverses; those that are nearly singular get a small diagonal."""
    for k in range(len(blocks)):
        one = blocks[k]
        extra = 1e-12 + 1e-9 * (one[0, 0] + one[1, 1] + one[2, 2])
        a, b, c = one[0, 0] + extra, one[0, 1], one[0, 2]
        d, e, f = one[1, 1] + extra, one[1, 2], one[2, 2] + extra
        u, v, w = d * f - e * e, c * e - b * f, b * e - c * d
        determinant = a * u + b * v + c * w
        one[0, 0], one[0, 1], one[0, 2] = u / determinant, v / determinant, w / determinant
        one[1, 0], one[1, 1], one[1, 2] = one[0, 1], (a * f - c * c) / determinant, (b * c - a * e) / determinant
        one[2, 0], one[2, 1], one[2, 2] = one[0, 2], one[1, 2], (a * d - b * b) / determinant


@jittable
def apply_blocks(blocks: Floats, vector: Floats, product: Floats) -> None:
    """Fill in the products of matrices (k, 3, 3) with the rows of a vector (k, 3); the first row is held at 0."""
    for k in range(len(vector)):
        for a in range(3):
            product[k, a] = (
                blocks[k, a, 0] * vector[k, 0] + blocks[k, a, 1] * vector[k, 1] + blocks[k, a, 2] * vector[k, 2]
            )
    for a in range(3):
        product[0, a] = 0.0
