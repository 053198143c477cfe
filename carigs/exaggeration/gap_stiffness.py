"""Elastic stiffness of narrow gaps: keeps lips, lids and nostril walls from growing into each other."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array, csc_array

from carigs.mesh.ray_caster import RayCaster
from carigs.mesh.triangle_mesh import barycenters, face_areas, face_normals, size

MAX_GAP = 0.02
"""Widest gap that has a stiffness, in head sizes."""
MIN_GAP = 0.0005
"""Gap below which the stiffness no longer grows, in head sizes."""
RAY_OFFSET = 1e-6
"""Distance of the rays' origins from the surface, in head sizes."""


def gap_stiffness(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> csc_array:
    """Stiffness matrix G of elastic columns between surfaces that face each other across a narrow gap.

    A ray from the barycenter of every face along its normal finds the face across the gap, at a distance t. The column
    between them is strained by |u - u'| / t under displacements u and u' of its ends, and x^T G x is the integral of
    the squared strain over the surface:

        x^T G x = sum over faces of a_f |u - u'|^2 (1 / (t^2 + t_min^2) - 1 / (t_max^2 + t_min^2)),

    with t_min = `MIN_GAP` and t_max = `MAX_GAP`. Constants have no energy. Like the Dirichlet energy, this one does not
    depend on the unit of the mesh, so one number relates the two (setting `exaggerate.gap_stiffness`).

    Args:
        vertices: Positions, in any unit.
        faces: Vertex indices of the triangles, counterclockwise seen from outside.

    Returns:
        Symmetric positive semi-definite matrix (v, v).
    """
    vertices = vertices - vertices[0]
    centers, extent = barycenters(vertices, faces), size(vertices, faces)
    normals = face_normals(vertices, faces)
    origins = centers / extent + RAY_OFFSET * normals
    opposite, gap, barycentric = RayCaster(vertices, faces).first_hit(origins, normals, MAX_GAP)
    gap = gap + RAY_OFFSET
    # A face that is hit from its inside does not bound a gap: the surface already intersects itself there.
    face = np.flatnonzero((opposite >= 0) & (gap < MAX_GAP))
    face = face[(normals[face] * normals[opposite[face]]).sum(axis=1) < 0]
    opposite, gap, barycentric = opposite[face], gap[face], barycentric[face]
    softness = (np.array([gap, np.full_like(gap, MAX_GAP)]) * extent) ** 2 + (MIN_GAP * extent) ** 2
    columns = face_areas(vertices, faces)[face] * (1 / softness[0] - 1 / softness[1])

    n = len(face)
    corners = np.concatenate([faces[face], faces[opposite]], axis=1)
    coefficients = np.concatenate([np.full((n, 3), 1 / 3), -barycentric], axis=1)
    difference = coo_array(
        (coefficients.ravel(), (np.repeat(np.arange(n), 6), corners.ravel())), shape=(n, len(vertices))
    ).tocsr()
    return (difference.T @ difference.multiply(columns[:, None])).tocsc()
