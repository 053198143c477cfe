"""The convention of cy is found by triangulation, whatever the files hold."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_head import ring_of_cameras, small_head

from carigs.capture import Camera, Capture
from carigs.capture.frame import Frame
from carigs.capture.importers.calibrated_images import FROM_THE_TOP
from carigs.fitting.landmarks.files import Landmarks
from carigs.fitting.principal_point import resolve_cy_by_landmarks

POINTS = small_head(subdivisions=2).v_template[::3].astype(np.float64)
TIMESTEPS = 3


def cameras(rows: list[float]) -> list[Camera]:
    """Cameras whose images have lost rows at the top, and 20 altogether."""
    return [replace(c, cy=c.cy - n, height=c.height - 20) for c, n in zip(ring_of_cameras(6), rows, strict=True)]


def capture(true: list[Camera], *, flipped: bool) -> Capture:
    """Footage as its files say."""
    frames = [Frame(t, c, "", "train", f"{t}_{c}", None, f"{t}", c) for t in range(TIMESTEPS) for c in range(len(true))]
    stated = [replace(c, cy=c.height - c.cy) for c in true] if flipped else true
    return Capture(Path("video"), Path("head.npz"), tuple(frames), tuple(stated), 1.0)


def landmarks(true: list[Camera], noise: float) -> Landmarks:
    values = np.ones((TIMESTEPS, len(true), len(POINTS), 3))
    values[..., :2] = np.stack([camera.project(POINTS)[0] for camera in true])
    values[..., :2] += noise * np.random.default_rng(0).normal(size=values[..., :2].shape)
    return Landmarks(values, np.arange(TIMESTEPS), np.arange(len(true)))


ALL, ONE, OWN = [16.0] * 6, [16.0, *[10.0] * 5], [4.0, 12, 9, 17, 13, 7]
"""Rows that images lose at the top: all as many, those of one camera more than the middle's 10, or each its own."""


@pytest.mark.parametrize("rows", [ALL, ONE, OWN])
@pytest.mark.parametrize("flipped", [False, True])
@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_either_convention_is_found(rows, flipped, noise):
    true = cameras(rows)
    found = resolve_cy_by_landmarks(capture(true, flipped=flipped), landmarks(true, noise))
    assert found.cy.startswith("flipped: " if flipped else "opencv: ") and found.warnings == ()
    assert [camera.cy for camera in found.calibrations] == [camera.cy for camera in true]


@pytest.mark.parametrize("flipped", [False, True])
def test_wrong_landmarks_do_not_change_the_answer(flipped):
    true = cameras(OWN)
    spoilt, random = landmarks(true, 1.0), np.random.default_rng(1)
    wrong = random.random(spoilt.values.shape[:3]) < 0.1
    spoilt.values[wrong] += np.append(random.uniform(30, 60, 2), 0)
    spoilt.values[random.random(spoilt.values.shape[:3]) < 0.3] = 0
    assert resolve_cy_by_landmarks(capture(true, flipped=flipped), spoilt).cy.startswith(
        "flipped" if flipped else "opencv"
    )


def test_a_centred_principal_point_does_not_matter():
    true = cameras([10.0] * 6)
    found = resolve_cy_by_landmarks(capture(true, flipped=True), landmarks(true, 1.0))
    assert found.cy.endswith("does not matter") and found.calibrations == tuple(true) and found.warnings == ()


def test_what_landmarks_cannot_tell_stays_as_it_is_with_a_warning():
    """A shift by one pixel of all images is within the noise."""
    true = cameras([9.4] * 6)
    stated = capture(true, flipped=True)
    found = resolve_cy_by_landmarks(stated, landmarks(true, 5.0))
    assert found.calibrations == stated.calibrations
    assert len(found.warnings) == 1 and found.warnings[0].startswith("video: cy: landmarks do not tell")
    assert "--cy opencv or flipped" in found.warnings[0]


def test_without_landmarks_nothing_changes():
    true = cameras(OWN)
    stated, none = capture(true, flipped=True), landmarks(true, 0.0)
    none.values[:, 1:] = 0  # one camera alone
    found = resolve_cy_by_landmarks(stated, none)
    assert found.calibrations == stated.calibrations and "too few landmarks" in found.cy


def test_a_form_of_files_that_says_it_needs_no_evidence():
    true = cameras(OWN)
    stated = replace(capture(true, flipped=True), cy=FROM_THE_TOP)
    assert resolve_cy_by_landmarks(stated, landmarks(true, 0.0)) is stated
    assert resolve_cy_by_landmarks(stated, landmarks(true, 0.0), "flipped").calibrations == tuple(true)


def test_a_setting_needs_no_evidence():
    true = cameras(OWN)
    stated = capture(true, flipped=False)
    assert resolve_cy_by_landmarks(stated, landmarks(true, 1.0), "opencv").calibrations == stated.calibrations
    flipped = resolve_cy_by_landmarks(stated, landmarks(true, 1.0), "flipped")
    assert [c.cy for c in flipped.calibrations] == [c.height - c.cy for c in true]
    assert flipped.cy == "flipped: --cy flipped"
