"""The learned surfel attributes before activation; every surfel is bound to one triangle of the mesh."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from carigs.errors import InputError
from carigs.readers.arrays import checked_array
from carigs.splat.colour.spherical_harmonics import SH_BASE, num_coefficients

BLEND_OWN, BLEND_NEIGHBOUR = 0.9, 0.05
"""Initial blend weights of a surfel's own triangle and of each neighbour, after the sigmoid (SurFhead)."""

SH_COUNTS = tuple(num_coefficients(degree) for degree in range(4))
"""Coefficients of the spherical harmonics of degree 1 and higher, for each highest degree that is possible."""

POSSIBLE = {
    "position": (-1e6, 1e6),
    "rotation": (-1e6, 1e6),
    "log_scale": (-1e4, 10.0),
    "opacity": (-1e4, 1e4),
    "colour": (-1e4, 1e4),
    "harmonics": (-1e4, 1e4),
    "blend": (-1e4, 1e4),
}
"""Smallest and largest values of a file's attributes; trained ones are smaller by far. Beyond, float32 overflows, or
one surfel covers everything: exp(10) is 22 000 times the size of its triangle."""
SMALLEST_QUATERNION = 1e-10
"""Largest entry of a quaternion that has a direction."""


@dataclass
class Surfels:
    """Attributes of n surfels in the local frames of their triangles, sorted by triangle.

    The unit of length is the triangle's scale k (see `rig.build_rig`).
    """

    position: Float[Tensor, "n 3"]
    """Centre in the frame of the canonical triangle, in units of k."""
    rotation: Float[Tensor, "n 4"]
    """Quaternion wxyz, not normalized, in that frame; the third axis of the rotation is the disc's normal."""
    log_scale: Float[Tensor, "n 2"]
    """Natural logarithm of the standard deviations along the first two axes, in units of k."""
    opacity: Float[Tensor, " n"]
    """Logit."""
    colour: Float[Tensor, "n 3"]
    """Spherical harmonic of degree 0: RGB = 0.5 + SH_BASE * colour."""
    harmonics: Float[Tensor, "n k 3"]
    """Higher degrees, k = (degree + 1)^2 - 1."""
    blend: Float[Tensor, "n 4"]
    """Logits of the blend weights: own triangle, then its three neighbours."""
    binding: Int[np.ndarray, " n"]
    """Triangle of each surfel, ascending: surfels of one triangle are contiguous in memory."""

    def __len__(self) -> int:
        return len(self.binding)

    @property
    def sh_degree(self) -> int:
        """Degree of the spherical harmonics."""
        return round((self.harmonics.shape[1] + 1) ** 0.5) - 1

    def attributes(self) -> Iterator[tuple[str, Tensor]]:
        """Iterate over the learned attributes.

        Yields:
            Name and tensor of each attribute.
        """
        for name in ATTRIBUTES:
            yield name, getattr(self, name)

    def detached(self) -> Surfels:
        """Copy the surfels to new leaf tensors.

        Returns:
            Surfels with the same values, without gradients.
        """
        leaves = {name: value.detach().clone().requires_grad_(True) for name, value in self.attributes()}
        return Surfels(**leaves, binding=self.binding.copy())


ATTRIBUTES = tuple(f.name for f in fields(Surfels) if f.name != "binding")


def from_arrays(binding: Int[np.ndarray, " n"], **arrays: np.ndarray) -> Surfels:
    """Make surfels from arrays and sort them by triangle.

    Args:
        binding: Triangle of each surfel, in any order.
        **arrays: One array per attribute (see `Surfels`), in the order of `binding`.

    Returns:
        Surfels with float32 leaf tensors.
    """
    order = np.argsort(binding, kind="stable")
    leaves = {name: torch.from_numpy(np.ascontiguousarray(arrays[name][order], np.float32)) for name in ATTRIBUTES}
    return Surfels(
        **{n: leaf.requires_grad_(True) for n, leaf in leaves.items()}, binding=binding[order].astype(np.int32)
    )


def checked_surfels(arrays: Mapping[str, np.ndarray], num_faces: int, file: str | Path, prefix: str = "") -> Surfels:
    """Make surfels from the arrays of a file.

    Args:
        arrays: One array per attribute and the binding (see `Surfels`), by name.
        num_faces: Number of the mesh's triangles.
        file: Where they come from, for messages.
        prefix: What precedes the names.

    Returns:
        Surfels with float32 leaf tensors.

    Raises:
        InputError: If an array is missing, has another shape, or holds a value that is not finite, no triangle, or out
            of range; if there are no surfels.
    """

    def take(name: str, *shape: int | None) -> np.ndarray:
        return checked_array(arrays, f"{prefix}{name}", shape, np.float32, within=POSSIBLE[name], file=file)

    binding = checked_array(arrays, f"{prefix}binding", (None,), np.int64, below=num_faces, file=file)
    n = len(binding)
    if n == 0:
        raise InputError("holds no surfels", file=file, field=f"{prefix}binding")
    rotation = take("rotation", n, 4)
    for zero in np.flatnonzero(np.abs(rotation).max(axis=1) < SMALLEST_QUATERNION)[:1]:
        raise InputError(f"the quaternion of surfel {zero} is 0", file=file, field=f"{prefix}rotation")
    harmonics = take("harmonics", n, None, 3)
    if harmonics.shape[1] not in SH_COUNTS:
        problem = f"{harmonics.shape[1]} coefficients; {', '.join(map(str, SH_COUNTS))} are possible"
        raise InputError(problem, file=file, field=f"{prefix}harmonics")
    return from_arrays(
        binding,
        position=take("position", n, 3),
        rotation=rotation,
        log_scale=take("log_scale", n, 2),
        opacity=take("opacity", n),
        colour=take("colour", n, 3),
        harmonics=harmonics,
        blend=take("blend", n, 4),
    )


def to_arrays(surfels: Surfels) -> dict[str, np.ndarray]:
    """Every attribute and the binding as arrays, by name.

    Args:
        surfels: Surfels.

    Returns:
        Views of the tensors, or copies of those that are on a device, and the binding.
    """
    return {name: value.detach().cpu().numpy() for name, value in surfels.attributes()} | {"binding": surfels.binding}


def flat_discs(
    binding: Int[np.ndarray, " n"],
    position: Float[np.ndarray, "n 3"],
    scale: Float[np.ndarray, " n"] | Float[np.ndarray, "n 2"],
    opacity: float | Float[np.ndarray, " n"],
    rgb: Float[np.ndarray, "n 3"],
    sh_degree: int = 0,
    rotation: Float[np.ndarray, "n 4"] | None = None,
) -> Surfels:
    """Make discs with SurFhead's initial blend weights, in the planes of their triangles unless a rotation is given.

    Args:
        binding: Triangle of each surfel.
        position: Centres in the triangles' frames, in units of k.
        scale: Standard deviations in units of k, one for round discs or one along each axis.
        opacity: Opacities after the sigmoid: one each, or one for all.
        rgb: Colours.
        sh_degree: Degree of the spherical harmonics; degrees 1 and higher start at zero.
        rotation: Quaternions (w, x, y, z).

    Returns:
        Surfels, sorted by triangle.
    """
    n = len(binding)
    scale = np.asarray(scale)
    return from_arrays(
        np.asarray(binding),
        position=position,
        rotation=np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)) if rotation is None else rotation,
        log_scale=np.log(np.broadcast_to(scale if scale.ndim == 2 else scale[:, None], (n, 2))),
        opacity=np.broadcast_to(np.log(opacity / (1 - opacity)), n),
        colour=(rgb - 0.5) / SH_BASE,
        harmonics=np.zeros((n, num_coefficients(sh_degree), 3)),
        blend=initial_blend(n),
    )


def initial_blend(n: int) -> Float[np.ndarray, "n 4"]:
    """Initial logits of the blend weights (SurFhead).

    Args:
        n: Number of surfels.

    Returns:
        The same row for every surfel.
    """
    weight = np.array([BLEND_OWN] + 3 * [BLEND_NEIGHBOUR])
    return np.tile(np.log(weight / (1 - weight)), (n, 1))
