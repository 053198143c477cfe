"""Closed-form alpha with a prior for each pixel (Levin, Lischinski, Weiss 2008).

Alpha minimises `alpha' L alpha + sum w (alpha - prior)^2`. L is the matting Laplacian of the image: in each window of
3 x 3 pixels alpha is taken for an affine function of the colour. Pixels of the trimap have a large weight; in the band
the weight is the certainty of the prior.
"""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8
from scipy.sparse import diags_array
from scipy.sparse.linalg import cg

from carigs.matting.pymatting_modules import pymatting_module

CERTAIN = 100.0
"""Weight of pixels whose alpha is known."""
EPSILON = 1e-6
"""Regularisation of the Laplacian's windows; the noise of a camera has a variance of 1e-5 to 1e-4."""
TOLERANCE, ITERATIONS = 1e-5, 500
"""Relative residual at which the conjugate gradients end, and their largest number."""
MARGIN = 3
"""Pixels around the band that are solved for as well."""


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
        weight: Its certainty; `CERTAIN` fixes alpha, 0 leaves it to the image.

    Returns:
        Alpha in [0, 1].

    Raises:
        CarigsError: If pymatting is not installed.
    """
    alpha = (trimap / 255).astype(np.float32)
    unknown = (trimap > 0) & (trimap < 255)
    if not unknown.any():
        return alpha
    x, y, width, height = cv2.boundingRect(unknown.astype(np.uint8))
    box = (
        slice(max(y - MARGIN, 0), y + height + MARGIN),
        slice(max(x - MARGIN, 0), x + width + MARGIN),
    )
    known, target = ~unknown[box], alpha[box].astype(np.float64)
    weights = np.where(known, CERTAIN, 0.0)
    if prior is not None and weight is not None:
        target[~known], weights[~known] = prior[box][~known], weight[box][~known]
    colours = image[box].astype(np.float64) / 255
    laplacian = pymatting_module("laplacian.cf_laplacian").cf_laplacian(colours, EPSILON, 1, is_known=known)
    # Only the band and its neighbours are unknowns: a solve of the whole image would take several times as long.
    active = np.flatnonzero(_beside(~known))
    matrix = laplacian.tocsr()[active][:, active]
    matrix.setdiag(matrix.diagonal() + weights.ravel()[active] + 1e-9)
    right, start, scale = (weights * target).ravel()[active], target.ravel()[active], 1 / matrix.diagonal()
    # An incomplete Cholesky factor would need 1 to 5 iterations, but takes longer than all iterations without it.
    solved, _ = cg(matrix, right, start, rtol=TOLERANCE, maxiter=ITERATIONS, M=diags_array(scale))
    result = alpha[box].flatten()
    result[active] = solved
    alpha[box] = np.where(known, alpha[box], result.reshape(known.shape).clip(0, 1))
    return alpha


def _beside(region: np.ndarray) -> np.ndarray:
    """Pixels that share a window of the Laplacian with a region."""
    return cv2.dilate(region.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
