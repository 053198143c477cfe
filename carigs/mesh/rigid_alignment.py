"""The rigid transform between two sets of corresponding points."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


def rigid_alignment(
    source: Float[np.ndarray, "n 3"], target: Float[np.ndarray, "n 3"], weights: Float[np.ndarray, " n"] | None = None
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """Rotation and translation that minimise sum w |R source + t - target|^2 (Umeyama 1991, without scale).

    Args:
        source: Points.
        target: Their counterparts.
        weights: Weight of each pair, 0 or larger; None: all are equal.

    Returns:
        R, of determinant +1, and t.
    """
    weights = np.ones(len(source)) if weights is None else weights
    share = weights / weights.sum()
    source_centre, target_centre = share @ source, share @ target
    covariance = (target - target_centre).T @ (share[:, None] * (source - source_centre))
    u, _, vt = np.linalg.svd(covariance)
    sign = np.linalg.det(u) * np.linalg.det(vt)
    rotation = u @ np.diag([1, 1, sign]) @ vt
    return rotation, target_centre - rotation @ source_centre
