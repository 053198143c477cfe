"""Smooth motion of the triangles that carry hair: strands that reach far from the head move together, as a solid.

The rotation of one triangle, extended to a point ten centimetres away, moves the point by centimetres where
neighbouring triangles turn by a few degrees. So the rotations of the triangles of the scalp are averaged over their
neighbourhood, the more the farther their hair reaches: short hair turns with the skin that it stands on. Strands keep
their length and width, or grow with the scalp, by the average of its stretch.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float64
from scipy.spatial.distance import cdist

from carigs.readers.arrays import checked_array
from carigs.simd import matrix3
from carigs.simd.kernels import kernel
from carigs.simd.polar_wide import BLOCK, load_matrix, polar_rotations, store_matrix
from carigs.simd.vectors import WIDE
from carigs.splat.rig.rig import Rig

RADIUS = 0.03
"""Standard deviation of the average in metres."""
ANCHORS = 48
"""Most places whose rotation is averaged; triangles interpolate between them."""
SHORT_HAIR, LONG_HAIR = 0.015, 0.03
"""Reach of hair in metres up to which it turns with its own triangle, and from which on with the average alone."""


def share_of_average(reach: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """Share of the average in the rotation of triangles.

    Args:
        reach: How far their hair reaches, in metres.

    Returns:
        0 up to `SHORT_HAIR`, 1 from `LONG_HAIR` on, linear in between.
    """
    return np.clip((np.asarray(reach) - SHORT_HAIR) / (LONG_HAIR - SHORT_HAIR), 0.0, 1.0)


class SmoothMotion:
    """Rotations of triangles, averaged over their neighbourhood on the canonical mesh.

    Attributes:
        inside: The triangles whose rotation is averaged (f,).
        faces: Their indices.
        grows: Whether hair grows with the scalp.
        share: Share of the average in the rotation of every triangle of the mesh (f,); the rest is the own rotation.
        anchors: The triangles, as places in `faces`, whose rotation is averaged; the others interpolate.
    """

    def __init__(
        self,
        rig: Rig,
        inside: Bool[np.ndarray, " f"],
        grows: bool = False,
        share: Float[np.ndarray, " f"] | None = None,
    ) -> None:
        """Prepare the weights.

        Args:
            rig: The canonical mesh.
            inside: Triangles whose rotation is averaged.
            grows: Whether hair grows with the scalp; otherwise it keeps its length.
            share: Share of the average in the rotation of every triangle of the mesh, in [0, 1]; 1 if None.
        """
        self.inside, self.faces, self.grows = inside, np.flatnonzero(inside), grows
        self.share = np.where(inside, np.float32(1) if share is None else share, 0).astype(np.float32)
        corners = rig.vertices[rig.faces[self.faces]]
        centres, edges = corners.mean(axis=1), corners[:, 1:] - corners[:, :1]
        area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
        self.anchors = _spread(centres, ANCHORS)
        weight = np.exp(-0.5 * (cdist(centres, centres[self.anchors]) / RADIUS) ** 2) + 1e-12
        gather = weight * area[:, None]
        self._gather = gather / np.maximum(gather.sum(axis=0), 1e-30)  # triangles to anchors
        self._scatter = weight / weight.sum(axis=1, keepdims=True)  # anchors to triangles

    def as_arrays(self) -> dict[str, np.ndarray]:
        """What the smooth motion is made of, for a file.

        Returns:
            Arrays by name.
        """
        return {"hair_faces": self.inside, "hair_grows": np.array(self.grows), "hair_share": self.share}

    def apply(self, rotation: Float64[np.ndarray, "f 3 3"], stretch: Float64[np.ndarray, "f 3 3"]) -> None:
        """Replace the rotations of the triangles by averages, and their stretches by one factor, in place.

        The factor is 1, or, if hair grows, the geometric mean of the stretches over all directions and the
        neighbourhood.

        Args:
            rotation: Rotation of every triangle of the mesh.
            stretch: Symmetric stretch of every triangle of the mesh.
        """
        if len(self.faces) == 0:
            return
        own = rotation[self.faces].reshape(-1, 9)
        mean = own + self.share[self.faces, None].astype(np.float64) * (self._scatter @ (self._gather.T @ own) - own)
        nearest = nearest_rotations(mean.reshape(-1, 3, 3))
        factor = np.ones(len(self.faces))
        if self.grows:
            volume = np.maximum(_volumes(stretch, self.faces), 1e-9)
            factor = np.exp(self._scatter @ (self._gather.T @ np.log(volume)) / 3)
        rotation[self.faces], stretch[self.faces] = nearest, factor[:, None, None] * np.eye(3)


def smooth_motion_of(arrays: Mapping[str, Any], rig: Rig, file: Path) -> SmoothMotion:
    """Read what `SmoothMotion.as_arrays` gave.

    Args:
        arrays: The arrays, from a file.
        rig: The canonical mesh.
        file: The file, for messages.

    Returns:
        The smooth motion; of a file without shares, that of the average alone.

    Raises:
        InputError: If an array is missing, has another shape or type, or holds a share that is not in [0, 1].
    """
    count, share = len(rig.faces), None
    inside = checked_array(arrays, "hair_faces", (count,), bool, file=file)
    grows = "hair_grows" in arrays and bool(checked_array(arrays, "hair_grows", (), bool, file=file))
    if "hair_share" in arrays:
        share = checked_array(arrays, "hair_share", (count,), np.float32, within=(0, 1), file=file)
    return SmoothMotion(rig, inside, grows, share)


def nearest_rotations(matrices: Float64[np.ndarray, "n 3 3"]) -> Float64[np.ndarray, "n 3 3"]:
    """Rotation nearest to each matrix: U of its polar decomposition, or by the SVD if its determinant is small.

    Args:
        matrices: Means of rotations.

    Returns:
        The rotations.
    """
    rotations, is_proper = np.empty_like(matrices), np.empty(len(matrices), bool)
    _polar_rotations(matrices, rotations, is_proper)
    if not is_proper.all():
        left, _, right = np.linalg.svd(matrices[~is_proper])
        left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, None]
        rotations[~is_proper] = left @ right
    return rotations


@kernel
def _polar_rotations(matrices, rotations, is_proper):
    """Polar rotations of means of rotations, which are near to rotations unless the neighbourhood turns by far."""
    count, block = len(matrices), np.empty(BLOCK)
    for first in range(0, count, WIDE):
        for r in range(WIDE):
            i = min(first + r, count - 1)
            m = matrix3.load(matrices, i)
            is_proper[i] = matrix3.dot(m[0:3], matrix3.cross(m[3:6], m[6:9])) > 0.01
            store_matrix(block, r, m if is_proper[i] else matrix3.IDENTITY)
        polar_rotations(block)
        for r in range(min(WIDE, count - first)):
            matrix3.store(rotations, first + r, load_matrix(block, r))


@kernel
def _volumes(stretches, faces):
    """Determinants of the stretches of some triangles."""
    volumes = np.empty(len(faces))
    for n in range(len(faces)):
        m = matrix3.load(stretches, faces[n])
        volumes[n] = matrix3.dot(m[0:3], matrix3.cross(m[3:6], m[6:9]))
    return volumes


def _spread(points: Float64[np.ndarray, "n 3"], count: int) -> list[int]:
    """Farthest-point sampling (Gonzalez 1985)."""
    if len(points) == 0:
        return []
    chosen, distance = [0], np.full(len(points), np.inf)
    while len(chosen) < min(count, len(points)):
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
        chosen.append(int(distance.argmax()))
    return chosen
