"""Budgets of CPU time: what they may be, the number of steps, and how a schedule is scaled."""

from itertools import count

import pytest

from carigs.errors import SettingsError
from carigs.settings import Density, Train
from carigs.settings.train import budget_seconds
from carigs.splat.training.budget import TRIAL_STEPS, WARM_UP, seconds_per_step, with_iterations


def test_units():
    assert [budget_seconds(text) for text in ("60s", "1.5min", "2 h", None)] == [60, 90, 7200, None]


@pytest.mark.parametrize(
    "text",
    ["60", "0s", "0.5s", "-5s", "1e3s", "nan s", "s", "60 s ", "6_0s", "\N{ARABIC-INDIC DIGIT SIX}s", "9" * 12 + "s"],
)
def test_other_texts_are_refused(text):
    with pytest.raises(SettingsError, match=r"train\.budget=.* must be a number with s, min or h, such as 60s"):
        Train(budget=text)


def test_the_time_of_a_step_is_without_the_first_ones():
    """The first steps compile kernels: here they take 100 s each, later ones 2 s."""
    now, steps = [0.0], count()

    def step():
        now[0] += 100.0 if next(steps) < WARM_UP else 2.0

    assert seconds_per_step(step, lambda: now[0]) == pytest.approx(2.0)
    assert next(steps) == TRIAL_STEPS


def test_what_is_given_in_steps_is_scaled():
    settings = Train(
        iterations=1000,
        budget="60s",
        density=Density(start=100, stop=600, every=50, reset_every=0),
    )
    longer = with_iterations(settings, 4000)
    assert (longer.iterations, longer.budget) == (4000, None)
    assert longer.density == Density(start=400, stop=2400, every=200, reset_every=0)
    assert with_iterations(settings, 1000).density == settings.density
