"""Medians of what several frames show."""

from __future__ import annotations

import numpy as np
import pytest

from carigs.plausibility.vertex_misfit import LEAST_FRAMES, median_of_known, reference


@pytest.mark.filterwarnings("ignore:All-NaN slice")
@pytest.mark.parametrize("shape", [(1, 50), (2, 50), (3, 40, 3), (8, 5, 40, 3), (701, 6)])
@pytest.mark.parametrize("hidden", [0.0, 0.4, 0.9])
def test_the_median_is_that_of_numpy(shape, hidden):
    random = np.random.default_rng(0)
    values = random.normal(100, 50, shape).astype(np.float32)
    values[random.random(shape) < hidden] = np.nan
    np.testing.assert_array_equal(median_of_known(values), np.nanmedian(values, axis=0), strict=True)


def test_one_frame_of_three_that_shows_something_else_changes_no_colour():
    samples = np.full((LEAST_FRAMES, 4, 3), 100, np.float32)
    samples[1] = 255
    samples[2, 3] = np.nan
    found = reference(samples)
    np.testing.assert_array_equal(found.colours[:3], 100)
    assert np.isnan(found.colours[3]).all()
