"""Closed-form alpha with a prior for each pixel (Levin, Lischinski, Weiss 2008).

Alpha minimises `alpha' L alpha + sum w (alpha - prior)^2` in the band of a trimap, outside of which it is known. L is
the matting Laplacian of the image (`carigs.matting.laplacian`), and the weights w are the certainty of the prior.
"""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt8

from carigs.matting.laplacian import REACH, coefficients, solve

EPSILON = 1e-6
"""Regularisation of the Laplacian's windows; the noise of a camera has a variance of 1e-5 to 1e-4."""
TOLERANCE, WITHOUT_PRIOR, ITERATIONS = 1e-4, 1e-5, 500
"""Root mean square of the steps of alpha at which the conjugate gradients end, with a prior and without one, and their
largest number. Known pixels alone reach the middle of a band slowly: ending early costs .007 there."""
LEAST_WEIGHT = 1e-9
"""Of every pixel: no alpha is undetermined."""


def closed_form_alpha(
    image: UInt8[np.ndarray, "h w 3"],
    trimap: UInt8[np.ndarray, "h w"],
    prior: Float[np.ndarray, "h w"] | None = None,
    weight: Float[np.ndarray, "h w"] | None = None,
) -> Float32[np.ndarray, "h w"]:
    """Solve for alpha in the band of a trimap.

    Args:
        image: sRGB.
        trimap: 0 background, 255 foreground, else unknown.
        prior: Estimate of alpha in the band, for example from a known background.
        weight: Its certainty; 0 leaves alpha to the image.

    Returns:
        Alpha in [0, 1].
    """
    alpha = (trimap / 255).astype(np.float32)
    unknown = (trimap > 0) & (trimap < 255)
    if not unknown.any():
        return alpha
    x, y, width, height = cv2.boundingRect(unknown.astype(np.uint8))
    box = slice(max(y - REACH, 0), y + height + REACH), slice(max(x - REACH, 0), x + width + REACH)
    inside = unknown[box]
    count = int(inside.sum())
    number = np.where(inside, np.cumsum(inside).reshape(inside.shape) - 1, -1).astype(np.int32)
    matrix = coefficients(image[box].astype(np.float32) / 255, number, count, EPSILON)
    weights, right = np.full(count, LEAST_WEIGHT, np.float32), np.zeros(count, np.float32)
    tolerance = WITHOUT_PRIOR
    if prior is not None and weight is not None:
        tolerance = TOLERANCE
        alpha[unknown] = prior[unknown]
        weights += weight[unknown]
        right += weights * prior[unknown]
    matrix[REACH, REACH] += weights
    found = np.pad(alpha[box], REACH)
    solve(matrix, _runs(inside), found, right, tolerance, ITERATIONS)
    alpha[box] = found[REACH:-REACH, REACH:-REACH].clip(0, 1)
    return alpha


def _runs(region: Bool[np.ndarray, "h w"]) -> Int[np.ndarray, "r 4"]:
    """The pixels of a region that lie side by side: row, first column, number of the first pixel, and length."""
    steps = np.diff(np.pad(region, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    (row, first), (_, end) = np.nonzero(steps == 1), np.nonzero(steps == -1)
    length = end - first
    return np.stack([row, first, np.cumsum(length) - length, length], axis=1)
