"""What a camera sees of a triangle mesh: the nearest face, its depth and its coverage of each pixel."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int, Int32

from carigs.raster import projection
from carigs.raster.bit_masks import BitMask, greater
from carigs.raster.coverage import covered_shares, outline
from carigs.raster.scan_conversion import nearest_faces

if TYPE_CHECKING:
    from carigs.capture.camera import Camera

NEAR = 0.01
"""Depth of the near plane in metres."""


class Fragments(NamedTuple):
    """The first surface point on the ray through each pixel centre."""

    face: Int32[np.ndarray, "h w"]
    """Index of the nearest face, -1 where there is none."""
    barycentric: Float32[np.ndarray, "h w 3"]
    """Perspective-correct weights of the face's corners: weights @ corners is the 3D point."""
    depth: Float32[np.ndarray, "h w"]
    """Depth along the optical axis in metres, inf where there is no face."""


@dataclass(frozen=True)
class Visibility:
    """The nearest face at every pixel centre, with the geometry that it was computed from."""

    face: Int32[np.ndarray, "h w"]
    """Index of the nearest face, -1 where there is none."""
    inverse_depth: Float32[np.ndarray, "h w"]
    """Inverse depth along the optical axis in 1/metres, 0 where there is no face."""
    back_facing: Bool[np.ndarray, " f"]
    """Faces that show the camera their back."""
    depth_planes: Float64[np.ndarray, "f 3"]
    """Inverse depth of each face's plane at the pixel (x, y): depth_planes @ (x, y, 1)."""
    camera_points: Float64[np.ndarray, "v 3"]
    """Vertices in camera axes, in metres."""
    pixels: Float64[np.ndarray, "v 2"]
    """Image positions of the vertices; valid where their depth is positive."""
    faces: Int32[np.ndarray, "f 3"]
    camera: Camera

    @cached_property
    def on_mesh(self) -> BitMask:
        """The pixels that show a face."""
        return greater(self.face, -1)

    @property
    def fragments(self) -> Fragments:
        """Barycentric coordinates and depth at every pixel."""
        weights, depth = projection.barycentrics(
            self.camera_points, self.faces, self.depth_planes, self.face, *self.camera.intrinsics
        )
        return Fragments(self.face, weights, depth)

    @property
    def pixel_size(self) -> float:
        """Size of a pixel at the middle depth of the mesh, in metres."""
        depth = max(float(np.median(self.camera_points[:, 2])), 1e-3)
        return depth / float(np.sqrt(self.camera.fx * self.camera.fy))

    def coverage(self, n: int) -> Float32[np.ndarray, "h w"]:
        """Share of each pixel that the mesh covers, sampled where a pixel on the mesh has a neighbour off it.

        Args:
            n: Samples per pixel and axis, 1 to 8; with 1, every pixel is covered fully.

        Returns:
            Shares from 1 / n^2 to 1; 1 for all other pixels. Faces that reach nearer than `NEAR` are not counted.
        """
        height, on_mesh = len(self.face), self.on_mesh.words
        sampled = np.zeros_like(on_mesh) if n == 1 else outline(on_mesh, height)
        return covered_shares(self.camera_points, self.pixels, self.faces, sampled, n, NEAR, height)


def compute_visibility(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], camera: Camera, *, cull_back: bool = False
) -> Visibility:
    """Find the nearest face at every pixel centre.

    A pixel centre on a shared edge belongs to exactly one of its two faces (top-left rule), so neighbours leave no
    cracks. Faces are clipped at the depth `NEAR`. Faces that are edge-on or not finite cover no pixels.

    Args:
        vertices: World points in metres.
        faces: Vertex indices of the triangles.
        camera: The camera.
        cull_back: Leave out faces that are seen from behind (clockwise in the image).

    Returns:
        Faces and inverse depths of all pixels.
    """
    faces, intrinsics = np.ascontiguousarray(faces, np.int32), camera.intrinsics
    rotation, translation = np.ascontiguousarray(camera.camera_from_world[:3, :3]), camera.camera_from_world[:3, 3]
    points, pixels = projection.project_points(
        np.ascontiguousarray(vertices, np.float64), rotation, translation.copy(), *intrinsics
    )
    planes, back = projection.inverse_depth_planes(points, faces, *intrinsics)
    face, inverse_depth = nearest_faces(
        points, pixels, faces, planes, back, cull_back, NEAR, intrinsics, camera.height, camera.width
    )
    return Visibility(face, inverse_depth, back, planes, points, pixels, faces, camera)


def rasterize_mesh(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], camera: Camera, *, cull_back: bool = False
) -> Fragments:
    """Find the nearest face with barycentric coordinates and depth at every pixel centre.

    Args:
        vertices: World points in metres.
        faces: Vertex indices of the triangles.
        camera: The camera.
        cull_back: Leave out faces that are seen from behind.

    Returns:
        Face, barycentric coordinates and depth of all pixels.
    """
    return compute_visibility(vertices, faces, camera, cull_back=cull_back).fragments
