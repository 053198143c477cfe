"""Noise is smooth, centred, seeded, and zero on its lattice."""

from __future__ import annotations

import numpy as np

from carigs.toy.shape.noise import gradient_noise, spots


def test_noise_is_smooth_centred_and_seeded() -> None:
    points = np.random.default_rng(0).uniform(-50, 50, (4000, 3)).astype(np.float32)
    values = gradient_noise(points, 5.0, 3, 1)
    assert abs(values.mean()) < 0.03 and 0.15 < values.std() < 0.6
    assert np.abs(gradient_noise(points + np.float32(1e-2), 5.0, 3, 1) - values).max() < 0.05
    assert np.abs(np.corrcoef(values, gradient_noise(points, 5.0, 3, 99))[0, 1]) < 0.1
    lattice = np.round(points)
    np.testing.assert_allclose(
        gradient_noise(lattice, 1.0, 1, 1), 0, atol=1e-5
    )  # gradient noise vanishes on its lattice
    share = (spots(points, 4.0, 0.5, 3) > 0).mean()
    assert (spots(points, 4.0, 0.0, 3) == 0).all() and 0.01 < share < 0.5
