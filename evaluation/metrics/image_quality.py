"""PSNR and SSIM of an image against the truth, on the whole image or on a region of it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Float64
from scipy.ndimage import correlate1d

RADIUS, SIGMA = 5, 1.5  # the 11 x 11 Gaussian window of Wang et al. 2004
C1, C2 = 0.01**2, 0.03**2  # their constants for values in [0, 1]


def psnr(
    image: Float[np.ndarray, "h w 3"], truth: Float[np.ndarray, "h w 3"], region: Bool[np.ndarray, "h w"] | None = None
) -> float:
    """Peak signal-to-noise ratio in dB over the region's pixels x 3 channels, of values in [0, 1].

    Infinite where both agree exactly, nan where the region is empty.  For one image: average the results over images,
    as the field does; pooling the squared error over images gives other numbers.
    """
    error = (np.asarray(image, np.float64) - truth) ** 2
    if region is not None:
        error = error[region]
    if error.size == 0:
        return float("nan")
    mean = float(error.mean())
    return float("inf") if mean == 0 else -10 * float(np.log10(mean))


def ssim_map(image: Float[np.ndarray, "h w 3"], truth: Float[np.ndarray, "h w 3"]) -> Float64[np.ndarray, "h w"]:
    """Structural similarity around each pixel (Wang et al. 2004), mean of the channels; values in [0, 1].

    Gaussian window 11 x 11, sigma 1.5, images zero-padded: the convention of Gaussian splatting papers.
    """
    x, y = np.asarray(image, np.float64), np.asarray(truth, np.float64)
    mean_x, mean_y = _blur(x), _blur(y)
    variance_x, variance_y = _blur(x * x) - mean_x**2, _blur(y * y) - mean_y**2
    covariance = _blur(x * y) - mean_x * mean_y
    luminance = (2 * mean_x * mean_y + C1) / (mean_x**2 + mean_y**2 + C1)
    structure = (2 * covariance + C2) / (variance_x + variance_y + C2)
    return (luminance * structure).mean(axis=2)


def region_mean(values: Float[np.ndarray, "h w"], region: Bool[np.ndarray, "h w"] | None = None) -> float:
    """Mean over the region, nan where it is empty."""
    inside = values if region is None else values[region]
    return float(inside.mean()) if inside.size else float("nan")


def _blur(image: Float64[np.ndarray, "h w 3"]) -> Float64[np.ndarray, "h w 3"]:
    window = np.exp(-0.5 * (np.arange(-RADIUS, RADIUS + 1) / SIGMA) ** 2)
    window /= window.sum()
    rows = correlate1d(image, window, axis=0, mode="constant", cval=0.0)
    return correlate1d(rows, window, axis=1, mode="constant", cval=0.0)
