"""The photometric loss of Gaussian splatting, L1 and SSIM: value and gradient in one pass on the CPU."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Bool, Float

from carigs.splat.training.ssim import l1_ssim_loss


def photometric_loss(
    image: Float[torch.Tensor, "h w 3"],
    target: Float[torch.Tensor, "h w 3"],
    ssim_weight: float = 0.2,
    valid: Bool[torch.Tensor, "h w"] | None = None,
    emphasis: Float[torch.Tensor, "h w"] | None = None,
) -> Float[torch.Tensor, ""]:
    """Weighted sum of L1 and SSIM terms, (1 - lambda) mean |image - target| + lambda (1 - mean SSIM(image, target)).

    Equation 7 of 3D Gaussian splatting (Kerbl et al. 2023), lambda = `ssim_weight`, with both means over all pixels of
    the image. Where `valid` is false the target is replaced by the image, and the gradient of both terms is zero:
    otherwise SSIM's window would pass on gradients of invalid pixels.

    Args:
        image: Rendered RGB; the loss is differentiable with respect to it.
        target: RGB of the frame or GT* target.
        ssim_weight: Weight lambda in [0, 1].
        valid: Pixels that supervise; all if None.
        emphasis: Factors on the gradient of each pixel, not on the value; all 1 if None.

    Returns:
        The loss.
    """
    return _PhotometricLoss.apply(image, target, ssim_weight, valid, emphasis)


class _PhotometricLoss(torch.autograd.Function):
    """The gradient needs what the forward pass computes, so the forward pass computes it, too."""

    @staticmethod
    def forward(ctx, image, target, ssim_weight, valid, emphasis):
        x, y = (t.detach().permute(2, 0, 1).contiguous().numpy() for t in (image, target))
        mask = np.ones(x.shape[1:], bool) if valid is None else valid.contiguous().numpy()
        value, gradient = l1_ssim_loss(x, y, mask, ssim_weight)
        if emphasis is not None:
            gradient *= emphasis.numpy()
        ctx.gradient = torch.from_numpy(gradient).permute(1, 2, 0)
        return torch.tensor(value, dtype=image.dtype)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, upstream):
        return ctx.gradient if upstream == 1 else ctx.gradient * upstream, None, None, None, None
