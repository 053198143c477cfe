"""The frames that are compared with the mesh: all of a small capture, the most suspicious ones of a large capture."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from carigs.capture import Capture, Frame
from carigs.capture.evenly_spread import evenly_spread
from carigs.plausibility.images import ImageSummary

MAX_TIMESTEPS = 32
MAX_CAMERAS = 16
"""Each image is compared with the head of every other timestep: costs grow with MAX_TIMESTEPS^2 x MAX_CAMERAS."""


def select_frames(capture: Capture, summaries: Mapping[Frame, ImageSummary]) -> dict[int, dict[int, Frame]]:
    """Choose frames.

    Half of the timesteps are spread evenly. The others are those at which an image differs most from the mean of its
    neighbours in time: swapped files stand out there.

    Args:
        capture: The capture.
        summaries: Summaries of all frames.

    Returns:
        Frames by timestep and camera, both sorted.
    """
    cameras = evenly_spread(sorted(capture.cameras), MAX_CAMERAS)
    timesteps = sorted(capture.parameter_files)
    if len(timesteps) > MAX_TIMESTEPS:
        jumps = _jumps(summaries)
        even = evenly_spread(timesteps, MAX_TIMESTEPS // 2)
        rest = sorted(set(timesteps) - set(even), key=lambda t: -jumps.get(t, 0.0))
        timesteps = sorted([*even, *rest[: MAX_TIMESTEPS - len(even)]])
    chosen: dict[int, dict[int, Frame]] = {t: {} for t in timesteps}
    for frame in capture.frames:
        if frame.timestep in chosen and frame.camera in cameras:
            chosen[frame.timestep][frame.camera] = frame
    return {t: dict(sorted(frames.items())) for t, frames in chosen.items() if frames}


def _jumps(summaries: Mapping[Frame, ImageSummary]) -> dict[int, float]:
    """Largest difference of an image from its neighbours in time, per timestep."""
    tracks: dict[tuple[int, str], list[tuple[int, Float[np.ndarray, "8 8 3"]]]] = {}
    for frame, summary in summaries.items():
        tracks.setdefault((frame.camera, frame.sequence), []).append((frame.timestep, summary.thumbnail))
    jumps: dict[int, float] = {}
    for images in tracks.values():
        for (_, before), (t, image), (_, after) in zip(images, images[1:], images[2:], strict=False):
            jumps[t] = max(jumps.get(t, 0.0), float(np.abs(image - (before + after) / 2).mean()))
    return jumps
