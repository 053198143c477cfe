"""Mattes that do not flicker: alpha of the frame before, carried along by the motion of the image."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

FLOW_SIDE = 256
"""Largest side of the images that motion is estimated in, in pixels."""
AGREEMENT = 6.0
"""Difference between a frame and the moved one before it at which the weight is 1 / e, in levels of 8 bits."""


class SteadyMatte:
    """Filter of the mattes of consecutive frames: state is the frame before and its alpha."""

    def __init__(self, share: float, keep_certain: bool = False) -> None:
        """Start with the first frame.

        Args:
            share: Weight of the frame before where both agree; the frames before it have less and less.
            keep_certain: Leave pixels as they are whose alpha is 0 or 1.
        """
        self._share, self._keep_certain = share, keep_certain
        self._flow = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
        self._grey: np.ndarray | None = None
        self._image: np.ndarray | None = None
        self._alpha: np.ndarray | None = None

    def __call__(
        self, image: UInt8[np.ndarray, "h w 3"], alpha: Float32[np.ndarray, "h w"]
    ) -> Float32[np.ndarray, "h w"]:
        """Mix alpha with that of the frame before where both frames show the same.

        Args:
            image: The next frame.
            alpha: Its matte.

        Returns:
            The steadier matte.
        """
        height, width = alpha.shape
        scale = min(1.0, FLOW_SIDE / max(height, width))
        size = max(round(width * scale), 16), max(round(height * scale), 16)
        grey = cv2.cvtColor(cv2.resize(image, size, interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY)
        if self._grey is not None:
            flow = cv2.resize(self._flow.calc(grey, self._grey, None), (width, height))
            flow *= np.array([width / size[0], height / size[1]], np.float32)
            y, x = np.mgrid[:height, :width].astype(np.float32)
            places = x + flow[..., 0], y + flow[..., 1]
            moved = [cv2.remap(part, *places, cv2.INTER_LINEAR) for part in (self._image, self._alpha)]
            difference = cv2.blur(cv2.absdiff(moved[0], image), (3, 3)).max(axis=2)
            share = self._share * np.exp(-((difference / AGREEMENT) ** 2), dtype=np.float32)
            if self._keep_certain:
                share *= (alpha > 0) & (alpha < 1)
            alpha = alpha + share * (moved[1] - alpha)
        self._grey, self._image, self._alpha = grey, image, alpha
        return alpha
