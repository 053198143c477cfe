"""Files of world-space splats without a rig: .ply of 3D and 2D Gaussian Splatting, and .splat."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from carigs.splat.colour.spherical_harmonics import SH_BASE, num_coefficients
from carigs.splat.formats.world_splats import WorldSplats
from carigs.splat.surfels.ply import numbered, write_float_ply
from carigs.system.files import writing

REST = num_coefficients(3)  # viewers of 3D Gaussian Splatting expect degree 3
THICKNESS = 1e-6
"""Standard deviation along the normal in metres, where a format has three scales: flat, and its logarithm is finite."""
SURFEL_MARK = "SplatRenderMode: 2dgs"
"""Comment of a .ply by which splat-transform and its viewers know surfels; they also lack `scale_2`."""
RECORD = np.dtype([("position", "<f4", 3), ("scale", "<f4", 3), ("rgba", "u1", 4), ("rotation", "u1", 4)])
"""A splat of a .splat file (antimatter15): 32 bytes."""


def write_3dgs_ply(file: Path, splats: WorldSplats) -> None:
    """Write a .ply with the 62 properties of 3D Gaussian Splatting (Kerbl et al. 2023), in their order.

    Args:
        file: Path to write.
        splats: Splats in world coordinates; `THICKNESS` becomes the third scale.
    """
    write_float_ply(file, _columns(splats, 3))


def write_2dgs_ply(file: Path, splats: WorldSplats) -> None:
    """Write a .ply with the 61 properties of 2D Gaussian Splatting (Huang et al. 2024): without `scale_2`.

    Args:
        file: Path to write.
        splats: Splats in world coordinates.
    """
    write_float_ply(file, _columns(splats, 2), SURFEL_MARK)


def write_splat(file: Path, splats: WorldSplats) -> None:
    """Write a .splat file: records of 32 bytes without a header, the largest and most opaque splats first.

    View-dependent colour is left out; colours, opacities and rotations are rounded to 8 bits.

    Args:
        file: Path to write.
        splats: Splats in world coordinates; `THICKNESS` becomes the third scale.
    """
    order = np.argsort(-splats.scale.prod(axis=1) * splats.opacity, kind="stable")
    rgba = np.concatenate([0.5 + SH_BASE * splats.colour, splats.opacity[:, None]], axis=1)
    records = np.empty(len(order), RECORD)
    records["position"] = splats.centre
    records["scale"] = three_scales(splats)
    records["rgba"] = (255 * rgba.clip(0, 1)).round()
    records["rotation"] = (128 * splats.rotation + 128).round().clip(0, 255)
    with writing(file) as part:
        part.write_bytes(records[order].tobytes())


def three_scales(splats: WorldSplats) -> np.ndarray:
    """Standard deviations along all three axes.

    Args:
        splats: Splats in world coordinates.

    Returns:
        Metres, (n, 3); the third is `THICKNESS`.
    """
    return np.column_stack([splats.scale, np.full(len(splats.scale), THICKNESS)])


def _columns(splats: WorldSplats, scales: int) -> dict[str, np.ndarray]:
    n = len(splats.centre)
    rest = np.zeros((n, REST, 3))
    rest[:, : splats.harmonics.shape[1]] = splats.harmonics
    blocks = [
        ("xyz", splats.centre),
        (("nx", "ny", "nz"), np.zeros((n, 3))),
        (numbered("f_dc", 3), splats.colour),
        (numbered("f_rest", 3 * REST), rest.transpose(0, 2, 1).reshape(n, -1)),  # channel by channel
        (("opacity",), np.log(splats.opacity / (1 - splats.opacity))[:, None]),
        (numbered("scale", scales), np.log(three_scales(splats))[:, :scales]),
        (numbered("rot", 4), splats.rotation),
    ]
    return {name: value[:, k] for names, value in blocks for k, name in enumerate(names)}
