"""Rules for the surfels of hair and of the skin below it, in plain PyTorch: the twins of `HairSurfels`' methods."""

from __future__ import annotations

import math

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from carigs.hair.bare_skin import CELL
from carigs.splat.rasterizer.torch_projection import wide
from carigs.splat.surfels.surfels import Surfels
from carigs.splat.training.device.mesh import DeviceMesh
from carigs.splat.training.initial_surfels.hair_surfels import COVERED_POSITION, COVERED_SCALE, FADING, HairSurfels


class HairRules:
    """Hair in a training, as tensors on a device.

    Args:
        hair: The hair.
        mesh: The rig on the device.
        device: The device.
    """

    def __init__(self, hair: HairSurfels, mesh: DeviceMesh, device: torch.device) -> None:
        self._mesh, self._type = mesh, wide(device)
        self._scalp, self._covered, self._hidden = (
            torch.from_numpy(faces).to(device) for faces in (hair.scalp, hair.covered, hair.hidden)
        )
        self._low = torch.from_numpy(hair.above_skin.low).to(self._type).to(device)
        self._inside = torch.from_numpy(hair.above_skin.grid()).to(device)
        self._size = torch.tensor(self._inside.shape, device=device)

    def keep_hidden_skin(self, surfels: Surfels, binding: Int[Tensor, " n"]) -> None:
        """Set the gradients of colours and opacities of hidden skin to zero.

        Args:
            surfels: The surfels, with gradients.
            binding: Triangle of each surfel.
        """
        inside = self._hidden[binding]
        for values in (surfels.colour, surfels.harmonics, surfels.opacity):
            if values.grad is not None:
                values.grad.masked_fill_(inside.reshape(-1, *(1,) * (values.ndim - 1)), 0)

    @torch.no_grad()
    def keep_on_covered_skin(self, surfels: Surfels, binding: Int[Tensor, " n"]) -> None:
        """Keep the surfels of covered skin on their triangles, in place.

        Args:
            surfels: The surfels.
            binding: Triangle of each surfel.
        """
        inside, position, log_scale = self._covered[binding][:, None], surfels.position, surfels.log_scale
        distance = torch.linalg.vector_norm(position, dim=1, keepdim=True).clamp_min(1e-9)
        position.copy_(torch.where(inside, position * (COVERED_POSITION / distance).clamp_max(1), position))
        log_scale.copy_(torch.where(inside, log_scale.clamp_max(math.log(COVERED_SCALE)), log_scale))

    @torch.no_grad()
    def fade_over_bare_skin(self, surfels: Surfels, binding: Int[Tensor, " n"]) -> None:
        """Make surfels of hair more transparent where there is no hair, in place.

        Args:
            surfels: The surfels.
            binding: Triangle of each surfel.
        """
        local = (self._mesh.frame[binding].to(self._type) @ surfels.position.to(self._type)[:, :, None])[:, :, 0]
        fading = self._scalp[binding] & self._contains(self._mesh.centre[binding] + local)
        surfels.opacity.sub_(fading * FADING)

    def _contains(self, points: Float[Tensor, "n 3"]) -> Bool[Tensor, " n"]:
        """As `SpaceAboveSkin.contains`."""
        if self._inside.numel() == 0:
            return torch.zeros(len(points), dtype=torch.bool, device=points.device)
        cell = ((points - self._low) / CELL).floor().nan_to_num(-1).clamp(-1, max(self._inside.shape)).long()
        on_grid = ((cell >= 0) & (cell < self._size)).all(dim=1)
        i, j, k = torch.minimum(cell.clamp_min(0), self._size - 1).unbind(dim=1)
        return self._inside[i, j, k] & on_grid
