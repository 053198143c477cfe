"""Bootstrap intervals: degenerate cases, invariances, coverage."""

import numpy as np
import pytest

from evaluation.tables.bootstrap import mean_interval

OPTIONS = {"resamples": 500, "confidence": 0.95, "seed": 3}


def crossed(timesteps, cameras):
    t, c = np.divmod(np.arange(timesteps * cameras), cameras)
    return t.tolist(), c.tolist()


def test_the_interval_of_a_constant_is_that_constant():
    interval = mean_interval(np.full(12, 2.5), crossed(3, 4), **OPTIONS)
    assert interval == pytest.approx((2.5, 2.5, 2.5), abs=1e-12)


def test_a_single_frame_has_no_interval():
    interval = mean_interval(np.array([2.5]), [[0], [1]], **OPTIONS)
    assert interval.mean == 2.5 and np.isnan(interval.low) and np.isnan(interval.high)


def test_the_result_does_not_depend_on_the_order_of_the_frames():
    generator = np.random.default_rng(0)
    values, units = generator.normal(size=24), np.array(crossed(4, 6))
    shuffled = generator.permutation(24)
    assert mean_interval(values, units.tolist(), **OPTIONS) == mean_interval(
        values[shuffled], units[:, shuffled].tolist(), **OPTIONS
    )


def test_the_result_does_not_depend_on_the_names_of_timesteps_and_cameras():
    values = np.random.default_rng(0).normal(size=24)
    timesteps, cameras = crossed(4, 6)
    renamed = [[f"t{t}" for t in timesteps], [c + 100 for c in cameras]]
    assert mean_interval(values, [timesteps, cameras], **OPTIONS) == mean_interval(values, renamed, **OPTIONS)


def test_shifting_and_scaling_the_values_does_the_same_to_the_interval():
    values = np.random.default_rng(0).normal(size=24)
    plain = np.array(mean_interval(values, crossed(4, 6), **OPTIONS))
    np.testing.assert_allclose(mean_interval(3 * values + 7, crossed(4, 6), **OPTIONS), 3 * plain + 7)


def test_what_depends_on_the_camera_alone_is_resampled_by_camera():
    # Repeating every camera's value at more timesteps is no new information: the interval must not shrink.
    values = np.random.default_rng(0).normal(size=6)
    once = mean_interval(values, crossed(1, 6), **OPTIONS)
    often = mean_interval(np.tile(values, 50), crossed(50, 6), **{**OPTIONS, "resamples": 4000})
    assert often.high - often.low == pytest.approx(once.high - once.low, rel=0.1)


def test_intervals_cover_the_true_mean_about_as_often_as_they_say():
    # Effects of timesteps and cameras: what frames of a capture look like.
    generator = np.random.default_rng(1)
    hits, trials = 0, 150
    for trial in range(trials):
        timestep, camera = generator.normal(size=(12, 1)), generator.normal(size=(1, 12))
        values = 5 + timestep + camera + 0.3 * generator.normal(size=(12, 12))
        interval = mean_interval(values.ravel(), crossed(12, 12), resamples=300, confidence=0.95, seed=trial)
        hits += interval.low <= 5 <= interval.high
    assert 0.87 <= hits / trials <= 0.99


def test_a_wider_confidence_gives_a_wider_interval():
    values = np.random.default_rng(0).normal(size=24)
    narrow = mean_interval(values, crossed(4, 6), **{**OPTIONS, "confidence": 0.5})
    wide = mean_interval(values, crossed(4, 6), **OPTIONS)
    assert wide.low < narrow.low < narrow.high < wide.high
