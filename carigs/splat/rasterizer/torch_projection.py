"""Projection of surfels in plain PyTorch, on any device: the twin of `projection`, differentiated by autograd.

The formulas are those of `projection`. They are evaluated in float64, on devices that have it, as the kernels do.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from carigs.splat.rasterizer.interface import WorldSurfels
from carigs.splat.rasterizer.projection import BOX_MARGIN
from carigs.splat.rasterizer.records import (
    ALPHA_THRESHOLD,
    CAMERA_PLANE_MARGIN,
    MAX_SQUARED_LENGTH,
    MIN_AREA,
    NEAR_PLANE,
)

if TYPE_CHECKING:
    from carigs.capture.camera import Camera


class CameraSurfels(NamedTuple):
    """Discs in camera axes; those that are culled are replaced by a disc in front of the camera."""

    centre: Float[Tensor, "n 3"]
    """Metres."""
    tangent_u: Float[Tensor, "n 3"]
    """First axis times its standard deviation, in metres."""
    tangent_v: Float[Tensor, "n 3"]
    """Second axis times its standard deviation."""
    opacity: Float[Tensor, " n"]
    """In [0, 1]."""
    colour: Float[Tensor, "n 3"]
    """RGB."""
    kept: Bool[Tensor, " n"]
    """Surfels that are not culled."""


class ScreenSurfels(NamedTuple):
    """Surfels in image space."""

    centre: Float[Tensor, "n 2"]
    """Projected centres in pixels, in the precision of the projection."""
    record: Float[Tensor, "n 15"]
    """Float32: u0, u1, v0, v1, det, a3, b3, log2_opacity, red, green, blue, depth and the normal, see `records`."""
    box: Int[Tensor, "n 4"]
    """Pixel box [x0, x1, y0, y1) that contains all alphas of 1/255 or more."""
    visible: Bool[Tensor, " n"]
    """Whether the surfel is kept and its box is not empty."""


def wide(device: torch.device) -> torch.dtype:
    """The widest type of floating-point numbers of a device.

    Args:
        device: A device.

    Returns:
        float64; float32 on Apple's GPUs.
    """
    return torch.float32 if device.type == "mps" else torch.float64


def to_camera(surfels: WorldSurfels, camera: Camera) -> CameraSurfels:
    """Transform surfels to camera axes and cull, as `projection.project_surfels` does, before the test of the box.

    Nothing is left out, and nothing waits for the device: a culled surfel is replaced by another one, which keeps its
    numbers out of all results and gives it zero gradients.

    Args:
        surfels: Surfels in world space.
        camera: Pinhole camera.

    Returns:
        The surfels in the widest precision of the device.
    """
    dtype = wide(surfels.centre.device)
    rotation, translation = camera.camera_from_world[:3, :3].tolist(), camera.camera_from_world[:3, 3].tolist()
    m = transformed(surfels.centre.to(dtype), rotation, translation)
    u, v = (transformed(tangent.to(dtype), rotation) for tangent in (surfels.tangent_u, surfels.tangent_v))
    opacity, colour = surfels.opacity.to(dtype), surfels.colour.to(dtype)
    with torch.no_grad():
        rho2 = 2 * torch.log(255 * opacity)
        squared = (u[:, 2] / m[:, 2]).square() + (v[:, 2] / m[:, 2]).square()
        kept = (m.square() + u.square() + v.square()).sum(dim=1) < MAX_SQUARED_LENGTH
        kept &= (opacity + colour.abs().sum(dim=1)).isfinite() & (opacity >= ALPHA_THRESHOLD)
        kept &= (torch.linalg.cross(u, v).norm(dim=1) > MIN_AREA) & (m[:, 2] > NEAR_PLANE)
        kept &= rho2 * squared - 1 < CAMERA_PLANE_MARGIN
    m, u, v = (_or_row(kept, *pair) for pair in ((m, (0.0, 0.0, 1.0)), (u, (1e-2, 0.0, 0.0)), (v, (0.0, 1e-2, 0.0))))
    opacity, colour = torch.where(kept, opacity, 0.5), torch.where(kept[:, None], colour, 0.0)
    return CameraSurfels(m, u, v, opacity, colour, kept)


def transformed(
    points: Float[Tensor, "n 3"], matrix: Sequence[Sequence[float]], offset: Sequence[float] = (0.0, 0.0, 0.0)
) -> Float[Tensor, "n 3"]:
    """Apply an affine map whose numbers are on the host: no tensor of them has to reach the device first.

    Args:
        points: Points.
        matrix: Three rows.
        offset: Three numbers.

    Returns:
        M x + offset of every point.
    """
    x, y, z = points.unbind(dim=1)
    return torch.stack([r[0] * x + r[1] * y + r[2] * z + t for r, t in zip(matrix, offset, strict=True)], dim=1)


def _or_row(kept: Bool[Tensor, " n"], values: Float[Tensor, "n 3"], row: tuple[float, ...]) -> Float[Tensor, "n 3"]:
    """The kept values, and a row of numbers instead of the others."""
    return torch.stack([torch.where(kept, x, other) for x, other in zip(values.unbind(dim=1), row, strict=True)], dim=1)


def facing_normal(surfels: CameraSurfels) -> Float[Tensor, "n 3"]:
    """Unit normals that face the camera.

    Args:
        surfels: Discs in camera axes.

    Returns:
        n = sign (u x v) / |u x v| with n . m <= 0.
    """
    cross = torch.linalg.cross(surfels.tangent_u, surfels.tangent_v)
    sign = torch.where((cross.detach() * surfels.centre.detach()).sum(dim=1, keepdim=True) > 0, -1.0, 1.0)
    return cross * (sign.to(cross.dtype) / cross.norm(dim=1, keepdim=True))


def project_surfels(surfels: WorldSurfels, camera: Camera) -> ScreenSurfels:
    """Project surfels to records and pixel boxes, as `projection.project_surfels`.

    Args:
        surfels: Surfels in world space.
        camera: Pinhole camera.

    Returns:
        The surfels in image space; centres and records are differentiable.
    """
    discs = to_camera(surfels, camera)
    m, u, v = discs.centre, discs.tangent_u, discs.tangent_v
    iz = 1 / m[:, 2]
    xh, yh, p, q = m[:, 0] * iz, m[:, 1] * iz, u[:, 2] * iz, v[:, 2] * iz
    u0, u1 = camera.fx * (u[:, 0] * iz - xh * p), camera.fx * (v[:, 0] * iz - xh * q)
    v0, v1 = camera.fy * (u[:, 1] * iz - yh * p), camera.fy * (v[:, 1] * iz - yh * q)
    centre = torch.stack([camera.fx * xh + camera.cx, camera.fy * yh + camera.cy], dim=1)
    numbers = (
        u0, u1, v0, v1, u0 * v1 - u1 * v0, v0 * q - v1 * p, u1 * p - u0 * q, torch.log2(discs.opacity),
        *discs.colour.unbind(dim=1), m[:, 2], *facing_normal(discs).unbind(dim=1),
    )  # fmt: skip
    with torch.no_grad():
        rho2 = 2 * torch.log(255 * discs.opacity)
        x0, x1 = _pixel_range(centre[:, 0], u0, u1, p, q, rho2, camera.width)
        y0, y1 = _pixel_range(centre[:, 1], v0, v1, p, q, rho2, camera.height)
        visible = discs.kept & (x1 > x0) & (y1 > y0)
        box = torch.where(visible[:, None], torch.stack([x0, x1, y0, y1], dim=1), 0).long()
    return ScreenSurfels(centre, torch.stack(numbers, dim=1).float(), box, visible)


def _pixel_range(
    centre: Float[Tensor, " n"],
    a: Float[Tensor, " n"],
    b: Float[Tensor, " n"],
    p: Float[Tensor, " n"],
    q: Float[Tensor, " n"],
    rho2: Float[Tensor, " n"],
    size: int,
) -> tuple[Float[Tensor, " n"], Float[Tensor, " n"]]:
    """Half-open range of the pixels whose centres lie in the visible extent along one axis (`projection._extent`)."""
    e = rho2 * (p * p + q * q) - 1
    middle = rho2 * (a * p + b * q) / e
    half = (middle * middle - rho2 * (a * a + b * b) / e).clamp_min(0).sqrt()
    low, high = centre + middle - half, centre + middle + half
    first = (low - 0.5 - BOX_MARGIN).clamp_min(0).ceil()
    return first, (high - 0.5 + BOX_MARGIN).clamp_max(size - 1).floor() + 1
