"""Expressions of one head as those of another, by how they move the landmarks of the face.

MediaPipe's landmarks lie on both heads (`carigs.embedding`): they are the registration of the templates. Each
expression of the driver moves them; least squares finds the coefficients of the other head that move its landmarks the
same way.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import lsq_linear

from carigs.embedding import LandmarkEmbedding, landmark_embedding
from carigs.errors import MeshError
from carigs.head import HeadModel, HeadParameters, pose
from carigs.motion.facial_actions import actions
from carigs.readers.npz import read_npz
from carigs.system.files import writing

DAMPING = 3e-4
"""Weight of the coefficients, relative to the mean square of the displacements: of similar expressions the least
motion is taken."""
FEWEST = 20
"""Least number of landmarks that both heads must have."""
SHIPPED, METRES_PER_UNIT = Path(__file__).with_name("procedural_actions.npz"), 2e-6
LARGEST_NAMED = 1.5
"""Largest coefficient of a named expression that one of the driver's becomes."""
SMALL_ANGLE = 0.05
"""Angle in radians at which the motion by the jaw is measured."""
LEAST = 1e-4
"""Root mean square displacement in metres below which an expression moves nothing."""


class LandmarkActions(NamedTuple):
    """How the expressions of a head move the landmarks of its face."""

    names: tuple[str, ...]
    landmarks: Int[np.ndarray, " n"]
    """Numbers among MediaPipe's 478, in ascending order."""
    points: Float[np.ndarray, "n 3"]
    """Places on the template in metres."""
    basis: Float[np.ndarray, "n 3 d"]
    """Displacements in metres at a coefficient of 1."""


def landmark_actions(model: HeadModel) -> LandmarkActions:
    """Measure a head.

    Args:
        model: The head model.

    Returns:
        Its expressions at the landmarks, with numbers for names that it does not have.

    Raises:
        MeshError: If landmarks cannot be placed on the head.
    """
    embedding = landmark_embedding(model)
    corners, weights = model.faces[embedding.faces], embedding.barycentric
    points = np.einsum("nk,nkc->nc", weights, model.v_template[corners].astype(np.float64))
    basis = np.einsum("nk,nkce->nce", weights, model.expression_basis[corners].astype(np.float64))
    names = (*model.expression_names, *map(str, range(len(model.expression_names), model.num_expressions)))
    return LandmarkActions(names, embedding.landmarks, points, basis)


def shipped_actions() -> LandmarkActions:
    """Named expressions of the procedural head, for drivers of names and heads of numbers.

    Returns:
        Its expressions at the landmarks.
    """
    arrays = read_npz(SHIPPED, "landmark actions")
    return LandmarkActions(
        tuple(map(str, arrays["names"])), arrays["landmarks"].astype(np.int64), arrays["points"].astype(np.float64),
        METRES_PER_UNIT * arrays["basis"].astype(np.float64),
    )  # fmt: skip


def ship(model: HeadModel) -> None:
    """Write the file that `shipped_actions` reads.

    Args:
        model: The procedural head.
    """
    found = landmark_actions(model)
    named = slice(0, len(model.expression_names))
    basis = np.rint(found.basis[:, :, named] / METRES_PER_UNIT).astype(np.int16)
    with writing(SHIPPED) as part, part.open("wb") as stream:
        np.savez_compressed(
            stream, names=np.array(found.names[named]), landmarks=found.landmarks.astype(np.uint16),
            points=found.points.astype(np.float32), basis=basis,
        )  # fmt: skip


def displacement_map(
    driver: LandmarkActions, head: HeadModel
) -> tuple[Float[np.ndarray, "h d"], Float[np.ndarray, "3 d"]]:
    """Matrices from the driver's coefficients to another head.

    Args:
        driver: Expressions of the driver.
        head: The other head model.

    Returns:
        Matrix to its coefficients, and to the rotation vector of its joint `jaw`, zero where it has no such joint.

    Raises:
        MeshError: If landmarks cannot be placed on the head.
    """
    own, embedding = landmark_actions(head), landmark_embedding(head)
    shared = np.intersect1d(driver.landmarks, own.landmarks)
    if len(shared) < FEWEST:
        raise MeshError("the two heads share too few landmarks of the face")
    there, here = np.isin(driver.landmarks, shared), np.isin(own.landmarks, shared)
    rotation, scale = _similarity(driver.points[there], own.points[here])
    wanted = scale * np.einsum("ij,nje->nie", rotation, driver.basis[there]).reshape(3 * len(shared), -1)
    basis = np.concatenate([own.basis[here], _jaw_motion(head, embedding, here)], axis=2)
    return _solve(basis.reshape(3 * len(shared), -1), wanted, head)


def _solve(
    basis: Float[np.ndarray, "m b"], wanted: Float[np.ndarray, "m d"], head: HeadModel
) -> tuple[Float[np.ndarray, "h d"], Float[np.ndarray, "3 d"]]:
    """Damped least squares; coefficients of named expressions are at least 0."""
    count = head.num_expressions
    moves = np.sqrt(np.mean(basis**2, axis=0)) > LEAST / 10
    active = np.sqrt(np.mean(wanted**2, axis=0)) > LEAST
    named = np.zeros(basis.shape[1], bool)
    named[: len(head.expression_names)] = [bool(actions(name)) for name in head.expression_names]
    low = np.where(named, -1e-9, -np.inf)[moves]
    high = np.where(named, LARGEST_NAMED, np.inf)[moves]
    used = basis[:, moves]
    size = np.sqrt((used**2).sum(axis=0).mean())
    damped = np.concatenate([used, np.sqrt(DAMPING) * size * np.eye(used.shape[1])])
    found = np.zeros((basis.shape[1], wanted.shape[1]))
    for column in np.flatnonzero(active):
        target = np.concatenate([wanted[:, column], np.zeros(used.shape[1])])
        if np.isinf(low).all():
            found[moves, column] = np.linalg.lstsq(damped, target)[0]
        else:
            found[moves, column] = lsq_linear(damped, target, (low, high), tol=1e-8).x
    jaw = np.zeros((3, wanted.shape[1]))
    jaw[: found.shape[0] - count] = found[count:]
    return np.where(named[:count, None], np.maximum(found[:count], 0), found[:count]), jaw


def _jaw_motion(head: HeadModel, embedding: LandmarkEmbedding, kept: np.ndarray) -> Float[np.ndarray, "n 3 k"]:
    """Displacement of the landmarks for each radian of the jaw's rotation about x, y and z."""
    if "jaw" not in head.joint_names[1:] or any(actions(name) & {"jaw_open"} for name in head.expression_names):
        return np.zeros((int(kept.sum()), 3, 0))  # a head whose jaw opens by an expression needs no joint
    corners, weights = head.faces[embedding.faces[kept]], embedding.barycentric[kept]
    rest, columns = HeadParameters.zeros(head), []
    still = pose(head, rest)
    for axis in range(3):
        joints = rest.joints.copy()
        joints[head.joint_names.index("jaw") - 1, axis] = SMALL_ANGLE
        moved = pose(head, HeadParameters(joints=joints, shape=rest.shape, expression=rest.expression)) - still
        columns.append(np.einsum("nk,nkc->nc", weights, moved[corners]) / SMALL_ANGLE)
    return np.stack(columns, axis=2)


def _similarity(source: Float[np.ndarray, "n 3"], target: Float[np.ndarray, "n 3"]) -> tuple[np.ndarray, float]:
    """Rotation and scale that carry one head's landmarks to the other's (Umeyama 1991)."""
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    u, s, vt = np.linalg.svd(b.T @ a)
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    return (u * sign) @ vt, float((s * sign).sum() / (a**2).sum())
