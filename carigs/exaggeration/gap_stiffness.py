"""The air between surfaces that face each other: it keeps lips, lids and nostril walls from growing into each other."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array, csc_array

from carigs.mesh.ray_caster import RayCaster
from carigs.mesh.triangle_mesh import barycenters, face_areas, face_normals, size

REACH = 0.02
"""Widest gap, in head sizes."""
NARROW = 0.0005
"""The same for the gap below which stiffness no longer grows."""
OFFSET = 1e-6
"""Of the head's size: rays start this far off the surface."""


def gap_stiffness(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> csc_array:
    """G, positive semi-definite: x^T G x measures how much x stretches and squeezes the air, as cotans do for the skin.

    From the middle of every face a ray along the normal finds the face across the gap, at a distance t.  Air there is
    an elastic column: a relative displacement u - u' strains it by |u - u'| / t, and x^T G x is the integral of that
    strain's square over the surface, faded out where t comes near to REACH.  Constants cost nothing, and like the
    cotans' energy this one has no unit, so that one number relates both (`Exaggerate.air`).
    """
    vertices = vertices - vertices[0]
    middles, extent = barycenters(vertices, faces), size(vertices, faces)
    normals = face_normals(vertices, faces)
    across, gap, barycentric = RayCaster(vertices, faces).first(middles / extent + OFFSET * normals, normals, REACH)
    gap = gap + OFFSET
    # Seen from its inside, a face is no opposite: there the surface already cuts itself.
    own = np.flatnonzero((across >= 0) & (gap < REACH))
    own = own[(normals[own] * normals[across[own]]).sum(axis=1) < 0]
    across, gap, barycentric = across[own], gap[own], barycentric[own]
    softness = (np.array([gap, np.full_like(gap, REACH)]) * extent) ** 2 + (NARROW * extent) ** 2
    columns = face_areas(vertices, faces)[own] * (1 / softness[0] - 1 / softness[1])

    n = len(own)
    corners = np.concatenate([faces[own], faces[across]], axis=1)
    shares = np.concatenate([np.full((n, 3), 1 / 3), -barycentric], axis=1)
    difference = coo_array(
        (shares.ravel(), (np.repeat(np.arange(n), 6), corners.ravel())), shape=(n, len(vertices))
    ).tocsr()
    return (difference.T @ difference.multiply(columns[:, None])).tocsc()
