"""The smoothstep function against its definition."""

import numpy as np
import pytest

from carigs.mesh.smoothstep import smoothstep


@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (0.45, 0.75), (-3.0, 5.0)])
def test_smoothstep_is_a_clamped_cubic_with_flat_ends(low, high):
    width = high - low
    np.testing.assert_array_equal(smoothstep(np.array([low - width, low, high, high + width]), low, high), [0, 0, 1, 1])
    t = np.linspace(0, 1, 11)
    np.testing.assert_allclose(smoothstep(low + width * t, low, high), 3 * t**2 - 2 * t**3, atol=1e-12)
    ends = np.array([low, high]) + np.array([1e-4, -1e-4]) * width
    np.testing.assert_allclose(smoothstep(ends, low, high), [0, 1], atol=1e-7)


def test_smoothstep_keeps_single_precision():
    assert smoothstep(np.linspace(0, 1, 5, dtype=np.float32)).dtype == np.float32
