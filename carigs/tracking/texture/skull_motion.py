"""How the skull turns, by the texture of hair, ears and temples.

Landmarks of a network say little about it: expressions of a head model explain a nod nearly as well as a turn does. A
tracker that had nothing else took a quarter of a person's nods for expressions, and the crown of the head, ten
centimetres behind the landmarks, was several pixels off. Corners that are followed through the video know nothing of
expressions.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from scipy.spatial.transform import Rotation

from carigs.fitting.fitted_parameters import FittedParameters
from carigs.fitting.head_points import HeadPoints
from carigs.head import HeadModel, SurfacePoints
from carigs.tracking.cameras import Cameras
from carigs.tracking.start import first_guess
from carigs.tracking.texture.bundle_adjustment import BundleAdjustment, RigidMotion
from carigs.tracking.texture.corners import HeadImage, follow_texture
from carigs.tracking.visibility import facing_camera

RIGID = 0.003
"""Metres: what no expression moves farther counts as rigid."""
CARRIED = 0.95
"""Skinning weight of the joints that carry the head."""
SPACING = 0.004
"""Metres between the vertices that are drawn."""
ANCHORS = 24
"""Points that hand the motion on to the tracker."""
ERROR = 1.5
"""Pixels that a corner may be off to count."""
LEAST_CORNERS, LEAST_SHARE = 12, 0.5
"""Corners that a frame needs, and share of those that are followed in it: hair that sways, or a hand, is not rigid."""
LEAST_KNOWN = 0.8
"""Share of the frames whose motion must be known: on a synthetic head with smooth hair, a fifth was, which was worse
than landmarks alone."""


@dataclass(frozen=True)
class SkullMotion:
    """Points of the skull that are known in the images, although no network sees them."""

    points: SurfacePoints
    pixels: Float[np.ndarray, "t n 2"]
    known: Bool[np.ndarray, " t"]
    """Frames in which enough texture was followed."""


def skull_motion(
    images: Iterable[UInt8[np.ndarray, "h w 3"]],
    model: HeadModel,
    fitted: FittedParameters,
    embedding: SurfacePoints,
    landmarks: Float[np.ndarray, "t n 2"],
    cameras: Cameras,
) -> SkullMotion | None:
    """Find how the skull moves before one camera that stands still.

    Args:
        images: The frames.
        model: The head model.
        fitted: Its parameters that are estimated.
        embedding: Landmarks on it.
        landmarks: The same in the frames, in pixels.
        cameras: The camera.

    Returns:
        The motion; None if too few frames have texture that moves as one body.

    Raises:
        CarigsError: If the landmarks place the head model in no frame.
    """
    seen = np.isfinite(landmarks).all(axis=2)
    points = HeadPoints(model, fitted, embedding).merged()
    frames, _, _ = first_guess(points, landmarks[:, None], seen[:, None], cameras)
    joint = int(np.bincount(model.weights[np.unique(embedding.corners)].argmax(axis=1)).argmax())
    vertices, image = _head_image(model, joint, fitted, frames, cameras)
    tracks = follow_texture(images, image)
    if not len(tracks.vertex):
        return None
    # The body is the skull, its origin the middle of what is followed.
    rotation = Rotation.from_rotvec(frames[:, 3:6]).as_matrix()
    camera_from_world = cameras.camera_from_world()[0]
    root = model.joint_template[0]
    middle = image.rest[image.rigid].mean(axis=0)
    placed = np.einsum("tij,j->ti", rotation, middle - root) + root + frames[:, :3]
    guess = RigidMotion(
        camera_from_world[:, :3] @ rotation,
        placed @ camera_from_world[:, :3].T + camera_from_world[:, 3],
        image.rest[tracks.vertex] - middle,
    )
    adjustment = BundleAdjustment(tracks, float(cameras.focal[0]), cameras.centres[0], guess)
    motion = adjustment.solve()
    good = np.linalg.norm(adjustment.errors(motion), axis=1) < ERROR
    followed, count = (np.bincount(tracks.frame[chosen], minlength=len(frames)) for chosen in (slice(None), good))
    known = (count >= LEAST_CORNERS) & (count > LEAST_SHARE * followed)
    if known.mean() < LEAST_KNOWN:
        return None
    anchors = _spread(image.rest, np.flatnonzero(image.rigid))
    seen = np.einsum("tij,nj->tni", motion.rotation, image.rest[anchors] - middle) + motion.middle[:, None]
    pixels = cameras.focal[0] * seen[..., :2] / seen[..., 2:] + cameras.centres[0]
    return SkullMotion(SurfacePoints.at_vertices(vertices[anchors]), pixels, known)


def _head_image(
    model: HeadModel, joint: int, fitted: FittedParameters, frames: Float[np.ndarray, "t q"], cameras: Cameras
) -> tuple[Int[np.ndarray, " n"], HeadImage]:
    """Vertices of the head, one per cell of a grid, and where the images have them."""
    hanging = [joint, *(j for j, parent in enumerate(model.parents) if parent == joint)]
    carried = np.flatnonzero(model.weights[:, hanging].sum(axis=1) > CARRIED)
    cells = np.floor(model.v_template[carried] / SPACING).astype(int)
    chosen = np.sort(carried[np.unique(cells, axis=0, return_index=True)[1]])
    rest, root = model.v_template[chosen].astype(np.float64), model.joint_template[0]
    rotation = Rotation.from_rotvec(frames[:, 3:6]).as_matrix()
    world = np.einsum("tij,nj->tni", rotation, rest - root) + root + frames[:, None, :3]
    pixels, _ = cameras.project(world)
    points = SurfacePoints.at_vertices(chosen)
    shown = facing_camera(model, points, fitted, frames, cameras, neighbourhood=0)[:, 0] >= 1
    moved = np.linalg.norm(model.expression_basis[chosen], axis=1).max(axis=1, initial=0)
    rigid = (model.weights[chosen, joint] > CARRIED) & (moved < RIGID)
    return chosen, HeadImage(pixels[:, 0], shown, rigid, rest)


def _spread(points: Float[np.ndarray, "v 3"], candidates: Int[np.ndarray, " n"]) -> Int[np.ndarray, " m"]:
    """Points far from each other, one after the other."""
    chosen = [int(candidates[0])]
    distance = np.full(len(candidates), np.inf)
    for _ in range(min(ANCHORS, len(candidates)) - 1):
        distance = np.minimum(distance, np.linalg.norm(points[candidates] - points[chosen[-1]], axis=1))
        chosen.append(int(candidates[distance.argmax()]))
    return np.array(chosen)
