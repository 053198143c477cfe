"""The random alternation of real frames and GT* targets."""

import numpy as np
import pytest

from carigs.splat.training.schedule import draw_schedule


def test_each_example_comes_once_per_epoch():
    schedule = draw_schedule(700, frames=30, targets=20, gtstar_probability=0.3, seed=5)
    assert schedule.gtstar.mean() == pytest.approx(0.3, abs=0.06)
    for is_target, count in ((False, 30), (True, 20)):
        index = schedule.index[schedule.gtstar == is_target]
        for start in range(0, len(index) - count + 1, count):
            np.testing.assert_array_equal(np.sort(index[start : start + count]), np.arange(count))
    assert not draw_schedule(50, 30, 0, 0.0, 5).gtstar.any()
    assert draw_schedule(50, 30, 20, 1.0, 5).gtstar.all()


@pytest.mark.parametrize("probability", [0.0, 1.0])
def test_trainings_on_frames_or_targets_alone_stay_so(probability):
    assert (draw_schedule(1000, 30, 20, probability, 5).gtstar == bool(probability)).all()
