"""What an editor of frames gets and returns."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from jaxtyping import Float, Float32

from carigs.capture import Camera, Frame


class ViewToEdit(NamedTuple):
    """One view of the avatar in training."""

    frame: Frame
    captured: Float32[np.ndarray, "h w 3"]
    """Its image of the capture, sRGB in [0, 1]."""
    rendered: Float32[np.ndarray, "h w 3"]
    """The avatar as it is, in [0, 1]."""
    camera: Camera
    vertices: Float[np.ndarray, "v 3"]
    """The natural head in world coordinates, in metres."""
    seed: tuple[int, ...]
    """Seed of this edit."""


class Editor(Protocol):
    """Changes one view."""

    def __call__(self, view: ViewToEdit) -> Float32[np.ndarray, "h w 3"]:
        """Edit a view.

        Args:
            view: The view.

        Returns:
            Its new image in [0, 1]; the same for equal views and seeds.
        """
