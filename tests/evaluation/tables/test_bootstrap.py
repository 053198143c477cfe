"""Intervals of means: degenerate cases, invariances, closed forms, coverage."""

import numpy as np
import pytest
import scipy.stats

from evaluation.tables import bootstrap
from evaluation.tables.bootstrap import mean_interval
from evaluation.tables.factors import MAX_BLOCKS, crossed_factors

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


def simulated_frames(generator, subjects, timesteps, cameras, seeds=1, *, training=0.0, memory=0.0):
    """Frames with mean 5 and effects of subject, timestep of the subject, camera, training and frame, and noise.

    `memory` is the correlation of the effects of neighbouring timesteps (autoregressive process of order 1), `training`
    the standard deviation of the effects of trainings, each of one subject and seed. They differ a little between
    timesteps and between cameras.
    """
    of_time = generator.normal(size=(subjects, timesteps, 1))
    for t in range(1, timesteps):
        of_time[:, t] = memory * of_time[:, t - 1] + np.sqrt(1 - memory**2) * of_time[:, t]
    of_subject, of_camera = generator.normal(size=(subjects, 1, 1)), generator.normal(size=(1, 1, cameras))
    values = 5 + of_time + of_camera + (of_subject if subjects > 1 else 0)
    values = values + 0.5 * generator.normal(size=(subjects, timesteps, cameras))
    if seeds > 1 or training:
        values = values[..., None] + 0.5 * generator.normal(size=(subjects, timesteps, cameras, seeds))
        for share, shape in ((1.0, (1, 1)), (0.3, (timesteps, 1)), (0.3, (1, cameras))):
            values = values + share * training * generator.normal(size=(subjects, *shape, seeds))
    subject, timestep, camera, seed = np.indices((subjects, timesteps, cameras, seeds)).reshape(4, -1)
    return values.ravel(), {"subject": subject, "timestep": timestep, "camera": camera, "seed": seed}


def coverage(trials, *design, resamples=2000, factors_of=crossed_factors, **options):
    """Share of intervals that hold the true mean, in percent."""
    generator, hits = np.random.default_rng(7), 0
    for _ in range(trials):
        values, frames = simulated_frames(generator, *design, **options)
        factors = factors_of(frames, "test")
        interval = mean_interval(values, factors, resamples=resamples, confidence=0.95, seed=0)
        hits += interval.low <= 5 <= interval.high
    return 100 * hits / trials


def test_intervals_cover_the_true_mean_about_as_often_as_they_say():
    assert 89 <= coverage(200, 1, 3, 9) <= 100  # three standard errors of 200 trials around 93 to 97
    assert 89 <= coverage(200, 10, 2, 16, resamples=400) <= 100


# Subjects x timesteps x cameras of the toy, of one real person, of small studies, and of the paper.
@pytest.mark.slow
@pytest.mark.parametrize(
    ("design", "memory"),
    [((1, 3, 9), 0.0), ((1, 150, 16), 0.8), ((3, 16, 16), 0.0), ((5, 16, 16), 0.5), ((10, 16, 16), 0.5)],
)
def test_intervals_of_clustered_frames_cover_the_true_mean_in_93_to_97_percent(design, memory):
    assert 93 <= coverage(2000, *design, memory=memory) <= 97


@pytest.mark.parametrize("design", [(1, 3, 9, 2), (1, 12, 9, 3), (1, 3, 9, 8), (10, 2, 9, 3)])
def test_intervals_over_several_seeds_cover_the_mean_over_trainings(design):
    """Few seeds give Student's t of few degrees of freedom, which covers more than it says."""
    assert 91 <= coverage(200, *design, resamples=400, training=1.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("design", "training", "most"),
    [
        ((1, 3, 9, 2), 0.3, 99.5),
        ((1, 20, 16, 2), 1.0, 99.5),
        ((1, 20, 16, 5), 1.0, 98.5),
        ((1, 20, 16, 10), 1.0, 97),
        ((10, 16, 16, 3), 1.0, 97),
    ],
)
def test_intervals_over_several_seeds_cover_at_least_93_percent(design, training, most):
    assert 93 <= coverage(2000, *design, resamples=1000, training=training) <= most


def test_trainings_are_not_independent_frames():
    """Without seeds as a factor, as if each of three trainings had other timesteps and cameras."""
    assert coverage(200, 1, 3, 9, 3, training=3.0, factors_of=lambda *frames: crossed_factors(*frames)[:2]) < 80


def test_within_several_subjects_seeds_add_nothing_to_the_spread():
    """As a crossed factor they would count twice: trainings are part of the spread between subjects."""
    generator = np.random.default_rng(7)
    _, frames = simulated_frames(generator, 3, 2, 4, 2)
    assert [len(set(factor)) for factor in crossed_factors(frames, "test")] == [3, 4]


def test_a_single_seed_changes_no_interval():
    generator = np.random.default_rng(7)
    for design in ((1, 3, 9), (1, 12, 9), (3, 2, 9)):
        values, frames = simulated_frames(generator, *design)
        factors = crossed_factors(frames, "test")
        assert mean_interval(values, factors, **OPTIONS) == mean_interval(values, factors[:2], **OPTIONS)


def test_frames_of_one_camera_are_not_independent():
    # Resampled one by one, they cover the mean in half of the cases.
    generator, hits = np.random.default_rng(7), 0
    for _ in range(100):
        values, _ = simulated_frames(generator, 1, 8, 8)
        interval = mean_interval(values, [np.arange(64)], resamples=200, confidence=0.95, seed=0)
        hits += interval.low <= 5 <= interval.high
    assert hits < 80 < coverage(100, 1, 8, 8, resamples=200)


def test_few_levels_of_one_factor_give_students_t():
    values = np.array([1.0, 2.0, 4.0, 9.0])
    half = scipy.stats.t.interval(0.95, 3, values.mean(), scipy.stats.sem(values))
    assert mean_interval(values, [range(4)], **OPTIONS) == pytest.approx((4.0, *half))


def test_many_levels_of_one_factor_give_the_bootstrap_t():
    """Against resampled values, one by one."""
    values = np.random.default_rng(0).exponential(size=12)
    generator = np.random.default_rng(1)
    drawn = generator.choice(values, size=(40_000, 12))
    scores = (drawn.mean(axis=1) - values.mean()) / scipy.stats.sem(drawn, axis=1)
    low, high = values.mean() - scipy.stats.sem(values) * np.quantile(scores, [0.975, 0.025])
    interval = mean_interval(values, [range(12)], resamples=40_000, confidence=0.95, seed=5)
    assert interval[1:] == pytest.approx((low, high), rel=0.03)


def test_the_variance_of_crossed_effects_is_unbiased():
    generator, variances = np.random.default_rng(3), []
    for _ in range(3000):
        table = generator.normal(size=(3, 1)) + generator.normal(size=(1, 9)) + 0.5 * generator.normal(size=(3, 9))
        uniform = [np.full((1, n), 1 / n) for n in table.shape]
        variances.append(bootstrap._variance_parts(table, uniform)[1].sum())
    assert np.mean(variances) == pytest.approx(1 / 3 + 1 / 9 + 0.25 / 27, rel=0.06)


def test_a_missing_frame_that_the_others_predict_changes_only_the_mean():
    t, c = np.divmod(np.arange(30), 6)
    additive = np.array([0.0, 3, 1, 7, 2])[t] + np.array([1.0, 0, 5, 2, 8, 3])[c]
    whole = mean_interval(additive, [t, c], **OPTIONS)
    missing = mean_interval(additive[1:], [t[1:], c[1:]], **OPTIONS)
    assert missing.mean == pytest.approx(additive[1:].mean())
    assert missing.high - missing.low == pytest.approx(whole.high - whole.low, rel=1e-3)


def test_frames_without_a_grid_are_independent_frames():
    """One camera per timestep: timestep and camera cannot be told apart."""
    values = np.random.default_rng(0).normal(size=6)
    assert mean_interval(values, [range(6), range(6)], **OPTIONS) == mean_interval(values, [range(6)], **OPTIONS)


def test_an_empty_factor_changes_nothing():
    values = np.random.default_rng(0).normal(size=6)
    assert mean_interval(values, [[0] * 6, range(6)], **OPTIONS) == mean_interval(values, [range(6)], **OPTIONS)


def test_neighbours_in_time_are_blocks_unless_there_are_other_subjects():
    seed = {"seed": [0] * 40}
    frames = {"subject": ["a"] * 40, "timestep": np.repeat(np.arange(20) * 3, 2), "camera": [0, 1] * 20, **seed}
    blocks, cameras, _ = crossed_factors(frames, "test")
    assert np.array_equal(blocks, np.repeat(np.arange(10), 4)) and np.array_equal(cameras, [0, 1] * 20)
    orbit = {"subject": ["a"] * 24, "timestep": [5] * 24, "camera": range(24), "seed": [0] * 24}
    assert len(set(crossed_factors(orbit, "orbit")[1])) == MAX_BLOCKS
    subjects, cameras = crossed_factors({**frames, "subject": ["a"] * 20 + ["b"] * 20}, "test")
    assert subjects.tolist() == ["a"] * 20 + ["b"] * 20 and len(set(cameras)) == 2


def test_a_wider_confidence_gives_a_wider_interval():
    values = np.random.default_rng(0).normal(size=24)
    narrow = mean_interval(values, crossed(4, 6), **{**OPTIONS, "confidence": 0.5})
    wide = mean_interval(values, crossed(4, 6), **OPTIONS)
    assert wide.low < narrow.low < narrow.high < wide.high
