"""Threshold losses on positions and scales in plain PyTorch: the twin of `training.regularizers.add_threshold_loss`."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from carigs.splat.surfels.surfels import Surfels


def threshold_loss(
    surfels: Surfels,
    visible: Bool[Tensor, " n"],
    position_limit: Float[Tensor, " n"],
    position_weight: float,
    scale_limit: float,
    scale_weight: float,
) -> Float[Tensor, ""]:
    """Threshold losses of GaussianAvatars (Qian et al. 2024), averaged over the visible surfels.

    Args:
        surfels: The surfels, on the device.
        visible: Surfels that count.
        position_limit: Largest distance from the triangle's centre without a loss, in units of the triangle's scale.
        position_weight: Weight of mean relu(|mu| - position_limit).
        scale_limit: Largest standard deviation without a loss, in units of the triangle's scale.
        scale_weight: Weight of mean ||relu(exp(s) - scale_limit)||.

    Returns:
        The loss, differentiable by autograd; surfels that are not visible get zero gradients.
    """
    position = torch.where(visible[:, None], surfels.position, 0.0)
    scale = torch.where(visible[:, None], surfels.log_scale, float("-inf")).exp()
    # The gradient of `vector_norm` at 0 is 0.
    far = torch.relu(torch.linalg.vector_norm(position, dim=1) - position_limit)
    large = torch.linalg.vector_norm(torch.relu(scale - scale_limit), dim=1)
    total = position_weight * far + scale_weight * large
    return torch.where(visible, total, 0.0).sum() / visible.sum().clamp_min(1)
