"""Outlines of mattes and images: what is wrong with discs is known; in captures it is named once, and mended."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from discs import RADIUS, before, disc, in_bytes

from carigs.capture import Capture, read_dataset
from carigs.cli.check import check
from carigs.errors import CarigsWarning
from carigs.plausibility.halos import fit_halo, outline_pixels
from carigs.plausibility.matte_outlines import outline_error
from carigs.plausibility.outlines import measure_outlines, mend_outlines
from carigs.settings import CaptureSettings, Toy
from carigs.stages.capture import capture as capture_stage
from carigs.toy import write_capture
from evaluation.benchmarks.mattes.damaged_dataset import IMAGES, MATTES, SCREEN, damage_dataset

COLOUR = 0.7, 0.5, 0.35


@pytest.mark.parametrize("background", [0.0, 1.0])
@pytest.mark.parametrize("margin", [-3.0, -1.5, 0.0, 0.7, 3.0])
def test_the_offset_is_the_distance_of_the_outlines(margin, background):
    """The area between circles of radius r and r + m, over the circumference 2 pi r, is m + m^2 / 2 r."""
    image = in_bytes(before(background, COLOUR, disc()))
    found = outline_error(image, in_bytes(disc(RADIUS + margin)), background)
    assert found.offset == pytest.approx(margin + margin**2 / (2 * RADIUS), abs=0.08)
    assert found.spread == pytest.approx(0, abs=0.08)


@pytest.mark.parametrize("deviation", [1.0, 2.0])
def test_the_spread_of_a_blur_follows_from_its_deviation(deviation):
    """The integral of |Phi(x / s) - step(x)| is s sqrt(2 / pi).

    The outline of the disc is a ramp of one pixel, a mean of steps at -1/2 to 1/2, which takes away
    2 E(int_0^|u| (1 - Phi(x / s)) dx) = 1 / 4 - 1 / (12 s sqrt(2 pi)), to second order.
    """
    image = in_bytes(before(1.0, COLOUR, disc()))
    found = outline_error(image, in_bytes(cv2.GaussianBlur(disc(), (0, 0), deviation)), 1.0)
    expected = deviation * np.sqrt(2 / np.pi) - 1 / 4 + 1 / (12 * deviation * np.sqrt(2 * np.pi))
    assert abs(found.offset) + found.spread == pytest.approx(expected, abs=0.05)


def test_nothing_is_known_of_a_wall_behind_the_head_and_of_soft_images():
    wall, soft = before(0.5, COLOUR, disc()), before(1.0, COLOUR, cv2.GaussianBlur(disc(), (0, 0), 4))
    for image in (wall, soft):
        assert outline_error(in_bytes(image), in_bytes(disc(RADIUS + 2)), 1.0) is None


@pytest.mark.parametrize("photograph", [True, False])
@pytest.mark.parametrize("old", [(0.0, 0.6, 0.25), (0.2, 0.2, 0.2), (0.4, 0.6, 0.9)])
def test_the_old_background_is_found(old, photograph):
    shown = before(old, COLOUR, disc())
    shown = before(1.0, shown, disc()) if photograph else np.where(disc()[..., None] > 0, shown, 1.0)
    found = fit_halo([outline_pixels(in_bytes(shown), in_bytes(disc()))] * 2, 1.0)
    np.testing.assert_allclose(found.colour, old, atol=0.02)
    assert found.photograph == photograph


@pytest.mark.parametrize("margin", [-3.0, -2.0, 0.0, 2.0])
def test_a_matte_of_another_size_is_no_halo(margin):
    """A disc of noisy colours: a rim that is left out has the colour of the foreground, not of an old background."""
    noise = np.random.default_rng(0).normal(0, 0.02, (*disc().shape, 3))
    image = in_bytes(before(1.0, np.clip(COLOUR + noise, 0, 1), disc()))
    assert fit_halo([outline_pixels(image, in_bytes(disc(RADIUS + margin)))] * 2, 1.0) is None


def toy(folder: Path, hair: str) -> Capture:
    size = {"width": 156, "height": 204, "cameras": 3, "steps_per_sequence": 1, "texture_size": 256}
    write_capture(folder, Toy(**size, supersampling=3, hair=hair, hair_strands=1500))
    return read_dataset(folder, folder / "head_model.npz")


@pytest.fixture(scope="module")
def sound(tmp_path_factory) -> Capture:
    return toy(tmp_path_factory.mktemp("short"), "short")


def damaged(sound: Capture, folder: Path, kind: str) -> Capture:
    damage_dataset(sound, folder / "copy", kind)
    return replace(sound, root=folder / "copy")


def error_of_mattes(capture: Capture, sound: Capture) -> float:
    pairs = zip(capture.frames, sound.frames, strict=True)
    return float(np.mean([np.abs(capture.foreground(a) - sound.foreground(b)).mean() for a, b in pairs]))


def error_of_images(capture: Capture, sound: Capture) -> float:
    pairs = zip(capture.split("train"), sound.split("train"), strict=True)
    return float(np.mean([np.abs(capture.image(a) - sound.image(b)).mean() for a, b in pairs]))


def test_nothing_is_said_of_a_sound_capture_and_nothing_changes(sound, tmp_path):
    for capture in (sound, toy(tmp_path, "long")):
        assert measure_outlines(capture) == {}
        assert mend_outlines(capture, {}) is capture


@pytest.mark.parametrize("kind", MATTES)
def test_wrong_mattes_are_made_anew(kind, sound, tmp_path):
    wrong = damaged(sound, tmp_path, kind)
    found = measure_outlines(wrong)
    assert sorted(found) == sorted(sound.cameras)
    assert all(camera.remade and camera.halo is None for camera in found.values())
    mended = mend_outlines(wrong, found)
    assert all(frame.remade for frame in mended.frames)
    assert error_of_mattes(mended, sound) < 0.4 * error_of_mattes(wrong, sound)


@pytest.mark.parametrize("kind", IMAGES)
def test_old_backgrounds_are_removed_from_training_frames(kind, sound, tmp_path):
    wrong = damaged(sound, tmp_path, kind)
    found = measure_outlines(wrong)
    assert sorted(found) == sorted(sound.cameras)
    for camera in found.values():
        assert not camera.remade
        np.testing.assert_allclose(camera.halo.colour, SCREEN, atol=0.06)
    mended = mend_outlines(wrong, found)
    assert error_of_images(mended, sound) < 0.25 * error_of_images(wrong, sound)
    assert all(frame.halo is None for frame in mended.frames if frame.split != "train")


def test_the_check_and_the_stage_say_it_in_one_line(sound, tmp_path, capsys):
    wrong = damaged(sound, tmp_path, "grown")
    assert check(wrong.root, wrong.head_model, background=1.0, split="files", sheet=None) == 0
    printed = capsys.readouterr().out.splitlines()
    assert len([line for line in printed if "mattes end outside the outline of the foreground" in line]) == 1
    settings = CaptureSettings(source="folder", folder=str(wrong.root), head_model=str(wrong.head_model))
    for mend in (True, False):
        settings = replace(settings, mend_outlines=mend)
        index = tmp_path / f"{mend}.json"
        with pytest.warns(CarigsWarning, match="mattes end outside the outline"):
            capture_stage(settings, index=index, dataset=tmp_path / f"dataset {mend}")
        assert all(frame.remade == mend for frame in Capture.load(index).frames)


def test_mattes_that_are_far_off_are_named_and_left(sound, tmp_path):
    """Beyond the reach, the image does not tell any more."""
    damage_dataset(sound, tmp_path / "copy", "grown")
    for frame in sound.frames:
        matte = cv2.dilate(sound.mask8(frame), cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (11, 11)))
        cv2.imwrite(str(tmp_path / "copy" / str(frame.mask)), matte)
    found = measure_outlines(replace(sound, root=tmp_path / "copy"))
    assert sorted(found) == sorted(sound.cameras)
    assert not any(camera.remade for camera in found.values())
