"""Shadow maps against a ray per pixel."""

import numpy as np

from carigs.light.shadow_map import _shadow_map


def test_every_pixel_holds_the_nearest_triangle():
    """Triangles of all sizes, some of them partly outside; the side is no multiple of the tiles'."""
    random, side = np.random.default_rng(0), 38
    centres = random.uniform(-4, side + 4, (300, 1, 3))
    points = (centres + random.normal(size=(300, 3, 3)) * random.choice([0.3, 2, 15], (300, 1, 1))).reshape(-1, 3)
    points = points.astype(np.float32)
    faces = np.arange(900).reshape(300, 3).astype(np.int32)
    tiles = _shadow_map(*points.T.copy(), faces, side)
    count = len(tiles)
    depth = tiles.reshape(count, count, 4, 4).transpose(0, 2, 1, 3).reshape(4 * count, 4 * count)[:side, :side]

    y, x = np.mgrid[:side, :side] + 0.5
    expected, near_edge = np.full((side, side), np.inf), np.zeros((side, side), bool)
    for a, b, c in points[faces].astype(np.float64):
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        of_b = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / area
        of_c = ((y - a[1]) * (b[0] - a[0]) - (x - a[0]) * (b[1] - a[1])) / area
        least = np.minimum(np.minimum(of_b, of_c), 1 - of_b - of_c)
        hit = a[2] + of_b * (b[2] - a[2]) + of_c * (c[2] - a[2])
        expected = np.where(least >= 0, np.minimum(expected, hit), expected)
        near_edge |= np.abs(least) * np.sqrt(abs(area)) < 1e-3
    clear = ~near_edge
    assert clear.mean() > 0.7 and np.isinf(expected[clear]).any() and np.isfinite(expected[clear]).any()
    np.testing.assert_allclose(depth[clear], expected[clear], atol=2e-3)
