"""Shading that follows the surface: factors on colours from the ratio of irradiances of two surfaces."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int

from carigs.errors import InputError
from carigs.hair import HairShadow
from carigs.light.shadow_map import multiply_irradiance
from carigs.light.transfer import Transfer, light_transfer
from carigs.raster import Visibility
from carigs.readers.arrays import checked_array
from carigs.readers.npz import read_npz

GAMMA = 2.2
"""Approximate exponent of the sRGB curve."""
MAX_DIRECTIONS = 1000
"""Of the light of a file: each has a number for every vertex in memory. `carigs.light.fitting` finds 64."""


def irradiance_ratio(
    light: Float64[np.ndarray, "k 3"], natural: Transfer, caricature: Transfer, strength: float, limit: float
) -> Float64[np.ndarray, "v 3"]:
    """Factor on linear colours from the shading of one surface to that of another.

    The factor is (E_caricature / E_natural)^strength, clipped to [1 / limit, limit], with the irradiance E = transfer @
    light.

    Args:
        light: Light of each direction.
        natural: Transfer of the surface that the colours were seen on.
        caricature: Transfer of the other surface.
        strength: Exponent.
        limit: Largest factor.

    Returns:
        Factor of every vertex and channel.
    """
    floor = 1e-3 * max(float(light.sum(axis=0).max()), 1e-9)
    ratio = np.maximum(caricature @ light, floor) / np.maximum(natural @ light, floor)
    return np.clip(ratio**strength, 1 / limit, limit)


@dataclass(frozen=True)
class Shading:
    """The light of a capture, and how far colours follow the irradiance of a surface."""

    directions: Float64[np.ndarray, "d 3"]
    """Unit vectors towards the light in world axes."""
    light: Float64[np.ndarray, "k 3"]
    """Light of each direction, and of the head's own reflection in the last row."""
    strength: float
    """Exponent of the ratio of irradiances. Below 1, because diffuse light explains neither gloss nor subsurface
    scattering."""
    limit: float
    """Largest factor on linear colours; its inverse is the smallest."""
    kept: Bool[np.ndarray, " f"]
    """Triangles whose colours do not change."""
    extinction: float = 0.0
    """Optical thickness of a metre of opaque hair."""

    def transfer(
        self, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], hair: HairShadow | None = None
    ) -> Transfer:
        """Light transfer of a surface for the directions of this light.

        Args:
            vertices: World points in metres.
            faces: Vertex indices of the triangles.
            hair: Hair that shades the surface, if there is any.

        Returns:
            See `light_transfer`.
        """
        return light_transfer(vertices, faces, self.directions, hair)

    def vertex_factors(self, before: Transfer, after: Transfer) -> Float64[np.ndarray, "v 3"]:
        """Factor on the linear colours of every vertex.

        Args:
            before: Transfer of the surface that the colours were seen on.
            after: Transfer of the other surface.

        Returns:
            See `irradiance_ratio`.
        """
        return irradiance_ratio(self.light, before, after, self.strength, self.limit)

    def face_factors(
        self, before: Transfer, after: Transfer, faces: Int[np.ndarray, "f 3"]
    ) -> Float32[np.ndarray, "f 3"]:
        """Factor on the sRGB values of every triangle: the mean over its corners, to the power 1 / `GAMMA`.

        Args:
            before: Transfer of the surface that the colours were seen on.
            after: Transfer of the other surface.
            faces: Vertex indices of the triangles.

        Returns:
            Factors, 1 for triangles whose colours do not change.
        """
        factor = self.vertex_factors(before, after)[faces].mean(axis=1) ** (1 / GAMMA)
        return np.where(self.kept[:, None], 1, factor).astype(np.float32)


def relight(
    colour: Float32[np.ndarray, "h w 3"],
    caricature: Visibility,
    vertex_factors: Float64[np.ndarray, "v 3"],
    kept: Bool[np.ndarray, " f"],
) -> Float32[np.ndarray, "h w 3"]:
    """Multiply the colours of a mesh in an image by a factor per vertex, in linear light.

    Args:
        colour: sRGB image.
        caricature: What its camera sees of the mesh.
        vertex_factors: Factors on linear colours, interpolated over triangles.
        kept: Triangles whose colours do not change.

    Returns:
        The sRGB image in the new light.
    """
    fragments = caricature.fragments
    return multiply_irradiance(
        np.ascontiguousarray(colour), fragments.face, fragments.barycentric, caricature.faces,
        vertex_factors.astype(np.float32), kept,
    )  # fmt: skip


def save_shading(file: Path, shading: Shading) -> None:
    """Write a shading.

    Args:
        file: Path of the .npz file.
        shading: The shading.
    """
    np.savez(file, **asdict(shading))


def load_shading(file: Path, num_faces: int) -> Shading | None:
    """Read a shading.

    Args:
        file: An .npz file of `save_shading`.
        num_faces: Number of the head's triangles.

    Returns:
        The shading, or None if there is no such file.

    Raises:
        InputError: If the file is broken, or an array is missing or not valid.
    """
    if not os.path.lexists(file):
        return None
    return shading_of(read_npz(file, "shading"), num_faces, file)


def shading_of(arrays: Mapping[str, np.ndarray], num_faces: int, file: str | Path, prefix: str = "") -> Shading:
    """Check the arrays of a shading.

    Args:
        arrays: Arrays by the names of the fields.
        num_faces: Number of the head's triangles.
        file: Where they come from, for messages.
        prefix: What precedes the names.

    Returns:
        The shading.

    Raises:
        InputError: If an array is missing or not valid.
    """

    def take(
        name: str, shape: tuple[int | None, ...], dtype: type = np.float64, within: tuple[float, float] | None = None
    ) -> np.ndarray:
        return checked_array(arrays, f"{prefix}{name}", shape, dtype, within=within, file=file)

    def refuse(is_bad: bool, name: str, problem: str) -> None:
        if is_bad:
            raise InputError(problem, file=file, field=f"{prefix}{name}")

    directions = take("directions", (None, 3))
    count = len(directions)
    refuse(not 0 < count <= MAX_DIRECTIONS, "directions", f"{count} directions; 1 to {MAX_DIRECTIONS} are possible")
    light = take("light", (count + 1, 3), within=(0, 1e9))
    strength, limit = float(take("strength", (), within=(0, 1))), float(take("limit", (), within=(1, 100)))
    unit = np.abs(np.linalg.norm(directions, axis=1) - 1).max(initial=0) < 1e-6
    refuse(not unit, "directions", "expected unit vectors")
    extinction = float(take("extinction", (), within=(0, 1000))) if f"{prefix}extinction" in arrays else 0.0
    return Shading(directions, light, strength, limit, take("kept", (num_faces,), bool), extinction)
