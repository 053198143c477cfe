"""Offsets of units that show the same places: known ones are found, and where there are none, none is significant."""

from __future__ import annotations

import numpy as np
import pytest

from carigs.exposure.offsets import fit_offsets

UNITS, TIMES, VERTICES, PATCHES = 6, 3, 240, 12
PATCH = np.arange(VERTICES) * PATCHES // VERTICES


def levels(seed: int, *, hidden: float = 0.4, noise: float = 0.01, patchy: float = 0.0) -> np.ndarray:
    """Values of units that differ in nothing: levels of places, noise, and errors that a patch shares."""
    random = np.random.default_rng(seed)
    values = np.repeat(random.normal(-1, 0.5, (1, TIMES, VERTICES, 3)), UNITS, axis=0)
    values += noise * random.normal(size=values.shape)
    values += patchy * random.normal(size=(UNITS, 1, PATCHES, 3))[:, :, PATCH]
    values[random.random(values.shape[:3]) < hidden] = np.nan
    return values


def test_known_offsets_are_found_exactly_without_noise():
    truth = np.random.default_rng(1).uniform(-0.2, 0.2, (UNITS, 3))
    found = fit_offsets(levels(0, noise=0.0) + truth[:, None, None], PATCH, reference=2)
    np.testing.assert_allclose(found.offset, truth - truth[2], atol=1e-6)
    assert np.nanmax(np.abs(found.residual)) < 1e-6


def test_outliers_at_a_fifth_of_the_places_do_not_move_offsets():
    truth, random = np.random.default_rng(1).uniform(-0.2, 0.2, (UNITS, 3)), np.random.default_rng(2)
    values = levels(0) + truth[:, None, None]
    wrong = random.random(values.shape[:3]) < 0.2
    values[wrong] += random.uniform(0.3, 1.0, (int(wrong.sum()), 1))  # as highlights: all in one direction
    found = fit_offsets(values, PATCH, reference=0)
    np.testing.assert_allclose(found.offset, truth - truth[0], atol=0.005)


def test_the_order_of_units_does_not_matter():
    values, order = levels(3) + np.linspace(0, 0.3, UNITS)[:, None, None, None], np.array([4, 1, 5, 0, 3, 2])
    found, permuted = fit_offsets(values, PATCH, reference=1), fit_offsets(values[order], PATCH, reference=1)
    np.testing.assert_allclose(permuted.offset, found.offset[order], atol=1e-9)
    np.testing.assert_allclose(permuted.error, found.error[order], atol=1e-9)


@pytest.mark.parametrize("patchy", [0.0, 0.02])
def test_units_that_do_not_differ_are_rarely_significant(patchy):
    """At most a hundredth of the families of tests; errors that patches share make the standard error larger."""
    found = [fit_offsets(levels(seed, patchy=patchy), PATCH, reference=0) for seed in range(40)]
    assert sum(each.is_significant().any() for each in found) <= 2
    offsets, errors = (np.stack([getattr(each, name)[1:] for each in found]) for name in ("offset", "error"))
    assert 0.7 < offsets.std() / np.sqrt(np.square(errors).mean()) < 1.3


def test_a_unit_that_differs_by_several_errors_is_significant_and_the_others_are_not():
    values = levels(0, patchy=0.01)
    values[4] += 0.1
    found = fit_offsets(values, PATCH, reference=0).is_significant()
    assert found[4].all() and not np.delete(found, 4, axis=0).any()


def test_a_unit_that_shares_no_place_is_not_judged():
    values = levels(0, hidden=0.0)
    values[3, :, 120:], values[:3, :, :120], values[4:, :, :120] = np.nan, np.nan, np.nan
    values[3] += 0.5
    found = fit_offsets(values, PATCH, reference=0)
    assert np.isinf(found.error[3]).all() and not found.is_significant().any()


def test_causes_that_are_given_do_not_count_as_offsets():
    """Light on a head that turns: it depends on the normal, and not on the moment."""
    random = np.random.default_rng(5)
    cause, strength = random.normal(size=(UNITS, TIMES, VERTICES, 2)), np.array([[0.3, 0.2, 0.1], [-0.1, 0.0, 0.1]])
    cause += np.arange(UNITS)[:, None, None, None] / 3  # it differs between units, too
    truth = random.uniform(-0.2, 0.2, (UNITS, 3))
    found = fit_offsets(levels(0) + truth[:, None, None] + cause @ strength, PATCH, 0, cause)
    np.testing.assert_allclose(found.offset, truth - truth[0], atol=0.01)
