"""The shading kernel: texture lookup and colour tables."""

from __future__ import annotations

import numpy as np

from carigs.capture.images import to_linear
from carigs.raster import rasterize_mesh
from carigs.settings import Toy
from carigs.toy.look.atlas import allocate_texels, texel_points
from carigs.toy.look.shading import LINEAR_FROM_SRGB, SRGB_FROM_LINEAR, ambient_by_channel, shade
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
    colour, alpha = shade(
        hit.face, hit.barycentric, faces, 2, vertices, up, open_sky, first, resolution, texels,
        np.zeros((1, 3), np.float32), view.centre, light,
        np.full((8, 8), np.inf, np.float32), np.eye(3, 4), 1, flat, np.linspace(0, 1, 4097, dtype=np.float32),
    )  # fmt: skip
    inside = alpha == 1
    assert inside.sum() > 100
    expected = 0.5 + 4 * np.einsum("nk,nkx->nx", hit.barycentric[inside], vertices[faces[hit.face[inside]]])
    np.testing.assert_allclose(colour[inside], expected, atol=1.2 / 255)


def test_colour_tables_are_each_others_inverse() -> None:
    levels = np.arange(256) / 255
    np.testing.assert_allclose(to_linear(levels), LINEAR_FROM_SRGB, atol=1e-6)
    np.testing.assert_allclose(SRGB_FROM_LINEAR[np.rint(LINEAR_FROM_SRGB * 4096).astype(int)], levels, atol=2e-3)
