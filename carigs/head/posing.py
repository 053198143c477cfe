"""Vertices from parameters: blendshapes, pose correctives, linear blend skinning (Li et al. 2017, FLAME)."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from jaxtyping import Float, Int

from carigs.errors import MeshError
from carigs.exaggeration.gamma_path import Caricature
from carigs.head.model import N_JOINTS, N_SHAPE, HeadModel
from carigs.head.parameters import HeadParameters

LARGEST_COORDINATE = 1e4
"""Largest coordinate of a head in metres, without its sign; what uses the vertices may overflow beyond."""


def neutral(model: HeadModel, parameters: HeadParameters) -> Float[np.ndarray, "v 3"]:
    """Neutral head of a subject: template + identity blendshapes + static offset, without expression and pose.

    Args:
        model: The head model.
        parameters: Any frame of the subject.

    Returns:
        Vertices in the model's rest frame, in metres.

    Raises:
        MeshError: If a vertex is not finite or farther away than `LARGEST_COORDINATE`.
    """
    return _in_range(_neutral(model, parameters), "neutral")


def _neutral(model: HeadModel, parameters: HeadParameters) -> Float[np.ndarray, "v 3"]:
    vertices = model.v_template + _sum_blendshapes(model.shapedirs[:, :, :N_SHAPE], parameters.shape)
    return vertices if parameters.static_offset is None else vertices + parameters.static_offset


def _in_range(vertices: Float[np.ndarray, "v 3"], kind: str) -> Float[np.ndarray, "v 3"]:
    """Refuse vertices that overflow, from parameters that are finite but far too large."""
    if not np.abs(vertices).max(initial=0) <= LARGEST_COORDINATE:  # also refuses NaN
        bad = int(np.argmax(~(np.abs(vertices) <= LARGEST_COORDINATE).all(axis=1)))
        problem = f"lies at {vertices[bad].tolist()} m; coordinates up to {LARGEST_COORDINATE:g} m are possible"
        raise MeshError(f"vertex {bad} of the {kind} head {problem}: check its parameters")
    return vertices


def pose(
    model: HeadModel, parameters: HeadParameters, caricature: Caricature | None = None
) -> Float[np.ndarray, "v 3"]:
    """Pose the head by linear blend skinning (Li et al. 2017, equations 1 to 5).

    v = sum_j weights_j (world_from_rest_j (shaped + corrective)) + translation. The joints are regressed from the
    shaped vertices; those of a caricature move with it.

    Args:
        model: The head model.
        parameters: One frame.
        caricature: Change of the neutral and the blendshapes at a level; None for the natural head.

    Returns:
        Vertices in world coordinates, in metres.

    Raises:
        MeshError: If a vertex is not finite or farther away than `LARGEST_COORDINATE`.
    """
    shaped = _neutral(model, parameters) + _sum_blendshapes(model.shapedirs[:, :, N_SHAPE:], parameters.expression)
    rotations = _rotations(parameters)
    pose_feature = (rotations[1:] - np.eye(3)).reshape(-1)
    corrective = _sum_blendshapes(model.posedirs, pose_feature)
    if caricature is not None:
        shaped = shaped + caricature.displacement + caricature.blendshape_change(parameters.expression)
        corrective = corrective + caricature.blendshape_change(pose_feature, first=len(parameters.expression))
    joints = model.joint_regressor.astype(np.float64) @ shaped
    world_from_rest = _joint_transforms(rotations, joints, model.parents)
    blended = np.tensordot(model.weights.astype(np.float64), world_from_rest, axes=1)  # (v, 4, 4)
    posed = np.einsum("vij,vj->vi", blended[:, :3, :3], shaped + corrective) + blended[:, :3, 3]
    return _in_range(posed + parameters.translation, "posed")


def active_blendshapes(
    model: HeadModel, parameters: Iterable[HeadParameters]
) -> tuple[Float[np.ndarray, "b v 3"], Int[np.ndarray, " b"]]:
    """Blendshapes and pose correctives with a non-zero coefficient in any of the frames.

    Args:
        model: The head model.
        parameters: The frames.

    Returns:
        The blendshapes in metres per unit of the coefficient, and their indices: expressions are counted first, then
        pose correctives.
    """
    blendshapes = np.concatenate([model.shapedirs[:, :, N_SHAPE:], model.posedirs], axis=2)
    is_nonzero = blendshapes.any(axis=(0, 1))
    coefficients = [np.concatenate([p.expression, (_rotations(p)[1:] - np.eye(3)).reshape(-1)]) for p in parameters]
    columns = np.flatnonzero(is_nonzero & np.any(coefficients, axis=0))
    return blendshapes[:, :, columns].transpose(2, 0, 1).astype(np.float64), columns


def rotation_matrix(rotation_vector: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Rodrigues' formula: R = I + sin(a)/a K + (1 - cos a)/a^2 K^2 with the cross product matrix K of the vector.

    Args:
        rotation_vector: Axis times angle a, in radians.

    Returns:
        Rotation matrix; exact in the limit of a vanishing vector.
    """
    x, y, z = rotation_vector
    angle_squared = x * x + y * y + z * z
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = np.sqrt(angle_squared)
    # sin(a)/a and (1 - cos a)/a^2 by sinc, which is smooth at 0.
    first, second = np.sinc(angle / np.pi), 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    return np.eye(3) + first * cross + second * cross @ cross


def _sum_blendshapes(
    blendshapes: Float[np.ndarray, "v 3 b"], coefficients: Float[np.ndarray, " b"]
) -> Float[np.ndarray, "v 3"]:
    used = np.flatnonzero(coefficients)  # most of the 400 coefficients of a tracked frame are zero
    return blendshapes[:, :, used].astype(np.float64) @ coefficients[used]


def _rotations(parameters: HeadParameters) -> Float[np.ndarray, "5 3 3"]:
    vectors = [parameters.rotation, parameters.neck, parameters.jaw, parameters.eyes[:3], parameters.eyes[3:]]
    return np.stack([rotation_matrix(vector) for vector in vectors])


def _joint_transforms(
    rotations: Float[np.ndarray, "5 3 3"], joints: Float[np.ndarray, "5 3"], parents: np.ndarray
) -> Float[np.ndarray, "5 4 4"]:
    """Rigid transforms world_from_rest of the joints, along the kinematic chain."""
    world_from_joint = np.zeros((N_JOINTS, 4, 4))
    for j in range(N_JOINTS):
        local = np.eye(4)
        local[:3, :3] = rotations[j]
        local[:3, 3] = joints[j] if parents[j] < 0 else joints[j] - joints[parents[j]]
        world_from_joint[j] = local if parents[j] < 0 else world_from_joint[parents[j]] @ local
    world_from_rest = world_from_joint.copy()
    world_from_rest[:, :3, 3] -= np.einsum("jik,jk->ji", world_from_joint[:, :3, :3], joints)
    return world_from_rest
