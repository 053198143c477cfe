"""The benchmark of posing."""

from evaluation.benchmarks.posing import measure_posing


def test_frames_together_take_less_time_than_one_by_one():
    (row,) = measure_posing()
    assert row.quantity == "CPU: pose 100 frames"
    assert 0 < row.value < row.reference
