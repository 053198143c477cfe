"""Mattes that end at the neck: the head model has no shoulders and no clothes."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int
from scipy.spatial.transform import Rotation

from carigs.capture import Camera
from carigs.raster import rasterize_mesh

BELOW_CHIN = 0.03
"""Metres from the chin down to where the matte ends."""
FADE = 0.015
"""Metres over which it fades, above that."""
EDGE = 0.7
"""Standard deviation in pixels by which the cut is smoothed, where a chin before the chest ends at the mesh."""
NECK = 0.03
"""Metres above and below the cut: this part of the head says where the cut is beside it."""


class NeckCut:
    """A horizontal cut through a head at rest, a little below the chin.

    On the head, skin counts by where it lies at rest: a chin that is lowered to the chest stays. Beside the head, hair
    and shoulders count by their height above the cut, in the plane through the neck that faces the camera.

    Args:
        vertices: The neutral head in metres; y is up.
        faces: Vertex indices of its triangles.
        chin: Height of the chin on it.
    """

    def __init__(self, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], chin: float) -> None:
        self._faces = faces
        self._height = vertices[:, 1] - (chin - BELOW_CHIN)
        self._neck = np.flatnonzero(np.abs(self._height) < NECK)
        self._rest = vertices[self._neck]

    def kept_share(self, posed: Float[np.ndarray, "v 3"], camera: Camera) -> Float32[np.ndarray, "h w"]:
        """How much of each pixel's matte is kept.

        Args:
            posed: Vertices of a frame in metres.
            camera: The camera.

        Returns:
            1 above the cut, 0 below, with a smooth ramp between; 1 everywhere if the head ends above the cut.
        """
        if len(self._neck) < 3 or not (self._height < 0).any():
            return np.ones((camera.height, camera.width), np.float32)
        centre, at_rest = posed[self._neck].mean(axis=0), self._rest.mean(axis=0)
        turn, _ = Rotation.align_vectors(posed[self._neck] - centre, self._rest - at_rest)
        up = turn.apply([0.0, 1.0, 0.0])
        centre = centre - up * self._height[self._neck].mean()
        height = self._beside(centre, up, camera)
        seen = rasterize_mesh(posed, self._faces, camera)
        on_head = seen.face >= 0
        corners = self._height[self._faces[seen.face[on_head]]]
        height[on_head] = np.einsum("nk,nk->n", corners, seen.barycentric[on_head])
        share = (height / FADE).clip(0, 1)
        share = (share * share * (3 - 2 * share)).astype(np.float32)
        return cv2.GaussianBlur(share, (0, 0), EDGE)

    def _beside(
        self, centre: Float[np.ndarray, "3"], up: Float[np.ndarray, "3"], camera: Camera
    ) -> Float[np.ndarray, "h w"]:
        """Height above the cut of each pixel's point in the plane through the neck that faces the camera."""
        fx, fy, cx, cy = camera.intrinsics
        middle = camera.to_camera(centre[None])[0]
        upward = camera.camera_from_world[:3, :3] @ up
        x = (np.arange(camera.width) + 0.5 - cx) / fx * middle[2] - middle[0]
        y = (np.arange(camera.height) + 0.5 - cy) / fy * middle[2] - middle[1]
        return x[None, :] * upward[0] + y[:, None] * upward[1]
