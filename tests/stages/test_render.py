"""Stage `render`: which frames are rendered."""

from dataclasses import dataclass
from itertools import pairwise

import pytest
from miniature import write_ball

from carigs.capture.gaussian_avatars import read_dataset
from carigs.settings import Render
from carigs.stages.render import rendered_views, spread_test_frames


@dataclass(frozen=True)
class Frame:
    timestep: int
    camera: int


@pytest.mark.parametrize("count", [1, 2, 7, 16, 39])
def test_test_frames_are_spread_over_the_sequence_with_all_cameras(count):
    frames = tuple(Frame(3 * t + 5, camera) for t in range(40) for camera in range(4))
    chosen = spread_test_frames(frames, count)
    timesteps = sorted({frame.timestep for frame in chosen})
    assert len(timesteps) == count and len(chosen) == 4 * count
    assert timesteps[0] == 5 and (count == 1 or timesteps[-1] == 3 * 39 + 5)
    steps = [(b - a) // 3 for a, b in pairwise(timesteps)]
    assert not steps or max(steps) - min(steps) <= 1
    assert spread_test_frames(frames, None) == spread_test_frames(frames, 40) == frames


def test_held_out_views_are_rendered_at_level_0_alone(tmp_path):
    """They show what training frames show from another side; of a caricature, no camera has shown that."""
    subject = read_dataset(write_ball(tmp_path / "ball"), tmp_path / "ball/head_model.npz")
    shown = {level: [view for view, _ in rendered_views(Render(), subject, level)] for level in (0.0, 0.1)}
    held_out = [(frame.timestep, frame.camera) for frame in subject.split("val")]
    assert held_out
    assert [(view.timestep, view.camera) for view in shown[0.0] if view.protocol == "val"] == held_out
    assert shown[0.1] == [view for view in shown[0.0] if view.protocol != "val"]
