"""Does `cy` count from the top of the image, or from its bottom? Landmarks tell before any head is known.

With the right convention, the rays of a landmark in all views meet in a point. They nearly meet in either case if all
cameras stand at one height and all principal points are shifted alike: such a shift of the images moves the head.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from carigs.capture import Capture
from carigs.capture.importers.calibrated_images import FROM_THE_TOP
from carigs.fitting.footage import frame_landmarks, frame_projections
from carigs.fitting.landmarks.files import Landmarks
from carigs.fitting.triangulation import triangulate, well_seen_timesteps
from carigs.plausibility.principal_point import CENTRED, DOES_NOT_MATTER, cy_offsets, flipped_cy, with_cy

TIMESTEPS = 12
"""Timesteps that are triangulated."""
STANDARD_ERRORS = 3.0
"""A convention is believed if the errors of the other exceed its own by so many standard errors over the landmarks."""


def resolve_cy_by_landmarks(capture: Capture, landmarks: Landmarks, convention: str = "auto") -> Capture:
    """Convert principal points to OpenCV's convention: y down, from the top of the image.

    Args:
        capture: The footage, as its files say.
        landmarks: Its landmarks.
        convention: What the files hold: `opencv`, `flipped`, or `auto` to find out, unless their form says it.

    Returns:
        The capture with its field `cy`: the convention of the files and how it was found. If landmarks do not tell, the
        principal points stay as they are, with a line in `warnings`.
    """
    if convention != "auto":
        return with_cy(capture, convention, f"--cy {convention}")
    if capture.cy == FROM_THE_TOP:
        return capture
    if not cy_offsets(capture).max(initial=0) > CENTRED:
        return with_cy(capture, "opencv", DOES_NOT_MATTER)
    flipped = replace(capture, calibrations=tuple(map(flipped_cy, capture.calibrations)))
    errors = np.stack([_triangulation_errors(found, landmarks) for found in (capture, flipped)])
    errors = errors[:, np.isfinite(errors).all(axis=0)]
    if errors.shape[1] < 2:
        return with_cy(capture, "opencv", "too few landmarks to find out")
    excess, means = errors[1] - errors[0], errors.mean(axis=1)
    needed = STANDARD_ERRORS * excess.std(ddof=1) / np.sqrt(len(excess))
    reason = f"triangulated landmarks are {means[0]:.2f} pixels off, flipped {means[1]:.2f}"
    if excess.mean() < -needed:
        return with_cy(capture, "flipped", reason)
    kept = with_cy(capture, "opencv", reason)
    if excess.mean() > needed:
        return kept
    problem = f"landmarks do not tell whether it counts from the top ({reason}); give --cy opencv or flipped"
    return replace(kept, warnings=(*kept.warnings, f"{capture.root}: cy: {problem}"))


def _triangulation_errors(capture: Capture, landmarks: Landmarks) -> Float[np.ndarray, " p"]:
    """Mean distance in pixels of each landmark from its triangulated points, in views whose cy is far off the middle.

    NaN for landmarks that no two cameras see.
    """
    cameras, timesteps = sorted(capture.cameras), sorted(capture.parameter_files)
    values = frame_landmarks(capture, landmarks, timesteps, cameras)
    chosen = well_seen_timesteps(values[..., 2], TIMESTEPS)
    timesteps, values = [timesteps[i] for i in chosen], values[chosen]
    projections = frame_projections(capture, timesteps, cameras)
    _, distances = triangulate(values[..., :2], values[..., 2], projections)
    counted = np.isfinite(distances) & _far_off(capture, timesteps, cameras)[..., None]
    total, count = (np.where(counted, x, 0).sum(axis=(0, 1)) for x in (distances, 1.0))
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _far_off(capture: Capture, timesteps: Sequence[int], cameras: Sequence[int]) -> Bool[np.ndarray, "t c"]:
    """Views whose cy is at least half as far off the middle as that of any."""
    offsets, known = cy_offsets(capture), capture.frame_at
    frames = [[known.get((t, c)) for c in cameras] for t in timesteps]
    offset = np.array([[0.0 if frame is None else offsets[frame.calibration] for frame in row] for row in frames])
    return offset.reshape(len(timesteps), len(cameras)) >= offset.max(initial=0) / 2
