"""Shaded renderings of meshes from three sides, without texture."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, Int

from carigs.capture.camera import Camera, look_at
from carigs.capture.images import write_png
from carigs.mesh.triangle_mesh import vertex_normals
from carigs.raster import rasterize_mesh
from carigs.system.files import writing

VIEWS = (0.0, 40.0, 90.0)
"""Degrees around the upright axis +y; 0 looks at the face from +z."""
SIZE = 360
"""Height and width of one picture in pixels."""
SUPERSAMPLING = 2
CLAY = np.array([0.78, 0.70, 0.64])


def clay_sheet(file: Path, meshes: Mapping[str, Float[np.ndarray, "v 3"]], faces: Int[np.ndarray, "f 3"]) -> None:
    """Draw meshes of equal topology, one row each, all at the same scale.

    Args:
        file: PNG file to write.
        meshes: Vertices by label, in any unit. Those that no triangle uses do not count.
        faces: Vertex indices of the triangles.
    """
    used = np.unique(faces)
    vertices = np.concatenate([of_mesh[used] for of_mesh in meshes.values()])
    centre = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    radius = float(np.linalg.norm(np.ptp(vertices, axis=0))) / 2
    rows = []
    for name, vertices in meshes.items():
        views = [_shaded((vertices - centre) / radius, faces, angle) for angle in VIEWS]
        row = np.rint(255 * np.concatenate(views, axis=1).clip(0, 1)).astype(np.uint8)
        cv2.putText(row, name, (8, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (50, 50, 50), 1, cv2.LINE_AA)
        rows.append(row / 255)
    with writing(file) as part:
        write_png(part, np.concatenate(rows))


def _shaded(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], angle: float) -> np.ndarray:
    """Render a mesh inside the unit sphere from a distance of 8, lit from beside the camera."""
    turn, pixels = np.deg2rad(angle), SIZE * SUPERSAMPLING
    position = 8.0 * np.array([np.sin(turn), 0.0, np.cos(turn)])
    focal = 8.0 * pixels / 2 * 0.98
    camera = Camera(look_at(position, np.zeros(3)), focal, focal, pixels / 2, pixels / 2, pixels, pixels)
    hit = rasterize_mesh(vertices, faces, camera)
    corners = vertex_normals(vertices, faces)[faces[hit.face]]
    normal = np.einsum("hwc,hwcx->hwx", hit.barycentric, corners)
    normal /= np.maximum(np.linalg.norm(normal, axis=2, keepdims=True), 1e-9)
    lamp = np.array([np.sin(turn - 0.5), 0.6, np.cos(turn - 0.5)])
    light = 0.25 + 0.8 * np.clip(normal @ (lamp / np.linalg.norm(lamp)), 0, 1)
    image = np.where(hit.face[..., None] >= 0, CLAY * light[..., None], 1.0)
    return cv2.resize(image.astype(np.float32), (SIZE, SIZE), interpolation=cv2.INTER_AREA)
