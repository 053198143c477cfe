"""Gradients with respect to the posed mesh, for those who fine-tune the head: surfels -> motion rows -> vertices.

Only then are they computed.  One surfel, one triangle at a time, sums in float64 and in a fixed order: the result does
not depend on the number of threads.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from jaxtyping import Float

from carigs.simd import matrix3
from carigs.simd.kernels import kernel, parallel_for
from carigs.simd.vector_math import exp
from carigs.simd.vectors import scalar_or_simd
from carigs.splat.rig.face_motion import (
    CENTRE,
    ROTATION,
    STRETCH,
    TURN,
    FaceMotion,
    read3,
    read4,
    read9,
    read_blend,
)
from carigs.splat.rig.jacobian_blend import (
    direction_gradient,
    disc_axes,
    pulled_back,
    stretch_gradient,
    torque_of,
    turn_gradient,
    view_direction,
)
from carigs.splat.rig.rig import Rig, polar_motion, rows_of


def differentiable_face_motion(rig: Rig, posed: Float[torch.Tensor, "v 3"]) -> FaceMotion:
    """`rig.face_motion` with rows that are differentiable with respect to the float64 vertices.

    Triangles without area, which follow their neighbours, pass the gradient of their centre alone.
    """
    return FaceMotion(_Motion.apply(posed, rig))


class _Motion(torch.autograd.Function):
    @staticmethod
    def forward(ctx, posed, rig):
        vertices = np.ascontiguousarray(posed.detach().numpy())
        centre, rotation, stretch, sound = polar_motion(rig, vertices)
        ctx.kept = rig, vertices, rotation, stretch, sound
        return torch.from_numpy(rows_of(rig, centre, rotation, stretch, np.float32))

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, g_rows):
        rig, *kept = ctx.kept
        gradient = vertices_gradient(g_rows.double().contiguous().numpy(), rig, *kept)
        return torch.from_numpy(gradient), None


@scalar_or_simd
def _of_one(
    i, position, quaternion, log_scale, blend, binding, frame_rows, neighbours, rows, blended, eye, turning,
    centre, g_centre, g_u, g_v, g_direction, weights, parts,
):  # fmt: skip
    """What surfel i adds to its face's columns (`weights` times the stretch and turns), in their order."""
    _faces, _t, _shares, _g, v, w, p, (a, b, c), q = read_blend(i, blend, binding, neighbours, rows, blended)
    first, second, unit, length = disc_axes(read4(quaternion, i))
    gx, gu, gv = read3(g_centre, i), read3(g_u, i), read3(g_v, i)
    twist, view, gd = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    if len(g_direction) > 0:
        gd = read3(g_direction, i)
        view, near, d = view_direction(q, read3(centre, i), eye, turning)
        more, twist = direction_gradient(q, view, near, d, gd, turning)
        gx = (gx[0] + more[0], gx[1] + more[1], gx[2] + more[2])
    still = True
    for k in range(3):
        still &= g_centre[i, k] == 0 and gu[k] == 0 and gv[k] == 0 and gd[k] == 0
    if still:
        return
    _dx, _dq, _ds, h, y = pulled_back(
        q, p, read9(frame_rows, binding[i], 0), first, second, unit, length, exp(log_scale[i, 0]),
        exp(log_scale[i, 1]), gx, gu, gv, read3(position, i),
    )  # fmt: skip
    torque = torque_of(p, h, y)
    dw = turn_gradient(w, b, c, (torque[0] + twist[0], torque[1] + twist[1], torque[2] + twist[2]))
    dp = stretch_gradient(h, y)
    # Of the matrix Q = U exp(w), by its use: Q P y for three y, and Q^T n.
    e = matrix3.product_exp(matrix3.IDENTITY, w, a, b)
    x0, x1, x2 = (
        matrix3.apply_symmetric(p, y[0]), matrix3.apply_symmetric(p, y[1]), matrix3.apply_symmetric(p, y[2]),
    )  # fmt: skip
    g0, g1, g2 = matrix3.apply(q, h[0]), matrix3.apply(q, h[1]), matrix3.apply(q, h[2])
    for r in range(3):
        n = view[r] if turning else 0.0
        dq = (
            g0[r] * x0[0] + g1[r] * x1[0] + g2[r] * x2[0] + n * gd[0],
            g0[r] * x0[1] + g1[r] * x1[1] + g2[r] * x2[1] + n * gd[1],
            g0[r] * x0[2] + g1[r] * x1[2] + g2[r] * x2[2] + n * gd[2],
        )
        du = matrix3.apply(e, dq)
        for k in range(3):
            parts[i, ROTATION + 3 * r + k] = du[k]
    for k in range(6):
        parts[i, STRETCH + k] = dp[k]
    for k in range(3):
        parts[i, CENTRE + k], parts[i, TURN + k] = gx[k], dw[k]
    for k in range(4):
        weights[i, k] = v[k]


@kernel
def rows_gradient(
    position, quaternion, log_scale, logit, blend, binding, frame_rows, neighbours, rows, blended, eye, turning,
    centre, g_centre, g_u, g_v, g_opacity, g_direction,
):  # fmt: skip
    """Of the motion rows, from the gradients of what `skinning.skin_each` wrote."""
    n = len(binding)
    weights, parts = np.zeros((n, 4)), np.zeros((n, TURN + 3))
    parallel_for(
        _of_one, n,
        (position, quaternion, log_scale, blend, binding, frame_rows, neighbours, rows, blended, eye, turning,
         centre, g_centre, g_u, g_v, g_direction, weights, parts),
    )  # fmt: skip
    total = np.zeros(rows.shape)
    for i in range(n):
        f = binding[i]
        for k in range(6):
            total[f, STRETCH + k] += weights[i, 0] * parts[i, STRETCH + k]
        for k in range(CENTRE, TURN):
            total[f, k] += parts[i, k]
        for s in range(3):
            other, share = neighbours[f, s], weights[i, 1 + s]
            for k in range(6):
                total[other, STRETCH + k] += share * parts[i, STRETCH + k]
            for k in range(3):
                total[f, TURN + 3 * s + k] += share * parts[i, TURN + k]
    return total


@scalar_or_simd
def _logarithm_gradient(rho, g):
    """G J^-1(rho): with log(exp(d) R) = rho + J^-1(rho) d, J the left Jacobian of SO(3) (Sola et al. 2018, eq. 146)."""
    square = matrix3.dot(rho, rho)
    c = 1 / 12 + square / 720
    if square > 1e-4:
        angle = math.sqrt(square)
        # (1 + cos)/sin = cot(angle / 2), which does not lose its digits near pi.
        c = 1 / square - 1 / (2 * angle * math.tan(0.5 * angle))
    once = matrix3.cross(rho, g)
    twice = matrix3.cross(rho, once)
    return (
        g[0] + 0.5 * once[0] + c * twice[0], g[1] + 0.5 * once[1] + c * twice[1], g[2] + 0.5 * once[2] + c * twice[2],
    )  # fmt: skip


@scalar_or_simd
def _axial(m):
    """The vector a with (M - M^T) x = a x x."""
    return m[7] - m[5], m[2] - m[6], m[3] - m[1]


@scalar_or_simd
def _jacobian_gradient(u, p, torque, g):
    """From the gradients of J's polar parts to that of J = U P: `torque` for dU = [w] U, `g` (six numbers) for P.

    With a = U^T w and M = U^T dJ = [a] P + dP:  (tr P - P) a is the axial vector of M - M^T,  dP = M - [a] P.
    """
    gp = (g[0], 0.5 * g[1], 0.5 * g[2], 0.5 * g[1], g[3], 0.5 * g[4], 0.5 * g[2], 0.5 * g[4], g[5])
    pg = _axial(matrix3.product(p, gp))
    alpha = matrix3.apply_transposed(u, torque)
    alpha = (alpha[0] + pg[0], alpha[1] + pg[1], alpha[2] + pg[2])
    trace = p[0] + p[4] + p[8]
    system = (trace - p[0], -p[1], -p[2], -p[3], trace - p[4], -p[5], -p[6], -p[7], trace - p[8])
    inverse = matrix3.cofactor(system)  # symmetric; over the determinant
    det = system[0] * inverse[0] + system[1] * inverse[1] + system[2] * inverse[2]
    x, y, z = matrix3.apply(inverse, alpha)
    x, y, z = x / det, y / det, z / det
    return matrix3.product(u, (gp[0], gp[1] - z, gp[2] + y, gp[3] + z, gp[4], gp[5] - x, gp[6] - y, gp[7] + x, gp[8]))


@scalar_or_simd
def _edge_gradients(a, b, m):
    """From the gradient m of E = [a, b, n sqrt(2 area)] to those of its edges a and b."""
    normal = matrix3.cross(a, b)
    length = math.sqrt(matrix3.dot(normal, normal))  # 2 area
    n = (normal[0] / length, normal[1] / length, normal[2] / length)
    g = (m[2], m[5], m[8])
    along, root = 0.5 * matrix3.dot(n, g), 1 / math.sqrt(length)
    g = (root * (g[0] - along * n[0]), root * (g[1] - along * n[1]), root * (g[2] - along * n[2]))
    ga, gb = matrix3.cross(b, g), matrix3.cross(g, a)
    return (m[0] + ga[0], m[3] + ga[1], m[6] + ga[2]), (m[1] + gb[0], m[4] + gb[1], m[7] + gb[2])


@scalar_or_simd
def _face_corners(f, g_rows, torque, faces, canonical_edges, posed, rotation, stretch, sound, corners):
    for corner in range(3):
        for k in range(3):
            corners[f, corner, k] = g_rows[f, CENTRE + k] / 3
    if not sound[f]:
        return
    u, p = matrix3.load(rotation, f), matrix3.load(stretch, f)
    g = (g_rows[f, 0], g_rows[f, 1], g_rows[f, 2], g_rows[f, 3], g_rows[f, 4], g_rows[f, 5])
    to_jacobian = _jacobian_gradient(u, p, read3(torque, f), g)
    to_edges = matrix3.product(to_jacobian, matrix3.transpose(matrix3.load(canonical_edges, f)))
    i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
    origin, a, b = read3(posed, i), read3(posed, j), read3(posed, k)
    a = (a[0] - origin[0], a[1] - origin[1], a[2] - origin[2])
    b = (b[0] - origin[0], b[1] - origin[1], b[2] - origin[2])
    ga, gb = _edge_gradients(a, b, to_edges)
    for c in range(3):
        corners[f, 0, c] -= ga[c] + gb[c]
        corners[f, 1, c] += ga[c]
        corners[f, 2, c] += gb[c]


@kernel
def _corner_gradients(g_rows, torque, faces, canonical_edges, posed, rotation, stretch, sound):
    corners = np.zeros((len(faces), 3, 3))
    parallel_for(
        _face_corners, len(faces),
        (g_rows, torque, faces, canonical_edges, posed, rotation, stretch, sound, corners),
    )  # fmt: skip
    return corners


@kernel
def _torques(g_rows, neighbours, rotation):
    """Gradient of every face's rotation vector, dU = [w] U: from U itself, and from the turns between neighbours."""
    torque = np.zeros((len(neighbours), 3))
    for f in range(len(neighbours)):
        u = matrix3.load(rotation, f)
        own = _axial(matrix3.product(read9(g_rows, f, ROTATION), matrix3.transpose(u)))
        for k in range(3):
            torque[f, k] += own[k]
        for s in range(3):
            other = neighbours[f, s]
            if other == f:
                continue
            at = TURN + 3 * s
            turn = matrix3.product(matrix3.transpose(u), matrix3.load(rotation, other))
            g = (g_rows[f, at], g_rows[f, at + 1], g_rows[f, at + 2])
            pull = matrix3.apply(u, _logarithm_gradient(matrix3.rotation_vector(turn), g))
            for k in range(3):
                torque[other, k] += pull[k]
                torque[f, k] -= pull[k]
    return torque


def vertices_gradient(
    g_rows: Float[np.ndarray, "f 32"],
    rig: Rig,
    posed: Float[np.ndarray, "v 3"],
    rotation: Float[np.ndarray, "f 3 3"],
    stretch: Float[np.ndarray, "f 3 3"],
    sound: np.ndarray,
) -> Float[np.ndarray, "v 3"]:
    """Of the posed vertices, from that of the rows that they make."""
    torque = _torques(g_rows, rig.neighbours, rotation)
    corners = _corner_gradients(g_rows, torque, rig.faces, rig.canonical_edges, posed, rotation, stretch, sound)
    gradient = np.zeros(posed.shape)
    np.add.at(gradient, rig.faces.reshape(-1), corners.reshape(-1, 3))
    return gradient
