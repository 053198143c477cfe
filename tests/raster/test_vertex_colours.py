"""Colours at vertices."""

import numpy as np

from carigs.raster.vertex_colours import sample_colours


def test_sampled_colours_have_the_gradient_of_finite_differences():
    rng = np.random.default_rng(0)
    image = rng.random((7, 9, 3)).astype(np.float32)
    pixels = 0.5 + rng.integers(0, [8, 6], (50, 2)) + rng.uniform(0.1, 0.9, (50, 2))
    _, gradients = sample_colours(image, pixels)
    for axis in range(2):
        step = 1e-3 * np.eye(2)[axis]
        ends = [sample_colours(image, pixels + sign * step)[0] for sign in (1, -1)]
        np.testing.assert_allclose(gradients[:, :, axis], (ends[0] - ends[1]) / 2e-3, atol=1e-4)
