"""L1 and SSIM in plain PyTorch: the twin of `training.photometric_loss`, whose formulas are in `training.ssim`."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from carigs.splat.training.ssim import C1, C2, RADIUS

SIGMA = 1.5


def photometric_loss(
    image: Float[Tensor, "h w 3"],
    target: Float[Tensor, "h w 3"],
    ssim_weight: float = 0.2,
    valid: Bool[Tensor, "h w"] | None = None,
    emphasis: Float[Tensor, "h w"] | None = None,
) -> Float[Tensor, ""]:
    """(1 - lambda) mean |image - target| + lambda (1 - mean SSIM), see `training.photometric_loss`.

    Args:
        image: Rendered RGB; the loss is differentiable with respect to it.
        target: RGB of the frame or GT* target.
        ssim_weight: Weight lambda in [0, 1].
        valid: Pixels that supervise; all if None.
        emphasis: Factors on the gradient of each pixel, not on the value; all 1 if None.

    Returns:
        The loss.
    """
    if emphasis is not None:
        image = image.detach() + emphasis[..., None] * (image - image.detach())  # the same values
    if valid is not None:
        target = torch.where(valid[..., None], target, image.detach())
        image = torch.where(valid[..., None], image, image.detach())
    return (1 - ssim_weight) * (image - target).abs().mean() + ssim_weight * (1 - similarity(image, target).mean())


def similarity(x: Float[Tensor, "h w c"], y: Float[Tensor, "h w c"]) -> Float[Tensor, "c h w"]:
    """SSIM of every pixel and channel (Wang et al. 2004), as in `training.ssim`.

    Args:
        x: An image.
        y: Another one.

    Returns:
        At most 1.
    """
    x, y = x.permute(2, 0, 1), y.permute(2, 0, 1)
    m, n, squares, product = _filtered(torch.stack([x, y, x * x + y * y, x * y]))
    mn, mm_nn = m * n, m * m + n * n
    a1, a2 = 2 * mn + float(C1), 2 * (product - mn) + float(C2)
    return a1 * a2 / ((mm_nn + float(C1)) * (squares - mm_nn + float(C2)))


def _filtered(planes: Float[Tensor, "m c h w"]) -> Float[Tensor, "m c h w"]:
    """Convolve with eleven Gaussian taps along either axis; zeros around the image."""
    taps = torch.exp(-(torch.arange(-RADIUS, RADIUS + 1, device=planes.device) ** 2) / (2 * SIGMA**2))
    taps = (taps / taps.sum()).to(planes.dtype)
    rows = planes.reshape(-1, 1, *planes.shape[2:])
    rows = torch.nn.functional.conv2d(rows, taps.reshape(1, 1, 1, -1), padding=(0, RADIUS))
    return torch.nn.functional.conv2d(rows, taps.reshape(1, 1, -1, 1), padding=(RADIUS, 0)).reshape(planes.shape)
