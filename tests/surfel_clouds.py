"""Random surfels for tests of the rasterizer, three cameras that see them, and a functional of the images."""

import numpy as np
import torch

from carigs.capture import Camera, look_at
from carigs.splat.rasterizer.interface import OUTPUTS

CAMERA = Camera(look_at(np.array([0.3, 0.4, 2.0]), np.zeros(3)), fx=90, fy=85, cx=31.2, cy=24.9, width=64, height=48)
ODD = Camera(look_at(np.array([-0.9, 0.2, 1.6]), np.zeros(3)), fx=70, fy=74, cx=36.7, cy=21.3, width=71, height=45)
FRONTAL = Camera(look_at(np.array([0.0, 0.0, 2.0]), np.zeros(3)), fx=80, fy=80, cx=24, cy=20, width=48, height=40)


def cloud(count, seed, size=0.08, opacity=(0.02, 1.0), extent=0.5):
    """Arrays of surfels with skewed axes, anywhere in a cube around the origin."""
    random = np.random.default_rng(seed)
    axes = np.linalg.qr(random.normal(size=(count, 3, 3)))[0]
    scale = size * np.exp(random.normal(0, 0.6, (count, 2)))
    u = axes[:, :, 0] * scale[:, :1]
    v = axes[:, :, 1] * scale[:, 1:] + 0.4 * u * random.normal(size=(count, 1))
    centre = random.uniform(-extent, extent, (count, 3))
    return [centre, u, v, random.uniform(*opacity, count), random.uniform(0, 1, (count, 3))]


def degenerate_cloud():
    """A cloud with every kind of degenerate surfel, seen by FRONTAL (depth = 2 - z)."""
    centre, u, v, opacity, colour = cloud(120, 7)
    centre[:10] = [0.0, 0.0, 2.5]  # behind the camera
    u[10:14] *= 1e-4  # very thin and very small
    u[14:18], v[14:18] = u[14:18] * 1e-5, v[14:18] * 1e-5
    u[18:20] *= 40  # reaches the camera's plane, or covers everything
    u[20:24], v[20:24] = [0, 0, 0.1], centre[20:24] * 0.1 + [0, 0, -0.2]  # the disc's plane contains the camera
    opacity[24:28] = 0
    opacity[28:44] = 1
    centre[44:64, 2] = 0.125  # equal depths
    u[64:66] = 0  # no area
    v[66:68] = 2 * u[66:68]
    u[68:72], v[68:72] = [3, 0, 0], [0, 3, 0]  # covers the image
    opacity[72:74] = 0.0045  # just visible
    return [centre, u, v, opacity, colour]


def layers(count, seed):
    """Nearly opaque discs, one behind the other, that cover FRONTAL's image: every pixel is complete after a few."""
    random = np.random.default_rng(seed)
    centre = np.column_stack([np.zeros((count, 2)), random.uniform(-0.5, 0.5, count)])
    u, v = random.normal(0, 0.1, (2, count, 3)) * [1, 1, 0] + [[[2, 0, 0]], [[0, 2, 0]]]
    return [centre, u, v, random.uniform(0.6, 1, count), random.uniform(0, 1, (count, 3))]


def tensors(arrays, dtype=torch.float32, grad=False):
    # Through float32, so that both precisions see the same numbers.
    return [torch.tensor(np.asarray(a, np.float32)).to(dtype).requires_grad_(grad) for a in arrays]


def upstream(images, mask, seed):
    """A random linear functional of the images, with weight zero where `mask` is false."""
    generator = torch.Generator().manual_seed(seed)
    total = 0
    for name in OUTPUTS:
        weight = torch.randn(mask.shape + ((3,) if name in ("colour", "normal") else ()), generator=generator)
        image = images[name] if isinstance(images, dict) else getattr(images, name)
        if image is not None:
            weight = weight * (mask if weight.ndim == 2 else mask[..., None])
            total = total + (image * weight).sum()
    return total


def relative(a, b):
    return ((a.double() - b).norm() / b.norm()).item()
