"""The benchmark of the viewer."""

from avatars import ball_avatar

from carigs.library import HeadAvatar
from evaluation.benchmarks.viewer import measure


def test_a_change_is_measured_on_the_server_and_to_the_image():
    records, image = measure({"ball": HeadAvatar(ball_avatar())}, repeats=2)
    assert (records.unit, image.unit) == ("CPU ms", "ms")
    assert "ball: " in records.case and records.case == image.case
    assert records.value > 0 and image.value > 0
