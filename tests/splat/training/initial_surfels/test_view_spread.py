"""Where views look from, and where they are too few for colours that depend on the view."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from carigs.hair.views import largest_gap
from carigs.splat.training.initial_surfels.view_spread import NARROW, seen_from_one_side


def on_arc(degrees) -> np.ndarray:
    angle = np.radians(np.asarray(degrees, float))
    return np.stack([np.sin(angle), np.zeros_like(angle), np.cos(angle)], axis=-1)


@given(st.lists(st.floats(-80, 80), min_size=2, max_size=12), st.integers(0, 2**31))
def test_the_gap_on_an_arc_is_the_largest_between_neighbours(degrees, seed):
    rng = np.random.default_rng(seed)
    turned = Rotation.random(rng=rng).apply(on_arc(rng.permutation(degrees)))
    # The arc cosine of cosines near 1 is precise to the root of their rounding.
    assert largest_gap(turned) == pytest.approx(np.diff(np.sort(degrees)).max(), abs=1e-5)


def test_one_view_has_no_gap():
    assert largest_gap(on_arc([20])) == 0


@pytest.mark.parametrize("spread", [0, 0.9 * NARROW, 1.1 * NARROW, 80])
def test_a_triangle_is_seen_from_one_side_if_its_views_are_near_their_mean(spread):
    views = on_arc(np.linspace(-spread, spread, 15))[:, None]
    assert seen_from_one_side(views).tolist() == [spread < NARROW]


def test_one_view_of_twenty_may_lie_elsewhere_and_what_nobody_sees_counts_as_one_side():
    degrees = np.zeros(40)
    degrees[0] = 70
    once = on_arc(degrees)
    often = on_arc(np.where(np.arange(40) < 10, 70, 0))
    hidden = np.full((40, 3), np.nan)
    partly = np.where((np.arange(40) < 20)[:, None], on_arc(np.linspace(-60, 60, 40)), np.nan)
    found = seen_from_one_side(np.stack([once, often, hidden, partly], axis=1))
    assert found.tolist() == [True, False, True, False]
