"""Which device and which rasterizer the backends `torch` and `cuda` use."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import torch

from carigs.settings import Train
from carigs.splat.rasterizer.cuda import load_gsplat, rasterize_gsplat
from carigs.splat.rasterizer.interface import Rendering
from carigs.splat.rasterizer.torch_rasterizer import rasterize_torch

Rasterizer = Callable[..., Rendering]
"""Takes surfels, camera, names of outputs, and the background."""


def open_device(settings: Train) -> tuple[torch.device, Rasterizer]:
    """Find the device of a training.

    Args:
        settings: `backend` is `torch`, which takes a GPU of NVIDIA, AMD or Apple if torch finds one, or `cuda`.

    Returns:
        The device, and the rasterizer for it.

    Raises:
        SettingsError: If `cuda` is chosen, and there is no such device, or gsplat is not installed.
    """
    if settings.backend == "cuda":
        device = torch.device("cuda")
        return device, partial(rasterize_gsplat, load_gsplat(), device=device)
    available = {"cuda": torch.cuda.is_available(), "mps": torch.backends.mps.is_available(), "cpu": True}
    return torch.device(next(name for name, there in available.items() if there)), rasterize_torch
