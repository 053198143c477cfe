"""What is learned: the surfels' attributes before activation, each surfel bound to one triangle."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from carigs.splat.colour.spherical_harmonics import SH_BASE, num_coefficients

BLEND_OWN, BLEND_NEIGHBOUR = 0.9, 0.05
"""Initial sigmoids of the blend weights (SurFhead)."""


@dataclass
class Surfels:
    """Attributes of n surfels in units of their triangles, sorted by triangle."""

    position: Float[Tensor, "n 3"]
    """In the canonical triangle's frame, in units of its scale k."""
    rotation: Float[Tensor, "n 4"]
    """Quaternion wxyz, not normalised, in that frame; the third axis is the disc's normal."""
    log_scale: Float[Tensor, "n 2"]
    """Logarithm of the standard deviations along the first two axes, in units of k."""
    opacity: Float[Tensor, "n"]
    """Logit."""
    colour: Float[Tensor, "n 3"]
    """Spherical harmonic of degree 0: RGB = 0.5 + SH_BASE * colour."""
    harmonics: Float[Tensor, "n k 3"]
    """Higher degrees, k = (degree + 1)^2 - 1."""
    blend: Float[Tensor, "n 4"]
    """Logits of the blend weights: own face, then its neighbours."""
    binding: Int[np.ndarray, "n"]
    """Index of the triangle, ascending: neighbours on the mesh are neighbours in memory."""

    def __len__(self) -> int:
        return len(self.binding)

    @property
    def sh_degree(self) -> int:
        """Degree of the spherical harmonics."""
        return round((self.harmonics.shape[1] + 1) ** 0.5) - 1

    def attributes(self) -> Iterator[tuple[str, Tensor]]:
        """Name and tensor of every learned attribute."""
        for name in ATTRIBUTES:
            yield name, getattr(self, name)

    def detached(self) -> Surfels:
        """Fresh leaves with the same values, ready for gradients."""
        leaves = {name: value.detach().clone().requires_grad_(True) for name, value in self.attributes()}
        return Surfels(**leaves, binding=self.binding.copy())


ATTRIBUTES = tuple(f.name for f in fields(Surfels) if f.name != "binding")


def from_arrays(binding: Int[np.ndarray, "n"], **arrays: np.ndarray) -> Surfels:
    """Surfels as float32 leaves from arrays of every attribute; they are sorted by triangle."""
    order = np.argsort(binding, kind="stable")
    leaves = {name: torch.from_numpy(np.ascontiguousarray(arrays[name][order], np.float32)) for name in ATTRIBUTES}
    return Surfels(
        **{n: leaf.requires_grad_(True) for n, leaf in leaves.items()}, binding=binding[order].astype(np.int32)
    )


def to_arrays(surfels: Surfels) -> dict[str, np.ndarray]:
    """Every attribute and the binding as arrays."""
    return {name: value.detach().numpy() for name, value in surfels.attributes()} | {"binding": surfels.binding}


def flat_discs(
    binding: Int[np.ndarray, "n"],
    position: Float[np.ndarray, "n 3"],
    scale: Float[np.ndarray, "n"],
    opacity: float,
    rgb: Float[np.ndarray, "n 3"],
    sh_degree: int = 0,
) -> Surfels:
    """Round discs in their triangles' planes.

    Positions and scales are in units of the triangles, opacity and colour after activation; blend weights start as in
    SurFhead.
    """
    n = len(binding)
    blend = np.array([BLEND_OWN] + 3 * [BLEND_NEIGHBOUR])
    return from_arrays(
        np.asarray(binding),
        position=position,
        rotation=np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)),
        log_scale=np.log(np.repeat(np.asarray(scale)[:, None], 2, axis=1)),
        opacity=np.full(n, np.log(opacity / (1 - opacity))),
        colour=(rgb - 0.5) / SH_BASE,
        harmonics=np.zeros((n, num_coefficients(sh_degree), 3)),
        blend=np.tile(np.log(blend / (1 - blend)), (n, 1)),
    )
