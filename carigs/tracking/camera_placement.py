"""Where cameras stand to each other, from the head's pose in each of them: closed form, no calibration."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

FAR_OFF = 3.0
"""A rotation farther from the mean than this many median distances does not count."""
ROUNDS = 3
"""Times that the mean is computed again without rotations that are far off."""


def rigid_mean(transforms: Float[np.ndarray, "n 4 4"]) -> Float[np.ndarray, "4 4"]:
    """Mean of rigid transformations of which some may be wrong.

    Args:
        transforms: Rotations and translations.

    Returns:
        The rotation nearest to the mean of the rotations (chordal mean, Hartley et al. 2013), without those far off it,
        and the medians of the translation.
    """
    rotations = transforms[:, :3, :3]
    kept = np.ones(len(rotations), bool)
    for _ in range(ROUNDS):
        u, _, vt = np.linalg.svd(rotations[kept].sum(axis=0))
        mean = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
        distance = np.linalg.norm(rotations - mean, axis=(1, 2))
        kept = distance <= FAR_OFF * np.median(distance) + 1e-12
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = mean, np.median(transforms[kept, :3, 3], axis=0)
    return found


def linked(seen: Bool[np.ndarray, "t c"]) -> Bool[np.ndarray, " c"]:
    """Find the cameras whose places to the first one can be known.

    Args:
        seen: In which frames each camera sees the head.

    Returns:
        Whether a camera sees it together with the first one, or with another camera that is linked to it.
    """
    reached = np.arange(seen.shape[1]) == 0
    for _ in range(seen.shape[1]):
        reached |= seen[seen[:, reached].any(axis=1)].any(axis=0)
    return reached


def place_cameras(
    camera_from_head: Float[np.ndarray, "t c 4 4"],
) -> tuple[Float[np.ndarray, "c 4 4"], Float[np.ndarray, "t 4 4"]]:
    """Place cameras, and the head in every frame, against the first camera.

    One camera after the other, that with the most frames which another one of a known place sees.

    Args:
        camera_from_head: The head's pose before each camera; NaN where a camera does not see it.

    Returns:
        The first camera's frame from the world's is the identity. camera_from_world of each camera, NaN for those that
        are not `linked` to the first one; and world_from_head of each frame, NaN for those that no placed camera sees.
    """
    c = camera_from_head.shape[1]
    seen = np.isfinite(camera_from_head[:, :, 0, 0])
    cameras, heads = np.full((c, 4, 4), np.nan), camera_from_head[:, 0].copy()
    cameras[0] = np.eye(4)
    for _ in range(1, c):
        common = seen & np.isfinite(heads[:, :1, 0])
        common[:, np.isfinite(cameras[:, 0, 0])] = False
        i = int(common.sum(axis=0).argmax())
        if not common[:, i].any():
            break
        which = common[:, i]
        cameras[i] = rigid_mean(camera_from_head[which, i] @ np.linalg.inv(heads[which]))
        new = seen[:, i] & ~np.isfinite(heads[:, 0, 0])
        heads[new] = np.linalg.inv(cameras[i]) @ camera_from_head[new, i]
    placed = np.isfinite(cameras[:, 0, 0])
    for frame in np.flatnonzero(seen[:, placed].sum(axis=1) > 1):
        which = seen[frame] & placed
        heads[frame] = rigid_mean(np.linalg.inv(cameras[which]) @ camera_from_head[frame, which])
    return cameras, heads


def rotation_vectors(rotations: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, "n 3"]:
    """Logarithms of rotations.

    Args:
        rotations: Matrices.

    Returns:
        Axes times angles, in radians.
    """
    return Rotation.from_matrix(rotations).as_rotvec()
