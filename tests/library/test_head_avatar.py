"""A trained avatar, posed and exaggerated from a script."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from avatars import CAMERA, ball_avatar
from scipy.spatial.transform import Rotation

import carigs
from carigs.errors import InputError, SettingsError
from carigs.head import flame_joints, pose
from carigs.library import HeadAvatar
from carigs.splat.avatar import save_avatar
from carigs.splat.formats.world_splats import bake


@pytest.fixture(scope="module")
def avatar():
    return HeadAvatar(ball_avatar())


def test_importing_carigs_is_fast_and_loads_no_library():
    code = "import sys, carigs; print([m for m in ('torch', 'numba', 'numpy', 'igl') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"
    assert {"load", "orbit", "exaggerate"} <= set(dir(carigs))
    with pytest.raises(AttributeError, match="no attribute 'caricature'"):
        _ = carigs.caricature


def test_a_saved_avatar_is_loaded(tmp_path):
    made = ball_avatar()
    save_avatar(tmp_path / "avatar.npz", made)
    loaded = carigs.load(tmp_path / "avatar.npz")
    assert loaded.gamma == 0.25 and loaded.timesteps == [0, 1, 2]
    assert loaded.joints == ["neck", "jaw", "left_eye", "right_eye"] and "scalp" in loaded.regions
    np.testing.assert_allclose(loaded.render(CAMERA, level=0.2), made.render(0, 0.2, CAMERA), atol=1e-6)
    with pytest.raises(InputError, match="none"):
        carigs.load(tmp_path / "none.npz")


@pytest.mark.parametrize(("timestep", "level"), [(0, 0.0), (2, 0.25), (1, 0.1)])
def test_image_mesh_and_surfels_are_those_of_the_avatar(avatar, timestep, level):
    made = avatar.avatar
    image = avatar.render(CAMERA, timestep=timestep, level=level)
    np.testing.assert_allclose(image, made.render(timestep, level, CAMERA), atol=1e-6)
    vertices, faces = avatar.mesh(timestep=timestep, level=level)
    np.testing.assert_allclose(vertices, made.sequence.posed(timestep, level), atol=1e-9)
    assert faces is made.sequence.head.faces
    for found, expected in zip(
        avatar.surfels(timestep=timestep, level=level), bake(made, timestep, level), strict=True
    ):
        np.testing.assert_allclose(found, expected, atol=1e-6)


def test_expression_and_joints_replace_those_of_the_timestep(avatar):
    sequence = avatar.avatar.sequence
    turn = np.array([0.2, 0, 0])
    vertices, _ = avatar.mesh(timestep=2, expression=[0, 0.7], jaw=turn, neck=-turn, eyes=[0, 0.1, 0])
    joints = flame_joints(jaw=turn, neck=-turn, left_eye=[0, 0.1, 0], right_eye=[0, 0.1, 0])
    expression = np.zeros(100)
    expression[1] = 0.7
    expected = pose(sequence.head, replace(sequence.parameters[2], joints=joints, expression=expression))
    np.testing.assert_allclose(vertices, expected, atol=1e-9)
    by_name, _ = avatar.mesh(timestep=2, expression={"1": 0.7}, jaw=turn, neck=-turn, eyes=[0, 0.1, 0])
    np.testing.assert_array_equal(by_name, vertices)
    assert sequence.parameters[2].expression[0] == 1.0  # the avatar's own are as before


def test_a_region_moves_alone_and_is_added_to_the_whole(avatar):
    head = avatar.avatar.sequence.head
    away = ~head.vertex_region("scalp")
    away[np.unique(head.faces[head.face_region("scalp")])] = False
    rest, _ = avatar.mesh()
    moved, _ = avatar.mesh(regions={"scalp": 0.25})
    change = np.linalg.norm(moved - rest, axis=1)
    assert change[head.vertex_region("scalp")].max() > 3 * change[away].max() and change.max() > 1e-4
    # Displacements of the neutral head add up; the pose of timestep 0 rotates them.
    whole, _ = avatar.mesh(level=0.2)
    both, _ = avatar.mesh(level=0.2, regions={"scalp": 0.25})
    np.testing.assert_allclose(both - whole, moved - rest, atol=1e-6)
    assert np.abs(avatar.mesh(level=0.2, regions={"scalp": 0.0})[0] - whole).max() == 0


@pytest.mark.parametrize(
    ("controls", "problem"),
    [
        ({"timestep": 7}, r"timestep=7: the avatar has 0 to 2 \(3\)"),
        ({"regions": {"beak": 0.1}}, "regions: there is no beak"),
        ({"level": np.nan}, "finite"),
        ({"regions": {"scalp": np.inf}}, "finite"),
        ({"expression": {"smile": 1.0}}, "expression smile: known are jawOpen, 1, 2"),
        ({"expression": np.zeros(101)}, "up to 100 numbers"),
        ({"expression": [np.nan]}, "expression: expected finite"),
        ({"jaw": [0.1, 0]}, "jaw.*rotation vector"),
        ({"neck": [np.nan, 0, 0]}, "neck.*rotation vector"),
    ],
)
def test_impossible_controls_are_named(avatar, controls, problem):
    with pytest.raises(SettingsError, match=problem):
        avatar.pose(**controls)


def test_the_orbit_sees_the_whole_head_from_all_sides(avatar):
    vertices = avatar.mesh()[0]
    middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    cameras = carigs.orbit(avatar, 8, size=(60, 90), elevation=20)
    offsets = np.array([camera.centre for camera in cameras]) - middle
    np.testing.assert_allclose(np.linalg.norm(offsets, axis=1), np.linalg.norm(offsets[0]), rtol=1e-9)
    angles = np.degrees(np.unwrap(np.arctan2(offsets[:, 0], offsets[:, 2])))
    np.testing.assert_allclose(np.diff(angles), 45, atol=1e-6)
    np.testing.assert_allclose(np.degrees(np.arcsin(offsets[:, 1] / np.linalg.norm(offsets, axis=1))), 20)
    for camera in cameras:
        pixel, depth = camera.project(vertices)
        assert (depth > 0).all() and (pixel > 0).all() and (pixel < [90, 60]).all()
        assert np.ptp(pixel[:, 1]) > 0.5 * 60
    (front,) = carigs.orbit(avatar, 1)
    np.testing.assert_allclose((front.centre - middle)[:2], 0, atol=1e-9)
    assert front.centre[2] > middle[2]
    (left,) = carigs.orbit(avatar, 1, azimuth=90, distance=2.0)
    np.testing.assert_allclose(left.centre - middle, [2, 0, 0], atol=1e-9)
    for wrong in ({"count": 0}, {"size": 0}, {"distance": -1.0}, {"distance": np.nan}):
        with pytest.raises(SettingsError, match="must be positive"):
            carigs.orbit(avatar, **wrong)
    for wrong in ({"elevation": 90.0}, {"azimuth": np.inf}, {"degrees": np.nan}):
        with pytest.raises(SettingsError, match="expected angles"):
            carigs.orbit(avatar, **wrong)


def test_exaggerate_is_the_solver_on_any_mesh():
    from surfaces import sphere

    from carigs.exaggeration import Exaggerator

    vertices, faces = sphere(3)
    vertices = vertices * [1.0, 0.8, 0.6]
    expected = vertices + Exaggerator(vertices, faces).solve(0.3)
    moved = carigs.exaggerate(vertices, faces, 0.3)
    np.testing.assert_allclose(moved, expected, atol=1e-9)
    np.testing.assert_array_equal(carigs.exaggerate(vertices, faces, 0.0), vertices)
    # The order of the vertices, and a motion of the mesh, do not matter.
    order, turn = np.random.default_rng(0).permutation(len(vertices)), Rotation.from_rotvec([0.3, 1, -0.5])
    place = np.argsort(order)
    again = carigs.exaggerate(turn.apply(vertices[order]), place[faces], 0.3)
    np.testing.assert_allclose(again, turn.apply(moved[order]), atol=1e-6)
    top = np.flatnonzero(vertices[:, 2] > 0.4)
    local = carigs.exaggerate(vertices, faces, 0.0, regions={"top": top}, levels={"top": 0.3})
    change = np.linalg.norm(local - vertices, axis=1)
    assert change[top].max() > 1e-3 and change[vertices[:, 2] < -0.3].max() < 0.1 * change.max()
    with pytest.raises(SettingsError, match="bottom"):
        carigs.exaggerate(vertices, faces, 0.1, regions={"top": top}, levels={"bottom": 0.3})
