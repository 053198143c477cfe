"""Which device and which rasterizer the backends `torch` and `cuda` use."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import torch

from carigs.errors import SettingsError
from carigs.settings import Train
from carigs.splat.rasterizer.cuda import load_gsplat, rasterize_gsplat
from carigs.splat.rasterizer.interface import Rendering
from carigs.splat.rasterizer.torch_rasterizer import rasterize_torch

Rasterizer = Callable[..., Rendering]
"""Takes surfels, camera, names of outputs, and the background."""


def open_device(settings: Train) -> tuple[torch.device, Rasterizer]:
    """Find the device of a training.

    Args:
        settings: `backend` is `torch` or `cuda`; `device` is where `torch` computes.

    Returns:
        The device, and the rasterizer for it.

    Raises:
        SettingsError: If torch has no such device here, or gsplat is needed and not installed.
    """
    if settings.backend == "cuda":
        device = torch.device("cuda")
        return device, partial(rasterize_gsplat, load_gsplat(), device=device)
    available = {"cuda": torch.cuda.is_available(), "mps": torch.backends.mps.is_available(), "cpu": True}
    name = settings.device
    if name == "auto":
        name = next(name for name, there in available.items() if there)
    if not available[name]:
        raise SettingsError(f"train.device={name}: torch sees no such device here")
    return torch.device(name), rasterize_torch
