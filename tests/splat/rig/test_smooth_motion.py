"""The motion of the scalp, averaged so that hair moves as a solid."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from surfaces import sphere

from carigs.errors import InputError
from carigs.splat.rig.rig import build_rig, face_motion, polar_decomposition
from carigs.splat.rig.smooth_motion import SmoothMotion, share_of_average, smooth_motion_of


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


def test_a_share_of_the_average_turns_between_the_own_rotation_and_the_average(scalp):
    """Without a share the own rotation stays; half of it lies halfway, whatever the triangle's direction."""
    rig, inside = scalp
    posed = rig.vertices * (1 + 0.004 * np.random.default_rng(0).standard_normal((len(rig.vertices), 1)))
    _, own, stretch, _ = polar_decomposition(rig, posed)

    def turned(value):
        rotation = own.copy()
        SmoothMotion(rig, inside, share=np.full(len(inside), value)).apply(rotation, stretch.copy())
        return Rotation.from_matrix(rotation[inside])

    before, half, average = (turned(value) for value in (0.0, 0.5, 1.0))
    np.testing.assert_allclose(before.as_matrix(), own[inside], atol=1e-12)
    np.testing.assert_allclose((half * before.inv()).as_rotvec(), (average * half.inv()).as_rotvec(), atol=2e-3)
    assert np.median((average * before.inv()).magnitude()) > 0.02


def test_long_hair_follows_the_average_and_short_hair_the_skin():
    share = share_of_average(np.array([0.0, 0.015, 0.0225, 0.03, 0.3]))
    np.testing.assert_allclose(share, [0, 0, 0.5, 1, 1])


def test_the_smooth_motion_of_a_file_is_the_one_that_was_written(scalp, tmp_path):
    rig, inside = scalp
    share = np.random.default_rng(1).random(len(inside))
    written = SmoothMotion(rig, inside, True, share)
    posed = rig.vertices * (1 + 0.004 * np.random.default_rng(0).standard_normal((len(rig.vertices), 1)))
    read = smooth_motion_of(written.as_arrays(), rig, tmp_path / "avatar.npz")
    np.testing.assert_array_equal(
        face_motion(rig, posed, read.apply).records, face_motion(rig, posed, written.apply).records
    )
    old = {name: array for name, array in written.as_arrays().items() if name != "hair_share"}
    assert (smooth_motion_of(old, rig, tmp_path / "avatar.npz").share == inside).all()
    for value in (-0.1, 1.5, np.nan):
        broken = {**old, "hair_share": np.full(len(inside), value)}
        with pytest.raises(InputError, match=r"avatar\.npz.*hair_share"):
            smooth_motion_of(broken, rig, tmp_path / "avatar.npz")


def test_an_empty_scalp_changes_nothing(scalp):
    rig, inside = scalp
    smooth = SmoothMotion(rig, np.zeros_like(inside))
    np.testing.assert_array_equal(
        face_motion(rig, rig.vertices, smooth.apply).records, face_motion(rig, rig.vertices).records
    )
