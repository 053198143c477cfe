"""The world of a tracked dataset: its origin and axes, which landmarks leave open."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from carigs.fitting.head_points import HeadPoints
from carigs.tracking.camera_placement import rigid_mean, rotation_vectors
from carigs.tracking.cameras import Cameras


def at_the_head(
    points: HeadPoints, frames: Float[np.ndarray, "t q"], cameras: Cameras
) -> tuple[Float[np.ndarray, "t q"], Cameras]:
    """Move the world to where a dataset has it: its origin at the head; with several cameras, turned as the head is.

    One camera stands before the person, and stays level.

    Args:
        points: The landmarks on the person's head.
        frames: Parameters of each frame.
        cameras: The cameras.

    Returns:
        The same head and cameras in another world.
    """
    centre = np.median(frames[:, :3], axis=0)
    moved, poses, matrices = frames.copy(), cameras.poses.copy(), cameras.camera_from_world()
    moved[:, :3] -= centre
    poses[:, 3:] += matrices[:, :, :3] @ centre
    if len(cameras.focal) > 1:
        heads = np.tile(np.eye(4), (len(frames), 1, 1))
        heads[:, :3, :3] = Rotation.from_rotvec(frames[:, 3:6]).as_matrix()
        turn = rigid_mean(heads)[:3, :3].T
        # The model turns about its root joint, which expressions may move.
        roots = points.joints[0] + frames[:, points.fitted.expression_slice] @ points.joint_blendshapes[1][0].T
        moved[:, :3] = (moved[:, :3] + roots) @ turn.T - roots
        moved[:, 3:6] = rotation_vectors(turn @ heads[:, :3, :3])
        poses[:, :3] = rotation_vectors(matrices[:, :, :3] @ turn.T)
    return moved, replace(cameras, poses=poses)
