"""Views of one surface warped to each other: painted meshes, noise with a known difference, and occlusion."""

import numpy as np
import pytest
from miniature import ball_model, sheet

from carigs.capture import Camera, look_at
from carigs.raster import compute_visibility
from evaluation.metrics.view_warping import DEPTH_TOLERANCE, correspondence, nearest_views, well_seen

SIZE = 160


def camera_at(x, y=0.0, z=1.0, target=(0.0, 0.0, 0.0)):
    return Camera(look_at(np.array([x, y, z]), np.array(target)), 500, 500, SIZE / 2, SIZE / 2, SIZE, SIZE)


def painted(vertices, visibility):
    """A Lambertian image: smooth colours that are fixed to the surface, on white."""
    fragments = visibility.fragments
    points = np.einsum("hwc,hwck->hwk", fragments.barycentric, vertices[visibility.faces[fragments.face]])
    colours = 0.5 + 0.4 * np.sin(points @ np.array([[60, 20, 5], [10, 70, -30], [40, -20, 50]]))
    image = np.where(fragments.face[..., None] >= 0, colours, 1.0)
    return np.rint(255 * image).astype(np.uint8)


def test_a_painted_surface_looks_the_same_from_two_cameras():
    model = ball_model()
    vertices = model.v_template.astype(np.float64)
    views = [compute_visibility(vertices, model.faces, camera_at(*position)) for position in ((-0.2, 0.1), (0.2, -0.1))]
    images = [painted(vertices, view) for view in views]
    shared = correspondence(*views)
    assert shared.seen.sum() > 0.4 * (views[0].face >= 0).sum()
    difference = shared.difference(*images)
    assert difference.mean() < 0.004 and difference.max() < 0.03  # rounding to 8 bits and bilinear interpolation
    unwarped = np.abs(images[0][shared.seen] / 255 - images[1][shared.seen] / 255).mean()
    assert unwarped > 20 * difference.mean()


def test_points_of_both_views_are_the_same_points_of_the_world():
    model = ball_model()
    vertices = model.v_template.astype(np.float64)
    views = [compute_visibility(vertices, model.faces, camera_at(*position)) for position in ((-0.2, 0.1), (0.2, -0.1))]
    shared = correspondence(*views)
    rows, columns = np.nonzero(shared.seen)
    points = np.einsum(
        "nc,nck->nk", views[0].fragments.barycentric[rows, columns], vertices[model.faces[views[0].face[rows, columns]]]
    )
    np.testing.assert_allclose(views[1].camera.project(points)[0], shared.pixels, atol=1e-3)


def test_independent_noise_differs_by_a_third():
    # A sheet, and a camera that moves along it by 20 pixels: no interpolation. E|u - v| = 1/3 for uniform u and v.
    vertices, faces = sheet(width=1, height=1)
    views = [compute_visibility(vertices, faces, camera_at(x, target=(x, 0, 0))) for x in (0.0, 20 / 500)]
    shared = correspondence(*views)
    rows, columns = np.nonzero(shared.seen)
    np.testing.assert_allclose(shared.pixels, np.column_stack([columns - 20, rows]) + 0.5, atol=1e-3)
    random = np.random.default_rng(0)
    images = random.integers(0, 256, (2, SIZE, SIZE, 3), dtype=np.uint8)
    difference = shared.difference(*images)
    assert difference.mean() == pytest.approx(1 / 3, abs=4 * np.sqrt(1 / 18 / difference.size / 3) + 0.002)
    same = np.roll(images[0], -20, axis=1)
    assert shared.difference(images[0], same).max() < 1e-3


def test_hidden_points_are_not_compared():
    # A small sheet 5 cm before a large one hides other parts of it from each camera.
    (back, faces), (small, more) = sheet(width=1, height=1), sheet(width=0.05, height=0.05)
    vertices = np.vstack([back, small + np.array([0, 0, 0.05])])
    faces = np.vstack([faces, more + len(back)])
    views = [compute_visibility(vertices, faces, camera_at(x)) for x in (-0.3, 0.3)]
    shared = correspondence(*views)
    rows, columns = np.nonzero(shared.seen)
    points = np.einsum(
        "nc,nck->nk", views[0].fragments.barycentric[rows, columns], vertices[faces[views[0].face[rows, columns]]]
    )
    on_back = points[:, 2] < 0.025
    assert on_back.any() and (~on_back).any()
    eye = views[1].camera.centre
    through = (
        eye + (points - eye) * ((0.05 - eye[2]) / (points[:, 2] - eye[2]))[:, None]
    )  # where the ray meets z = 5 cm
    hidden = on_back & (np.abs(through[:, :2]) < 0.025).all(axis=1)
    assert not hidden.any()
    # and from the second camera the small sheet did hide points that the first one shows
    rows, columns = np.nonzero(well_seen(views[0]))
    points = np.einsum(
        "nc,nck->nk", views[0].fragments.barycentric[rows, columns], vertices[faces[views[0].face[rows, columns]]]
    )
    through = eye + (points - eye) * ((0.05 - eye[2]) / np.minimum(points[:, 2] - eye[2], -1e-9))[:, None]
    assert ((points[:, 2] < 0.025) & (np.abs(through[:, :2]) < 0.025).all(axis=1)).any()


@pytest.mark.parametrize("distance", [0.3, 1.0, 5.0])
@pytest.mark.parametrize(("gap", "same"), [(0.9 * DEPTH_TOLERANCE, True), (1.1 * DEPTH_TOLERANCE, False)])
def test_the_tolerance_of_depth_is_a_length_from_near_and_from_afar(distance, gap, same):
    """Two cameras at one place: the second one sees the same sheet a little nearer."""
    vertices, faces = sheet(width=1, height=1)
    camera = camera_at(0.0, z=distance)
    views = [compute_visibility(vertices + np.array([0, 0, z]), faces, camera) for z in (0, gap)]
    assert correspondence(*views).seen[SIZE // 2, SIZE // 2] == same


@pytest.mark.parametrize(("degrees", "expected"), [(0, True), (60, True), (65, True), (75, False), (85, False)])
def test_surface_at_a_grazing_angle_is_not_well_seen(degrees, expected):
    angle = np.radians(degrees)
    vertices, faces = sheet(width=2, height=2)
    turned = vertices @ np.array([[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]])
    visibility = compute_visibility(turned, faces, camera_at(0.0))
    assert well_seen(visibility)[SIZE // 2, SIZE // 2] == expected


def test_the_outline_is_not_well_seen():
    vertices, faces = sheet(width=0.2, height=0.1)
    visibility = compute_visibility(vertices, faces, camera_at(0.0))
    rows, columns = np.nonzero(visibility.face >= 0)
    inner = np.zeros((SIZE, SIZE), bool)
    inner[rows.min() + 1 : rows.max(), columns.min() + 1 : columns.max()] = True
    np.testing.assert_array_equal(well_seen(visibility), inner)


def test_opposite_cameras_share_nothing():
    model = ball_model()
    vertices = model.v_template.astype(np.float64)
    shared = correspondence(*(compute_visibility(vertices, model.faces, camera_at(0.0, z=z)) for z in (1.0, -1.0)))
    blank = np.zeros((SIZE, SIZE, 3), np.uint8)
    assert not shared.seen.any() and shared.difference(blank, blank).shape == (0,)


def test_the_nearest_view_has_the_smallest_angle():
    cameras = [camera_at(r * np.sin(a), z=r * np.cos(a)) for a, r in ((-0.5, 1), (-0.4, 3), (0.1, 1), (0.2, 1))]
    assert nearest_views(cameras, np.zeros(3)).tolist() == [1, 0, 3, 2]


def test_nothing_changes_when_head_and_cameras_move_together():
    model = ball_model()
    vertices = model.v_template.astype(np.float64)
    moved = np.eye(4)
    moved[:3, :3] = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    moved[:3, 2] *= np.sign(np.linalg.det(moved[:3, :3]))
    moved[:3, 3] = 0.3, -0.1, 0.5
    cameras = [camera_at(-0.1), camera_at(0.2)]
    shared = correspondence(*(compute_visibility(vertices, model.faces, camera) for camera in cameras))
    there = [Camera(c.camera_from_world @ np.linalg.inv(moved), *c.intrinsics, SIZE, SIZE) for c in cameras]
    elsewhere = vertices @ moved[:3, :3].T + moved[:3, 3]
    again = correspondence(*(compute_visibility(elsewhere, model.faces, camera) for camera in there))
    assert (shared.seen != again.seen).sum() <= 2  # rounding at the limits
    both = shared.seen & again.seen
    np.testing.assert_allclose(shared.pixels[both[shared.seen]], again.pixels[both[again.seen]], atol=1e-3)
