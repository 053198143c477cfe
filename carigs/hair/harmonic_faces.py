"""Values on the triangles of a mesh, continued to where they are not known."""

from __future__ import annotations

import igl
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import splu

TOWARDS_ZERO = 1e-9
"""Weight of the value 0 against that of a neighbour: parts of the mesh without known values get 0."""


def faces_beside(faces: Int[np.ndarray, "f 3"]) -> csr_array:
    """Which triangles share an edge.

    Args:
        faces: Vertex indices of the triangles.

    Returns:
        Symmetric matrix (f, f) with 1 for triangles with a common edge.
    """
    across, _ = igl.triangle_triangle_adjacency(np.asarray(faces, np.int64))
    row, side = np.nonzero(across >= 0)
    beside = csr_array((np.ones(len(row)), (row, across[row, side])), shape=(len(faces), len(faces)))
    return beside.maximum(beside.T)


def harmonic_faces(
    values: Float[np.ndarray, " faces *d"], known: Bool[np.ndarray, " faces"], beside: csr_array
) -> Float[np.ndarray, " faces *d"]:
    """Continue values harmonically: each unknown one is the mean of those of the triangles beside.

    Args:
        values: Values on the triangles; unknown ones are not read.
        known: Which of them are known.
        beside: Which triangles share an edge.

    Returns:
        The values; 0 on parts of the mesh without a known one.
    """
    unknown = np.flatnonzero(~known)
    result = np.array(values, np.float64)
    if not unknown.size:
        return result
    laplacian = (diags_array(beside.sum(axis=1) + TOWARDS_ZERO) - beside).tocsr()[unknown]
    columns = result.reshape(len(result), -1)  # a view: it changes the result
    around = laplacian[:, np.flatnonzero(known)] @ columns[known]
    columns[unknown] = splu(laplacian[:, unknown].tocsc()).solve(-around)
    return result
