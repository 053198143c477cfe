"""Gradient statistics of density control on a device: the twin of `density.GradientStatistics`."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float64

from carigs.capture import Camera
from carigs.splat.rasterizer.interface import Screen
from carigs.splat.rasterizer.torch_projection import wide
from carigs.splat.training.density import GradientStatistics


class DeviceStatistics(GradientStatistics):
    """Mean screen-space positional gradient of every surfel over the views that saw it.

    Args:
        start: What to continue.
        device: The device.
    """

    def __init__(self, start: GradientStatistics, device: torch.device) -> None:
        self._total, self._views = (
            torch.from_numpy(values).to(wide(device)).to(device) for values in (start.total, start.views)
        )

    def add(self, screen: Screen, camera: Camera) -> None:
        """Add the gradients of one view, in units of half the image (NDC).

        Args:
            screen: Screen-space gradients (1/pixel) and visibility of the surfels, on the device.
            camera: The view.
        """
        x, y = screen.gradient.to(self._total.dtype).unbind(dim=1)
        length = ((x * (camera.width / 2)).square() + (y * (camera.height / 2)).square()).sqrt()
        self._total += torch.where(screen.visible, length, torch.zeros_like(length))
        self._views += screen.visible

    @property
    def total(self) -> Float64[np.ndarray, " n"]:
        """Sums of the gradients, copied to the host."""
        return self._total.cpu().double().numpy()

    @property
    def views(self) -> Float64[np.ndarray, " n"]:
        """Numbers of views, copied to the host."""
        return self._views.cpu().double().numpy()
