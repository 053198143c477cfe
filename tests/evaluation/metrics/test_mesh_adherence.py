"""Adherence to the mesh: surfaces whose errors are known, and surfels that tile a mesh."""

import numpy as np
import pytest
import torch
from miniature import FRONTAL, sheet

from carigs.capture import Camera, look_at
from carigs.raster import compute_visibility
from carigs.splat.rasterizer.rasterize import WorldSurfels, rasterize
from evaluation.metrics.mesh_adherence import (
    HIDDEN,
    RenderedSurface,
    adherence_maps,
    facing_normals,
    mesh_adherence,
    not_hidden,
    silhouette_ious,
)

CAMERA = Camera(look_at(np.array([0.0, 0.0, 1.0]), np.zeros(3)), 400, 400, 128, 96, 256, 192)
SPACING = 0.002


def rotation_about_y(degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def tiled_sheet(width=0.4, height=0.3, rotation=None, shift=(0, 0, 0), opacity=0.99):
    """Surfels on a grid over the sheet of the same size, turned about its middle and then shifted."""
    rotation = np.eye(3) if rotation is None else rotation
    x, y = (np.arange(-size / 2 + SPACING / 2, size / 2, SPACING) for size in (width, height))
    grid = np.stack([*map(np.ravel, np.meshgrid(x, y)), np.zeros(len(x) * len(y))], axis=1)
    n = len(grid)
    u, v = (np.tile(0.8 * SPACING * rotation[:, axis], (n, 1)) for axis in (0, 1))
    arrays = grid @ rotation.T + shift, u, v, np.full(n, opacity), np.full((n, 3), 0.5)
    return WorldSurfels(*(torch.from_numpy(np.asarray(a, np.float32)) for a in arrays))


def rendered(surfels, camera=CAMERA):
    images = rasterize(surfels, camera, outputs=("alpha", "depth", "normal"))
    return RenderedSurface(images.alpha.numpy(), images.depth.numpy(), images.normal.numpy())


def adherence(surfels, vertices, faces, camera=CAMERA):
    visibility = compute_visibility(vertices, faces, camera)
    values = mesh_adherence(rendered(surfels, camera), visibility, {"full": visibility.face >= 0})
    return {metric: value for (_, metric), value in values.items()}


def test_surfels_that_tile_the_mesh_have_no_error():
    values = adherence(tiled_sheet(), *sheet())
    assert values["depth_error"] < 1e-3
    assert values["normal_error"] < 1e-3
    assert values["hole_rate"] < 0.02  # the outline is soft: about half of it lies inside
    assert values["silhouette_iou"] >= 160 * 120 / (162 * 122)  # discs end within a pixel of the outline


@pytest.mark.parametrize("millimetres", [-3.0, 1.0, 8.0])
def test_a_shift_along_the_line_of_sight_is_the_depth_error(millimetres):
    values = adherence(tiled_sheet(shift=(0, 0, millimetres / 1000)), *sheet())
    assert values["depth_error"] == pytest.approx(abs(millimetres), rel=2e-3)
    assert values["normal_error"] < 1e-3


@pytest.mark.parametrize("degrees", [-25.0, 10.0, 40.0])
def test_the_angle_between_two_planes_is_the_normal_error(degrees):
    values = adherence(tiled_sheet(rotation=rotation_about_y(degrees)), *sheet())
    assert values["normal_error"] == pytest.approx(abs(degrees), rel=1e-3)


def test_transparent_surfels_are_holes_and_leave_no_silhouette():
    values = adherence(tiled_sheet(opacity=0.01), *sheet())
    assert values["hole_rate"] > 0.9
    assert values["silhouette_iou"] == 0
    assert np.isnan(values["depth_error"]) and np.isnan(values["normal_error"])


def test_half_a_sheet_has_half_the_iou_and_half_of_its_pixels_are_holes():
    values = adherence(tiled_sheet(width=0.2, shift=(0.1, 0, 0)), *sheet())
    assert values["silhouette_iou"] == pytest.approx(0.5, abs=0.02)
    assert values["hole_rate"] == pytest.approx(0.5, abs=0.02)
    assert values["depth_error"] < 1e-3  # where something is shown


def test_nothing_changes_when_head_and_camera_move_together():
    vertices, faces = sheet()
    rotation, shift = rotation_about_y(70) @ np.diag([-1.0, -1.0, 1.0]), np.array([0.3, -2.0, 1.0])
    moved = np.eye(4)
    moved[:3, :3], moved[:3, 3] = rotation, shift
    camera = Camera(CAMERA.camera_from_world @ np.linalg.inv(moved), 400, 400, 128, 96, 256, 192)
    tilt = rotation_about_y(12)
    here = adherence(tiled_sheet(rotation=tilt, shift=(0, 0, 0.004)), vertices, faces)
    surfels = tiled_sheet(rotation=rotation @ tilt, shift=rotation @ [0, 0, 0.004] + shift)
    there = adherence(surfels, vertices @ rotation.T + shift, faces, camera)
    for metric, value in here.items():
        assert there[metric] == pytest.approx(value, rel=2e-3, abs=1e-3), metric


def test_normals_face_the_camera_on_both_sides_of_a_mesh():
    vertices, faces = sheet()
    turned = rotation_about_y(30)
    expected = -turned[:, 2] @ FRONTAL.camera_from_world[:3, :3].T  # the sheet shows +z to the camera, whose z is -z
    for order in (faces, faces[:, ::-1]):
        normals = facing_normals(compute_visibility(vertices @ turned.T, order, FRONTAL))
        np.testing.assert_allclose(normals, np.tile(-expected, (len(faces), 1)), atol=1e-9)


def test_errors_are_measured_only_where_both_are_seen():
    vertices, faces = sheet()
    visibility = compute_visibility(vertices, faces, CAMERA)
    maps = adherence_maps(rendered(tiled_sheet(shift=(0.1, 0, 0))), visibility)
    both = (visibility.face >= 0) & (maps.transparency < 0.5)
    np.testing.assert_array_equal(np.isfinite(maps.depth_error), both)
    np.testing.assert_array_equal(np.isfinite(maps.normal_error), both)


def test_what_stands_out_beside_one_region_does_not_count_for_another():
    mesh = np.zeros((40, 60), bool)
    mesh[10:30, 20:40] = True
    left, right = mesh.copy(), mesh.copy()
    left[:, 30:] = right[:, :30] = False
    alpha = mesh.astype(np.float32)
    alpha[10:30, 40:50] = 1  # as wide as the right half of the mesh
    ious = silhouette_ious(alpha, mesh, {"full": mesh, "left": left, "right": right})
    assert ious == {"full": pytest.approx(2 / 3), "left": 1.0, "right": pytest.approx(0.5)}


def test_a_region_out_of_view_has_no_iou():
    mesh = np.zeros((8, 8), bool)
    assert np.isnan(silhouette_ious(np.ones((8, 8)), mesh, {"full": mesh})["full"])
    mesh[2:4, 2:4] = True
    assert np.isnan(silhouette_ious(np.ones((8, 8)), mesh, {"none": np.zeros_like(mesh)})["none"])


def test_surfels_behind_the_surface_that_the_mesh_shows_are_hidden():
    visibility = compute_visibility(*sheet(), CAMERA)
    ray = np.array([0.05, -0.03, -1.0])  # from the camera at z = 1 to the sheet at z = 0
    depths = np.array([0.5, 0.9, 1.0, 1.0 + 0.9 * HIDDEN, 1.0 + 1.1 * HIDDEN, 1.5])
    on_ray = CAMERA.centre + depths[:, None] * ray
    beside = on_ray + np.array([0.4, 0, 0])
    behind_camera = CAMERA.centre - depths[:, None] * ray
    np.testing.assert_array_equal(not_hidden(on_ray, visibility), [True, True, True, True, False, False])
    assert not_hidden(np.vstack([beside, behind_camera]), visibility).all()
