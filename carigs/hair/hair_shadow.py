"""The shadow of hair: how much it weakens the light that falls on the skin, wherever the scalp carries it.

Skin below a fringe is darker than skin beside it, and brightens where a caricature moves it out of the shadow. The
space that hair fills is made of cubes, each of which weakens the light that passes by its optical thickness (law of
Beer and Lambert).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import igl
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int32

from carigs.hair.found_hair import FoundHair
from carigs.head.model_arrays import POSSIBLE
from carigs.mesh.rigid_alignment import rigid_alignment
from carigs.readers.arrays import checked_array

WIDTH = 0.008
"""Edge of the cubes in metres."""
PREFIX = "hair_shadow_"


@dataclass(frozen=True)
class HairShadow:
    """Hair that shades a head."""

    points: Float32[np.ndarray, "n 3"]
    """Centres of the cubes on the canonical head, in metres."""
    thickness: Float32[np.ndarray, " n"]
    """Optical thickness of each cube along an edge: the light that passes is weakened by exp(-thickness)."""
    corners: Int32[np.ndarray, "n 3"]
    """Vertices of the triangle of the scalp that carries each cube."""
    canonical: Float32[np.ndarray, "v 3"]
    """Vertices of the canonical head, in metres."""
    lit: Bool[np.ndarray, " v"]
    """Vertices that hair hides from the cameras: their colours are those of bare skin, out of the shadow."""

    def over(self, vertices: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "n 3"]:
        """Centres of the cubes on a posed head.

        They follow the rigid motion of the scalp, and are shifted as the triangle that carries them.

        Args:
            vertices: World points of the head in metres.

        Returns:
            World points in metres.
        """
        if len(self.points) == 0:
            return np.zeros((0, 3))
        carrier = np.unique(self.corners)
        rotation, translation = rigid_alignment(self.canonical[carrier].astype(np.float64), vertices[carrier])
        rest = self.canonical[self.corners].mean(axis=1) @ rotation.T + translation
        return self.points @ rotation.T + translation + vertices[self.corners].mean(axis=1) - rest

    def as_arrays(self) -> dict[str, np.ndarray]:
        """What the shadow is made of, for a file that has the canonical head as well.

        Returns:
            Arrays by name.
        """
        return {f"{PREFIX}{name}": getattr(self, name) for name in ("points", "thickness", "corners", "lit")}


def hair_shadow(
    found: FoundHair,
    scalp: Bool[np.ndarray, " f"],
    canonical: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    extinction: float,
) -> HairShadow | None:
    """The shadow that the hair of a subject casts.

    Args:
        found: The hair.
        scalp: Triangles that carry it.
        canonical: Vertices of the neutral head in metres.
        faces: Vertex indices of the triangles.
        extinction: Optical thickness of a metre of opaque hair.

    Returns:
        The shadow; None if there is no hair, or if it casts none.
    """
    if extinction == 0 or not found.has_hair(scalp):
        return None
    cells, cell = np.unique(np.floor(found.volume.centres / WIDTH).astype(np.int64), axis=0, return_inverse=True)
    filled = np.bincount(cell.ravel(), found.volume.opacity) * (found.volume.size / WIDTH) ** 3
    points, carrying = (cells + 0.5) * WIDTH, np.asarray(faces[scalp], np.int64)
    nearest = igl.point_mesh_squared_distance(points, np.asarray(canonical, np.float64), carrying)[1]
    lit = np.zeros(len(canonical), bool)
    lit[faces[found.hidden & ~scalp]] = True
    return HairShadow(
        points.astype(np.float32),
        (extinction * WIDTH * filled).astype(np.float32),
        carrying[nearest].astype(np.int32),
        canonical.astype(np.float32),
        lit,
    )


def hair_shadow_of(arrays: Mapping[str, Any], canonical: Float[np.ndarray, "v 3"], file: Path) -> HairShadow:
    """Read what `HairShadow.as_arrays` gave.

    Args:
        arrays: The arrays, from a file.
        canonical: Vertices of the canonical head in metres.
        file: The file, for messages.

    Returns:
        The shadow.

    Raises:
        InputError: If an array is missing, has another shape or type, or holds an impossible number or index.
    """
    v = len(canonical)
    points = checked_array(arrays, f"{PREFIX}points", (None, 3), np.float32, within=POSSIBLE, file=file)
    thickness = checked_array(arrays, f"{PREFIX}thickness", (len(points),), np.float32, within=(0, 1e6), file=file)
    corners = checked_array(arrays, f"{PREFIX}corners", (len(points), 3), np.int32, file=file, below=v)
    lit = checked_array(arrays, f"{PREFIX}lit", (v,), bool, file=file)
    return HairShadow(points, thickness, corners, canonical.astype(np.float32), lit)
