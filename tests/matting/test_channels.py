"""Numbers of each pixel against NumPy's reductions."""

import numpy as np
import pytest

from carigs.matting.channels import largest, mean_colour, summed

IMAGE = np.random.default_rng(0).normal(size=(7, 9, 3)).astype(np.float32)


def test_sums_and_maxima_are_those_of_numpy():
    assert summed(IMAGE, 0.5) == pytest.approx(0.5 * IMAGE.sum(axis=2), abs=1e-6)
    assert np.array_equal(largest(IMAGE), IMAGE.max(axis=2))
    eight_bits = (IMAGE * 255).astype(np.uint8)
    assert np.array_equal(largest(eight_bits), eight_bits.max(axis=2))


def test_the_mean_is_that_of_the_region_and_black_without_one():
    region = IMAGE[..., 0] > 0
    assert mean_colour(IMAGE, region) == pytest.approx(IMAGE[region].mean(axis=0), abs=1e-6)
    assert np.array_equal(mean_colour(IMAGE, np.zeros_like(region)), np.zeros(3))
