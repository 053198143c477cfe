"""A head model with blendshapes of one person's own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from carigs.head import HeadModel, HeadParameters
from carigs.head.joint_transforms import joint_transforms, rotation_matrices
from carigs.head.model_arrays import RestJoints


def with_own_blendshapes(
    model: HeadModel,
    parameters: Sequence[HeadParameters],
    shapes: Float[np.ndarray, "v 3 k"],
    coefficients: Float[np.ndarray, "t k"],
    carried_joints: Bool[np.ndarray, " j"] | None = None,
) -> tuple[HeadModel, list[HeadParameters]]:
    """Add expressions to a head model.

    Args:
        model: The head model, which may have own expressions already.
        parameters: Those of each timestep.
        shapes: The blendshapes in metres.
        coefficients: Of each timestep.
        carried_joints: Joints of a model with rest joints of its own that move as what the blendshapes shift most; none
            if None. In other models, the vertices move the joints.

    Returns:
        The model with more expressions, which lie behind those with names and before others, so that names still say
        which coefficient is whose; and parameters with their coefficients.
    """
    named, count = model.expression_names, shapes.shape[2]
    place = len(named) or model.num_expressions
    names = (*named, *(f"own_{number}" for number in range(place, place + count))) if named else ()
    column, rest_joints = model.num_identity + place, model.rest_joints
    before, after = np.split(model.shapedirs, [column], axis=2)
    basis = np.concatenate([before, shapes.astype(model.shapedirs.dtype), after], axis=2)
    if rest_joints is not None:
        moved = np.insert(rest_joints.basis, [column] * count, 0, axis=2)
        if carried_joints is not None:
            farthest = np.linalg.norm(shapes, axis=1).argmax(axis=0)
            moved[carried_joints, :, column : column + count] = shapes[farthest, :, np.arange(count)].T
        rest_joints = RestJoints(rest_joints.template, moved)
    larger = replace(model, shapedirs=basis, expression_names=names, rest_joints=rest_joints)
    return larger, [
        replace(frame, expression=np.concatenate([frame.expression[:place], own, frame.expression[place:]]))
        for frame, own in zip(parameters, coefficients, strict=True)
    ]


def principal_shapes(
    moved: Float[np.ndarray, "t n 3"], count: int
) -> tuple[Float[np.ndarray, "n 3 k"], Float[np.ndarray, "t k"]]:
    """Find the principal components of displacements, about no displacement.

    Args:
        moved: Displacements of points at each timestep, in metres.
        count: Most components.

    Returns:
        Displacements of each component in metres, and its coefficient at each timestep, with a root mean square of 1.
    """
    left, size, right = np.linalg.svd(moved.reshape(len(moved), -1), full_matrices=False)
    scale = np.sqrt(len(moved))
    shapes = (right[:count] * (size[:count] / scale)[:, None]).reshape(-1, *moved.shape[1:])
    return np.moveaxis(shapes, 0, 2), left[:, :count] * scale


def skinning_turns(
    model: HeadModel, parameters: Sequence[HeadParameters], weights: Float[np.ndarray, "n j"]
) -> Float[np.ndarray, "t n 3 3"]:
    """Compute how the joints turn displacements on the neutral head: the linear part of linear blend skinning.

    Args:
        model: The head model.
        parameters: Those of each timestep.
        weights: Skinning weights of points.

    Returns:
        Matrices from displacements at rest to those in the world.
    """
    vectors = np.stack([np.vstack([frame.rotation, frame.joints]) for frame in parameters])
    chain = joint_transforms(rotation_matrices(vectors), np.zeros_like(vectors), model.parents)[..., :3]
    return np.einsum("nj,tjxy->tnxy", weights, chain)
