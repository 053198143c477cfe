"""The photometric loss of Gaussian splatting: L1 and SSIM, value and gradient fused on the CPU."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Bool, Float

from carigs.splat.training.ssim import l1_ssim_gradient


def photometric(
    image: Float[torch.Tensor, "h w 3"],
    target: Float[torch.Tensor, "h w 3"],
    ssim_weight: float = 0.2,
    valid: Bool[torch.Tensor, "h w"] | None = None,
) -> Float[torch.Tensor, ""]:
    """(1 - w) mean|image - target| + w (1 - mean SSIM), both means over all pixels of the image (3DGS, equation 7).

    Where `valid` is false the render itself is put into the target, and the gradient of both terms is zero: SSIM's
    window would leak otherwise.  Differentiable with respect to `image` alone, on the CPU.
    """
    return _Photometric.apply(image, target, ssim_weight, valid)


class _Photometric(torch.autograd.Function):
    """The forward pass already has everything that the gradient needs, so it computes it."""

    @staticmethod
    def forward(ctx, image, target, ssim_weight, valid):
        x, y = (t.detach().permute(2, 0, 1).contiguous().numpy() for t in (image, target))
        mask = np.ones(x.shape[1:], bool) if valid is None else valid.contiguous().numpy()
        value, gradient = l1_ssim_gradient(x, y, mask, ssim_weight)
        ctx.gradient = torch.from_numpy(gradient).permute(1, 2, 0)
        return torch.tensor(value, dtype=image.dtype)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, upstream):
        return ctx.gradient if upstream == 1 else ctx.gradient * upstream, None, None, None
