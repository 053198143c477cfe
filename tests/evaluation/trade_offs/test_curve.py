"""Curves: where a default lies, and names of choices."""

import pytest

from evaluation.trade_offs.curve import ABOVE, BELOW, ON, Choice, make_curve, short_labels
from evaluation.trade_offs.knee import GAIN, TOLERANCE

STEEP_THEN_FLAT = [Choice("a", 1, 20.0), Choice("b", 2, 26.0), Choice("c", 4, 26.0 + 0.1 * GAIN)]


@pytest.mark.parametrize(("default", "position"), [("a", BELOW), ("b", ON), ("c", ABOVE)])
def test_a_default_lies_below_on_or_above_the_knee(default, position):
    curve = make_curve("PSNR", STEEP_THEN_FLAT, default, is_psnr=True)
    assert (curve.position, curve.choices[curve.knee_index].label) == (position, "b")


def test_an_error_and_its_psnr_have_the_same_knee():
    errors = [Choice(c.label, c.seconds, 10 ** (-c.error / 20)) for c in STEEP_THEN_FLAT]
    assert make_curve("error", errors, "c").position == ABOVE
    assert make_curve("error", errors, "b").position == ON


def test_differences_within_the_tolerance_do_not_count():
    near = [Choice("a", 1, 30.0), Choice("b", 1, 30.0 + 0.9 * TOLERANCE)]
    assert make_curve("PSNR", near, "a", is_psnr=True).position == ON
    far = [Choice("a", 1, 30.0), Choice("b", 1, 30.0 + 1.1 * TOLERANCE)]
    assert make_curve("PSNR", far, "a", is_psnr=True).position == BELOW


def test_a_default_that_another_value_beats_in_both_is_above_the_knee():
    """Unless the times may be equal: then the error could be lowered."""
    for seconds, position in ((0.5, ABOVE), (0.95, BELOW)):
        choices = [Choice("default", 1, 30.0), Choice("better", seconds, 31.0)]
        assert make_curve("PSNR", choices, "default", is_psnr=True).position == position


def test_errors_below_what_is_needed_are_equal():
    choices = [Choice("2", 1, 1e-2), Choice("4", 1.5, 1e-5), Choice("8", 2, 1e-12)]
    assert make_curve("path", choices, "4", needed=1e-4).position == ON
    assert make_curve("path", choices, "4").position == BELOW
    assert make_curve("path", [Choice("exact", 1, 0.0)], "exact").position == ON


def test_long_names_have_numbers_in_figures():
    assert short_labels([make_curve("", STEEP_THEN_FLAT, "a")]) == {"a": "a", "b": "b", "c": "c"}
    long = [Choice("conjugate gradients", 2, 1.0), Choice("LU", 1, 1.0)]
    assert short_labels([make_curve("", long, "LU")]) == {"LU": "1", "conjugate gradients": "2"}
