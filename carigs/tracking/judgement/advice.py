"""What a person should record otherwise, in sentences with numbers; docs/recording.md says why."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from math import ceil, log

import numpy as np
from jaxtyping import Bool, Float

from carigs.detection.face_track import listed
from carigs.tracking.judgement.coverage import DOWN, LEFT, RIGHT, UP, Coverage, coverage
from carigs.tracking.judgement.quality import TrackedFrames

ENOUGH = 0.8
"""Share of each range of `coverage` that must be reached."""
SHORT_SECONDS, SHORT_FRAMES = 10.0, 100
"""A recording with less of both gets the advice to record longer."""
SMALL_FACE, GOOD_FACE = 120.0, 200.0
"""Widths of a face in pixels: below the first, lids and lips have too few of them."""
BLURRED, RELATIVE_BLUR = 45.0, 0.4
"""Sharpness of a blurred face, and of a blurred frame in that of the median one."""
EXPOSURE_RANGE = 0.4
"""Stops between bright and dark frames (5th and 95th percentile) that shading as the head turns does not explain."""
EXPOSURE_JUMP = 0.15
"""Stops from one frame to the next that a head does not explain."""
ZOOM = 1.25
"""Ratio of the widths of a face in two frames that follow each other: nobody comes nearer so fast, or turns so far."""
OPEN_MOUTH = 0.12
"""Opening of a mouth that shows its inside."""
CLOSED_EYES = 0.65
"""Opening of closed eyes in that of the median frame; networks seldom see lids close wholly."""
OUTSIDE = 0.02
"""Share of the head outside the image from which a frame counts as cut off."""
MANY = 0.1
"""Share of frames from which something is more than a few bad frames."""


def advice(frames: TrackedFrames, *, moving_camera: bool = False) -> list[str]:
    """Find what a better recording would do otherwise.

    Args:
        frames: The frames of one camera.
        moving_camera: Whether the camera circles a still person, who is to do nothing else.

    Returns:
        Sentences, the gravest first; none for a good recording.
    """
    tracked = frames.tracked
    if not tracked.any():
        return ["No frame could be tracked. " + " ".join(_left_out(frames))]
    found = [*_left_out(frames), *_framing(frames), *_camera(frames, moving_camera), *_length(frames)]
    return [*found, *_turns(coverage(frames.yaw, frames.pitch), moving_camera), *_motion(frames, moving_camera)]


def advice_of_cameras(frames: Mapping[str, TrackedFrames]) -> list[str]:
    """Find what a better recording by several cameras in step would do otherwise.

    Args:
        frames: The frames of each camera, by its name.

    Returns:
        Sentences; each camera must be sharp and see the whole head, and all together show it from all sides.
    """
    found = []
    for name, seen in frames.items():
        own = [*_left_out(seen), *_framing(seen), *_camera(seen, False)] if seen.tracked.any() else _left_out(seen)
        found += [f"{name}: {line}" for line in own]
    first = next(iter(frames.values()))
    yaw, pitch = (np.concatenate([getattr(seen, name) for seen in frames.values()]) for name in ("yaw", "pitch"))
    frontal = min((seen for seen in frames.values() if seen.tracked.any()), key=_usual_turn)
    return [*found, *_length(first), *_turns(coverage(yaw, pitch), False), *_motion(frontal, False)]


def _left_out(frames: TrackedFrames) -> Iterator[str]:
    reasons = Counter(reason for reason in frames.left_out if reason)
    if reasons.total() > MANY * len(frames.left_out):
        for reason, count in reasons.most_common():
            where = np.array([r == reason for r in frames.left_out])
            yield f"{count} of {len(where)} frames are left out ({reason}): {listed(where, frames.numbers)}."


def _framing(frames: TrackedFrames) -> Iterator[str]:
    cut = frames.outside > OUTSIDE
    if cut.any():
        worst = 100 * np.nanmax(frames.outside)
        which = f"in frames {listed(cut, frames.numbers)} up to {worst:.0f} % of it lie outside"
        yield f"Keep the whole head in the image: {which}."
    width = np.nanmedian(frames.face_width)
    if width < SMALL_FACE:
        yield (
            f"Move the camera closer or record at a higher resolution: the face is {width:.0f} pixels wide, and should "
            f"be {GOOD_FACE:.0f} or more."
        )


def _camera(frames: TrackedFrames, moving_camera: bool) -> Iterator[str]:
    sharp = np.nanmedian(frames.sharpness)
    blurred = frames.sharpness < RELATIVE_BLUR * sharp
    if sharp < BLURRED:
        yield (
            f"Focus on the face and clean the lens: its sharpness is {sharp:.0f} in the median frame, and below "
            f"{BLURRED:.0f} skin and lashes are lost."
        )
    elif blurred.sum() > MANY * frames.tracked.sum():
        yield (
            f"Move more slowly or use more light: {_share(blurred, frames)} of the frames are blurred "
            f"({listed(blurred, frames.numbers)})."
        )
    if moving_camera:  # other parts of the room come into the image
        return
    low, high = np.nanpercentile(frames.exposure[frames.tracked], (5, 95))
    jumps = _jumps(frames, frames.exposure, EXPOSURE_JUMP)
    if high - low > EXPOSURE_RANGE or jumps.any():
        change = f"the brightness changes by {high - low:.1f} stops"
        if jumps.any():
            change += f", at once in frame{'s' if jumps.sum() > 1 else ''} {listed(jumps, frames.numbers)}"
        yield f"Lock the exposure and keep the light as it is: {change}."
    zooms = _jumps(frames, np.log(frames.face_width), log(ZOOM))
    if zooms.any():
        where = f"in frame{'s' if zooms.sum() > 1 else ''} {listed(zooms, frames.numbers)}"
        yield f"Do not zoom: the size of the face changes at once {where}, as if you had come nearer or gone away."


def _jumps(frames: TrackedFrames, values: Float[np.ndarray, " n"], least: float) -> Bool[np.ndarray, " n"]:
    """Frames from which on values are others than before; a few frames with other values are no jump."""
    tracked = np.flatnonzero(frames.tracked)
    seen, jumps = values[tracked], np.zeros(len(frames.tracked), bool)
    lasting = max(ceil(MANY * len(seen)), 1)
    for i in 1 + np.flatnonzero(np.abs(np.diff(seen)) > least):
        if lasting <= i <= len(seen) - lasting and tracked[i] == tracked[i - 1] + 1:
            before, after = np.median(seen[i - lasting : i]), np.median(seen[i : i + lasting])
            jumps[tracked[i]] = abs(after - before) > least
    return jumps


def _length(frames: TrackedFrames) -> Iterator[str]:
    """Photographs of one moment have one time, and no length."""
    seconds, count = float(np.ptp(frames.times[frames.tracked])), int(frames.tracked.sum())
    if 0 < seconds < SHORT_SECONDS and count < SHORT_FRAMES:
        yield f"Record longer, about 20 seconds: {count} frames of {seconds:.1f} seconds could be tracked."


def _turns(seen: Coverage, moving_camera: bool) -> Iterator[str]:
    move = "Move the camera farther to the person's" if moving_camera else "Turn your head farther to the"
    # A camera to the person's right sees the head turned to the left.
    sides = ("right", "left") if moving_camera else ("left", "right")
    for side, reached, wanted in zip(sides, (seen.left, seen.right), (LEFT, RIGHT), strict=True):
        if reached < ENOUGH * wanted:
            yield f"{move} {side}: {_beyond(reached)}; {wanted:.0f} are good."
    if moving_camera:
        return
    for verb, reached, wanted in (("Raise", seen.up, UP), ("Lower", seen.down, DOWN)):
        if reached < ENOUGH * wanted:
            yield f"{verb} your chin farther: {_beyond(reached)}; {wanted:.0f} are good."


def _beyond(reached: float) -> str:
    if reached < 1:
        return "no frame shows it turned there"
    return f"no frame shows it beyond {reached:.0f} degrees"


def _motion(frames: TrackedFrames, moving_camera: bool) -> Iterator[str]:
    if moving_camera:
        return
    widest = np.nanmax(frames.mouth)
    if widest < OPEN_MOUTH:
        yield (
            f'Open your mouth wide, as for a long "ah": it opens by {100 * widest:.0f} % of the distance of the eyes\' '
            f"outer corners, and shows its inside from {100 * OPEN_MOUTH:.0f} % on."
        )
    closed = np.nanmin(frames.eyes) / np.nanmedian(frames.eyes)
    if closed > CLOSED_EYES:
        yield f"Blink, and close your eyes for a second: no frame shows them less than {100 * closed:.0f} % open."


def _usual_turn(frames: TrackedFrames) -> float:
    """Degrees by which the head is usually turned away from the camera."""
    return float(np.nanmedian(np.abs(frames.yaw)))


def _share(where: Bool[np.ndarray, " n"], frames: TrackedFrames) -> str:
    return f"{100 * where.sum() / frames.tracked.sum():.0f} %"
