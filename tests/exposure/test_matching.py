"""Exposures of cameras: known ones are found, and a capture whose cameras agree stays as it is."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from carigs.capture import Capture
from carigs.exposure import match_exposures, measure_exposures
from carigs.plausibility.exposures import exposure_findings
from evaluation.benchmarks.exposure.disturbed_dataset import constant_factor, disturb_dataset, drawn_factors

TOLERANCE = 0.015
"""Of light: 0.6 % of stored values."""


def disturbed(sound: Capture, folder, factor_of) -> Capture:
    disturb_dataset(sound, folder, factor_of)
    return replace(sound, root=folder)


def with_frames(capture: Capture, keep) -> Capture:
    return replace(capture, frames=tuple(frame for frame in capture.frames if keep(frame)))


def test_a_capture_whose_cameras_agree_stays_as_it_is(sound, found):
    assert match_exposures(sound, found) is sound
    assert max(np.abs(found.light(camera) - 1).max() for camera in sound.cameras) < TOLERANCE


@pytest.fixture(scope="module")
def factors(sound):
    return drawn_factors(sound, seed=3)


@pytest.fixture(scope="module")
def other(sound, factors, tmp_path_factory) -> Capture:
    return disturbed(sound, tmp_path_factory.mktemp("other") / "copy", partial(constant_factor, factors))


@pytest.fixture(scope="module")
def measured(other):
    return measure_exposures(other)


def test_drawn_factors_are_found(sound, factors, measured):
    assert measured.reference == sound.validation_camera
    for camera, factor in factors.items():
        np.testing.assert_allclose(measured.light(camera) / factor, 1, atol=TOLERANCE)


def test_matched_training_frames_are_those_of_the_sound_capture(sound, other, measured):
    """To three levels at nearly all pixels; those that were clipped cannot come back."""
    matched, distance, before = match_exposures(other, measured), [], []
    for frame, true in zip(matched.split("train"), sound.split("train"), strict=True):
        inside = sound.foreground(true) >= 1
        before.append(np.abs(other.image8(true).astype(int) - sound.image8(true))[inside])
        distance.append(np.abs(matched.image8(frame).astype(int) - sound.image8(true))[inside])
    assert np.quantile(np.concatenate(distance), 0.99) <= 3
    assert np.concatenate(distance).mean() < 0.15 * np.concatenate(before).mean()


def test_frames_that_are_held_out_and_the_reference_stay_as_they_are(other, measured):
    matched = match_exposures(other, measured)
    assert all(frame.gains is None for frame in matched.frames if frame.split != "train")
    assert any(frame.gains is not None for frame in matched.frames)


def test_the_numbers_of_the_cameras_do_not_matter(other, measured):
    """Cameras in reverse order: gains belong to cameras, not to their places."""
    last = max(other.cameras)
    renumbered = replace(other, frames=tuple(replace(f, camera=last - f.camera) for f in other.frames))
    again = measure_exposures(renumbered)
    assert again.reference == last - measured.reference
    for camera in other.cameras:
        np.testing.assert_allclose(again.light(last - camera), measured.light(camera), rtol=1e-6)


def test_test_frames_are_not_looked_at(sound, factors, measured, tmp_path):
    """They are made darker: nothing changes."""
    constant = partial(constant_factor, factors)
    dark = disturbed(sound, tmp_path / "dark", lambda f: np.full(3, 0.5) if f.split == "test" else constant(f))
    np.testing.assert_array_equal(measure_exposures(dark).static, measured.static)


def over_time(camera: int, frame) -> np.ndarray | None:
    """An exposure that rises by 40 %."""
    return np.full(3, 0.8 + 0.04 * frame.timestep) if frame.camera == camera and frame.split != "test" else None


def test_an_automatic_exposure_of_one_camera_is_followed(sound, tmp_path):
    camera = next(c for c in sound.cameras if c != sound.validation_camera)
    capture = disturbed(sound, tmp_path / "drift", partial(over_time, camera))
    found = measure_exposures(capture)
    assert [c for c, drifts in zip(found.observations.cameras, found.drifts, strict=True) if drifts] == [camera]
    for frame in match_exposures(capture, found).split("train"):
        if frame.camera == camera:
            np.testing.assert_allclose(np.array(frame.gains) * over_time(camera, frame), 1, atol=2 * TOLERANCE)


def test_an_automatic_exposure_of_the_only_camera_is_followed(sound, tmp_path):
    """Against its median, since nothing else is known."""
    camera = sound.validation_camera
    capture = disturbed(
        with_frames(sound, lambda f: f.camera == camera and f.split != "test"),
        tmp_path / "one",
        partial(over_time, camera),
    )
    capture = replace(capture, frames=tuple(replace(f, split="train") for f in capture.frames))
    found = measure_exposures(capture)
    assert found.drifts.all() and not found.differs.any()
    frames = match_exposures(capture, found).frames
    light = np.array([np.array(frame.gains or (1, 1, 1)) * over_time(camera, frame) for frame in frames])
    np.testing.assert_allclose(light / np.median(light), 1, atol=2 * TOLERANCE)


def test_a_head_that_turns_before_one_camera_is_no_automatic_exposure(sound):
    one = with_frames(sound, lambda f: f.camera == sound.validation_camera)
    assert not measure_exposures(one).drifts.any()


@pytest.mark.parametrize("keep", ["one frame", "one timestep", "test frames"])
def test_captures_that_say_little_are_left_as_they_are(sound, keep):
    choice = {
        "one frame": lambda f: f.timestep == 0 and f.camera == sound.validation_camera,
        "one timestep": lambda f: f.timestep == 0,
        "test frames": lambda f: f.split == "test",
    }
    some = with_frames(sound, choice[keep])
    found = measure_exposures(some)
    assert match_exposures(some, found) is some
    assert exposure_findings(some, found) == []


def test_photographs_of_one_moment_are_matched(sound, factors, other):
    found = measure_exposures(with_frames(other, lambda f: f.timestep == 0))
    assert found.differs.any()
    for camera, differs in zip(found.observations.cameras, found.differs, strict=True):
        assert not differs or np.allclose(found.light(camera) / factors[camera], 1, atol=2 * TOLERANCE)
