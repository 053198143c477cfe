"""Motion of some triangles as solids, for what hangs on them: teeth on the jaws, the body on the border of the neck.

A tooth is centimetres away from the triangle that carries it, and is not stretched with the skin of the mouth. So all
triangles of a solid have one rotation, the nearest one to the mean of theirs, and one translation, that of their mean
centre. Surfels keep their size.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float64, UInt8

from carigs.errors import InputError
from carigs.mesh.triangle_mesh import barycenters, face_areas
from carigs.readers.arrays import checked_array
from carigs.splat.rig.rig import Rig
from carigs.splat.rig.smooth_motion import nearest_rotations


class Solid(IntEnum):
    """What a triangle moves with."""

    NONE = 0
    """Its own vertices."""
    UPPER_JAW = 1
    """The skull: the number of `carigs.mouth.Jaw`."""
    LOWER_JAW = 2
    """The jaw: the number of `carigs.mouth.Jaw`."""
    BODY = 3
    """Neck below the mesh, shoulders and clothes."""


class SolidMotion:
    """Motion of solids.

    Attributes:
        solids: A `Solid` for every triangle (f,).
        faces: Indices of the triangles of all solids.
    """

    def __init__(self, rig: Rig, solids: UInt8[np.ndarray, " f"]) -> None:
        """Prepare the weights.

        Args:
            rig: The canonical mesh.
            solids: A `Solid` for every triangle.
        """
        self.solids, self.faces = solids, np.flatnonzero(solids)
        centres, areas = barycenters(rig.vertices, rig.faces), face_areas(rig.vertices, rig.faces)
        self._solids = []
        for solid in Solid:
            mine = np.flatnonzero(solids == solid) if solid else []
            if len(mine):
                weight = np.maximum(areas[mine], 1e-30)
                self._solids.append((mine, weight / weight.sum(), centres[mine]))

    def as_arrays(self) -> dict[str, np.ndarray]:
        """What the motion is made of, for a file.

        Returns:
            Arrays by name.
        """
        return {"solid_faces": self.solids}

    def apply(
        self,
        centre: Float64[np.ndarray, "f 3"],
        rotation: Float64[np.ndarray, "f 3 3"],
        stretch: Float64[np.ndarray, "f 3 3"],
    ) -> None:
        """Replace the motions of the triangles of each solid by one, in place.

        Args:
            centre: Centre of every triangle of the mesh, in metres.
            rotation: Rotation of every triangle.
            stretch: Symmetric stretch of every triangle.
        """
        for mine, weight, canonical in self._solids:
            mean = np.einsum("n,nij->ij", weight, rotation[mine])
            solid = nearest_rotations(mean[None])[0]
            translation = weight @ centre[mine] - solid @ (weight @ canonical)
            centre[mine], rotation[mine], stretch[mine] = canonical @ solid.T + translation, solid, np.eye(3)

    def spread_gradient(self, gradient: Float[np.ndarray, "f 3"]) -> None:
        """Turn a gradient with respect to the centres of `apply` into one with respect to those before it, in place.

        Rotations are taken as constant.

        Args:
            gradient: Gradient with respect to the centre of every triangle.
        """
        for mine, weight, _ in self._solids:
            gradient[mine] = weight[:, None].astype(gradient.dtype) * gradient[mine].sum(axis=0)


def solid_motion_of(arrays: Mapping[str, Any], rig: Rig, file: Path) -> SolidMotion:
    """Read what `SolidMotion.as_arrays` gave.

    Args:
        arrays: The arrays, from a file.
        rig: The canonical mesh.
        file: The file, for messages.

    Returns:
        The motion.

    Raises:
        InputError: If the array has another shape or type, or a number that is no `Solid`.
    """
    solids = checked_array(arrays, "solid_faces", (len(rig.faces),), np.uint8, file=file)
    if (solids > max(Solid)).any():
        problem = f"expected numbers from 0 to {max(Solid)}, see carigs.splat.rig.solid_motion.Solid"
        raise InputError(problem, file=file, field="solid_faces")
    return SolidMotion(rig, solids)
