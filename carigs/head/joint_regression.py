"""Joint regressors: joints as weighted sums of the vertices around them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float


def regressor_row(
    vertices: Float[np.ndarray, "v 3"], near: Bool[np.ndarray, " v"], joint: Float[np.ndarray, "3"]
) -> Float[np.ndarray, " v"]:
    """Weights with which vertices give a joint: the smallest change, by least squares, of a plain mean.

    Args:
        vertices: Positions on the template.
        near: The vertices that may have weight.
        joint: Position of the joint on the template.

    Returns:
        Weights that sum to 1, of either sign.
    """
    row = np.zeros(len(vertices))
    q = np.concatenate([vertices[near], np.ones((np.count_nonzero(near), 1))], axis=1)
    mean = np.full(len(q), 1 / len(q))
    row[near] = mean + np.linalg.pinv(q.T) @ (np.append(joint, 1.0) - q.T @ mean)
    return row
