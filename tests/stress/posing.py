"""Cases of the suite `rig`: rotation vectors, chains of joints, and parameters that no head can have."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import product

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from carigs.head import HeadModel, HeadParameters, pose
from carigs.head.joint_transforms import rotation_matrices
from stress.case import Case, Measure, difference

PI = np.pi
ANGLES = (0.0, 1e-300, 1e-12, 1e-8, 1e-4, 1.0, PI / 2, PI - 1e-6, PI - 1e-9, PI, PI + 1e-9, 2 * PI, 2 * PI + 1e-9, 1e4)
AXES = {"x": (1, 0, 0), "-y": (0, -1, 0), "z": (0, 0, 1), "diagonal": (1, 1, 1), "oblique": (0.3, -2.0, 0.7)}


def cases() -> Iterator[Case]:
    """All cases.

    Yields:
        Cases.
    """
    for angle, (axis, direction) in product(ANGLES, AXES.items()):
        vector = angle * np.array(direction) / np.linalg.norm(direction)
        yield Case(f"rotation by {angle:.17g} about {axis}", partial(rotation, vector))
    for joints, angle in product((1, 2, 5, 20), (0.0, 1e-12, 0.3, PI, 2 * PI)):
        yield Case(f"chain of {joints} joints, each turned by {angle:.3g}", partial(chain, joints, angle))
    for value in (np.nan, np.inf, -np.inf):
        yield Case(f"translation is {value}", partial(broken_pose, {"translation": np.full(3, value)}), invalid=True)
        yield Case(f"rotation is {value}", partial(broken_pose, {"rotation": np.full(3, value)}), invalid=True)
    yield Case("translation by 1e9 m", partial(broken_pose, {"translation": np.full(3, 1e9)}), invalid=True)
    yield Case("too many joints", partial(broken_pose, {"joints": np.zeros((9, 3))}), invalid=True)
    yield Case("too few expressions", partial(broken_pose, {"expression": np.zeros(1)}), invalid=True)


def rotation(vector: Float64[np.ndarray, "3"]) -> Iterator[Measure]:
    """Rodrigues' formula against quaternions.

    Args:
        vector: Rotation vector in radians.

    Yields:
        Errors; the angle itself is rounded, hence a tolerance in proportion to it.
    """
    found, angle = rotation_matrices(vector), float(np.linalg.norm(vector))
    tolerance = 1e-14 + 4e-16 * angle
    axis = vector / angle if angle else np.array([1.0, 0, 0])
    half = 0.5 * angle
    expected = Rotation.from_quat([*(np.sin(half) * axis), np.cos(half)]).as_matrix()
    yield difference("rotation matrix", found, expected, 3 * tolerance)
    yield difference("R R^T - I", found @ found.T, np.eye(3), 1e-14)
    yield difference("determinant", np.linalg.det(found), 1.0, 1e-14)
    yield difference("axis", found @ axis, axis, tolerance)


def chain_model(joints: int) -> HeadModel:
    """A rod along x whose joints lie one metre apart; vertex k belongs to joint k, one more sits at the end of the rod.

    Args:
        joints: Number of joints.

    Returns:
        The model.
    """
    v = joints + 2
    vertices = np.zeros((v, 3), np.float32)
    vertices[:-1, 0] = np.arange(joints + 1)
    vertices[-1] = [joints, 1, 0]
    weights = np.zeros((v, joints), np.float32)
    weights[np.arange(v), np.minimum(np.arange(v), joints - 1)] = 1
    regressor = np.eye(joints, v, dtype=np.float32)
    return HeadModel(
        v_template=vertices,
        faces=np.array([[0, 1, 2]]),
        shapedirs=np.zeros((v, 3, 2), np.float32),
        posedirs=np.zeros((v, 3, 0), np.float32),
        joint_regressor=regressor,
        weights=weights,
        parents=np.arange(joints) - 1,
        num_identity=0,
    )


def chain(joints: int, angle: float) -> Iterator[Measure]:
    """A rod that bends at each joint about z: its joints lie on a regular polygon.

    Args:
        joints: Number of joints.
        angle: Angle at each joint in radians.

    Yields:
        Distance of the vertices from the closed form in metres.
    """
    model = chain_model(joints)
    turns = np.tile([0, 0, angle], (joints, 1))
    parameters = HeadParameters(
        rotation=turns[0],
        translation=np.array([0.5, -2, 1]),
        joints=turns[1:],
        shape=np.zeros(0),
        expression=np.zeros(2),
    )
    directions = np.exp(1j * angle * np.arange(1, joints + 1))
    places = np.concatenate([[0], np.cumsum(directions)])
    places = np.append(places, places[-1] + 1j * directions[-1])
    expected = np.column_stack([places.real, places.imag, np.zeros(len(places))]) + parameters.translation
    yield difference("vertices", pose(model, parameters), expected, 1e-13 * joints**2)


def broken_pose(changes: dict[str, np.ndarray]) -> list[Measure]:
    """Parameters that are too large, not finite or of another model.

    Args:
        changes: Changed parameters.

    Returns:
        Nothing: they are an error.
    """
    usual = {"joints": np.zeros((2, 3)), "shape": np.zeros(0), "expression": np.zeros(2)}
    pose(chain_model(3), HeadParameters(**{**usual, **changes}))
    return []
