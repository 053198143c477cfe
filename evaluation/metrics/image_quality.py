"""PSNR and SSIM of an image against the true image, over the whole image or a region."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float64

RADIUS, SIGMA = 5, 1.5  # the 11 x 11 Gaussian window of Wang et al. 2004
WINDOW = np.exp(-0.5 * (np.arange(-RADIUS, RADIUS + 1) / SIGMA) ** 2)
WINDOW /= WINDOW.sum()
C1, C2 = 0.01**2, 0.03**2  # their constants for values in [0, 1]


def psnr(
    image: Float[np.ndarray, "h w 3"], truth: Float[np.ndarray, "h w 3"], region: Bool[np.ndarray, "h w"] | None = None
) -> float:
    """Peak signal-to-noise ratio: -10 log10(mean squared error), for values in [0, 1].

    Average the results over images, as usual in the field: pooling the squared error over images gives other numbers.

    Args:
        image: Image.
        truth: True image.
        region: Pixels to compare; all by default.

    Returns:
        PSNR in dB. Infinite if both images agree exactly, nan if the region is empty.
    """
    error = squared_error(image, truth)
    return psnr_of_errors(error if region is None else error[region])


def squared_error(image: Float[np.ndarray, "h w 3"], truth: Float[np.ndarray, "h w 3"]) -> Float64[np.ndarray, "h w 3"]:
    """Squared difference of two images.

    Args:
        image: Image.
        truth: True image.

    Returns:
        The square for each pixel and channel.
    """
    return (np.asarray(image, np.float64) - truth) ** 2


def psnr_of_errors(errors: Float64[np.ndarray, "..."]) -> float:
    """PSNR from squared errors: -10 log10(mean).

    Args:
        errors: Squared errors of values in [0, 1].

    Returns:
        PSNR in dB. Infinite if all errors are 0, nan if there are none.
    """
    if errors.size == 0:
        return float("nan")
    mean = float(errors.mean())
    return float("inf") if mean == 0 else -10 * float(np.log10(mean))


def ssim_map(image: Float[np.ndarray, "h w 3"], truth: Float[np.ndarray, "h w 3"]) -> Float64[np.ndarray, "h w"]:
    """Structural similarity (SSIM, Wang et al. 2004) around each pixel.

        SSIM = (2 mx my + C1) (2 sxy + C2) / ((mx^2 + my^2 + C1) (sx^2 + sy^2 + C2))

    with means, variances and covariance under a Gaussian window, 11 x 11, sigma 1.5. Images are zero-padded: the
    convention of Gaussian splatting papers.

    Args:
        image: Image with values in [0, 1].
        truth: True image.

    Returns:
        Mean of the channels at every pixel.
    """
    ssim = np.ones(image.shape[:2])  # exactly 1 where both images agree in the whole window
    # To combine three planes is faster than to reduce an axis of length three.
    differing = np.logical_or.reduce([image[..., c] != truth[..., c] for c in range(image.shape[2])])
    if not differing.any():
        return ssim
    # Windows that meet a difference end within the inner box; the outer one holds them whole.
    inner, outer = _box(differing, RADIUS), _box(differing, 2 * RADIUS)
    ssim[inner] = _ssim(image[outer], truth[outer])[
        tuple(slice(i.start - o.start, i.stop - o.start) for i, o in zip(inner, outer, strict=True))
    ]
    return ssim


def _box(mask: Bool[np.ndarray, "h w"], margin: int) -> tuple[slice, slice]:
    """Bounding box of the pixels of a mask with a margin, inside the image."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    return tuple(slice(max(ids[0] - margin, 0), ids[-1] + 1 + margin) for ids in (rows, columns))


def _ssim(image: Float[np.ndarray, "h w 3"], truth: Float[np.ndarray, "h w 3"]) -> Float64[np.ndarray, "h w"]:
    x, y = np.asarray(image, np.float64), np.asarray(truth, np.float64)
    mean_x, mean_y = _blur(x), _blur(y)
    means, squares = mean_x * mean_y, mean_x**2 + mean_y**2
    covariance, variances = _blur(x * y) - means, _blur(x * x + y * y) - squares  # only the sum of the two is needed
    ssim = (2 * means + C1) * (2 * covariance + C2) / ((squares + C1) * (variances + C2))
    return sum(ssim[..., c] for c in range(ssim.shape[2])) / ssim.shape[2]


def region_mean(values: Float[np.ndarray, "..."], region: Bool[np.ndarray, "h w"] | None = None) -> float:
    """Mean over a region.

    Args:
        values: One value per pixel: an image (h, w) as of `ssim_map`, or the pixels of a region (n,).
        region: Pixels to average; all by default.

    Returns:
        The mean, nan if the region is empty.
    """
    inside = values if region is None else values[region]
    return float(inside.mean()) if inside.size else float("nan")


class ImageMetric(NamedTuple):
    """How an image is compared with the truth, region by region."""

    pixel_map: Callable[[np.ndarray, np.ndarray], np.ndarray]
    """From an image and the truth (h, w, 3) to values of each pixel, (h, w) or (h, w, 3)."""
    summarise: Callable[[np.ndarray], float]
    """From the values of a region's pixels to the metric of the region."""


IMAGE_METRICS = {"psnr": ImageMetric(squared_error, psnr_of_errors), "ssim": ImageMetric(ssim_map, region_mean)}
"""Every metric against the truth, by its name in the records. `evaluation.metrics.catalogue` describes them."""


def _blur(image: Float64[np.ndarray, "h w 3"]) -> Float64[np.ndarray, "h w 3"]:
    return cv2.sepFilter2D(image, -1, WINDOW, WINDOW, borderType=cv2.BORDER_CONSTANT)
