"""Triangles that move as in GaussianAvatars: by the similarity between their frames, without stretch or shear."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from carigs.splat.rig.face_motion import FaceMotion
from carigs.splat.rig.rig import Rig, motion_records


def similarity_motion(rig: Rig, motion: FaceMotion) -> FaceMotion:
    """Replace the Jacobian of every triangle by the similarity that takes its canonical frame to its posed frame.

    GaussianAvatars (Qian et al. 2024) places a Gaussian at k R mu + T, with the frame R = [edge, normal, binormal] and
    the scale k = (base + height) / 2 of the posed triangle. With the frame k_c R_c of the canonical triangle this is
    J k_c R_c mu + T for the Jacobian J = (k / k_c) R R_c^T, in the axes of either package.

    Args:
        rig: Canonical mesh.
        motion: Motion of the triangles to the posed mesh. Of a degenerate triangle only the rotation is kept.

    Returns:
        The motion with rotations R R_c^T and stretches k / k_c, equal in all directions.
    """
    corners = rig.vertices[rig.faces]
    edges = corners[:, 1:] - corners[:, :1]
    canonical, canonical_scale = _frames(edges)
    posed, posed_scale = _frames(np.einsum("fij,fkj->fki", motion.jacobian, edges))
    valid = (canonical_scale > 0) & (posed_scale > 0) & rig.inverse_edges.any(axis=(1, 2))
    rotation = np.where(valid[:, None, None], posed @ canonical.transpose(0, 2, 1), motion.rotation)
    ratio = np.where(valid, posed_scale / np.where(valid, canonical_scale, 1), 1)
    stretch = ratio[:, None, None] * np.eye(3)
    return FaceMotion(motion_records(rig, motion.centre.astype(np.float64), rotation, stretch))


def _frames(edges: Float64[np.ndarray, "f 2 3"]) -> tuple[Float64[np.ndarray, "f 3 3"], Float64[np.ndarray, " f"]]:
    """Frames [edge, towards the third corner, normal] of triangles from their edges 01 and 02, and their scales k."""
    base = np.linalg.norm(edges[:, 0], axis=1)
    edge = edges[:, 0] / np.maximum(base, 1e-30)[:, None]
    normal = np.cross(edge, edges[:, 1])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-30)[:, None]
    towards = np.cross(normal, edge)
    return np.stack([edge, towards, normal], axis=2), (base + np.einsum("fi,fi->f", towards, edges[:, 1])) / 2
