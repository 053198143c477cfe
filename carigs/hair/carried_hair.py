"""Where hair is on a posed or exaggerated head: the scalp carries it."""

from __future__ import annotations

import igl
import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.hair.found_hair import FoundHair
from carigs.hair.hair_shadow import hair_shadow
from carigs.hair.views import scalp_motion
from carigs.raster import Visibility

MIN_OPACITY = 0.5
"""Opacity of a voxel that counts as hair: fainter ones surround the outline."""


class CarriedHair:
    """The visible voxels of the hair, each on the nearest triangle of the scalp, and the shadow of the hair.

    Args:
        found: The hair.
        scalp: Triangles that carry it.
        canonical: Vertices of the neutral head in metres.
        faces: Vertex indices of the triangles.
        extinction: Optical thickness of a metre of opaque hair.
    """

    def __init__(
        self,
        found: FoundHair,
        scalp: Bool[np.ndarray, " f"],
        canonical: Float[np.ndarray, "v 3"],
        faces: Int[np.ndarray, "f 3"],
        extinction: float,
    ) -> None:
        self.shadow = hair_shadow(found, scalp, canonical, faces, extinction)
        self.canonical, self.carrier, self.size = canonical, np.unique(faces[scalp]), found.volume.size
        kept = (found.volume.opacity >= MIN_OPACITY) & (found.visible > 0) & scalp.any()
        self.points = found.volume.centres[kept].astype(np.float64)
        self.corners = np.zeros((0, 3), np.int64)
        if len(self.points):
            carrying = np.asarray(faces[scalp], np.int64)
            vertices = np.asarray(canonical, np.float64)
            self.corners = carrying[igl.point_mesh_squared_distance(self.points, vertices, carrying)[1]]

    def pixels(self, natural: Visibility, caricature: Visibility) -> Bool[np.ndarray, "h w"]:
        """Pixels of the caricature that show voxels of the hair.

        Args:
            natural: What the camera sees of the tracked mesh.
            caricature: What it sees of the caricature.

        Returns:
            The pixels that the centres of voxels fall into. Strands are shifted as the scalp below them, not turned.
        """
        shown = np.zeros(caricature.face.shape, bool)
        if len(self.points) == 0:
            return shown
        motion, camera = scalp_motion(self.canonical, natural, self.carrier), caricature.camera
        shift = (caricature.camera_points - natural.camera_points)[self.corners].mean(axis=1)
        x, y, z = (self.points @ motion[:, :3].T + motion[:, 3] + shift).T
        z = np.where(z > 0, z, np.nan)
        with np.errstate(invalid="ignore"):
            column, row = np.floor(camera.fx * x / z + camera.cx), np.floor(camera.fy * y / z + camera.cy)
            inside = (column >= 0) & (row >= 0) & (column < camera.width) & (row < camera.height)
        shown[row[inside].astype(int), column[inside].astype(int)] = True
        return shown

    def radius(self, seen: Visibility) -> int:
        """Half of a voxel's size in an image.

        Args:
            seen: What a camera sees of the head.

        Returns:
            Pixels.
        """
        return int(np.ceil(0.5 * self.size / seen.pixel_size))
