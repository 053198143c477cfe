"""Flows that move images onto their common mean, which no image decides alone (congealing)."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float32

from carigs.tracking.skin.face_chart import UnwrappedFrame

ROUNDS = 6
"""Of mean and flows in turn."""
WINDOW = 5 / 288
"""Standard deviation of the window in which a flow is constant, in sides of the image."""
STIFFNESS = 0.003
"""Information that every window has that nothing moves, in squared gradients: it counts where there is no texture."""
LONGEST_STEP = 0.7
"""Pixels of a round."""
OUTLIER = 1.0
"""Difference at which a pixel counts a quarter (Geman and McClure): a wrinkle is there or not, whatever moves."""


def flows_to_mean(frames: Sequence[UnwrappedFrame]) -> Float32[np.ndarray, "t s s 2"]:
    """Find where the points of the mean image are in each image.

    Each flow minimises weighted squared differences in Gaussian windows (Lucas and Kanade 1981), by rounds. The mean
    flow of every pixel is 0: what all images have in common is the shape of the mean.

    Args:
        frames: The images.

    Returns:
        Flows in pixels: image t at the pixel x + flow[t, x] shows what the mean image shows at x.
    """
    side = len(frames[0].image)
    grid = np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).astype(np.float32)
    flows = np.zeros((len(frames), side, side, 2), np.float32)
    for _ in range(ROUNDS):
        moved = [warped(frame, grid + flow) for frame, flow in zip(frames, flows, strict=True)]
        total = sum(weight for _, weight in moved) + 1e-3
        mean = sum(weight * image for image, weight in moved) / total
        gradient = [cv2.Sobel(mean, cv2.CV_32F, dx, 1 - dx, ksize=3) / 8 for dx in (1, 0)]
        for flow, (image, weight) in zip(flows, moved, strict=True):
            flow += _step(mean - image, weight, gradient, flow)
        flows -= (
            sum(weight[..., None] * flow for (_, weight), flow in zip(moved, flows, strict=True)) / total[..., None]
        )
    return flows


def warped(frame: UnwrappedFrame, place: Float32[np.ndarray, "s s 2"]) -> UnwrappedFrame:
    """Move an image.

    Args:
        frame: The image.
        place: Where each pixel of the result is found in it.

    Returns:
        The moved image and its weights.
    """
    x, y = np.ascontiguousarray(place[..., 0]), np.ascontiguousarray(place[..., 1])
    image = cv2.remap(frame.image, x, y, cv2.INTER_CUBIC, borderValue=0.0)
    return UnwrappedFrame(image, cv2.remap(frame.weight, x, y, cv2.INTER_LINEAR, borderValue=0.0))


def _step(
    difference: Float32[np.ndarray, "s s"],
    weight: Float32[np.ndarray, "s s"],
    gradient: Sequence[Float32[np.ndarray, "s s"]],
    flow: Float32[np.ndarray, "s s 2"],
) -> Float32[np.ndarray, "s s 2"]:
    """One step of Gauss and Newton in every window, with outliers weighted down."""
    gx, gy = gradient
    robust, sigma = weight / (1 + (difference / OUTLIER) ** 2) ** 2, WINDOW * len(difference)
    xx, xy, yy, x, y = (
        cv2.GaussianBlur(robust * product, (0, 0), sigma)
        for product in (gx * gx, gx * gy, gy * gy, gx * difference, gy * difference)
    )
    xx, yy = xx + STIFFNESS, yy + STIFFNESS
    x, y = x - STIFFNESS * flow[..., 0], y - STIFFNESS * flow[..., 1]
    determinant = xx * yy - xy * xy
    step = np.stack([yy * x - xy * y, xx * y - xy * x], axis=-1) / determinant[..., None]
    return step.clip(-LONGEST_STEP, LONGEST_STEP)
