"""Gradients with respect to the posed mesh, for tracking refinement: surfels -> records of the motion -> vertices.

Computed only if the mesh is refined. One surfel and one triangle at a time; sums are in float64 and in a fixed order,
so the result does not depend on the number of threads.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from jaxtyping import Bool, Float

from carigs.simd import matrix3
from carigs.simd.kernels import kernel, parallel_for
from carigs.simd.tuples import add, divide, multiply, subtract, write_row
from carigs.simd.vectors import scalar_or_simd
from carigs.splat.rig import jacobian_blend_backward as backward
from carigs.splat.rig.face_motion import CENTRE, RECORD_SIZE, RELATIVE_ROTATION, ROTATION, STRETCH, FaceMotion
from carigs.splat.rig.rig import Rig, motion_records, polar_decomposition
from carigs.splat.rig.skinning_arguments import has_gradient, read3, read6, read9, read_blend, surfel_gradient
from carigs.splat.rig.smooth_motion import SmoothMotion
from carigs.splat.rig.solid_motion import SolidMotion


def differentiable_face_motion(
    rig: Rig,
    posed: Float[torch.Tensor, "v 3"],
    smooth: SmoothMotion | None = None,
    solids: SolidMotion | None = None,
) -> FaceMotion:
    """Motion of every triangle as `rig.face_motion`, differentiable with respect to the posed vertices.

    Degenerate triangles, which move with their neighbours, pass on the gradient of their centre only. So do triangles
    whose motion is an average: their gradient is approximate.

    Args:
        rig: Canonical mesh.
        posed: Posed vertices in metres, float64.
        smooth: Averages the motion of triangles that carry hair.
        solids: Moves triangles that carry teeth as solids.

    Returns:
        The motion; its records are a float32 tensor.

    Raises:
        MeshError: If a vertex is not finite.
    """
    return FaceMotion(_FaceMotion.apply(posed, rig, smooth, solids))


class _FaceMotion(torch.autograd.Function):
    @staticmethod
    def forward(ctx, posed, rig, smooth, solids):
        vertices = np.ascontiguousarray(posed.detach().numpy())
        centre, rotation, stretch, valid = polar_decomposition(rig, vertices)
        if smooth is not None:
            smooth.apply(rotation, stretch)
            valid[smooth.faces] = False
        if solids is not None:
            solids.apply(centre, rotation, stretch)
            valid[solids.faces] = False
        records = motion_records(rig, centre, rotation, stretch, np.float32)
        ctx.inputs, ctx.solids = (rig, vertices, rotation, stretch, valid, records), solids
        return torch.from_numpy(records)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, g_records):
        g_records = g_records.contiguous().numpy()
        if ctx.solids is not None:
            g_records = g_records.copy()
            ctx.solids.spread_gradient(g_records[:, CENTRE : CENTRE + 3])
        return torch.from_numpy(vertices_gradient(g_records, *ctx.inputs)), None, None, None


@kernel
def motion_parts(inputs, centre, upstream, parts):
    """Write what each surfel adds to the gradients of records, as `skinning_simd.skin_and_motion_backward`.

    Args:
        inputs: `SkinningInputs`.
        centre: World centres that skinning wrote.
        upstream: `SkinnedArrays` of gradients with respect to what skinning wrote.
        parts: `MotionParts` to write.
    """
    for i in range(len(inputs.binding)):
        if not has_gradient(i, upstream):
            parts.weights[i], parts.stretch_x[i], parts.stretch_yz[i], parts.centre[i] = 0.0, 0.0, 0.0, 0.0
            parts.rotation_x[i], parts.rotation_y[i], parts.rotation_z[i], parts.turn[i] = 0.0, 0.0, 0.0, 0.0
            continue
        _faces, _t, frame, _sigmoids, _inverse_sum, blend = read_blend(i, inputs)
        v, w, _p, (a, b, _c), _q, _tangent = blend
        (_dx, _dq, _ds, h, y), (gx, torque, view) = surfel_gradient(i, inputs, centre, upstream, frame, blend)
        dw, dp = backward.motion_gradient(blend, h, y, torque)
        rows = backward.rotation_gradient(blend, h, y)
        if inputs.rotate_directions and len(upstream.direction) > 0:
            seen = backward.turned_row(w, a, b, read3(upstream.direction, i))
            rows = (
                add(rows[0], multiply(view[0], seen)),
                add(rows[1], multiply(view[1], seen)),
                add(rows[2], multiply(view[2], seen)),
            )
        write_row(parts.weights, i, v)
        write_row(parts.stretch_x, i, (dp[0], dp[1], dp[2]))
        write_row(parts.stretch_yz, i, (dp[3], dp[4], dp[5]))
        write_row(parts.centre, i, gx)
        write_row(parts.rotation_x, i, rows[0])
        write_row(parts.rotation_y, i, rows[1])
        write_row(parts.rotation_z, i, rows[2])
        write_row(parts.turn, i, dw)


@kernel
def sum_of_parts(binding, neighbours, parts):
    """Gradient with respect to the records of the motion, summed in the order of the surfels.

    Args:
        binding: Triangle of each surfel (n,).
        neighbours: Neighbours of each triangle (f, 3).
        parts: `MotionParts`.

    Returns:
        Array (f, 32) float64.
    """
    total = np.zeros((len(neighbours), RECORD_SIZE))
    for i in range(len(binding)):
        f = binding[i]
        for k in range(3):
            total[f, STRETCH + k] += parts.weights[i, 0] * parts.stretch_x[i, k]
            total[f, STRETCH + 3 + k] += parts.weights[i, 0] * parts.stretch_yz[i, k]
            total[f, CENTRE + k] += parts.centre[i, k]
            total[f, ROTATION + k] += parts.rotation_x[i, k]
            total[f, ROTATION + 3 + k] += parts.rotation_y[i, k]
            total[f, ROTATION + 6 + k] += parts.rotation_z[i, k]
        for s in range(3):
            other, weight = neighbours[f, s], parts.weights[i, 1 + s]
            for k in range(3):
                total[other, STRETCH + k] += weight * parts.stretch_x[i, k]
                total[other, STRETCH + 3 + k] += weight * parts.stretch_yz[i, k]
                total[f, RELATIVE_ROTATION + 3 * s + k] += weight * parts.turn[i, k]
    return total


@scalar_or_simd
def _logarithm_gradient(rho, g):
    """G J^-1(rho): with log(exp(d) R) = rho + J^-1(rho) d, J the left Jacobian of SO(3) (Sola et al. 2018, eq. 146)."""
    square = matrix3.dot(rho, rho)
    # The series of the formula below, with an error of 1e-11 up to a third of a radian.
    c = 1 / 12 + square * (1 / 720 + square * (1 / 30240 + square / 1209600))
    if square > 0.1:
        angle = math.sqrt(square)
        # (1 + cos)/sin = cot(angle / 2), which does not lose its digits near pi.
        c = 1 / square - 1 / (2 * angle * math.tan(0.5 * angle))
    once = matrix3.cross(rho, g)
    return add(add(g, multiply(0.5, once)), multiply(c, matrix3.cross(rho, once)))


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
    alpha = add(matrix3.apply_transposed(u, torque), pg)
    trace = p[0] + p[4] + p[8]
    system = (trace - p[0], -p[1], -p[2], -p[3], trace - p[4], -p[5], -p[6], -p[7], trace - p[8])
    inverse = matrix3.cofactor(system)  # symmetric; over the determinant
    det = system[0] * inverse[0] + system[1] * inverse[1] + system[2] * inverse[2]
    x, y, z = divide(matrix3.apply(inverse, alpha), det)
    return matrix3.product(u, (gp[0], gp[1] - z, gp[2] + y, gp[3] + z, gp[4], gp[5] - x, gp[6] - y, gp[7] + x, gp[8]))


@scalar_or_simd
def _edge_gradients(a, b, m):
    """From the gradient m of E = [a, b, n sqrt(2 area)] to those of its edges a and b."""
    normal = matrix3.cross(a, b)
    length = math.sqrt(matrix3.dot(normal, normal))  # 2 area
    n = divide(normal, length)
    g = (m[2], m[5], m[8])
    along, root = 0.5 * matrix3.dot(n, g), 1 / math.sqrt(length)
    g = multiply(root, subtract(g, multiply(along, n)))
    return add((m[0], m[3], m[6]), matrix3.cross(b, g)), add((m[1], m[4], m[7]), matrix3.cross(g, a))


@scalar_or_simd
def _corner_gradient(f, g_records, torque, faces, inverse_edges, posed, rotation, stretch, valid, corners):
    for corner in range(3):
        for k in range(3):
            corners[f, corner, k] = g_records[f, CENTRE + k] / 3
    turn, g = read3(torque, f), read6(g_records, f, STRETCH)
    if not valid[f] or (turn == (0.0, 0.0, 0.0) and g == (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)):  # or not in view
        return
    u, p = matrix3.load(rotation, f), matrix3.load(stretch, f)
    to_jacobian = _jacobian_gradient(u, p, turn, g)
    to_edges = matrix3.product(to_jacobian, matrix3.transpose(matrix3.load(inverse_edges, f)))
    i, j, k = read3(faces, f)
    origin = read3(posed, i)
    ga, gb = _edge_gradients(subtract(read3(posed, j), origin), subtract(read3(posed, k), origin), to_edges)
    for c in range(3):
        corners[f, 0, c] -= ga[c] + gb[c]
        corners[f, 1, c] += ga[c]
        corners[f, 2, c] += gb[c]


@kernel
def _corner_gradients(g_records, torque, faces, inverse_edges, posed, rotation, stretch, valid):
    corners = np.empty((len(faces), 3, 3))
    parallel_for(
        _corner_gradient, len(faces),
        (g_records, torque, faces, inverse_edges, posed, rotation, stretch, valid, corners),
    )  # fmt: skip
    return corners


@kernel
def _torques(g_records, neighbours, rotation, records):
    """Gradient with respect to each triangle's w in dU = [w] U: through U and through the relative rotations."""
    torque = np.zeros((len(neighbours), 3))
    for f in range(len(neighbours)):
        u = matrix3.load(rotation, f)
        own = _axial(matrix3.product(read9(g_records, f, ROTATION), matrix3.transpose(u)))
        for k in range(3):
            torque[f, k] += own[k]
        for s in range(3):
            other = neighbours[f, s]
            if other == f:
                continue
            g = read3(g_records, f, RELATIVE_ROTATION + 3 * s)
            if g == (0.0, 0.0, 0.0):  # the view does not show its surfels
                continue
            relative = read3(records, f, RELATIVE_ROTATION + 3 * s)
            pull = matrix3.apply(u, _logarithm_gradient(relative, g))
            for k in range(3):
                torque[other, k] += pull[k]
                torque[f, k] -= pull[k]
    return torque


@kernel
def _sum_at_vertices(faces, corners, count):
    total = np.zeros((count, 3))
    for f in range(len(faces)):
        for corner in range(3):
            for k in range(3):
                total[faces[f, corner], k] += corners[f, corner, k]
    return total


def vertices_gradient(
    g_records: Float[np.ndarray, "f 32"],
    rig: Rig,
    posed: Float[np.ndarray, "v 3"],
    rotation: Float[np.ndarray, "f 3 3"],
    stretch: Float[np.ndarray, "f 3 3"],
    valid: Bool[np.ndarray, " f"],
    records: Float[np.ndarray, "f 32"],
) -> Float[np.ndarray, "v 3"]:
    """Gradient with respect to the posed vertices from that with respect to the records of the motion.

    Args:
        g_records: Gradient with respect to the records.
        rig: Canonical mesh.
        posed: Posed vertices in metres.
        rotation: U of every triangle, from `rig.polar_decomposition`.
        stretch: P of every triangle.
        valid: Whether a triangle has a motion of its own.
        records: The records, whose relative rotations are read.

    Returns:
        Gradient with respect to `posed`.
    """
    torque = _torques(g_records, rig.neighbours, rotation, records)
    corners = _corner_gradients(g_records, torque, rig.faces, rig.inverse_edges, posed, rotation, stretch, valid)
    return _sum_at_vertices(rig.faces, corners, len(posed))
