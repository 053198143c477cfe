"""How far hair stands off the head, measured from the mattes.

Beside the scalp, the foreground ends where the hair ends. So the distance of its edge from the outline of the mesh, in
metres at the depth of the outline, is the length of the hair that is seen there in profile.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import binary_erosion, distance_transform_edt

from carigs.capture import Camera, Capture
from carigs.head import pose
from carigs.raster import rasterize_mesh
from carigs.settings import Train

FRAMES = 32
"""Training frames that are measured."""
QUANTILE = 0.98
"""Of the reach over all pixels of the edge: the longest hair decides, but no stray lock."""
MAX_LENGTH = 0.15
"""Metres; a matte that reaches farther shows more than the head."""


def measured_hair_length(subject: Capture, hair: Bool[np.ndarray, " f"]) -> float:
    """Measure the length of the hair.

    Args:
        subject: The capture.
        hair: Faces that carry hair.

    Returns:
        Metres; the default of `train.hair_length` if no frame shows hair on the outline of the head.
    """
    frames = [frame for frame in subject.split("train") if frame.mask]
    chosen = np.unique(np.linspace(0, len(frames) - 1, min(FRAMES, len(frames))).astype(int))
    reach = [np.zeros(0)]
    for frame in (frames[i] for i in chosen):
        vertices = pose(subject.model, subject.parameters(frame.timestep))
        matte, camera = subject.mask(frame), subject.camera(frame)
        reach.append(hair_reach(vertices, subject.model.faces, hair, camera, matte))
    found = np.concatenate(reach)
    return float(min(np.quantile(found, QUANTILE), MAX_LENGTH)) if len(found) else Train().hair_length


def hair_reach(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    hair: Bool[np.ndarray, " f"],
    camera: Camera,
    matte: Float[np.ndarray, "h w"],
) -> Float[np.ndarray, " p"]:
    """Distance of the foreground's edge from the mesh, at each pixel of the edge whose nearest face has hair.

    Args:
        vertices: World points in metres.
        faces: Vertex indices of the triangles.
        hair: Faces that carry hair.
        camera: The view.
        matte: Opacity of the foreground in [0, 1].

    Returns:
        Metres, at the depth of the nearest pixel on the mesh; 0 where the foreground ends with the mesh.
    """
    seen, foreground = rasterize_mesh(vertices, faces, camera), matte > 0.5
    off_mesh = seen.face < 0
    if off_mesh.all():
        return np.zeros(0)
    pixels, (row, column) = distance_transform_edt(off_mesh, return_indices=True)
    edge = foreground & ~binary_erosion(foreground, border_value=1) & hair[seen.face[row, column]]
    return pixels[edge] * seen.depth[row, column][edge] / np.sqrt(camera.fx * camera.fy)
