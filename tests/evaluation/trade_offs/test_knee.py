"""The knee: curves in closed form, and what holds of every knee."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evaluation.trade_offs.knee import GAIN, cost, knee, pareto_optimal

points = st.lists(
    st.tuples(st.floats(1e-4, 1e4), st.floats(-60, 60)), min_size=1, max_size=12, unique_by=lambda point: point[0]
)


def test_the_knee_of_a_hyperbola_is_where_its_slope_is_the_gain():
    """Of error = a + b / t in dB, d error / d log2 t = -b ln 2 / t."""
    seconds, b = np.geomspace(0.1, 1000, 4001), 7.0
    assert seconds[knee(seconds, 3 + b / seconds)] == pytest.approx(b * np.log(2) / GAIN, rel=0.005)


@pytest.mark.parametrize(("slope", "expected"), [(1.2 * GAIN, 4), (0.8 * GAIN, 0)])
def test_the_knee_of_a_power_law_is_at_an_end(slope, expected):
    seconds = np.array([1.0, 2, 4, 8, 16])
    assert knee(seconds, -slope * np.log2(seconds)) == expected


def test_a_large_gain_behind_a_small_one_counts():
    """The hull decides, not the next step alone."""
    assert knee(np.array([1.0, 2, 4]), np.array([0.0, -0.1 * GAIN, -3 * GAIN])) == 2


def test_of_equal_costs_the_fastest_is_the_knee():
    assert knee(np.array([4.0, 2, 1]), np.array([-2 * GAIN, -GAIN, 0.0])) == 2


@given(points, st.floats(0.1, 10), st.floats(-20, 20))
def test_units_of_time_and_error_do_not_matter(curve, factor, shift):
    seconds, decibels = np.array(curve).T
    costs = np.sort(cost(seconds, decibels))
    if len(costs) == 1 or costs[1] - costs[0] > 1e-9:
        assert knee(factor * seconds, decibels + shift) == knee(seconds, decibels)


@given(points)
def test_no_choice_is_worth_leaving_the_knee(curve):
    """None is better and faster, and none gains more than the gain per doubling."""
    seconds, decibels = np.array(curve).T
    at = knee(seconds, decibels)
    assert pareto_optimal(seconds, decibels)[at]
    gained, doublings = decibels[at] - decibels, np.log2(seconds / seconds[at])
    assert (gained <= GAIN * doublings + 1e-9).all()


@given(points)
def test_what_is_not_optimal_is_beaten_by_something_that_is(curve):
    seconds, decibels = np.array(curve).T
    optimal = pareto_optimal(seconds, decibels)
    beaten = (seconds[optimal][:, None] <= seconds) & (decibels[optimal][:, None] <= decibels)
    assert beaten.any(axis=0).all()
    assert (np.diff(decibels[optimal][np.argsort(seconds[optimal])]) < 0).all()
