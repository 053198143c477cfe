"""Images as network input: resized with antialiasing, cropped or padded to a square, normalised."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

if TYPE_CHECKING:
    import torch

CROPS = ("center", "pad_square")
CLIP_STATISTICS = ((0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711))
IMAGENET_STATISTICS = ((0.485, 0.456, 0.406), (0.229, 0.224, 0.225))


def preprocess(
    image: Float[np.ndarray, "h w 3"],
    size: int,
    statistics: tuple[tuple[float, float, float], tuple[float, float, float]],
    crop: str,
    background: float = 1.0,
) -> torch.Tensor:
    """Resize, crop and normalise an image as CLIP's and DINO's own pipelines do (bicubic, antialiased).

    Args:
        image: Image with values in [0, 1].
        size: Height and width of the result in pixels.
        statistics: Mean and standard deviation of the channels to normalise by.
        crop: `center` scales the shorter side to `size` and cuts out the middle (CLIP's pipeline); `pad_square` pads
            the shorter side first, so that nothing is cut.
        background: Grey value of the padding.

    Returns:
        Float32 tensor (3, size, size).
    """
    import torch
    from torch.nn import functional

    pixels = torch.from_numpy(np.array(image, np.float32)).permute(2, 0, 1)[None]
    if crop == "pad_square":
        height, width = pixels.shape[-2:]
        side = max(height, width)
        left, top = (side - width) // 2, (side - height) // 2
        margins = (left, side - width - left, top, side - height - top)
        pixels = functional.pad(pixels, margins, value=background)
    # The longer side is truncated, not rounded, and the filter is antialiased, as in CLIP's training pipeline.
    shorter = min(pixels.shape[-2:])
    shape = [int(size * length / shorter) for length in pixels.shape[-2:]]
    for target in ((pixels.shape[2], shape[1]), shape):  # one axis after the other, with clamping between, as PIL
        pixels = functional.interpolate(pixels, target, mode="bicubic", antialias=True, align_corners=False).clamp(0, 1)
    top, left = (round((length - size) / 2) for length in shape)
    pixels = pixels[0, :, top : top + size, left : left + size]
    mean, deviation = (torch.tensor(values)[:, None, None] for values in statistics)
    return (pixels - mean) / deviation
