"""From parameters to vertices: blendshapes, pose correctives, linear blend skinning (Li et al. 2017, FLAME)."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from jaxtyping import Float, Int

from carigs.exaggeration.caricature import Caricature
from carigs.head.model import N_JOINTS, N_SHAPE, HeadModel
from carigs.head.parameters import HeadParameters


def neutral(model: HeadModel, parameters: HeadParameters) -> Float[np.ndarray, "v 3"]:
    """The subject without expression, pose and translation: template + identity + static offset (metres)."""
    vertices = model.v_template + _blend(model.shapedirs[:, :, :N_SHAPE], parameters.shape)
    return vertices if parameters.static_offset is None else vertices + parameters.static_offset


def pose(
    model: HeadModel, parameters: HeadParameters, caricature: Caricature | None = None
) -> Float[np.ndarray, "v 3"]:
    """World vertices (metres) of one frame.

    `caricature` is added to the neutral and its motions before joints turn; these are regressed from the displaced
    vertices, so that they move along.
    """
    shaped = neutral(model, parameters) + _blend(model.shapedirs[:, :, N_SHAPE:], parameters.expression)
    rotations = _rotations(parameters)
    feature = (rotations[1:] - np.eye(3)).reshape(-1)
    corrective = _blend(model.posedirs, feature)
    if caricature is not None:
        shaped = shaped + caricature.displacement + caricature.change(parameters.expression)
        corrective = corrective + caricature.change(feature, first=len(parameters.expression))
    joints = model.joint_regressor.astype(np.float64) @ shaped
    world_from_rest = _joint_transforms(rotations, joints, model.parents)
    blended = np.tensordot(model.weights.astype(np.float64), world_from_rest, axes=1)  # (v, 4, 4)
    posed = np.einsum("vij,vj->vi", blended[:, :3, :3], shaped + corrective) + blended[:, :3, 3]
    return posed + parameters.translation


def motions(
    model: HeadModel, parameters: Iterable[HeadParameters]
) -> tuple[Float[np.ndarray, "b v 3"], Int[np.ndarray, " b"]]:
    """The directions that any of these frames moves in, and their columns: expressions first, then pose correctives."""
    directions = np.concatenate([model.shapedirs[:, :, N_SHAPE:], model.posedirs], axis=2)
    used = directions.any(axis=(0, 1))
    codes = [np.concatenate([p.expression, (_rotations(p)[1:] - np.eye(3)).reshape(-1)]) for p in parameters]
    columns = np.flatnonzero(used & np.any(codes, axis=0))
    return directions[:, :, columns].transpose(2, 0, 1).astype(np.float64), columns


def rotation_matrix(rotation_vector: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Rodrigues' formula; exact in the limit of a vanishing vector."""
    x, y, z = rotation_vector
    angle_squared = x * x + y * y + z * z
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = np.sqrt(angle_squared)
    # sin(a)/a and (1 - cos a)/a^2 through sinc, which is smooth at 0.
    first, second = np.sinc(angle / np.pi), 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    return np.eye(3) + first * cross + second * cross @ cross


def _blend(directions: Float[np.ndarray, "v 3 b"], codes: Float[np.ndarray, "b"]) -> Float[np.ndarray, "v 3"]:
    used = np.flatnonzero(codes)  # trackers leave most of the 400 codes at zero
    return directions[:, :, used].astype(np.float64) @ codes[used]


def _rotations(parameters: HeadParameters) -> Float[np.ndarray, "5 3 3"]:
    vectors = [parameters.rotation, parameters.neck, parameters.jaw, parameters.eyes[:3], parameters.eyes[3:]]
    return np.stack([rotation_matrix(vector) for vector in vectors])


def _joint_transforms(
    rotations: Float[np.ndarray, "5 3 3"], joints: Float[np.ndarray, "5 3"], parents: np.ndarray
) -> Float[np.ndarray, "5 4 4"]:
    """Rigid transforms of the rest pose by the kinematic chain."""
    world_from_joint = np.zeros((N_JOINTS, 4, 4))
    for j in range(N_JOINTS):
        local = np.eye(4)
        local[:3, :3] = rotations[j]
        local[:3, 3] = joints[j] if parents[j] < 0 else joints[j] - joints[parents[j]]
        world_from_joint[j] = local if parents[j] < 0 else world_from_joint[parents[j]] @ local
    world_from_rest = world_from_joint.copy()
    world_from_rest[:, :3, 3] -= np.einsum("jik,jk->ji", world_from_joint[:, :3, :3], joints)
    return world_from_rest
