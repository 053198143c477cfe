"""Jacobian blend skinning in plain PyTorch: the twin of `rig.skinning`, whose formulas are in `rig.jacobian_blend`.

Where a surfel is not finite, its gradients are not either; the step clears those of surfels that no image shows.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from carigs.splat.rig.face_motion import CENTRE, RELATIVE_ROTATION, ROTATION, STRETCH, SYMMETRIC
from carigs.splat.rig.jacobian_blend import MIN_LENGTH, MIN_LOGIT
from carigs.splat.rig.skinning import SkinnedSurfels
from carigs.splat.surfels.surfels import Surfels
from carigs.splat.training.device.mesh import DeviceMesh

TERMS = 12
"""Terms of the series of sin(t)/t and (1 - cos t)/t^2 in t^2: the first one left out is below 1e-13 up to pi."""


def skin(
    surfels: Surfels,
    binding: Int[Tensor, " n"],
    mesh: DeviceMesh,
    records: Float[Tensor, "f 32"],
    *,
    blend: bool = True,
    eye: Float[np.ndarray, "3"] | None = None,
    rotate_directions: bool = True,
) -> SkinnedSurfels:
    """Carry the surfels to the posed mesh, as `rig.skinning.jacobian_blend_skinning`.

    Args:
        surfels: Surfels in the frames of the triangles, on the device.
        binding: Triangle of each surfel.
        mesh: The rig.
        records: Motion of the triangles, `FaceMotion.records`.
        blend: Whether neighbours are blended.
        eye: Centre of the camera in world coordinates; view directions are computed only if it is given.
        rotate_directions: Whether view directions are given in the axes of the canonical head.

    Returns:
        The surfels in world coordinates, differentiable by autograd.
    """
    own = records.index_select(0, binding)
    stretch, rotation = own[:, STRETCH:CENTRE], own[:, ROTATION:RELATIVE_ROTATION].reshape(-1, 3, 3)
    if blend:
        weight = torch.sigmoid(surfels.blend.clamp_min(MIN_LOGIT))
        weight = weight / weight.sum(dim=1, keepdim=True)
        around = records[:, STRETCH:CENTRE].index_select(0, mesh.neighbours[binding].reshape(-1)).reshape(-1, 3, 6)
        stretch = weight[:, :1] * stretch + (weight[:, 1:, None] * around).sum(dim=1)
        turn = own[:, RELATIVE_ROTATION : RELATIVE_ROTATION + 9].reshape(-1, 3, 3)
        rotation = rotation @ rotation_matrix((weight[:, 1:, None] * turn).sum(dim=1))
    numbers = stretch.unbind(dim=1)
    stretch, frame = torch.stack([numbers[k] for k in SYMMETRIC], dim=1).reshape(-1, 3, 3), mesh.frame[binding]
    axes = frame @ (disc_axes(surfels.rotation) * surfels.log_scale.exp()[:, None, :])
    kept = mesh.kept[binding][:, None, None]
    centre = stretch @ (frame @ surfels.position[:, :, None])
    columns = rotation @ torch.cat([centre, kept * axes + (1 - kept) * (stretch @ axes)], dim=2)
    centre = columns[:, :, 0] + own[:, CENTRE:ROTATION]
    direction = None
    if eye is not None:
        # Numbers of the host, one by one: a tensor of them would have to reach the device first.
        away = torch.stack([x - float(e) for x, e in zip(centre.unbind(dim=1), eye, strict=True)], dim=1)
        direction = away / away.square().sum(dim=1, keepdim=True).clamp_min(1e-24).sqrt()
        if rotate_directions:
            direction = (rotation.transpose(1, 2) @ direction[:, :, None])[:, :, 0]
    return SkinnedSurfels(centre, columns[:, :, 1], columns[:, :, 2], torch.sigmoid(surfels.opacity), direction)


def rotation_matrix(vector: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3 3"]:
    """Rodrigues' formula, by series that have no singularity at 0.

    Args:
        vector: Rotation vectors in radians, of lengths up to pi.

    Returns:
        exp([w]) = I + sin(t)/t [w] + (1 - cos t)/t^2 [w]^2.
    """
    square = vector.square().sum(dim=1)
    a, b = (torch.full_like(square, _coefficient(TERMS - 1, n)) for n in (1, 2))
    for k in range(TERMS - 2, -1, -1):
        a, b = a * square + _coefficient(k, 1), b * square + _coefficient(k, 2)
    x, y, z = vector.unbind(dim=1)
    zero = torch.zeros_like(x)
    cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=1).reshape(-1, 3, 3)
    identity = torch.eye(3, dtype=vector.dtype, device=vector.device)
    return identity + a[:, None, None] * cross + b[:, None, None] * (cross @ cross)


def _coefficient(k: int, n: int) -> float:
    return (-1) ** k / math.factorial(2 * k + n)


def disc_axes(quaternion: Float[Tensor, "n 4"]) -> Float[Tensor, "n 3 2"]:
    """Axes of the discs, as `jacobian_blend.disc_axes`.

    Args:
        quaternion: wxyz, of any length.

    Returns:
        The first two columns of the rotation matrices.
    """
    # Divided by the largest number first: squares could overflow, or vanish.
    largest = quaternion.detach().abs().amax(dim=1, keepdim=True).clamp_min(MIN_LENGTH)
    scaled = quaternion / largest
    w, x, y, z = (scaled / scaled.square().sum(dim=1, keepdim=True).clamp_min(1).sqrt()).unbind(dim=1)
    first = [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)]
    second = [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)]
    return torch.stack([torch.stack(first, dim=1), torch.stack(second, dim=1)], dim=2)
