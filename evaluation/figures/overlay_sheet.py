"""Contact sheet of a capture: the outline of the posed mesh over the frames, and how far the two disagree."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float32

from carigs.capture import Capture
from carigs.capture.evenly_spread import evenly_spread
from carigs.plausibility.diagnosis.reprojection import reproject
from carigs.plausibility.diagnosis.scene import Scene, Shot, read_scene
from carigs.raster import compute_visibility
from evaluation.figures.sheet import write_sheet

ROWS, COLUMNS, HEIGHT = 4, 8, 300
"""Timesteps, cameras, and the height of each image in pixels."""
MESH, OUTSIDE, MATTE = (0.1, 0.9, 0.2), (0.95, 0.1, 0.1), (0.1, 0.4, 1.0)
FEATURES = ("left_eyeball", "right_eyeball", "lips", "nose")
"""Regions of the head model whose outlines are drawn as well, if it has them."""
LEGEND = {"outline of the mesh": MESH, "mesh outside the matte": OUTSIDE, "outline of the matte": MATTE}


def overlay_sheet(file: Path, capture: Capture) -> None:
    """Draw the mesh over some frames.

    Args:
        file: PNG file to write.
        capture: The capture.
    """
    scene = read_scene(capture, timesteps=ROWS, size=2 * HEIGHT)
    cameras = evenly_spread(sorted({shot.frame.camera for shot in scene.shots}), COLUMNS)
    timesteps = sorted({shot.frame.timestep for shot in scene.shots})
    shots = {(shot.frame.timestep, shot.frame.camera): shot for shot in scene.shots}
    overlaps = reproject(scene, colours=False).overlaps
    images, captions = [], []
    for timestep in timesteps:
        row = [shots.get((timestep, camera)) for camera in cameras]
        images.append([shot and _overlay(scene, shot) for shot in row])
        captions.append([f"IoU {overlaps[shot].iou:.2f}" if shot in overlaps else "" for shot in row])
    write_sheet(
        file,
        images,
        rows=[f"timestep {timestep}" for timestep in timesteps],
        columns=[f"camera {camera}" for camera in cameras],
        title=f"{capture.root.name}: the posed mesh over the frames",
        height=HEIGHT,
        captions=captions,
        legend=LEGEND,
    )


def _overlay(scene: Scene, shot: Shot) -> Float32[np.ndarray, "h w 3"]:
    """The image with the edges of the mesh's silhouette and of the matte; what lies outside the matte is tinted."""
    face = compute_visibility(scene.heads[shot.timestep].vertices, scene.model.faces, shot.image_camera).face
    image = shot.image.astype(np.float32) / 255
    mesh = face >= 0
    if shot.matte is not None:
        image[mesh & ~shot.matte] = 0.4 * image[mesh & ~shot.matte] + 0.6 * np.float32(OUTSIDE)
        image[_outline(shot.matte)] = MATTE
    image[_outline(mesh)] = MESH
    for region in FEATURES:
        image[_outline(mesh & scene.model.face_region(region)[face], 3)] = MESH
    return image


def _outline(mask: Bool[np.ndarray, "h w"], width: int = 5) -> Bool[np.ndarray, "h w"]:
    """Pixels of a mask next to others; sheets are reduced, and thin lines would fade."""
    return mask & (cv2.erode(mask.astype(np.uint8), np.ones((width, width), np.uint8), borderValue=1) == 0)
