"""Medians of values of which some are not known."""

from __future__ import annotations

import numpy as np
import pytest

from carigs.exposure.known_median import median_of_known


@pytest.mark.filterwarnings("ignore:All-NaN slice")
@pytest.mark.parametrize("shape", [(1, 50), (2, 50), (3, 40, 3), (8, 5, 40, 3), (701, 6)])
@pytest.mark.parametrize("hidden", [0.0, 0.4, 0.9])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_median_is_that_of_numpy(shape, hidden, dtype):
    random = np.random.default_rng(0)
    values = random.normal(100, 50, shape).astype(dtype)
    values[random.random(shape) < hidden] = np.nan
    np.testing.assert_array_equal(median_of_known(values), np.nanmedian(values, axis=0), strict=True)
