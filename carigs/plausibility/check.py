"""All checks of a capture.

| what is checked | on which frames |
|---|---|
| head model | |
| head parameters: ranges, one neutral head | all timesteps |
| images and mattes: decoded whole, sizes, background, foreground | all, or 3000 at evenly spread timesteps |
| the posed mesh in the cameras, mattes against its silhouette | selected (`select_frames`) |
| mattes against the images of other timesteps | selected |
| images against the other frames at the vertices of the mesh | selected |
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from carigs.capture import Capture, Frame
from carigs.plausibility.alternatives import compare_frames
from carigs.plausibility.findings import Finding, summarize
from carigs.plausibility.head_models import check_head_model
from carigs.plausibility.images import check_images, read_frame, summarize_images
from carigs.plausibility.mattes import exchanged_mattes, matte_findings, outlines
from carigs.plausibility.parameters import check_parameters
from carigs.plausibility.selection import select_frames
from carigs.plausibility.vertex_misfit import sample
from carigs.plausibility.views import head_faces, pose_views


def check_capture(capture: Capture) -> Capture:
    """Check that the parts of a capture fit each other.

    Args:
        capture: The capture, as indexed by `read_dataset`.

    Returns:
        The capture with its `warnings`: what is likely to be wrong, one line each.

    Raises:
        InputError: If something cannot be true; names file and field.
    """
    findings = check_head_model(capture.model, capture.head_model)
    findings += check_parameters(capture)
    summaries = summarize_images(capture)
    findings += check_images(capture, summaries)
    findings += _check_views(capture, select_frames(capture, summaries))
    return replace(capture, warnings=(*capture.warnings, *summarize(findings)))


def _check_views(capture: Capture, frames: Mapping[int, Mapping[int, Frame]]) -> list[Finding]:
    findings: list[Finding] = []
    pixels, samples, foregrounds, head = {}, {}, {}, head_faces(capture.model)
    for views in pose_views(capture, frames, findings):
        for view in views:
            image, matte = read_frame(capture, view.frame)
            if matte is not None:
                findings += matte_findings(capture, view, matte, head)
                foregrounds[view.frame] = outlines(image, matte, capture.background)
            pixels[view.frame] = view.pixels
            samples[view.frame] = sample(image, view.pixels)
    findings += exchanged_mattes(capture, foregrounds)
    return findings + compare_frames(capture, frames, pixels, samples)
