"""Motion of the triangles inside the mouth as two solids, for the teeth that hang on them.

A tooth is centimetres away from the triangle that carries it, and is not stretched with the skin of the mouth. So all
triangles of a jaw have one rotation, the nearest one to the mean of theirs, and one translation, that of their mean
centre. Surfels keep their size.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float64, UInt8

from carigs.errors import InputError
from carigs.mesh.triangle_mesh import barycenters, face_areas
from carigs.mouth.jaw import Jaw
from carigs.readers.arrays import checked_array
from carigs.splat.rig.rig import Rig
from carigs.splat.rig.smooth_motion import nearest_rotations


class JawMotion:
    """Solid motion of the upper and of the lower jaw.

    Attributes:
        jaws: A `carigs.mouth.Jaw` for every triangle (f,).
        faces: Indices of the triangles of both.
    """

    def __init__(self, rig: Rig, jaws: UInt8[np.ndarray, " f"]) -> None:
        """Prepare the weights.

        Args:
            rig: The canonical mesh.
            jaws: A `carigs.mouth.Jaw` for every triangle.
        """
        self.jaws, self.faces = jaws, np.flatnonzero(jaws)
        centres, areas = barycenters(rig.vertices, rig.faces), face_areas(rig.vertices, rig.faces)
        self._solids = []
        for jaw in (Jaw.UPPER, Jaw.LOWER):
            mine = np.flatnonzero(jaws == jaw)
            if len(mine):
                weight = np.maximum(areas[mine], 1e-30)
                self._solids.append((mine, weight / weight.sum(), centres[mine]))

    def as_arrays(self) -> dict[str, np.ndarray]:
        """What the motion is made of, for a file.

        Returns:
            Arrays by name.
        """
        return {"jaw_faces": self.jaws}

    def apply(
        self,
        centre: Float64[np.ndarray, "f 3"],
        rotation: Float64[np.ndarray, "f 3 3"],
        stretch: Float64[np.ndarray, "f 3 3"],
    ) -> None:
        """Replace the motions of the triangles of each jaw by one, in place.

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


def jaw_motion_of(arrays: Mapping[str, Any], rig: Rig, file: Path) -> JawMotion:
    """Read what `JawMotion.as_arrays` gave.

    Args:
        arrays: The arrays, from a file.
        rig: The canonical mesh.
        file: The file, for messages.

    Returns:
        The motion.

    Raises:
        InputError: If the array has another shape or type, or a number that is no `Jaw`.
    """
    jaws = checked_array(arrays, "jaw_faces", (len(rig.faces),), np.uint8, file=file)
    if (jaws > max(Jaw)).any():
        raise InputError("expected 0 (other triangles), 1 (upper jaw) or 2 (lower jaw)", file=file, field="jaw_faces")
    return JawMotion(rig, jaws)
