"""Hair where no training frame shows any: the back of a head in front of few cameras.

Seen hair is copied there: each strand keeps its height above the scalp, its direction down the scalp, and how much
lighter or darker it is than the hair around it. Below the copies, discs on the scalp rise to half their height, so that
nothing shines through. The training leaves both as they are.

A copy that a frame would show before its background is left out. Trained surfels would paint the background over it,
which looks like white specks from every other side.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.capture import Capture
from carigs.capture.evenly_spread import evenly_spread
from carigs.mesh.carried_points import CarriedPoints
from carigs.mesh.triangle_mesh import barycenters, face_areas
from carigs.raster import rasterize_mesh
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.splat.rig.rig import Rig
from carigs.splat.training.initial_surfels.unseen_skin import FRAMES, LEFT_OUT, UnseenSkin

OPACITY = 0.7
"""Of copied surfels, which stand before discs of the same colour."""
LIFTED = 0.5
"""Height of the discs on the scalp, over that of the hair."""
HALF_LENGTH = 0.6
"""Of a copy, in units of the distance to its neighbours, times the root of its elongation: one and a half standard
deviations."""
INSIDE_OUTLINE = 0.95
"""Matte up to which a pixel counts as background."""
CONTRAST = 2.0
"""Difference of a copy's colour from those around, over that of its source: a first colour is a mean over views, of
which each shows other strands in front."""


class GraftedHair(NamedTuple):
    """Copies of seen hair on triangles that no frame shows."""

    points: CarriedPoints
    """Where their surfels start."""
    source: Int[np.ndarray, " n"]
    """Index of the point of the seen hair that each is a copy of."""
    height: Float[np.ndarray, " f"]
    """Of the disc on each triangle of the scalp that no frame shows, in metres; 0 on the others."""

    def colours(
        self,
        around: Float[np.ndarray, "n 3"],
        seen: Float[np.ndarray, "h 3"],
        seen_face: Int[np.ndarray, " h"],
    ) -> Float[np.ndarray, "n 3"]:
        """Give the copies the contrast of the hair that they are copies of.

        Args:
            around: RGB of the hair around each copy, as it continues where no frame shows it.
            seen: RGB of the points of the seen hair.
            seen_face: Triangles that carry them.

        Returns:
            RGB of the copies, in [0.02, 0.98].
        """
        count = np.maximum(np.bincount(seen_face), 1)
        mean = np.stack([np.bincount(seen_face, channel) / count for channel in seen.T], axis=1)
        return (around + CONTRAST * (seen - mean[seen_face])[self.source]).clip(0.02, 0.98)


def graft_hair(
    seen: CarriedPoints,
    reach: Float[np.ndarray, " f"],
    unseen: UnseenSkin,
    capture: Capture,
    sequence: HeadSequence,
    rng: np.random.Generator,
) -> GraftedHair | None:
    """Copy seen hair to the scalp that no frame shows, as densely as it grows where frames show it well.

    Args:
        seen: Points of the seen hair.
        reach: How far hair reaches from each triangle, in metres.
        unseen: Triangles that no frame shows.
        capture: The capture.
        sequence: The subject.
        rng: Draws triangles, places on them, and sources.

    Returns:
        The copies; None if frames show all of the scalp, or none of it well.
    """
    rig = sequence.rig
    sources = np.flatnonzero((unseen.well_seen & unseen.scalp)[seen.face])
    bare = np.flatnonzero(unseen.kept & unseen.scalp & (unseen.opacity > LEFT_OUT))
    if not len(sources) or not len(bare):
        return None
    area = face_areas(rig.vertices, rig.faces)
    weight = area[bare]
    count = round(len(sources) * float(weight.sum() / area[unseen.well_seen & unseen.scalp].sum()))
    face = np.sort(rng.choice(bare, count, p=weight / weight.sum()))
    source = rng.choice(sources, count)
    from_face = seen.face[source]
    bases, centres, full = down_bases(rig), barycenters(rig.vertices, rig.faces), unseen.height_of_hair(reach)
    height = np.einsum("nc,nc->n", seen.position[source] - centres[from_face], bases[from_face, :, 2]).clip(0)
    height *= (full[face] / np.maximum(reach[from_face], 1e-6)).clip(max=1)
    position = _on_triangles(rig, face, rng) + height[:, None] * bases[face, :, 2]
    axes = bases[face] @ bases[from_face].swapaxes(1, 2) @ seen.axes[source]
    arm = (HALF_LENGTH * seen.spacing[source] * np.sqrt(seen.elongation[source]))[:, None] * axes[..., 0]
    lifted = np.flatnonzero(full)
    discs = centres[lifted] + LIFTED * full[lifted, None] * bases[lifted, :, 2]
    beside = shown_as_background(
        np.concatenate([position - arm, position, position + arm, discs]), np.concatenate([np.tile(face, 3), lifted]),
        capture, sequence,
    )  # fmt: skip
    hidden = ~beside[: 3 * count].reshape(3, count).any(axis=0)
    discs_height = np.zeros(len(rig.faces))
    discs_height[lifted] = np.where(beside[3 * count :], 0, LIFTED * full[lifted])
    points = CarriedPoints(face, position, seen.spacing[source], axes, seen.elongation[source])
    points = CarriedPoints(*(values[hidden] for values in points[:5]), OPACITY)
    return GraftedHair(points, source[hidden], discs_height)


def shown_as_background(
    position: Float[np.ndarray, "n 3"], face: Int[np.ndarray, " n"], capture: Capture, sequence: HeadSequence
) -> Bool[np.ndarray, " n"]:
    """Find points that cannot belong to the subject: a training frame shows background where they are.

    Args:
        position: Points in the axes of the canonical head, in metres.
        face: Triangle that carries each.
        capture: The capture.
        sequence: The subject.

    Returns:
        True for points that lie before the mesh, or beside it, in front of a pixel of the background.
    """
    rig, found = sequence.rig, np.zeros(len(face), bool)
    offset = position - barycenters(rig.vertices, rig.faces)[face]
    for frame in evenly_spread(capture.split("train"), FRAMES):
        camera, motion = capture.camera(frame), sequence.motion(frame.timestep, 0.0)
        pixel, depth = camera.project(motion.centre[face] + np.einsum("nij,nj->ni", motion.jacobian[face], offset))
        surface = rasterize_mesh(sequence.posed(frame.timestep, 0.0), rig.faces, camera).depth
        inside = (depth > 0) & (pixel >= 0).all(axis=1) & (pixel < [camera.width, camera.height]).all(axis=1)
        column, row = np.where(inside[:, None], pixel, 0).astype(int).T
        background = capture.foreground(frame)[row, column] < INSIDE_OUTLINE
        found |= inside & background & (depth < surface[row, column])
    return found


def down_bases(rig: Rig) -> Float[np.ndarray, "f 3 3"]:
    """Directions in which hair lies, at every triangle.

    Args:
        rig: The canonical mesh, y up.

    Returns:
        Unit vectors down along the triangle, across, and out of it, as columns.
    """
    normal = rig.frame[:, :, 2] / np.linalg.norm(rig.frame[:, :, 2], axis=1, keepdims=True).clip(1e-12)
    down = normal * normal[:, 1:2] - [0.0, 1.0, 0.0]
    level = np.linalg.norm(down, axis=1) < 1e-3  # a triangle that lies flat: down is backwards
    down[level] = normal[level] * normal[level, 2:] - [0.0, 0.0, 1.0]
    down /= np.linalg.norm(down, axis=1, keepdims=True)
    return np.stack([down, np.cross(normal, down), normal], axis=2)


def _on_triangles(rig: Rig, face: Int[np.ndarray, " n"], rng: np.random.Generator) -> Float[np.ndarray, "n 3"]:
    """A point on each triangle, all places alike."""
    b, c = rng.random((2, len(face)))
    b, c = np.where(b + c > 1, (1 - b, 1 - c), (b, c))
    return np.einsum("nk,nkc->nc", np.stack([1 - b - c, b, c], axis=1), rig.vertices[rig.faces[face]])
