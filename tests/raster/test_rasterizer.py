"""The triangle rasteriser against closed forms and an independent ray caster."""

import igl
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import Delaunay

from carigs.capture import Camera, look_at
from carigs.raster import compute_visibility, rasterize_mesh

FRONTAL = Camera(look_at(np.array([0.0, 0.0, 2.0]), np.zeros(3)), fx=80, fy=80, cx=24, cy=20, width=48, height=40)


def pixel_rays(camera: Camera) -> np.ndarray:
    """World directions through all pixel centres (h, w, 3), unit depth."""
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    directions = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], axis=-1)
    return directions @ camera.camera_from_world[:3, :3]


def bumpy_sphere(subdivisions: int = 3) -> tuple[np.ndarray, np.ndarray]:
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=0.35)
    return mesh.vertices * (1 + 0.15 * np.sin(9 * mesh.vertices[:, :1])), np.asarray(mesh.faces, np.int32)


def ray_cast(vertices: np.ndarray, faces: np.ndarray, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Face and depth by Moeller-Trumbore for every pixel and face; faces at depth 0.01 or less do not count."""
    rays, origin = pixel_rays(camera).reshape(-1, 3), camera.centre
    corners = vertices[faces]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    cross = np.cross(rays[:, None], second[None])
    determinant = np.einsum("rfi,fi->rf", cross, first)
    offset = origin - corners[:, 0]
    u = np.einsum("rfi,fi->rf", cross, offset) / determinant
    other = np.cross(offset, first)
    v = np.einsum("ri,fi->rf", rays, other) / determinant
    depth = np.einsum("fi,fi->f", second, other)[None] / determinant
    depth[(u < 0) | (v < 0) | (u + v > 1) | (depth <= 0.01)] = np.inf
    face = np.where(np.isfinite(depth.min(axis=1)), depth.argmin(axis=1), -1)
    return face.reshape(camera.height, camera.width), depth.min(axis=1).reshape(camera.height, camera.width)


@pytest.mark.parametrize("eye", [(0.4, 0.3, 1.5), (0.1, 0.05, 0.36), (0.0, 0.1, 0.1)])
def test_matches_ray_casting_from_afar_from_close_by_and_from_inside(eye):
    vertices, faces = bumpy_sphere()
    camera = Camera(look_at(np.array(eye), np.array([0.0, 0.0, -0.1])), 90, 85, 31.2, 24.9, 64, 50)
    image = rasterize_mesh(vertices, faces, camera)
    expected, depth = ray_cast(vertices, faces, camera)
    np.testing.assert_array_equal(image.face, expected)
    hit = image.face >= 0
    assert hit.sum() > 400
    np.testing.assert_allclose(image.depth[hit], depth[hit], rtol=1e-6)
    # The stated point on the stated face is the one on the ray.
    points = np.einsum("pc,pcx->px", image.barycentric[hit], vertices[faces[image.face[hit]]])
    on_ray = camera.centre + pixel_rays(camera)[hit] * image.depth[hit][:, None]
    np.testing.assert_allclose(points, on_ray, atol=1e-6)


def test_matches_an_independent_ray_caster_on_a_fine_mesh():
    vertices, faces = bumpy_sphere(5)
    camera = Camera(look_at(np.array([0.4, 0.3, 1.5]), np.zeros(3)), 300, 290, 101.2, 84.9, 210, 160)
    image = rasterize_mesh(vertices, faces, camera)
    tree = igl.AABB()
    # It drops triangles by an absolute tolerance: a larger scene.
    tree.init(1000 * vertices, faces.astype(np.int64))
    rays = pixel_rays(camera).reshape(-1, 3)
    face, depth, _ = tree.intersect_ray_first(
        1000 * vertices, faces.astype(np.int64), np.tile(1000 * camera.centre, (len(rays), 1)), rays
    )
    np.testing.assert_array_equal(image.face.ravel(), face)
    hit = face >= 0
    np.testing.assert_allclose(image.depth.ravel()[hit], depth[hit] / 1000, rtol=1e-6)


@settings(max_examples=50)
@given(seed=st.integers(0, 2**31), half_pixels=st.booleans())
def test_a_triangulation_covers_every_pixel_exactly_once(seed, half_pixels):
    """Faces drawn alone add up to the whole, also where their corners and edges lie on pixel centres."""
    random = np.random.default_rng(seed)
    inner = random.uniform(-11.9, 11.9, (6, 2))
    if half_pixels:
        inner = np.round(2 * inner) / 2
    corners = np.array([[-12, -12], [12, -12], [12, 12], [-12, 12]])
    pixels = np.unique(np.vstack([corners, inner]), axis=0)
    faces = Delaunay(pixels).simplices.astype(np.int32)
    vertices = np.column_stack([pixels * 2 / 80, np.zeros(len(pixels))])  # 80 px at 2 m
    alone = sum((compute_visibility(vertices, face[None], FRONTAL).face >= 0).astype(int) for face in faces)
    assert alone.sum() == 24 * 24
    assert alone.max() == 1
    np.testing.assert_array_equal(compute_visibility(vertices, faces, FRONTAL).face >= 0, alone > 0)


def test_depth_order_and_culling():
    triangle = np.array([[-1, -1, 0], [1, -1, 0], [0, 1, 0.0]])
    vertices = np.vstack([triangle, triangle + np.array([0, 0, 0.5])])
    faces = np.array([[0, 1, 2], [3, 5, 4]])  # the nearer one shows its back
    both = compute_visibility(vertices, faces, FRONTAL)
    assert set(np.unique(both.face)) == {-1, 1}
    assert both.back_facing.tolist() == [False, True]
    culled = rasterize_mesh(vertices, faces, FRONTAL, cull_back=True)
    assert set(np.unique(culled.face)) == {-1, 0}
    np.testing.assert_allclose(culled.depth[culled.face == 0], 2.0, rtol=1e-6)


@pytest.mark.parametrize("z", [2.0, 1.999, 3.0])
def test_a_face_that_reaches_behind_the_camera_is_cut(z):
    """What lies in front of the camera is drawn where its rays meet the plane, the rest is not."""
    vertices, faces = np.array([[-1, -1, 0], [1, -1, 0], [0, 1, z]]), np.array([[0, 1, 2]])
    image = rasterize_mesh(vertices, faces, FRONTAL)
    expected, depth = ray_cast(vertices, faces, FRONTAL)
    np.testing.assert_array_equal(image.face, expected)
    assert (expected == 0).any()
    np.testing.assert_allclose(image.depth[image.face == 0], depth[expected == 0], rtol=1e-5)


@pytest.mark.parametrize("corner", [[0, 1, np.nan], [0, 1, np.inf], [1, -1, 0.0], [0, -1, 0.0]])
def test_faces_without_area_or_with_a_corner_that_is_not_finite_are_not_seen(corner):
    image = rasterize_mesh(np.array([[-1, -1, 0], [1, -1, 0], corner]), np.array([[0, 1, 2]]), FRONTAL)
    assert (image.face == -1).all()
    assert np.isinf(image.depth).all()


@pytest.mark.parametrize("size", [1e20, -1e20, 1e150])
@pytest.mark.parametrize("order", [[3, 4, 5], [3, 5, 4]])
@pytest.mark.parametrize("axis", [0, 1])
def test_faces_whose_image_positions_exceed_the_range_of_integers_change_nothing(size, order, axis):
    """Far beside the image, seen from the front and from behind."""
    triangle = np.array([[-1, -1, 0], [1, -1, 0], [0, 1, 0.0]])
    far = triangle + np.array([0, 0, 0.5])
    far[:, axis] = size * np.array([1, 2, 3])
    alone = compute_visibility(triangle, np.array([[0, 1, 2]]), FRONTAL)
    both = compute_visibility(np.vstack([triangle, far]), np.array([[0, 1, 2], order]), FRONTAL)
    np.testing.assert_array_equal(both.face, alone.face)
    np.testing.assert_array_equal(both.coverage(4), alone.coverage(4))


def test_nothing_is_seen_behind_the_camera():
    vertices, faces = bumpy_sphere(1)
    assert (compute_visibility(vertices + np.array([0, 0, 4.0]), faces, FRONTAL).face == -1).all()


@settings(max_examples=30)
@given(seed=st.integers(0, 2**31), n=st.integers(2, 8))
def test_coverage_is_the_share_of_samples_on_the_mesh(seed, n):
    """As the rasteriser itself finds them in an image n times as large, along every outline and hole."""
    vertices, faces = bumpy_sphere()
    random = np.random.default_rng(seed)
    faces = faces[random.random(len(faces)) < 0.9]
    camera = Camera(look_at(random.uniform([-0.3, -0.3, 0.9], [0.3, 0.3, 1.5]), np.zeros(3)), 60, 60, 24, 20, 48, 40)
    seen = compute_visibility(vertices, faces, camera)
    fine = compute_visibility(vertices, faces, camera.scaled(n)).face >= 0
    share = fine.reshape(40, n, 48, n).mean(axis=(1, 3))
    off = np.pad(seen.face < 0, 1, mode="edge")
    beside_off = np.any([off[j : j + 40, i : i + 48] for j in range(3) for i in range(3)], axis=0)
    outline = (seen.face >= 0) & beside_off
    assert outline.sum() > 50
    expected = np.where(outline, np.maximum(share, 1 / n**2), 1)
    np.testing.assert_allclose(seen.coverage(n), expected, atol=1e-6)


def test_coverage_of_a_half_plane_is_the_area_on_its_side():
    """A slanted edge through the image: to what n x n samples can tell of an area."""
    vertices = np.array([[-9, -3.33, 0], [9, 3.34, 0], [-9, 9, 0.0]])
    seen = compute_visibility(vertices, np.array([[0, 1, 2]]), FRONTAL)
    x, y = np.meshgrid((np.arange(48 * 64) + 0.5) / 64, (np.arange(40 * 64) + 0.5) / 64)
    points = np.stack([(x - 24) / 40, -(y - 20) / 40], axis=-1)  # at 2 m
    a, b = vertices[0, :2], vertices[1, :2]
    above = (b[0] - a[0]) * (points[..., 1] - a[1]) - (b[1] - a[1]) * (points[..., 0] - a[0]) > 0
    area = above.reshape(40, 64, 48, 64).mean(axis=(1, 3))
    on_mesh = seen.face >= 0
    assert (seen.coverage(8)[on_mesh] < 1).sum() > 20
    np.testing.assert_allclose(seen.coverage(8)[on_mesh], area[on_mesh], atol=1 / 8)
