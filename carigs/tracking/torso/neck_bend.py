"""Divide the motion of a head into that of the torso, which is the model's root, and the bend of the neck.

Landmarks show how the skull moves, not where the neck bends: a tracked head turns as a whole, with the border of its
neck. With the torso's motion as that of the root, the neck joint turns the head, and what a single joint cannot do, as
to push the chin forward, are three blendshapes that shift all that the neck carries. Skull and face stay where they
were; the border of the neck stays on the shoulders.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from carigs.head import HeadModel, HeadParameters
from carigs.head.joint_transforms import joint_transforms
from carigs.head.posing import pose, unposed_frames
from carigs.mesh.triangle_mesh import boundary_vertices
from carigs.tracking.camera_placement import rigid_mean
from carigs.tracking.own_blendshapes import with_own_blendshapes
from carigs.tracking.torso.torso_motion import TorsoView, torso_motion

ROOT, NECK = 0, 1
ROOTED = 0.5
"""Least weight of the root joint on the neck's border: other borders are those of eyes and mouth."""
UNIT = 0.01
"""Metres of a shift by a coefficient of 1."""


def bend_with_torso(
    model: HeadModel, parameters: Sequence[HeadParameters], views: Sequence[Sequence[TorsoView]]
) -> tuple[HeadModel, list[HeadParameters]]:
    """Find how the torso moves, and bend the neck between it and the head.

    Args:
        model: The head model.
        parameters: Those of each timestep.
        views: What cameras see of the torso, at each timestep.

    Returns:
        As of `bend_neck`; model and parameters as they were if the model has no neck that ends, or if no torso is seen.
    """
    border = boundary_vertices(model.faces, len(model.weights)) & (model.weights[:, ROOT] > ROOTED)
    if len(model.parents) <= NECK or model.parents[NECK] != ROOT or border.sum() < 3:
        return model, list(parameters)
    skull = skull_motion(model, parameters)
    turns = Rotation.from_matrix(skull[:, :3, :3])
    reference = int((turns * turns.mean().inv()).magnitude().argmin())
    posed = pose(model, parameters[reference])
    torso = torso_motion(views, reference, posed[border], skull[reference, :3, 1])
    return (model, list(parameters)) if torso is None else bend_neck(model, parameters, torso)


def skull_motion(model: HeadModel, parameters: Sequence[HeadParameters]) -> Float[np.ndarray, "t 4 4"]:
    """Compute the motion of what the neck joint alone carries.

    Args:
        model: The head model.
        parameters: Those of each timestep.

    Returns:
        World axes from those of the head at rest.
    """
    _, joints, rotations = unposed_frames(model, parameters)
    motion = np.tile(np.eye(4), (len(parameters), 1, 1))
    motion[:, :3] = joint_transforms(rotations, joints, model.parents)[:, NECK]
    motion[:, :3, 3] += [frame.translation for frame in parameters]
    return motion


def bend_neck(
    model: HeadModel, parameters: Sequence[HeadParameters], torso: Float[np.ndarray, "t 4 4"]
) -> tuple[HeadModel, list[HeadParameters]]:
    """Let the root follow the torso, and the neck carry the head where it was.

    Args:
        model: The head model; its second joint is the neck, a child of the first.
        parameters: Those of each timestep.
        torso: Rigid motion of the torso in world axes, from any frame to each timestep.

    Returns:
        The model with three more expressions, which shift what the neck carries, and parameters that place vertices
        which the root does not move as before. On the average over the timesteps, the neck does not bend.
    """
    skull = skull_motion(model, parameters)
    rest = rigid_mean(np.linalg.inv(torso) @ skull)
    root = torso @ rest
    neck = np.linalg.inv(root) @ skull
    carried = 1 - model.weights[:, ROOT].astype(np.float64)
    shapes = UNIT * carried[:, None, None] * np.eye(3)
    # The shift also moves the joints, by these shares.
    carried_joints = np.arange(len(model.parents)) != ROOT
    shares = model.joint_regressor @ carried if model.rest_joints is None else carried_joints.astype(float)
    root_share, neck_share = shares[[ROOT, NECK]]
    _, joints, _ = unposed_frames(model, parameters)
    bent, shifts = [], np.zeros((len(parameters), 3))
    for t, frame in enumerate(parameters):
        turn, pivot = neck[t, :3, :3], joints[t, NECK]
        left = neck[t, :3, 3] + turn @ pivot - pivot
        shift = np.linalg.solve((1 - neck_share) * turn + neck_share * np.eye(3), left)
        base = joints[t, ROOT] + root_share * shift
        rotations = frame.joints.copy()
        rotations[NECK - 1] = Rotation.from_matrix(turn).as_rotvec()
        turned = root[t, :3, :3]
        bent.append(
            replace(
                frame,
                rotation=Rotation.from_matrix(turned).as_rotvec(),
                translation=root[t, :3, 3] + turned @ base - base,
                joints=rotations,
            )
        )
        shifts[t] = shift / UNIT
    return with_own_blendshapes(model, bent, shapes, shifts, carried_joints)
