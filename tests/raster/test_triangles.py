"""The triangle rasteriser against closed forms and an independent ray caster."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from carigs.capture import Camera, look_at
from carigs.raster import rasterize_mesh

FRONTAL = Camera(look_at(np.array([0.0, 0.0, 2.0]), np.zeros(3)), fx=80, fy=80, cx=24, cy=20, width=48, height=40)


def pixel_rays(camera: Camera) -> np.ndarray:
    """World directions through all pixel centres, unit depth."""
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    directions = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], axis=-1)
    return directions.reshape(-1, 3) @ camera.camera_from_world[:3, :3]


def test_matches_ray_casting_on_a_bumpy_sphere():
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.35)
    vertices = mesh.vertices * (1 + 0.15 * np.sin(9 * mesh.vertices[:, :1]))
    camera = Camera(look_at(np.array([0.4, 0.3, 1.5]), np.zeros(3)), 90, 85, 31.2, 24.9, 64, 50)
    image = rasterize_mesh(vertices, mesh.faces, camera)

    # Moeller-Trumbore for every pixel and face.
    corners = vertices[mesh.faces]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    rays, origin = pixel_rays(camera), camera.centre
    cross = np.cross(rays[:, None], second[None])
    determinant = np.einsum("rfi,fi->rf", cross, first)
    offset = origin - corners[:, 0]
    u = np.einsum("rfi,fi->rf", cross, offset) / determinant
    other = np.cross(offset, first)
    v = np.einsum("ri,fi->rf", rays, other) / determinant
    depth = np.einsum("fi,fi->f", second, other)[None] / determinant
    depth[(u < 0) | (v < 0) | (u + v > 1) | (depth <= 0)] = np.inf
    expected = depth.min(axis=1).reshape(camera.height, camera.width)

    assert np.array_equal(np.isfinite(expected), image.face >= 0)
    hit = image.face >= 0
    np.testing.assert_allclose(image.depth[hit], expected[hit], rtol=1e-6)
    # The stated point on the stated face is the one on the ray.
    points = np.einsum("pc,pcx->px", image.barycentric[hit], vertices[mesh.faces[image.face[hit]]])
    on_ray = origin + rays.reshape(*hit.shape, 3)[hit] * image.depth[hit][:, None]
    np.testing.assert_allclose(points, on_ray, atol=1e-6)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**31))
def test_a_fan_leaves_no_cracks_and_covers_nothing_twice(seed):
    """Each pixel inside a triangulated square is hit; face areas add up: shared edges belong to one face."""
    random = np.random.default_rng(seed)
    square = np.array([[-0.3, -0.3], [0.3, -0.3], [0.3, 0.3], [-0.3, 0.3]])
    centre = random.uniform(-0.2, 0.2, 2)
    vertices = np.column_stack([np.vstack([square, centre]), np.zeros(5)])
    faces = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
    whole = rasterize_mesh(vertices, np.array([[0, 1, 2], [0, 2, 3]]), FRONTAL).face >= 0
    parts = rasterize_mesh(vertices, faces, FRONTAL).face
    assert np.array_equal(parts >= 0, whole)
    assert whole.sum() == 24 * 24  # 0.6 m at 2 m and 80 px focal length


def test_depth_order_and_culling():
    triangle = np.array([[-1, -1, 0], [1, -1, 0], [0, 1, 0.0]])
    vertices = np.vstack([triangle, triangle + np.array([0, 0, 0.5])])
    faces = np.array([[0, 1, 2], [3, 5, 4]])  # the nearer one shows its back
    assert set(np.unique(rasterize_mesh(vertices, faces, FRONTAL).face)) == {-1, 1}
    culled = rasterize_mesh(vertices, faces, FRONTAL, cull_back=True)
    assert set(np.unique(culled.face)) == {-1, 0}
    np.testing.assert_allclose(culled.depth[culled.face == 0], 2.0, rtol=1e-6)


@pytest.mark.parametrize("z", [2.0, 1.999, 3.0])
def test_faces_at_or_behind_the_camera_are_dropped(z):
    vertices = np.array([[-1, -1, 0], [1, -1, 0], [0, 1, z]])
    image = rasterize_mesh(vertices, np.array([[0, 1, 2]]), FRONTAL)
    assert (image.face == -1).all()
    assert np.isinf(image.depth).all()
