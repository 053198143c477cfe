"""Factors on the light of images, and their place in the index of a capture."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from miniature import write_ball

from carigs.capture import Capture, read_dataset
from carigs.capture.corrections.colour_gains import with_gains
from carigs.capture.images import to_linear, to_srgb
from carigs.errors import InputError
from carigs.splat.training.supervision import Supervision

GAINS = (0.8, 1.1, 1.25)
LEVELS = np.repeat(np.arange(256, dtype=np.uint8)[None, :, None], 3, axis=2)
OPAQUE = np.ones(LEVELS.shape[:2], np.float32)


def test_opaque_pixels_get_the_light_times_the_gains():
    expected = 255 * to_srgb(np.clip(to_linear(LEVELS / 255.0) * GAINS, 0, 1))
    above = LEVELS > 16  # below, the sRGB curve is a line
    difference = np.abs(with_gains(LEVELS, OPAQUE, 1.0, GAINS) - expected)
    assert difference[above].max() <= 0.51 and difference.max() < 3


@pytest.mark.parametrize("background", [0.0, 0.4, 1.0])
def test_mixed_pixels_are_composited_again(background):
    """The map of a composited colour is the composition of the mapped colour."""
    random = np.random.default_rng(0)
    colour, alpha = random.uniform(0.2, 0.7, (30, 20, 3)), random.random((30, 20)).astype(np.float32)
    behind = background * (1 - alpha[..., None])
    image = np.rint(255 * (colour * alpha[..., None] + behind)).astype(np.uint8)
    changed = to_srgb(to_linear(colour) * GAINS)
    expected = 255 * (changed * alpha[..., None] + behind)
    assert np.abs(with_gains(image, alpha, background, GAINS) - expected).max() < 1.2


def test_the_background_and_the_gain_of_one_change_nothing():
    image = np.random.default_rng(0).integers(0, 256, (8, 9, 3), np.uint8)
    some = np.random.default_rng(1).random((8, 9), np.float32)
    np.testing.assert_array_equal(with_gains(image, some, 0.4, (1.0, 1.0, 1.0)), image)
    white = np.full((8, 9, 3), 255, np.uint8)
    np.testing.assert_array_equal(with_gains(white, np.zeros((8, 9), np.float32), 1.0, GAINS), white)


def test_a_wall_behind_the_head_gets_the_gains_as_the_head_does():
    """The camera saw it: a grey wall of an underexposed camera is the white one that is stated."""
    random = np.random.default_rng(0)
    alpha = random.random((30, 20)).astype(np.float32)
    alpha[:10] = 0
    image = np.where(alpha[..., None] > 0, random.integers(80, 180, (30, 20, 3)), 220).astype(np.uint8)
    np.testing.assert_array_equal(with_gains(image, alpha, 1.0, GAINS), with_gains(image, alpha * 0 + 1, 1.0, GAINS))


def test_inverse_gains_undo_gains():
    middle = LEVELS[:, 40:200]
    there = with_gains(middle, OPAQUE[:, 40:200], 1.0, GAINS)
    back = with_gains(there, OPAQUE[:, 40:200], 1.0, tuple(1 / g for g in GAINS))
    assert np.abs(back.astype(int) - middle).max() <= 1


@pytest.fixture(scope="module")
def capture(tmp_path_factory) -> Capture:
    folder = write_ball(tmp_path_factory.mktemp("ball"))
    return read_dataset(folder, folder / "head_model.npz")


def test_the_index_keeps_gains_and_names_them_only_where_there_are_some(capture, tmp_path):
    frames = (replace(capture.frames[0], gains=GAINS), *capture.frames[1:])
    replace(capture, frames=frames).save(tmp_path / "some.json")
    assert Capture.load(tmp_path / "some.json").frames == frames
    capture.save(tmp_path / "none.json")
    assert "gains" not in (tmp_path / "none.json").read_text()


@pytest.mark.parametrize("gains", [[1, 1], [1, 1, 0], [1, 1, 1e9], ["a", 1, 1], 1, None])
def test_impossible_gains_are_refused(capture, tmp_path, gains):
    capture.save(tmp_path / "capture.json")
    content = json.loads((tmp_path / "capture.json").read_text())
    content["frames"][1]["gains"] = gains
    (tmp_path / "capture.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match=r"frames\[1\]\.gains"):
        Capture.load(tmp_path / "capture.json")


def test_images_are_read_with_gains_and_mattes_as_they_are(capture):
    frame = capture.frames[0]
    bright = replace(frame, gains=GAINS)
    expected = with_gains(capture.image8(frame), capture.foreground(frame), capture.background, GAINS)
    np.testing.assert_array_equal(capture.image8(bright), expected)
    assert (expected != capture.image8(frame)).any()
    without = replace(bright, mask=None)
    np.testing.assert_array_equal(capture.foreground(without), capture.foreground(replace(frame, mask=None)))


def test_trainings_read_images_with_gains(capture):
    bright = replace(capture, frames=tuple(replace(frame, gains=GAINS) for frame in capture.frames))
    for person in (capture, bright):
        supervision = Supervision(person)
        supervision.prefetch(False, 0)
        np.testing.assert_array_equal(
            supervision.stored_example(False, 0).image, person.image8(person.split("train")[0])
        )
