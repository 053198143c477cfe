"""Stage `render`: which frames are rendered."""

from dataclasses import dataclass
from itertools import pairwise

import pytest

from carigs.stages.render import spread_test_frames


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
