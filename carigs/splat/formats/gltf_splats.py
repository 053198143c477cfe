"""World-space splats as glTF with the extension KHR_gaussian_splatting (ratified 2026)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from carigs.splat.colour.spherical_harmonics import SH_BASE, num_coefficients
from carigs.splat.formats.gltf import ARRAY_BUFFER, POINTS, GltfBuffer, write_gltf
from carigs.splat.formats.splat_files import three_scales
from carigs.splat.formats.world_splats import WorldSplats

EXTENSION = "KHR_gaussian_splatting"


def write_gltf_splats(file: Path, splats: WorldSplats) -> None:
    """Write splats as a primitive of points, which programs without the extension show as coloured points.

    Values are those of the ratified extension: scales in metres and opacities in [0, 1], both without activation,
    quaternions xyzw, coefficients of spherical harmonics in the order of 3D Gaussian Splatting. `COLOR_0` is the colour
    of degree 0 with the opacity.

    Args:
        file: Path to write: .glb or .gltf.
        splats: Splats in world coordinates.
    """
    buffer = GltfBuffer()
    rgba = np.concatenate([0.5 + SH_BASE * splats.colour, splats.opacity[:, None]], axis=1).clip(0, 1)
    arrays = {
        "COLOR_0": rgba,
        f"{EXTENSION}:ROTATION": np.roll(splats.rotation, -1, axis=1),
        f"{EXTENSION}:SCALE": three_scales(splats),
        f"{EXTENSION}:OPACITY": splats.opacity,
        f"{EXTENSION}:SH_DEGREE_0_COEF_0": splats.colour,
    }
    for degree in (1, 2, 3):
        first = num_coefficients(degree - 1)
        for k in range(2 * degree + 1 if splats.harmonics.shape[1] > first else 0):
            arrays[f"{EXTENSION}:SH_DEGREE_{degree}_COEF_{k}"] = splats.harmonics[:, first + k]
    attributes = {"POSITION": buffer.add(splats.centre, ARRAY_BUFFER, bounds=True)}
    attributes |= {name: buffer.add(array, ARRAY_BUFFER) for name, array in arrays.items()}
    splatting = {
        "kernel": "ellipse",
        "colorSpace": "srgb_rec709_display",
        "sortingMethod": "cameraDistance",
        "projection": "perspective",
    }
    primitive = {"attributes": attributes, "mode": POINTS, "extensions": {EXTENSION: splatting}}
    write_gltf(
        file,
        buffer,
        {"extensionsUsed": [EXTENSION], "nodes": [{"mesh": 0}], "meshes": [{"primitives": [primitive]}]},
    )
