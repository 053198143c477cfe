"""Mattes that do not flicker: alpha of the frame before, carried along by the motion of the image."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from carigs.matting.channels import largest

FLOW_SIDE = 256
"""Largest side of the images that motion is estimated in, in pixels."""
AGREEMENT = 6.0
"""Difference between a frame and the moved one before it at which the weight is 1 / e, in levels of 8 bits."""


class Motion(NamedTuple):
    """Where the pixels of a frame were in the frame before."""

    x: Float32[np.ndarray, "h w"]
    """Columns in the frame before, in pixels from the centre of the first one."""
    y: Float32[np.ndarray, "h w"]
    agreement: Float32[np.ndarray, "h w"]
    """Weight in [0, 1]: 1 where both frames show the same."""


class ImageMotion:
    """Motion from frame to frame; state is the frame before."""

    def __init__(self) -> None:
        self._flow = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
        self._grey: np.ndarray | None = None
        self._image: np.ndarray | None = None

    def __call__(self, image: UInt8[np.ndarray, "h w 3"]) -> Motion | None:
        """Estimate the motion of the next frame.

        Args:
            image: The frame.

        Returns:
            The motion; None for the first frame.
        """
        height, width = image.shape[:2]
        scale = min(1.0, FLOW_SIDE / max(height, width))
        size = max(round(width * scale), 16), max(round(height * scale), 16)
        grey = cv2.cvtColor(cv2.resize(image, size, interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY)
        motion = None
        if self._grey is not None:
            flow = cv2.resize(self._flow.calc(grey, self._grey, None), (width, height))
            x = flow[..., 0] * np.float32(width / size[0]) + np.arange(width, dtype=np.float32)
            y = flow[..., 1] * np.float32(height / size[1]) + np.arange(height, dtype=np.float32)[:, None]
            moved = cv2.remap(self._image, x, y, cv2.INTER_LINEAR)
            difference = largest(cv2.blur(cv2.absdiff(moved, image), (3, 3))).astype(np.float32)
            motion = Motion(x, y, np.exp(-((difference / AGREEMENT) ** 2), dtype=np.float32))
        self._grey, self._image = grey, image
        return motion


class SteadyMatte:
    """Filter of the mattes of consecutive frames; state is the matte before."""

    def __init__(self, share: float, keep_certain: bool = False) -> None:
        """Start with the first frame.

        Args:
            share: Weight of the frame before where both agree; the frames before it have less and less.
            keep_certain: Leave pixels as they are whose alpha is 0 or 1.
        """
        self._share, self._keep_certain = share, keep_certain
        self._alpha: np.ndarray | None = None

    def __call__(self, alpha: Float32[np.ndarray, "h w"], motion: Motion | None) -> Float32[np.ndarray, "h w"]:
        """Mix alpha with that of the frame before where both frames show the same.

        Args:
            alpha: The matte of the next frame.
            motion: Of that frame; None for the first one.

        Returns:
            The steadier matte.
        """
        if motion is not None:
            moved = cv2.remap(self._alpha, motion.x, motion.y, cv2.INTER_LINEAR)
            share = self._share * motion.agreement
            if self._keep_certain:
                share *= (alpha > 0) & (alpha < 1)
            alpha = alpha + share * (moved - alpha)
        self._alpha = alpha
        return alpha
