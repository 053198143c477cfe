"""The motion of a torso is found from its images, beside a head that moves otherwise."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from carigs.capture import Camera
from carigs.tracking.torso.torso_motion import TorsoView, torso_motion

CAMERA = Camera(np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0.8], [0, 0, 0, 1]]), 400, 400, 100, 100, 200, 200)
BORDER = np.array([[-0.06, -0.02, 0.0], [0.06, -0.02, 0.0], [0.0, -0.02, 0.0]])
UP = np.array([0.0, 1.0, 0.0])


def seen(motion: np.ndarray, head: float, torso: bool = True) -> TorsoView:
    """A patterned torso in the plane z = 0 after a rigid motion, below a square head that is at height `head`."""
    row, column = np.mgrid[:200, :200] + 0.5
    rays = np.stack([(column - 100) / 400, -(row - 100) / 400, -np.ones_like(row)], axis=-1)
    eye, normal, origin = np.array([0, 0, 0.8]), motion[:3, 2], motion[:3, 3]
    point = eye + rays * (((origin - eye) @ normal) / (rays @ normal))[..., None]
    x, y = ((point - origin) @ motion[:3, :2]).transpose(2, 0, 1)
    shape = (10 * (1.05 - np.abs(x / 0.15) ** 4 - np.abs((y + 0.12) / 0.1) ** 4)).clip(0, 1)
    pattern = 0.5 + 0.3 * np.sin(60 * x + 20 * y) * np.cos(45 * y)
    alpha = shape * torso
    colour = np.stack([pattern, 0.6 * pattern, 1 - pattern], axis=-1)
    skull = (np.abs(column - 100) < 30) & (np.abs(row - 100 + 500 * head) < 40)
    alpha, colour = np.where(skull, 1, alpha), np.where(skull[..., None], [0.9, 0.2, 0.1], colour)
    rgba = np.dstack([colour * alpha[..., None], alpha])
    return TorsoView(CAMERA, np.rint(255 * rgba).astype(np.uint8), skull)


def motion_of(rotation, translation) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = Rotation.from_rotvec(rotation).as_matrix(), translation
    return matrix


@pytest.mark.parametrize(
    ("rotation", "translation"),
    [
        ([0.0, 0.0, 0.0], [0.012, -0.006, 0.0]),
        ([0.0, 0.0, 0.06], [0.0, 0.0, 0.0]),
        ([0.0, 0.0, 0.0], [0.0, 0.004, 0.02]),
        ([0.02, -0.05, 0.03], [-0.008, 0.005, 0.01]),
    ],
)
def test_the_motion_is_found_beside_a_head_that_moves(rotation, translation):
    steps = [motion_of(share * np.array(rotation), share * np.array(translation)) for share in (0, 0.5, 1.0)]
    views = [[seen(step, head)] for step, head in zip(steps, (0.1, 0.08, 0.12), strict=True)]
    found = torso_motion(views, 0, BORDER, UP)
    points = np.array([[x, y, 0, 1] for x in (-0.12, 0, 0.12) for y in (-0.19, -0.1)])
    for matrix, step in zip(found, steps, strict=True):
        off = (points @ (matrix - step).T)[:, :3]
        assert np.abs(off[:, :2]).max() < 0.001  # half a pixel
        assert np.abs(off[:, 2]).max() < 0.006  # along the line of sight
    np.testing.assert_array_equal(found[0], np.eye(4))


def test_the_motion_is_relative_to_the_frame_that_is_named():
    steps = [motion_of([0, 0, 0.02 * k], [0.004 * k, 0, 0]) for k in range(4)]
    views = [[seen(step, 0.1)] for step in steps]
    first, third = torso_motion(views, 0, BORDER, UP), torso_motion(views, 2, BORDER, UP)
    corner = np.array([0.12, -0.19, 0, 1])
    for k in range(4):
        expected = steps[k] @ np.linalg.inv(steps[2]) @ corner
        assert np.abs((third[k] @ corner - expected)[:2]).max() < 0.001
        assert np.abs((first[k] @ corner - steps[k] @ corner)[:2]).max() < 0.001


def test_there_is_none_where_mattes_end_at_the_neck():
    views = [[seen(np.eye(4), 0.1, torso=False)]] * 2
    assert torso_motion(views, 0, BORDER, UP) is None
