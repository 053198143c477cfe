"""Cameras and frames that show the same head brighter, in another white balance, or less sharply than the others."""

from __future__ import annotations

import numpy as np

from carigs.capture import Capture
from carigs.exposure import Exposures, band_strength, camera_sharpness, frame_sharpness
from carigs.plausibility.findings import Finding

LOCK = "lock exposure and white balance when recording"
MATCHED = f"none is needed: training frames are matched to it (capture.match_exposure); {LOCK}"
FOCUS = "leave the camera out, or focus it"
MOTION = "remove the frame, or record with a shorter shutter and more light"
MAINS = "set the shutter to a multiple of the period of the lamps (1/50 or 1/60 s), or use lamps that do not flicker"


def exposure_findings(capture: Capture, exposures: Exposures) -> list[Finding]:
    """Describe what is wrong with exposure, white balance and focus.

    Args:
        capture: The capture.
        exposures: Those of its cameras.

    Returns:
        What is likely to be wrong.
    """
    findings, seen, root = [], exposures.observations, capture.root
    sharpness, bands = camera_sharpness(seen), band_strength(exposures)
    for c, camera in enumerate(seen.cameras):
        field = f"camera {camera}"
        if exposures.differs[c]:
            light = exposures.light(camera) - 1
            details = ", ".join(f"{name} {x:+.0%}" for name, x in zip(("red", "green", "blue"), light, strict=True))
            kind = f"exposure or white balance differs from that of camera {exposures.reference}"
            findings.append(Finding(kind, root, field, details, MATCHED, float(np.abs(light).max())))
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
