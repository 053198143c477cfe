"""Medians of what several frames show."""

from __future__ import annotations

import numpy as np

from carigs.plausibility.vertex_misfit import LEAST_FRAMES, reference


def test_one_frame_of_three_that_shows_something_else_changes_no_colour():
    samples = np.full((LEAST_FRAMES, 4, 3), 100, np.float32)
    samples[1] = 255
    samples[2, 3] = np.nan
    found = reference(samples)
    np.testing.assert_array_equal(found.colours[:3], 100)
    assert np.isnan(found.colours[3]).all()
