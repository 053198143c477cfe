"""All checks of a capture.

| what is checked | on which frames |
|---|---|
| head model | |
| head parameters: ranges, one neutral head | all timesteps |
| images and mattes: decoded whole, sizes, background, foreground | all, or 3000 at evenly spread timesteps |
| the posed mesh in the cameras, mattes against its silhouette | selected (`select_frames`) |
| mattes against the images of other timesteps | selected |
| images against the other frames at the vertices of the mesh | selected |
| outlines of mattes and images against each other, if the mesh fits | 64 |
| exposure and sharpness of cameras, if the mesh fits | all but test frames, or 256 |
| usual mistakes, by trying (`diagnose`) | a few, at a low resolution |
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

from carigs.capture import Capture, Frame
from carigs.errors import InputError, collecting
from carigs.exposure import Exposures, match_exposures, measure_exposures
from carigs.plausibility.alternatives import compare_frames
from carigs.plausibility.diagnosis.scene import read_scene
from carigs.plausibility.diagnosis.trial import Diagnosis, diagnose
from carigs.plausibility.exposures import exposure_findings
from carigs.plausibility.findings import Finding, summarize
from carigs.plausibility.head_models import check_head_model
from carigs.plausibility.images import check_images, read_frame, summarize_images
from carigs.plausibility.mattes import exchanged_mattes, matte_findings, outlines
from carigs.plausibility.outlines import CameraOutlines, measure_outlines, mend_outlines, outline_findings
from carigs.plausibility.parameters import check_parameters
from carigs.plausibility.selection import select_frames
from carigs.plausibility.vertex_misfit import sample_inside
from carigs.plausibility.views import ImpossibleView, head_faces, pose_views


class Examination(NamedTuple):
    """What was found in a capture."""

    findings: list[Finding]
    """What is likely to be wrong."""
    diagnosis: Diagnosis | None
    """None if there was no reason to look for a mistake."""
    exposures: Exposures | None
    """None if the mesh does not fit the images, or there are errors."""
    outlines: Mapping[int, CameraOutlines]
    """What is wrong with the outlines of cameras; empty if the mesh does not fit the images, or there are errors."""


def check_capture(capture: Capture, *, match_exposure: bool = True, mend: bool = True) -> Capture:
    """Check that the parts of a capture fit each other.

    Args:
        capture: The capture, as indexed by `read_dataset`.
        match_exposure: Whether training frames get the factors that match their exposures to one camera.
        mend: Whether mattes that do not fit their images are made anew, and halos removed from training frames.

    Returns:
        The capture with its `warnings`: what is likely to be wrong, one line each.

    Raises:
        InputError: If something cannot be true; names file and field.
    """
    found = examine_capture(capture)
    if mend:
        capture = mend_outlines(capture, found.outlines)
    if match_exposure and found.exposures is not None:
        capture = match_exposures(capture, found.exposures)
    return replace(capture, warnings=(*capture.warnings, *summarize(found.findings)))


def examine_capture(
    capture: Capture, errors: list[InputError] | None = None, *, always_diagnose: bool = False
) -> Examination:
    """Find everything that is wrong with a capture.

    Args:
        capture: The capture, as indexed by `read_dataset`.
        errors: Receives what cannot be true; None to raise the first.
        always_diagnose: Whether mistakes are looked for although the mesh fits the images.

    Returns:
        What is likely to be wrong.

    Raises:
        InputError: If something cannot be true, and `errors` is None.
    """
    findings = check_head_model(capture.model, capture.head_model, errors)
    findings += check_parameters(capture, errors)
    summaries = summarize_images(capture, errors)
    findings += check_images(capture, summaries)
    if len(summaries) < len(capture.frames):
        capture = replace(capture, frames=tuple(summaries))
    misplaced: list[InputError] = []
    seen = _check_views(capture, select_frames(capture, summaries), misplaced)
    diagnosis = diagnose(read_scene(capture)) if always_diagnose or misplaced or seen else None
    if diagnosis and diagnosis.mistakes and diagnosis.is_unusable:  # the rest follows from it
        misplaced = [error for error in misplaced if not isinstance(error, ImpossibleView)]
        misplaced.insert(0, diagnosis.error(capture.root))
        seen = []
    elif diagnosis and diagnosis.mistakes:
        seen.insert(0, diagnosis.finding(capture.root))
    for error in misplaced:
        with collecting(errors):
            raise error
    exposures, wrong_outlines = None, {}
    if not (errors or misplaced or (diagnosis and diagnosis.mistakes)):
        wrong_outlines = measure_outlines(capture)
        seen += outline_findings(capture, wrong_outlines)
        capture = mend_outlines(capture, wrong_outlines)
        exposures = measure_exposures(capture)
        seen += exposure_findings(capture, exposures)
    return Examination(findings + seen, diagnosis, exposures, wrong_outlines)


def _check_views(
    capture: Capture, frames: Mapping[int, Mapping[int, Frame]], errors: list[InputError]
) -> list[Finding]:
    findings: list[Finding] = []
    pixels, samples, foregrounds, head = {}, {}, {}, head_faces(capture.model)
    for view in pose_views(capture, frames, findings, errors):
        image, matte = read_frame(capture, view.frame)
        if matte is not None:
            findings += matte_findings(capture, view, matte, head)
            foregrounds[view.frame] = outlines(image, matte, capture.background)
        pixels[view.frame] = view.pixels
        samples[view.frame] = sample_inside(image, view.pixels)
    findings += exchanged_mattes(capture, foregrounds)
    return findings + compare_frames(capture, frames, pixels, samples)
