"""The rig: frames, Jacobians, polar decomposition, degenerate triangles."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from carigs.splat.rig.rig import build_rig, edge_neighbours, face_motion


@pytest.fixture(scope="module")
def ball():
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=0.1)
    return np.asarray(mesh.vertices) * [1.0, 1.3, 0.8], np.asarray(mesh.faces)


def polar_parts(motion):
    stretch = motion.stretch[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)
    return motion.rotation, stretch


def test_frame_is_edge_then_towards_the_third_corner_then_normal():
    corners = np.array([[1.0, 1, 1], [3, 1, 1], [1.5, 4, 1]])
    rig = build_rig(corners, np.array([[0, 1, 2]]))
    assert rig.scale[0] == pytest.approx((2 + 3) / 2)  # base 2, height 3
    np.testing.assert_allclose(rig.frame[0] / rig.scale[0], np.eye(3), atol=1e-7)


def test_neighbours_lie_across_the_edges_in_order():
    #   2---3      edges of face 0: 01 (boundary), 12 (face 1), 20 (boundary)
    #   | \ |
    #   0---1
    np.testing.assert_array_equal(edge_neighbours(np.array([[0, 1, 2], [1, 3, 2]])), [[0, 1, 0], [1, 1, 0]])
    # An edge with three faces has no neighbour.
    np.testing.assert_array_equal(edge_neighbours(np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]]))[:, 0], [0, 1, 2])


def test_neighbours_of_a_closed_mesh_share_exactly_two_vertices(ball):
    _, faces = ball
    across = edge_neighbours(faces)
    for slot in range(3):
        shared = (faces[:, :, None] == faces[across[:, slot]][:, None, :]).any(axis=2)
        np.testing.assert_array_equal(shared.sum(axis=1), 2)
        assert not shared[:, (slot + 2) % 3].any()  # not the corner opposite the edge


def test_rigid_motion_is_its_rotation_without_stretch(ball):
    vertices, faces = ball
    turn = Rotation.from_rotvec([0.3, 2.9, -0.7]).as_matrix()
    motion = face_motion(build_rig(vertices, faces), vertices @ turn.T + [1, 2, 3])
    rotation, stretch = polar_parts(motion)
    np.testing.assert_allclose(rotation, np.broadcast_to(turn, rotation.shape), atol=1e-6)
    np.testing.assert_allclose(stretch, np.broadcast_to(np.eye(3), stretch.shape), atol=1e-6)
    np.testing.assert_allclose(motion.relative_rotation, 0, atol=1e-6)
    np.testing.assert_allclose(motion.centre, (vertices @ turn.T + [1, 2, 3])[faces].mean(axis=1), atol=1e-6)


def test_uniform_scale_scales_the_normal_too(ball):
    vertices, faces = ball
    _, stretch = polar_parts(face_motion(build_rig(vertices, faces), 1.7 * vertices))
    np.testing.assert_allclose(stretch, np.broadcast_to(1.7 * np.eye(3), stretch.shape), atol=1e-6)


def test_in_plane_stretch_scales_the_normal_by_the_root_of_the_area_ratio():
    plane = np.array([[0.0, 0, 0], [1, 0, 0], [0.3, 1, 0]])
    motion = face_motion(build_rig(plane, np.array([[0, 1, 2]])), plane * [3.0, 0.5, 1.0])
    np.testing.assert_allclose(motion.jacobian[0], np.diag([3.0, 0.5, np.sqrt(1.5)]), atol=1e-6)


def test_jacobian_maps_edges_and_its_polar_parts_are_a_rotation_and_symmetric_positive(ball):
    vertices, faces = ball
    rng = np.random.default_rng(3)
    posed = vertices * [1.4, 0.7, 1.1] + 0.01 * rng.standard_normal(vertices.shape)
    rig = build_rig(vertices, faces)
    motion = face_motion(rig, posed)
    a, b, c = faces.T
    for start, end in ((a, b), (a, c), (b, c)):
        moved = np.einsum("fij,fj->fi", motion.jacobian, vertices[end] - vertices[start])
        np.testing.assert_allclose(moved, posed[end] - posed[start], atol=1e-6)
    rotation, stretch = polar_parts(motion)
    np.testing.assert_allclose(
        rotation.transpose(0, 2, 1) @ rotation, np.broadcast_to(np.eye(3), rotation.shape), atol=1e-5
    )
    assert np.linalg.det(rotation).min() > 0.999
    assert np.linalg.eigvalsh(stretch).min() > 0
    relative = Rotation.from_matrix(rotation).inv() * Rotation.from_matrix(rotation[rig.neighbours[:, 1]])
    np.testing.assert_allclose(
        Rotation.from_rotvec(motion.relative_rotation[:, 1]).as_matrix(), relative.as_matrix(), atol=1e-5
    )


def test_relative_rotations_are_invariant_to_a_rotation_of_the_head(ball):
    """Absolute rotation vectors would jump at half a turn; relative ones do not change."""
    vertices, faces = ball
    posed = vertices * [1.2, 0.9, 1.0] + 0.005 * np.random.default_rng(0).standard_normal(vertices.shape)
    rig = build_rig(vertices, faces)
    still = face_motion(rig, posed)
    turned = face_motion(rig, posed @ Rotation.from_rotvec([0, np.pi - 1e-3, 0]).as_matrix().T)
    np.testing.assert_allclose(turned.relative_rotation, still.relative_rotation, atol=2e-6)
    np.testing.assert_allclose(turned.stretch, still.stretch, atol=2e-6)


@pytest.mark.parametrize("where", ["canonical", "posed", "both"])
def test_degenerate_triangles_follow_their_neighbours(ball, where):
    vertices, faces = ball
    turn = Rotation.from_rotvec([0, 0.8, 0]).as_matrix()
    flat = vertices.copy()
    flat[faces[0, 2]] = vertices[faces[0, :2]].mean(axis=0)  # the corner falls onto the opposite edge
    canonical = flat if where != "posed" else vertices
    posed = (flat if where != "canonical" else vertices) @ turn.T
    rig = build_rig(canonical, faces)
    motion = face_motion(rig, posed)
    for array in (*motion, rig.frame, rig.scale):
        assert np.isfinite(array).all()
    assert rig.scale.min() > 0
    if where == "both":  # then everything moves rigidly, the flat triangle with it
        np.testing.assert_allclose(motion.rotation[0], turn, atol=1e-6)
        np.testing.assert_allclose(motion.stretch[0], [1, 0, 0, 1, 0, 1], atol=1e-6)


def test_a_mesh_of_points_has_the_identity_as_motion():
    rig = build_rig(np.zeros((3, 3)), np.array([[0, 1, 2]]))
    motion = face_motion(rig, np.ones((3, 3)))
    np.testing.assert_array_equal(motion.rotation[0], np.eye(3))
    np.testing.assert_array_equal(motion.centre[0], 1)
    assert not motion.relative_rotation.any()


def test_slivers_keep_an_exact_jacobian():
    """The scaled Newton iteration also converges if the stretches differ by five orders of magnitude."""
    flat = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 1e-5, 0]])
    rig = build_rig(flat, np.array([[0, 1, 2]]))
    motion = face_motion(rig, np.array([[0.0, 0, 0], [0, 1, 0], [0, 0.5, 1.0]]))
    rotation, _ = polar_parts(motion)
    np.testing.assert_allclose(rotation[0].T @ rotation[0], np.eye(3), atol=1e-6)
    assert np.linalg.det(rotation[0]) == pytest.approx(1, abs=1e-6)
    assert motion.stretch.max() == pytest.approx(1e5, rel=1e-3)
