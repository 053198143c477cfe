"""Images as input of CLIP and DINO: resized with antialiasing, cropped or padded to a square, normalised."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import UInt8

if TYPE_CHECKING:
    import torch

CROPS = ("center", "pad_square")


@dataclass(frozen=True)
class Preprocessing:
    """What is done to an image before a network sees it. Two that are equal give equal results."""

    mean: tuple[float, float, float]
    """Of the channels, for values in [0, 1]."""
    deviation: tuple[float, float, float]
    """Standard deviation of the channels."""
    crop: str = "center"
    """`center` scales the shorter side to `size` and cuts out the middle, as CLIP's own pipeline does. `pad_square`
    pads the shorter side first, so that nothing is cut."""
    background: int = 255
    """Grey value of the padding, from 0 to 255."""
    size: int = 224
    """Height and width of the result in pixels."""

    def __call__(self, image: UInt8[np.ndarray, "h w 3"]) -> torch.Tensor:
        """Resize (bicubic, antialiased), crop and normalise an image.

        Args:
            image: RGB values from 0 to 255.

        Returns:
            Float32 tensor (3, size, size).
        """
        import torch
        from torchvision.transforms import InterpolationMode
        from torchvision.transforms.v2 import functional

        pixels = torch.tensor(image).permute(2, 0, 1)
        if self.crop == "pad_square":
            height, width = image.shape[:2]
            side = max(height, width)
            left, top = (side - width) // 2, (side - height) // 2
            margins = [left, top, side - width - left, side - height - top]
            pixels = functional.pad(pixels, margins, fill=self.background)
        pixels = functional.resize(pixels, [self.size], InterpolationMode.BICUBIC, antialias=True)
        pixels = functional.center_crop(pixels, [self.size, self.size])
        return functional.normalize(functional.to_dtype(pixels, torch.float32, scale=True), self.mean, self.deviation)
