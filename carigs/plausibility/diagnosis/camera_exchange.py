"""Exchanged cameras: the assignment of images to cameras under which the silhouettes fit best."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.optimize import linear_sum_assignment

from carigs.plausibility.diagnosis.hypotheses import Hypothesis
from carigs.plausibility.diagnosis.reprojection import silhouette_overlap
from carigs.plausibility.diagnosis.scene import Scene
from carigs.plausibility.views import head_faces
from carigs.raster import compute_visibility

TIMESTEPS = 2
LEAST_GAIN = 0.005
"""Gain in the mean misfit of a camera's silhouettes, below which it keeps its images."""


def exchanged_cameras(scene: Scene) -> list[Hypothesis]:
    """Find the cameras whose images fit each other's places.

    Args:
        scene: The scene as stated.

    Returns:
        One hypothesis, or none if the stated assignment is the best one, or images differ in size.
    """
    numbers = sorted({shot.frame.camera for shot in scene.shots})
    if len(numbers) < 2 or len({shot.image.shape for shot in scene.shots}) > 1:
        return []
    misfits = _misfits(scene, numbers)
    stated = np.diag(misfits).copy()
    misfits[np.diag_indices_from(misfits)] -= LEAST_GAIN
    images, cameras = linear_sum_assignment(misfits)
    moved = {numbers[i]: numbers[c] for i, c in zip(images, cameras, strict=True) if i != c}
    if not moved or misfits[images, cameras].mean() >= stated.mean():
        return []
    names = ", ".join(map(str, sorted(moved)))

    def undo(scene: Scene) -> Scene:
        known = {(shot.timestep, shot.frame.camera): shot.camera for shot in scene.shots}
        return scene.with_shots(
            lambda s: replace(s, camera=known.get((s.timestep, moved.get(s.frame.camera, s.frame.camera)), s.camera))
        )

    to = ", ".join(f"{image} -> {camera}" for image, camera in sorted(moved.items()))
    mistake = f"the images of cameras {names} are exchanged"
    remedy = f"give the images these cameras: {to}"
    return [Hypothesis("exchange", mistake, "camera_index", remedy, undo, frozenset(moved))]


def _misfits(scene: Scene, numbers: list[int]) -> Float[np.ndarray, "c c"]:
    """Mean misfit of the mattes of each camera (rows) to the silhouettes in each camera (columns)."""
    above_neck = head_faces(scene.model)
    timesteps = sorted({shot.timestep for shot in scene.shots})[:TIMESTEPS]
    total, count = np.zeros((len(numbers), len(numbers))), np.zeros((len(numbers), len(numbers)))
    for timestep in timesteps:
        shots = [shot for shot in scene.shots if shot.timestep == timestep and shot.matte is not None]
        for seen in shots:
            vertices = scene.heads[timestep].vertices
            face = compute_visibility(vertices, scene.model.faces, seen.image_camera).face
            for shot in shots:
                place = numbers.index(shot.frame.camera), numbers.index(seen.frame.camera)
                total[place] += silhouette_overlap(face, shot.matte, above_neck).misfit
                count[place] += 1
    return np.divide(total, count, out=np.ones_like(total), where=count > 0)
