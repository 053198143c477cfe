"""The motion of the scalp, averaged so that hair moves as a solid."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from surfaces import sphere

from carigs.splat.rig.rig import build_rig, face_motion, polar_decomposition
from carigs.splat.rig.smooth_motion import SmoothMotion


@pytest.fixture
def scalp():
    """A ball of the size of a head, and the triangles of its upper half."""
    vertices, faces = sphere(4, 0.1)
    rig = build_rig(vertices, faces)
    return rig, vertices[faces].mean(axis=1)[:, 1] > 0


def test_a_rigid_motion_stays_exact(scalp):
    rig, inside = scalp
    turn = Rotation.from_rotvec([0.4, -0.2, 0.7])
    posed = turn.apply(rig.vertices) + np.array([0.1, 0.2, -0.3])
    plain, smooth = face_motion(rig, posed), face_motion(rig, posed, SmoothMotion(rig, inside).apply)
    np.testing.assert_allclose(smooth.records, plain.records, atol=2e-6)


def test_rotations_are_averaged_and_all_else_is_kept(scalp):
    """Random normal displacements turn single triangles by several degrees; the average turns by a tenth of it."""
    rig, inside = scalp
    bumps = 0.0004 * np.random.default_rng(0).standard_normal((len(rig.vertices), 1))
    posed = rig.vertices * (1 + bumps / 0.1)
    _, rotation, stretch, _ = polar_decomposition(rig, posed)
    moved = rotation.copy(), stretch.copy()
    SmoothMotion(rig, inside).apply(*moved)

    def degrees(rotations):
        return np.degrees(Rotation.from_matrix(rotations).magnitude())

    assert np.median(degrees(moved[0][inside])) < 0.1 * np.median(degrees(rotation[inside]))
    np.testing.assert_array_equal(moved[1][inside], np.broadcast_to(np.eye(3), (int(inside.sum()), 3, 3)))
    for before, after in zip((rotation, stretch), moved, strict=True):
        np.testing.assert_array_equal(after[~inside], before[~inside])


def test_hair_grows_with_the_scalp_if_it_is_asked_to(scalp):
    """A head that grows by a quarter in all directions: so does the hair; otherwise it keeps its length."""
    rig, inside = scalp
    for grows, factor in ((True, 1.25), (False, 1.0)):
        smooth = SmoothMotion(rig, inside, grows)
        jacobian = face_motion(rig, 1.25 * rig.vertices, smooth.apply).jacobian[inside]
        np.testing.assert_allclose(jacobian, np.broadcast_to(factor * np.eye(3), jacobian.shape), atol=1e-5)


def test_neighbours_carry_a_distant_point_to_nearly_the_same_place(scalp):
    """Ten centimetres above the scalp, where the motions of single triangles differ by centimetres."""
    rig, inside = scalp
    rng = np.random.default_rng(1)
    posed = rig.vertices + 0.0003 * rng.standard_normal(rig.vertices.shape)
    smooth = SmoothMotion(rig, inside)
    top = smooth.faces
    top = top[np.linalg.norm(rig.vertices[rig.faces[top]].mean(axis=1) - [0, 0.1, 0], axis=1) < 0.015]
    spreads = []
    for motion in (face_motion(rig, posed), face_motion(rig, posed, smooth.apply)):
        offset = np.array([0, 0.2, 0]) - rig.vertices[rig.faces[top]].mean(axis=1)
        place = motion.centre[top] + np.einsum("fij,fj->fi", motion.jacobian[top], offset)
        spreads.append(float(np.linalg.norm(place - place.mean(axis=0), axis=1).max()))
    assert spreads[1] < 0.002 < 0.01 < spreads[0]


def test_an_empty_scalp_changes_nothing(scalp):
    rig, inside = scalp
    smooth = SmoothMotion(rig, np.zeros_like(inside))
    np.testing.assert_array_equal(
        face_motion(rig, rig.vertices, smooth.apply).records, face_motion(rig, rig.vertices).records
    )
