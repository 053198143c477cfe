"""Vertices from parameters: blendshapes, pose correctives, linear blend skinning (Li et al. 2017, FLAME)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from carigs.errors import MeshError
from carigs.exaggeration.gamma_path import Caricature
from carigs.head.joint_transforms import joint_transforms, rotation_matrices
from carigs.head.model import HeadModel
from carigs.head.model_arrays import LARGEST_COORDINATE, RestJoints
from carigs.head.parameters import HeadParameters


def neutral(model: HeadModel, parameters: HeadParameters) -> Float[np.ndarray, "v 3"]:
    """Neutral head of a subject: template + identity blendshapes + static offset, without expression and pose.

    Args:
        model: The head model.
        parameters: Any frame of the subject.

    Returns:
        Vertices in the model's rest frame, in metres.

    Raises:
        MeshError: If the parameters have other sizes than the model, or if a vertex is not finite or farther away than
            `LARGEST_COORDINATE`.
    """
    _check_sizes(model, parameters)
    vertices = model.v_template + _sum_blendshapes(model.identity_basis, parameters.shape[None])[0]
    if parameters.static_offset is not None:
        vertices = vertices + parameters.static_offset
    return _in_range(vertices, "neutral")


def subject_model(model: HeadModel, parameters: HeadParameters) -> HeadModel:
    """Head model of one subject: its template is the subject's neutral head, and it has no identity blendshapes.

    Args:
        model: The head model.
        parameters: Any frame of the subject.

    Returns:
        A model with identity coefficients of no effect. It is posed as the general model, with the subject's shape and
        static offset, up to the rounding of the template to float32.

    Raises:
        MeshError: As for `neutral`.
    """
    template = neutral(model, parameters)
    shapedirs = model.shapedirs.copy()
    shapedirs[:, :, : model.num_identity] = 0
    rest_joints = model.rest_joints
    if rest_joints is not None:
        identity = rest_joints.basis[:, :, : model.num_identity] @ parameters.shape
        if parameters.static_offset is not None:
            identity = identity + model.joint_regressor.astype(np.float64) @ parameters.static_offset
        basis = rest_joints.basis.copy()
        basis[:, :, : model.num_identity] = 0
        rest_joints = RestJoints((rest_joints.template + identity).astype(np.float32), basis)
    return replace(model, v_template=template.astype(np.float32), shapedirs=shapedirs, rest_joints=rest_joints)


def pose(
    model: HeadModel, parameters: HeadParameters, caricature: Caricature | None = None
) -> Float[np.ndarray, "v 3"]:
    """Pose the head by linear blend skinning (Li et al. 2017, equations 1 to 5).

    v = sum_j weights_j (world_from_rest_j (shaped + corrective)) + translation with

        shaped = template + blendshapes . coefficients + offsets + displacement of the caricature,
        joints = joint template + joint basis . coefficients + regressor (offsets + displacement of the caricature).

    Args:
        model: The head model.
        parameters: One frame.
        caricature: Change of the neutral and the blendshapes at a level; None for the natural head.

    Returns:
        Vertices in world coordinates, in metres.

    Raises:
        MeshError: If the parameters have other sizes than the model, or if a vertex is not finite or farther away than
            `LARGEST_COORDINATE`.
    """
    return pose_frames(model, [parameters], caricature)[0]


def pose_frames(
    model: HeadModel, frames: Sequence[HeadParameters], caricature: Caricature | None = None
) -> Float[np.ndarray, "t v 3"]:
    """Pose the head in many frames as `pose` does: sums of blendshapes are one product of matrices.

    Args:
        model: The head model.
        frames: One or more frames, of one or more subjects. A few arrays of (frames, v, 3) are held in memory.
        caricature: Change of the neutral and the blendshapes at a level; None for the natural head.

    Returns:
        Vertices of every frame in world coordinates, in metres.

    Raises:
        MeshError: As for `pose`.
    """
    vertices, joints, rotations = unposed_frames(model, frames, caricature)
    posed = _skin(model, vertices, joint_transforms(rotations, joints, model.parents))
    posed += np.array([parameters.translation for parameters in frames])[:, None]
    return _in_range(posed, "posed")


def unposed_frames(
    model: HeadModel, frames: Sequence[HeadParameters], caricature: Caricature | None = None
) -> tuple[Float[np.ndarray, "t v 3"], Float[np.ndarray, "t j 3"], Float[np.ndarray, "t j 3 3"]]:
    """What `pose_frames` skins: heads with blendshapes, offsets and pose correctives, before the joints turn.

    Args:
        model: The head model.
        frames: One or more frames, of one or more subjects.
        caricature: Change of the neutral and the blendshapes at a level; None for the natural head.

    Returns:
        Vertices of every frame in the rest frame (metres), the positions of its joints there, and the rotations of its
        joints relative to their parents.

    Raises:
        MeshError: If the parameters have other sizes than the model.
    """
    for parameters in frames:
        _check_sizes(model, parameters)
    # The frames of a subject share the sum of the identity blendshapes.
    shapes, subject = np.unique([parameters.shape for parameters in frames], axis=0, return_inverse=True)
    expressions = np.array([parameters.expression for parameters in frames])
    natural = _shaped(model, shapes)
    shaped = _sum_rows(model.expression_rows, expressions).reshape(-1, *model.v_template.shape) + natural[subject]
    coefficients = np.concatenate([shapes[subject], expressions], axis=1)
    joints = model.joint_template + np.einsum("jcb,tb->tjc", model.joint_basis, coefficients)
    rotations = rotation_matrices(np.array([_rotation_vectors(parameters) for parameters in frames]))
    pose_features = _pose_features(model, rotations)
    corrective = _sum_rows(model.corrective_rows, pose_features).reshape(shaped.shape)
    regressor = model.joint_regressor.astype(np.float64)
    for t, parameters in enumerate(frames):
        offsets = [o for o in (parameters.static_offset, parameters.dynamic_offset) if o is not None]
        if caricature is not None:
            offsets += [caricature.displacement, caricature.blendshape_change(parameters.expression)]
            corrective[t] += caricature.blendshape_change(pose_features[t], first=model.num_expressions)
        if offsets:
            offset = sum(offsets)
            shaped[t] += offset
            joints[t] += regressor @ offset
    return shaped + corrective, joints, rotations


def posed_changes(
    model: HeadModel, parameters: HeadParameters, caricatures: Sequence[Caricature]
) -> Float[np.ndarray, "k v 3"]:
    """Change of the posed head by each of several caricatures: pose(..., caricature) - pose(...) up to rounding.

    With given rotations, linear blend skinning is affine in the change of the rest shape, joints included. So the
    posed head of a sum of weighted caricatures is that of the natural head plus the same sum of these changes.

    Args:
        model: The head model.
        parameters: One frame.
        caricatures: Changes of the neutral and the blendshapes.

    Returns:
        Change of every vertex by each caricature, in metres.

    Raises:
        MeshError: If the parameters have other sizes than the model.
    """
    _check_sizes(model, parameters)
    rotations = rotation_matrices(_rotation_vectors(parameters)[None])
    features = _pose_features(model, rotations)[0]
    shaped = np.array([c.displacement + c.blendshape_change(parameters.expression) for c in caricatures], np.float64)
    corrective = np.array([c.blendshape_change(features, first=model.num_expressions) for c in caricatures])
    joints = np.stack([model.joint_regressor.astype(np.float64) @ offset for offset in shaped])
    rotations = np.repeat(rotations, len(caricatures), axis=0)
    return _skin(model, shaped + corrective, joint_transforms(rotations, joints, model.parents))


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
    frames = list(parameters)
    blendshapes = np.concatenate([model.expression_basis, model.posedirs], axis=2)
    is_nonzero = blendshapes.any(axis=(0, 1))
    rotations = rotation_matrices(np.array([_rotation_vectors(p) for p in frames]))
    expressions = np.array([p.expression for p in frames])
    coefficients = np.concatenate([expressions, _pose_features(model, rotations)], axis=1)
    columns = np.flatnonzero(is_nonzero & coefficients.any(axis=0))
    return blendshapes[:, :, columns].transpose(2, 0, 1).astype(np.float64), columns


def _check_sizes(model: HeadModel, parameters: HeadParameters) -> None:
    """Refuse parameters of another model."""
    v = model.v_template.shape
    expected = {
        "joints": (len(model.parents) - 1, 3), "shape": (model.num_identity,), "expression": (model.num_expressions,),
        "static_offset": v, "dynamic_offset": v,
    }  # fmt: skip
    for name, shape in expected.items():
        value = getattr(parameters, name)
        if value is not None and value.shape != shape:
            raise MeshError(f"{name} has the shape {value.shape}, the head model needs {shape}")


def _in_range(vertices: Float[np.ndarray, "*t v 3"], kind: str) -> Float[np.ndarray, "*t v 3"]:
    """Refuse vertices that overflow, from parameters that are finite but far too large."""
    if not np.abs(vertices).max(initial=0) <= LARGEST_COORDINATE:  # also refuses NaN
        *_, bad = bad_index = tuple(np.argwhere(~(np.abs(vertices) <= LARGEST_COORDINATE).all(axis=-1))[0])
        problem = f"lies at {vertices[bad_index].tolist()} m; coordinates up to {LARGEST_COORDINATE:g} m are possible"
        raise MeshError(f"vertex {bad} of the {kind} head {problem}: check its parameters")
    return vertices


def _shaped(model: HeadModel, shapes: Float[np.ndarray, "n i"]) -> Float[np.ndarray, "n v 3"]:
    """Shaped templates of subjects; that of a single one is kept, because most frames are posed one by one."""
    if len(shapes) > 1:
        return model.v_template + _sum_blendshapes(model.identity_basis, shapes)
    known, key = model.shaped_templates, shapes.tobytes()
    if (shaped := known.get(key)) is None:
        shaped = model.v_template + _sum_blendshapes(model.identity_basis, shapes)[0]
        known.clear()
        known[key] = shaped
    return shaped[None]


def _sum_blendshapes(
    blendshapes: Float[np.ndarray, "v 3 b"], coefficients: Float[np.ndarray, "t b"]
) -> Float[np.ndarray, "t v 3"]:
    used = np.flatnonzero(coefficients.any(axis=0))  # most of the 400 coefficients of a tracked frame are zero
    active = blendshapes[:, :, used].astype(np.float64)
    if len(coefficients) == 1:  # in small products, whose rounding does not depend on the number of BLAS threads
        return (active @ coefficients[0, used])[None]
    rows = active.reshape(blendshapes.shape[0] * 3, len(used))
    return (coefficients[:, used] @ rows.T).reshape(len(coefficients), *blendshapes.shape[:2])


def _sum_rows(rows: Float[np.ndarray, "b m"], coefficients: Float[np.ndarray, "t c"]) -> Float[np.ndarray, "t m"]:
    """Sums of blendshapes that are rows of an array, of which there may be none."""
    total = np.zeros((len(coefficients), rows.shape[1]))
    if len(coefficients) > 1 and len(rows):
        used = np.flatnonzero(coefficients.any(axis=0))
        return coefficients[:, used] @ rows[used].astype(np.float64)
    for one, frame in zip(total, coefficients, strict=True):
        for k in np.flatnonzero(frame[: len(rows)]):  # one after the other: rounding depends on no number of threads
            one += np.multiply(rows[k], frame[k], dtype=np.float64)
    return total


def _rotation_vectors(parameters: HeadParameters) -> Float[np.ndarray, "j 3"]:
    return np.concatenate([parameters.rotation[None], parameters.joints])


def _pose_features(model: HeadModel, rotations: Float[np.ndarray, "t j 3 3"]) -> Float[np.ndarray, "t p"]:
    """Coefficients of the pose correctives: R - I of the last joints."""
    corrected = model.posedirs.shape[2] // 9
    last = rotations[:, rotations.shape[1] - corrected :]
    return (last - np.eye(3)).reshape(len(rotations), -1)


def _skin(
    model: HeadModel, vertices: Float[np.ndarray, "t v 3"], world_from_rest: Float[np.ndarray, "t j 3 4"]
) -> Float[np.ndarray, "t v 3"]:
    """Linear blend skinning: sum_j weights_j (R_j x + t_j), one product of matrices for each frame."""
    weights = model.weights.astype(np.float64)
    weighted = np.ones((*weights.shape, 4))
    posed = np.empty_like(vertices)
    for t, x in enumerate(vertices):
        weighted[:, :, :3] = x[:, None]
        products = (weights[:, :, None] * weighted).reshape(len(x), -1)
        posed[t] = products @ world_from_rest[t].transpose(0, 2, 1).reshape(-1, 3)
    return posed
