"""The colour of a surfel along a view direction in plain PyTorch: the twin of `colour.appearance`."""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor

from carigs.splat.colour.spherical_harmonics import SH_BASE


def seen_colour(
    base: Float[Tensor, "n 3"],
    harmonics: Float[Tensor, "n k 3"],
    direction: Float[Tensor, "n 3"] | None,
    factor: Float[Tensor, "n 3"] | None,
) -> Float[Tensor, "n 3"]:
    """Colour of every surfel along its view direction, in its light: c = max(0, f (1/2 + Y_0 base + sum_k Y_k(d) h_k)).

    Args:
        base: Coefficients of degree 0.
        harmonics: Coefficients of degrees 1 to 3 (k = 0, 3, 8 or 15).
        direction: Unit vectors from the eye to the surfels; None if k = 0.
        factor: RGB factor of the light on each surfel's triangle; None for 1.

    Returns:
        RGB, not below 0; differentiable by autograd.
    """
    total = 0.5 + SH_BASE * base
    if harmonics.shape[1]:
        total = total + (basis(direction, harmonics.shape[1])[:, :, None] * harmonics).sum(dim=1)
    return torch.relu(total if factor is None else factor * total)


def basis(direction: Float[Tensor, "n 3"], count: int) -> Float[Tensor, "n k"]:
    """Real spherical harmonics of degrees 1 and higher, in the order and with the signs of 3D Gaussian Splatting.

    Closed forms of the functions of degrees 1 to 3 in Cartesian coordinates (Sloan 2008, appendix A2).

    Args:
        direction: Unit vectors.
        count: Number k of functions: 3, 8 or 15.

    Returns:
        Values of the functions.
    """
    x, y, z = direction.unbind(dim=1)
    a = math.sqrt(3 / math.pi) / 2
    functions = [-a * y, a * z, -a * x]
    if count > 3:
        b, c, d = (math.sqrt(n / math.pi) / m for n, m in ((15, 2), (5, 4), (15, 4)))
        functions += [b * x * y, -b * y * z, c * (2 * z * z - x * x - y * y), -b * x * z, d * (x * x - y * y)]
    if count > 8:
        e, f, g, h, i = (math.sqrt(n / math.pi) / m for n, m in ((17.5, 4), (105, 2), (10.5, 4), (7, 4), (105, 4)))
        xx, yy, zz = x * x, y * y, z * z
        functions += [
            -e * y * (3 * xx - yy), f * x * y * z, -g * y * (4 * zz - xx - yy), h * z * (2 * zz - 3 * xx - 3 * yy),
            -g * x * (4 * zz - xx - yy), i * z * (xx - yy), -e * x * (xx - 3 * yy),
        ]  # fmt: skip
    return torch.stack(functions, dim=1)
