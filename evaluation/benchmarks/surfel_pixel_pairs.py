"""Number of (surfel, pixel) pairs that contribute to an image: the unit of work of a rasterizer.

An independent count: it shares no formula with the kernels. Each pixel's ray is the intersection of two planes
(Weyrich et al. 2007), in float64.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from carigs.capture import Camera
from carigs.splat.rasterizer.rasterize import WorldSurfels
from carigs.splat.rasterizer.records import ALPHA_THRESHOLD, TRANSMITTANCE_THRESHOLD

ALPHA_CAP = 0.99  # the rasterizer's default


def contributing_pairs(surfels: WorldSurfels, camera: Camera) -> int:
    """Count the pairs in which a surfel adds to a pixel: its alpha is at least 1/255, and the pixel has not ended.

    Args:
        surfels: Surfels, all in front of the camera and of positive area.
        camera: Camera.

    Returns:
        Number of pairs.
    """
    tensors = surfels.centre, surfels.tangent_u, surfels.tangent_v, surfels.opacity
    centre, u, v, opacity = (tensor.detach().double().numpy() for tensor in tensors)
    rotation = camera.camera_from_world[:3, :3]
    in_camera = np.stack([u @ rotation.T, v @ rotation.T, camera.to_camera(centre)], axis=2)
    intrinsics = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    pixel_from_disc = intrinsics @ in_camera
    box = _boxes(pixel_from_disc, opacity, camera)
    # Front to back with the kernels' end conditions; the transmittance of a pixel that has ended is 0.
    transmittance, pairs = np.ones((camera.height, camera.width)), 0
    for i in np.argsort(in_camera[:, 2, 2].astype(np.float32), kind="stable"):
        x0, y0, x1, y1 = box[i]
        x, y = np.arange(x0, x1) + 0.5, np.arange(y0, y1)[:, None] + 0.5
        alpha = opacity[i] * np.exp(-0.5 * _squared_distance(pixel_from_disc[i], x, y))
        before = transmittance[y0:y1, x0:x1]
        after = before * (1.0 - np.minimum(alpha, ALPHA_CAP))
        touched, goes_on = (alpha >= ALPHA_THRESHOLD) & (before > 0), after > TRANSMITTANCE_THRESHOLD
        before[touched] = np.where(goes_on, after, 0.0)[touched]
        pairs += np.count_nonzero(touched & goes_on)
    return pairs


def _boxes(
    pixel_from_disc: Float[np.ndarray, "n 3 3"], opacity: Float[np.ndarray, " n"], camera: Camera
) -> Int[np.ndarray, "n 4"]:
    """Pixel ranges [x0, y0, x1, y1) that contain all pixels with an alpha of at least 1/255."""
    reach = np.sqrt(2 * np.log(np.maximum(opacity / ALPHA_THRESHOLD, 1)))[:, None]  # standard deviations
    # A disc's image lies in the image of its square.
    signs = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])
    corner = reach[:, :, None] * np.einsum("nij,kj->nki", pixel_from_disc[:, :, :2], signs)
    corner += pixel_from_disc[:, None, :, 2]
    image = corner[:, :, :2] / corner[:, :, 2:]
    low, high, size = image.min(axis=1), image.max(axis=1), [camera.width, camera.height]
    return np.concatenate([np.floor(low).clip(0, size), np.ceil(high).clip(0, size)], axis=1).astype(np.int64)


def _squared_distance(
    m: Float[np.ndarray, "3 3"], x: Float[np.ndarray, " w"], y: Float[np.ndarray, "h 1"]
) -> Float[np.ndarray, "h w"]:
    """Squared distance of pixels from a surfel in standard deviations."""
    # Planes through the pixel's column and row, pulled back to the disc; they meet in (s, t, 1) times a factor.
    a0, a1, a2 = (x * m[2, k] - m[0, k] for k in range(3))
    b0, b1, b2 = (y * m[2, k] - m[1, k] for k in range(3))
    s, t, factor = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
    with np.errstate(divide="ignore", invalid="ignore"):
        return (s * s + t * t) / (factor * factor)
