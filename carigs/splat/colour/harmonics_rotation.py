"""Rotation of spherical harmonics: the same colours for directions in other axes."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float64

from carigs.simd.kernels import kernel
from carigs.simd.tuples import write_row
from carigs.splat.colour.spherical_harmonics import BASIS, num_coefficients

SAMPLES = 16
"""Directions in which colours are compared; degree 3 needs seven."""
_basis3 = BASIS[3]


def rotate_harmonics(
    harmonics: Float[np.ndarray, "n k 3"], rotation: Float[np.ndarray, "n 3 3"]
) -> Float64[np.ndarray, "n k 3"]:
    """Coefficients h' with sum_k h'_k Y_k(d) = sum_k h_k Y_k(R^T d) for every direction d.

    A rotation mixes the functions of one degree only (Wigner). The matrix of a degree l follows from 2l + 1 or more
    directions: with the values Y of its functions there, h' = Y(d)^+ Y(R^T d) h.

    Args:
        harmonics: Coefficients of degrees 1 to 3, in the order of 3D Gaussian Splatting.
        rotation: Rotation matrix R of each row.

    Returns:
        The rotated coefficients.
    """
    degree = round((harmonics.shape[1] + 1) ** 0.5) - 1
    directions = np.random.default_rng(0).normal(size=(SAMPLES, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    turned = np.ascontiguousarray(np.einsum("nji,mj->nmi", rotation, directions).reshape(-1, 3), np.float64)
    values, turned_values = _basis(directions), _basis(turned).reshape(len(harmonics), SAMPLES, -1)
    result = np.empty(harmonics.shape)
    for d in range(1, degree + 1):
        functions = slice(num_coefficients(d - 1), num_coefficients(d))
        colours = turned_values[:, :, functions] @ harmonics[:, functions]
        result[:, functions] = np.linalg.pinv(values[:, functions]) @ colours
    return result


@kernel
def _basis(directions):
    values = np.empty((len(directions), 15))
    for i in range(len(directions)):
        x, y, z = directions[i]
        write_row(values, i, _basis3((x, y, z)))
    return values
