"""Cameras and frames that are brighter, blurred or banded against the others are named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from carigs.capture import Capture
from carigs.capture.images import read_rgb, write_png
from carigs.exposure import Exposures, measure_exposures
from carigs.plausibility.check import examine_capture
from carigs.plausibility.exposures import exposure_findings
from evaluation.benchmarks.exposure.disturbed_dataset import disturb_dataset

CAMERA = 1


def changed(sound: Capture, folder, change, timesteps=range(100)) -> Capture:
    """A copy with other images of a camera."""
    disturb_dataset(sound, folder, lambda _: None)
    for frame in sound.frames:
        if frame.camera == CAMERA and frame.timestep in timesteps:
            write_png(folder / frame.image, change(read_rgb(folder / frame.image), frame.timestep))
    return replace(sound, root=folder)


def kinds(capture: Capture, measured: Exposures | None = None) -> dict[str, list[str]]:
    found = exposure_findings(capture, measured or measure_exposures(capture))
    return {kind: sorted(f.field or f.file.name for f in found if f.kind == kind) for kind in {f.kind for f in found}}


def blurred(image, _timestep):
    return cv2.GaussianBlur(image, (0, 0), 1.0)


def banded(image, timestep):
    wave = 1 + 0.06 * np.sin(2 * np.pi * (np.arange(len(image))[:, None, None] / 60 + 0.37 * timestep))
    return np.where(image < 1, image * wave, image).clip(0, 1)


def test_nothing_is_said_of_cameras_that_agree(sound, found):
    assert kinds(sound, found) == {}


def test_a_camera_of_another_exposure_is_named(sound, tmp_path):
    disturb_dataset(sound, tmp_path / "dark", lambda f: np.full(3, 0.7) if f.camera == CAMERA else None)
    found = exposure_findings(capture := replace(sound, root=tmp_path / "dark"), measure_exposures(capture))
    assert [(f.field, f.details) for f in found] == [("camera 1", "red -30%, green -30%, blue -30%")]
    assert f"camera {sound.validation_camera}" in found[0].kind


def test_the_remedy_says_what_becomes_of_test_frames(sound, tmp_path):
    """Matching leaves them as they are, so a camera that has some needs more than that."""
    disturb_dataset(sound, tmp_path / "dark", lambda f: np.full(3, 0.7) if f.camera == CAMERA else None)
    dark = replace(sound, root=tmp_path / "dark")
    untested = replace(dark, frames=tuple(f for f in dark.frames if (f.split, f.camera) != ("test", CAMERA)))
    for capture, tested in ((dark, True), (untested, False)):
        (found,) = exposure_findings(capture, measure_exposures(capture))
        assert ("the test frames of the camera as they are" in found.remedy) == tested
        assert "none is needed for training frames" in found.remedy


@pytest.mark.parametrize("factor", [(0.5, 0.5, 0.5), (1.5, 1.1, 0.7)])
@pytest.mark.parametrize("split", ["test", "train"])
def test_frames_of_another_exposure_are_told_from_wrong_ones(sound, tmp_path, factor, split):
    """Of one camera, the test frame or a training frame: neither is to be tracked again."""
    frame = next(f for f in sound.split(split) if f.camera == CAMERA)
    disturb_dataset(sound, tmp_path / "a", lambda f: np.array(factor) if f == frame else None)
    found = examine_capture(replace(sound, root=tmp_path / "a")).findings
    (one,) = [f for f in found if "the camera's other images" in f.kind]
    assert "another exposure or white balance" in one.kind and one.file.name == Path(frame.image).name
    assert ("metrics compare with held-out frames as they are" in one.remedy) == (split == "test")
    measured = [1 + float(part.split()[1].rstrip("%")) / 100 for part in one.details.split(", ")]
    np.testing.assert_allclose(measured, factor, rtol=0.1)


def test_a_wrong_image_is_no_other_exposure(sound, tmp_path):
    """It is turned about its middle, and darker."""
    frame = next(f for f in sound.split("test") if f.camera == CAMERA)

    def turned(image, timestep):
        return np.rot90(0.7 * image, 2).copy() if timestep == frame.timestep else image

    found = examine_capture(changed(sound, tmp_path / "a", turned), []).findings
    kinds = [f.kind for f in found if f.file.name == Path(frame.image).name]
    assert kinds and not any("another exposure" in kind for kind in kinds)


def test_a_camera_out_of_focus_is_named(sound, tmp_path):
    assert kinds(changed(sound, tmp_path / "a", blurred)) == {"the camera is blurred against the others": ["camera 1"]}


def test_a_frame_that_is_blurred_is_named(sound, tmp_path):
    found = kinds(changed(sound, tmp_path / "a", blurred, timesteps=[3]))
    assert found == {"the frame is blurred against others of its camera": [f"{3:05d}_{CAMERA:02d}.png"]}


def test_a_camera_with_bands_is_named(sound, tmp_path):
    found = kinds(changed(sound, tmp_path / "a", banded))
    assert found["brightness changes from row to row of the image"] == ["camera 1"]
    assert "the camera is blurred against the others" not in found
