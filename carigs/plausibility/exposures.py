"""Cameras and frames that show the same head brighter, in another white balance, or less sharply than the others."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from carigs.capture import Capture
from carigs.exposure import Exposures, band_strength, camera_sharpness, frame_sharpness
from carigs.plausibility.findings import Finding

LOCK = "lock exposure and white balance when recording"
MATCHED = "none is needed for training frames, which are matched to it (capture.match_exposure)"
AS_THEY_ARE = "metrics compare with the test frames of the camera as they are: leave these out, or match them"
FOCUS = "leave the camera out, or focus it"
MOTION = "remove the frame, or record with a shorter shutter and more light"
MAINS = "set the shutter to a multiple of the period of the lamps (1/50 or 1/60 s), or use lamps that do not flicker"


def light_in_words(light: Float[np.ndarray, "3"]) -> str:
    """How much brighter something is, for messages.

    Args:
        light: Ratios of linear light in red, green and blue.

    Returns:
        For example `red +20%, green +0%, blue -5%`.
    """
    return ", ".join(f"{name} {x - 1:+.0%}" for name, x in zip(("red", "green", "blue"), light, strict=True))


def exposure_findings(capture: Capture, exposures: Exposures) -> list[Finding]:
    """Describe what is wrong with exposure, white balance and focus.

    Args:
        capture: The capture.
        exposures: Those of its cameras.

    Returns:
        What is likely to be wrong.
    """
    findings, seen, root = [], exposures.observations, capture.root
    tested = {frame.camera for frame in capture.split("test")}
    sharpness, bands = camera_sharpness(seen), band_strength(exposures)
    for c, camera in enumerate(seen.cameras):
        field = f"camera {camera}"
        if exposures.differs[c]:
            light = exposures.light(camera) - 1
            kind = f"exposure or white balance differs from that of camera {exposures.reference}"
            remedy = f"{MATCHED}; {AS_THEY_ARE if camera in tested else LOCK}"
            details = light_in_words(light + 1)
            findings.append(Finding(kind, root, field, details, remedy, float(np.abs(light).max())))
        low, high = exposures.drift_range(camera)
        if exposures.drifts[c]:
            kind = "exposure or white balance changes over time"
            remedy = f"none is needed: training frames are matched (capture.match_exposure); {LOCK}"
            findings.append(Finding(kind, root, field, f"{low:+.0%} to {high:+.0%}", remedy, high - low))
        if exposures.flickers[c]:
            kind = "exposure or white balance changes from frame to frame"
            findings.append(Finding(kind, root, field, f"{low:+.0%} to {high:+.0%}", f"{MAINS}; {LOCK}", high - low))
        if sharpness[c] < 1:
            kind, details = "the camera is blurred against the others", f"{sharpness[c]:.0%} of their fine detail"
            findings.append(Finding(kind, root, field, details, FOCUS, 1 - sharpness[c]))
        if bands[c].any():
            kind, banded = "brightness changes from row to row of the image", bands[c] > 0
            details = f"by {bands[c].max():.1%} (deviation), in {banded.sum()} of {banded.size} frames"
            findings.append(Finding(kind, root, field, details, MAINS, float(bands[c].max())))
    frames = frame_sharpness(seen)
    for c, t in np.argwhere(frames < 1):
        file = root / capture.frame_at[seen.timesteps[t], seen.cameras[c]].image
        kind = "the frame is blurred against others of its camera"
        findings.append(Finding(kind, file, "", f"{frames[c, t]:.0%} of their fine detail", MOTION, 1 - frames[c, t]))
    return findings
