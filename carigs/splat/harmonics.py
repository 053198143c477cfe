"""View-dependent colour: real spherical harmonics of degrees 1 to 3."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor


def coefficients(degree: int) -> int:
    """Number of basis functions of degrees 1 .. `degree`."""
    return (degree + 1) ** 2 - 1


def basis(direction: Float[Tensor, "n 3"], degree: int) -> Float[Tensor, "n k"]:
    """Basis functions of degrees 1 .. `degree` at unit directions.

    Order and signs are those of 3D Gaussian splatting (Condon-Shortley phase, m = -l .. l), so that its files fit.
    """
    x, y, z = direction.unbind(1)
    terms = []
    if degree >= 1:
        terms += [-0.4886025119029199 * y, 0.4886025119029199 * z, -0.4886025119029199 * x]
    if degree >= 2:
        terms += [
            1.0925484305920792 * x * y,
            -1.0925484305920792 * y * z,
            0.31539156525252005 * (2 * z * z - x * x - y * y),
            -1.0925484305920792 * x * z,
            0.5462742152960396 * (x * x - y * y),
        ]
    if degree >= 3:
        terms += [
            -0.5900435899266435 * y * (3 * x * x - y * y),
            2.890611442640554 * x * y * z,
            -0.4570457994644658 * y * (4 * z * z - x * x - y * y),
            0.3731763325901154 * z * (2 * z * z - 3 * x * x - 3 * y * y),
            -0.4570457994644658 * x * (4 * z * z - x * x - y * y),
            1.445305721320277 * z * (x * x - y * y),
            -0.5900435899266435 * x * (x * x - 3 * y * y),
        ]
    return torch.stack(terms, dim=1)


def view_colour(
    harmonics: Float[Tensor, "n k 3"],
    centre: Float[Tensor, "n 3"],
    camera_centre: Float[Tensor, "3"],
    rotation: Float[Tensor, "n 3 3"] | None,
    degree: int,
) -> Float[Tensor, "n 3"]:
    """What the higher degrees add to the colour seen from `camera_centre`.

    With `rotation` (posed from canonical, per surfel) the harmonics live on the canonical head and turn with it: the
    view direction is rotated back.
    """
    direction = torch.nn.functional.normalize(centre - camera_centre, dim=1)
    if rotation is not None:
        direction = (rotation * direction[:, :, None]).sum(dim=1)  # R^T d
    return (basis(direction, degree)[:, :, None] * harmonics).sum(dim=1)
