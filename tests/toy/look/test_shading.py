"""The shading kernel: texture lookup and colour tables."""

from __future__ import annotations

import numpy as np

from carigs.capture.images import to_linear
from carigs.raster import rasterize_mesh
from carigs.settings import Toy
from carigs.toy.look.atlas import allocate_texels, texel_points
from carigs.toy.look.shading import (
    LINEAR_FROM_SRGB,
    SRGB_FROM_LINEAR,
    _shadow_factor,
    ambient_by_channel,
    shade,
    shadow_bounds,
)
from carigs.toy.scene import studio_cameras


def test_texture_reproduces_linear_functions() -> None:
    """Mesh colours interpolate linearly between texels: a linear texture is exact whatever the resolution."""
    vertices = np.array([[-0.09, -0.08, 0.0], [0.09, -0.07, 0.01], [0.02, 0.09, -0.01], [-0.08, 0.07, 0.0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    first, resolution, count = allocate_texels(np.array([7.0, 3.0]), 60)
    assert count <= 60 and resolution.min() >= 1 and resolution[0] > resolution[1]
    points = texel_points(vertices[faces], resolution)
    texels = np.zeros((count, 4), np.uint8)
    texels[:, :3] = np.rint(255 * (0.5 + 4 * points))
    (view,) = studio_cameras(Toy(width=40, height=40, cameras=1))
    hit = rasterize_mesh(vertices, faces, view)
    flat = np.linspace(0, 1, 256, dtype=np.float32)
    light = np.zeros((8, 3))
    light[0, 2] = light[2] = 1  # no key light, the same ambient everywhere
    up, open_sky = np.tile([0.0, 0, 1], (4, 1)), ambient_by_channel(np.ones(4, np.float32))
    shadow = np.full((8, 8), np.inf, np.float32)
    colour, alpha = shade(
        hit.face, hit.barycentric, faces, 2, vertices, up, open_sky, first, resolution, texels,
        np.zeros((1, 3), np.float32), view.centre, light,
        shadow, shadow_bounds(shadow), np.eye(3, 4), 1, flat, np.linspace(0, 1, 4097, dtype=np.float32),
    )  # fmt: skip
    inside = alpha == 1
    assert inside.sum() > 100
    expected = 0.5 + 4 * np.einsum("nk,nkx->nx", hit.barycentric[inside], vertices[faces[hit.face[inside]]])
    np.testing.assert_allclose(colour[inside], expected, atol=1.2 / 255)


def test_colour_tables_are_each_others_inverse() -> None:
    levels = np.arange(256) / 255
    np.testing.assert_allclose(to_linear(levels), LINEAR_FROM_SRGB, atol=1e-6)
    np.testing.assert_allclose(SRGB_FROM_LINEAR[np.rint(LINEAR_FROM_SRGB * 4096).astype(int)], levels, atol=2e-3)


def test_bounds_of_the_shadow_map_change_no_shadow() -> None:
    random = np.random.default_rng(0)
    shadow = random.choice([0.5, 0.503, 0.506, np.inf], (40, 40)) + random.uniform(0, 0.002, (40, 40))
    shadow[:, 20:] = 0.5  # one depth, as on most of a head
    bounds, unknown = shadow_bounds(shadow), np.stack([np.full((37, 37), -np.inf), np.full((37, 37), np.inf)])
    pixel_from_world = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]])
    factors = set()
    for u, v, depth in random.uniform([0, 0, 0.49], [40, 40, 0.52], (4000, 3)):
        point = u * depth, v * depth, depth
        factor = _shadow_factor(shadow, bounds, pixel_from_world, point)
        assert factor == _shadow_factor(shadow, unknown, pixel_from_world, point)
        factors.add(factor)
    assert {0.0, 1.0} < factors
