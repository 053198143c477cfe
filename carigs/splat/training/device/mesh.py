"""What a step needs to know of the rig, as tensors on a device."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from carigs.splat.rasterizer.torch_projection import wide
from carigs.splat.rig.rig import Rig


class DeviceMesh(NamedTuple):
    """Canonical frames and neighbours of the triangles."""

    frame: Float[Tensor, "f 3 3"]
    """`Rig.frame`."""
    kept: Float[Tensor, " f"]
    """1 where surfels keep their size (`Rig.keeps_size`), else 0."""
    neighbours: Int[Tensor, "f 3"]
    """`Rig.neighbours`."""
    centre: Float[Tensor, "f 3"]
    """Centres of the canonical triangles in metres."""


def device_mesh(rig: Rig, device: torch.device) -> DeviceMesh:
    """Copy frames and neighbours to a device.

    Args:
        rig: Canonical mesh.
        device: The device.

    Returns:
        Tensors.
    """
    centre = rig.vertices[rig.faces].mean(axis=1)
    return DeviceMesh(
        torch.from_numpy(rig.frame.copy()).to(device),
        torch.from_numpy(rig.keeps_size.astype(np.float32)).to(device),
        torch.from_numpy(rig.neighbours).long().to(device),
        torch.from_numpy(centre).to(wide(device)).to(device),
    )
