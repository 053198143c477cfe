"""Shift of the principal point, common to all cameras, at which the outlines of mesh and mattes agree best.

Programs disagree whether the centre of the first pixel lies at 0 or at 0.5. A mistake shifts all images by half a
pixel in x and y: too little for the overlap of silhouettes, but not for outlines of thousands of pixels.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float64

from carigs.capture import Capture
from carigs.plausibility.diagnosis.scene import Scene, Shot, read_scene
from carigs.plausibility.views import head_faces
from carigs.raster import compute_visibility

REACH = 0.75
"""Pixels around the last estimate at which outlines are compared."""
ROUNDS = 4
CLIP = 1.5
"""Distance in pixels from which outlines do not belong together: hair and clothes lie between them."""
TIMESTEPS, SIZE = 2, 1200
"""Timesteps, and longest side of the images: small ones are enlarged, for outlines of pixels snap to each other."""
LEAST_CAMERAS = 3
"""Cameras that are needed to know how sure the shift is."""
SURE = 3.0
"""Standard errors of a shift that is believed."""
TOLERANCE = 0.2
"""Pixels by which the shift may differ from half a pixel: imperfect tracking shifts it as well."""


class Outlines(NamedTuple):
    """Outlines of a shot, in pixels of the shot."""

    mesh: Float64[np.ndarray, "n 2"]
    """Positions (x, y) on the outline of the mesh."""
    distance: Float[np.ndarray, "h w"]
    """Of each pixel to the outline of the matte."""
    scale: float
    """Pixels of the shot per pixel of the capture."""


class PrincipalPointShift(NamedTuple):
    """What must be added to cx and cy for the outlines to agree best, in pixels."""

    shift: Float64[np.ndarray, "2"]
    error: Float64[np.ndarray, "2"]
    """Standard errors; inf if the outlines do not tell."""

    @property
    def half_pixel(self) -> float:
        """0.5 or -0.5 if the shift is half a pixel beyond doubt, else 0."""
        half = 0.5 * float(np.sign(self.shift[0]))
        is_half = np.abs(self.shift - half).max() < TOLERANCE and (np.abs(self.shift) > SURE * self.error).all()
        return half if is_half else 0.0


def principal_point_shift(capture: Capture) -> PrincipalPointShift:
    """Measure the shift: the minimum of the distance of the outlines, with jackknife errors over the cameras.

    Args:
        capture: The capture.

    Returns:
        The shift and its errors.
    """
    return shift_of_outlines(read_scene(capture, timesteps=TIMESTEPS, size=SIZE, enlarge=True))


def shift_of_outlines(scene: Scene) -> PrincipalPointShift:
    """Measure the shift in a scene.

    Args:
        scene: The scene; the larger its images, the better.

    Returns:
        The shift and its errors.
    """
    outlines: dict[int, list[Outlines]] = {}
    above_neck = head_faces(scene.model)
    for shot in scene.shots:
        if shot.matte is not None:
            outlines.setdefault(shot.frame.camera, []).append(_outlines(scene, shot, above_neck))
    unknown = PrincipalPointShift(np.zeros(2), np.full(2, np.inf))
    if len(outlines) < LEAST_CAMERAS:
        return unknown
    shift = np.zeros(2)
    for _ in range(ROUNDS):
        costs = np.array([sum(_costs(outline, shift) for outline in members) for members in outlines.values()])
        step = _minimum(costs.sum(axis=0))
        if step is None:
            return unknown
        shift = shift + np.clip(step, -REACH, REACH)
    parts = [_minimum(costs.sum(axis=0) - cost) for cost in costs]
    if any(part is None for part in parts):
        return unknown
    n, deviations = len(parts), np.array(parts) - np.mean(parts, axis=0)
    return PrincipalPointShift(shift, np.sqrt((n - 1) / n * (deviations**2).sum(axis=0)))


def _outlines(scene: Scene, shot: Shot, above_neck: Bool[np.ndarray, " f"]) -> Outlines:
    face = compute_visibility(scene.heads[shot.timestep].vertices, scene.model.faces, shot.image_camera).face
    head = (face >= 0) & above_neck[face]
    y, x = np.nonzero(_edge(head) & _edge(face >= 0))  # not where the head ends at the neck
    off = (~_edge(shot.matte)).astype(np.uint8)
    distance = cv2.distanceTransform(off, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return Outlines(np.stack([x, y], axis=1).astype(np.float64), distance, shot.image.shape[1] / shot.camera.width)


def _edge(mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Pixels of a mask that have a neighbour outside; the border of the image is no edge."""
    return mask & (cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=1) == 0)


def _grid() -> Float64[np.ndarray, "25 2"]:
    return REACH * np.array(list(product((-1, -0.5, 0, 0.5, 1), repeat=2)))


def _costs(outlines: Outlines, shift: Float64[np.ndarray, "2"]) -> Float64[np.ndarray, "25"]:
    """Sum of the clipped distances of the outlines, at each shift of the grid about another one."""
    mesh, distance, scale = outlines
    if len(mesh) == 0:
        return np.zeros(25)
    x, y = (mesh + scale * (shift + _grid()[:, None])).astype(np.float32).transpose(2, 0, 1)
    sampled = cv2.remap(distance, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.minimum(sampled / scale, CLIP).sum(axis=1, dtype=np.float64)


def _minimum(costs: Float64[np.ndarray, "25"]) -> Float64[np.ndarray, "2"] | None:
    """Minimum of the quadratic function that fits the costs on the grid best; None if it has none."""
    x, y = _grid().T
    design = np.stack([np.ones(25), x, y, x * x / 2, x * y, y * y / 2], axis=1)
    _, gx, gy, xx, xy, yy = np.linalg.lstsq(design, costs, rcond=None)[0]
    if not (xx > 0 and xx * yy > xy * xy):
        return None
    return -np.linalg.solve([[xx, xy], [xy, yy]], [gx, gy])
