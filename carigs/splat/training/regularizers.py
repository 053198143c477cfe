"""Regularizers besides the images: surfels stay near their triangles and small; normals agree with depths."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from carigs.capture.camera import Camera
from carigs.simd.kernels import kernel, parallel_for
from carigs.simd.vectors import scalar_or_simd
from carigs.splat.surfels.surfels import Surfels

PART = 1024  # surfels whose terms are summed in order


def add_threshold_loss(
    surfels: Surfels,
    visible: Bool[np.ndarray, " n"],
    position_limit: Float[np.ndarray, " n"],
    position_weight: float,
    scale_limit: float,
    scale_weight: float,
) -> float:
    """Threshold losses of GaussianAvatars (Qian et al. 2024) on positions and scales.

    position_weight * mean relu(|mu| - position_limit) + scale_weight * mean ||relu(exp(s) - scale_limit)||, averaged
    over the visible surfels. The gradients are added to `.grad` of positions and scales.

    Args:
        surfels: Surfels with gradients.
        visible: Surfels that count.
        position_limit: Largest distance from the triangle's centre without a loss, in units of the triangle's scale.
        position_weight: Weight of the first term.
        scale_limit: Largest standard deviation without a loss, in units of the triangle's scale.
        scale_weight: Weight of the second term.

    Returns:
        Value of the loss.
    """
    count = int(np.count_nonzero(visible))
    if count == 0 or (position_weight == 0 and scale_weight == 0):
        return 0.0
    value = _thresholds(
        surfels.position.detach().numpy(), surfels.log_scale.detach().numpy(), visible, position_limit,
        position_weight / count, scale_limit, scale_weight / count,
        surfels.position.grad.numpy(), surfels.log_scale.grad.numpy(),
    )  # fmt: skip
    return float(value)


def normal_consistency_loss(
    normal: Float[Tensor, "h w 3"], depth: Float[Tensor, "h w"], alpha: Float[Tensor, "h w"], camera: Camera
) -> Float[Tensor, ""]:
    """Normal consistency of 2D Gaussian splatting (Huang et al. 2024): mean of sum_i w_i (1 - n_i . N).

    N is the normal of the depth map: the cross product of central differences of the back-projected mean depth.

    Args:
        normal: Rendered normals sum_i w_i n_i in camera axes.
        depth: Rendered depth sum_i w_i z_i in metres.
        alpha: Rendered opacity sum_i w_i.
        camera: The view.

    Returns:
        Mean over the inner pixels.
    """
    z = depth / alpha.clamp_min(1e-6)
    x = (torch.arange(camera.width, device=z.device) + 0.5 - camera.cx) / camera.fx
    y = (torch.arange(camera.height, device=z.device) + 0.5 - camera.cy) / camera.fy
    points = torch.stack([x[None, :] * z, y[:, None] * z, z], dim=2)
    across = points[1:-1, 2:] - points[1:-1, :-2]
    down = points[2:, 1:-1] - points[:-2, 1:-1]
    depth_normal = torch.nn.functional.normalize(torch.cross(down, across, dim=2), dim=2)  # towards the camera: z < 0
    return (alpha[1:-1, 1:-1] - (normal[1:-1, 1:-1] * depth_normal).sum(dim=2)).mean()


@scalar_or_simd
def _threshold_part(
    part, position, log_scale, visible, position_limit, position_weight, scale_limit, log_limit, scale_weight,
    d_position, d_log_scale, value,
):  # fmt: skip
    for i in range(part * PART, min((part + 1) * PART, len(visible))):
        if not visible[i]:
            continue
        # Few surfels exceed a limit: the others need no square root and no exponential.
        square = position[i, 0] ** 2 + position[i, 1] ** 2 + position[i, 2] ** 2
        if square > position_limit[i] ** 2:
            distance = np.sqrt(square)
            value[part] += position_weight * (distance - position_limit[i])
            for c in range(3):
                d_position[i, c] += position_weight * position[i, c] / distance
        if log_scale[i, 0] > log_limit or log_scale[i, 1] > log_limit:
            s, t = np.exp(log_scale[i, 0]), np.exp(log_scale[i, 1])
            over_s, over_t = max(s - scale_limit, 0.0), max(t - scale_limit, 0.0)
            over = np.sqrt(over_s**2 + over_t**2)
            if over > 0:
                value[part] += scale_weight * over
                d_log_scale[i, 0] += scale_weight * over_s / over * s
                d_log_scale[i, 1] += scale_weight * over_t / over * t


@kernel
def _thresholds(
    position, log_scale, visible, position_limit, position_weight, scale_limit, scale_weight, d_position, d_log_scale
):
    log_limit = np.log(max(scale_limit, 0.0))
    value = np.zeros((len(visible) + PART - 1) // PART)
    parallel_for(
        _threshold_part, len(value),
        (position, log_scale, visible, position_limit, position_weight, scale_limit, log_limit, scale_weight,
         d_position, d_log_scale, value),
    )  # fmt: skip
    return value.sum()
