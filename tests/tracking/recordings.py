"""What is known of the frames of recordings: a good one, to be changed."""

from __future__ import annotations

from typing import Any

import numpy as np

from carigs.tracking.judgement.quality import TrackedFrames

COUNT, FPS = 500, 25.0


def recording(**changes: Any) -> TrackedFrames:
    """Twenty seconds in which the head turns, nods, talks and blinks; errors grow towards the end."""
    t = np.arange(COUNT) / FPS
    values: dict[str, Any] = {
        "numbers": np.arange(COUNT),
        "times": t,
        "left_out": ("",) * COUNT,
        "yaw": 35 * np.sin(0.5 * t),
        "pitch": 4 + 14 * np.sin(1.3 * t),
        "errors": {"lips": 0.5 + 0.01 * t, "eyes": 0.4 + 0.02 * t},
        "face_width": np.full(COUNT, 220.0),
        "outside": np.zeros(COUNT),
        "mouth": 0.15 * (1 - np.cos(6 * t)),
        "eyes": np.where(np.arange(COUNT) % 60 < 4, 0.05, 0.3),
        "sharpness": np.full(COUNT, 200.0),
        "exposure": 0.05 * np.sin(t),
    }
    return TrackedFrames(**(values | changes))
