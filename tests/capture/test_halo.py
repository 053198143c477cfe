"""Old backgrounds at outlines: their removal inverts how they come about; their place in the index of a capture."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from discs import before, in_bytes
from miniature import write_ball

from carigs.capture import Capture, read_dataset
from carigs.capture.corrections.halo import Halo, without_halo
from carigs.capture.corrections.known_background import remake_matte
from carigs.capture.images import write_png
from carigs.errors import InputError

OLD = 0.1, 0.6, 0.25
HALOS = [Halo(OLD, True), Halo(OLD, False)]


def with_old_background(halo: Halo, colour, alpha: np.ndarray, background: float) -> np.ndarray:
    photograph = before(halo.colour, colour, alpha)
    if halo.photograph:
        return before(background, photograph, alpha)
    return np.where(alpha[..., None] > 0, photograph, background)


@pytest.mark.parametrize("background", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("halo", HALOS)
def test_the_foreground_is_composited_as_if_there_had_been_no_old_background(halo, background):
    random = np.random.default_rng(0)
    colour, alpha = random.random((40, 30, 3)), random.integers(0, 256, (40, 30)).astype(np.float32) / 255
    alpha[:5], alpha[5:10] = 0, 1
    image = in_bytes(with_old_background(halo, colour, alpha, background))
    found = without_halo(image, alpha, background, halo).astype(float)
    error = np.abs(found - 255 * before(background, colour, alpha)).max(axis=-1)
    # Rounding errs by half a level, which the division by alpha enlarges; the result is rounded again.
    assert (error <= 0.51 + 0.51 / np.maximum(alpha, 1 / 255)).all()
    np.testing.assert_array_equal(found[:10], image[:10])


@pytest.mark.parametrize("halo", HALOS)
def test_the_error_at_faint_pixels_is_at_most_their_opacity(halo):
    """The image is wrong by as much as it can be, but the foreground has a colour in [0, 1]."""
    alpha = np.array([[0.001, 0.01, 0.1]], np.float32)
    for shown in (0, 255):
        found = without_halo(np.full((1, 3, 3), shown, np.uint8), alpha, 1.0, halo)
        assert (255 - found.astype(float) <= 255 * alpha[..., None] + 0.51).all()


@pytest.fixture(scope="module")
def capture(tmp_path_factory) -> Capture:
    folder = write_ball(tmp_path_factory.mktemp("ball"))
    found = read_dataset(folder, folder / "head_model.npz")
    for frame in found.frames:  # soft mattes
        matte = found.mask(frame)
        write_png(folder / str(frame.mask), 0.5 * matte + 0.5 * np.roll(matte, 1, axis=1))
    return found


def test_the_index_keeps_halos_and_remade_mattes_and_names_them_only_where_there_are_some(capture, tmp_path):
    frames = (replace(capture.frames[0], halo=HALOS[0]), replace(capture.frames[1], remade=True), *capture.frames[2:])
    replace(capture, frames=frames).save(tmp_path / "some.json")
    assert Capture.load(tmp_path / "some.json").frames == frames
    capture.save(tmp_path / "none.json")
    text = (tmp_path / "none.json").read_text()
    assert "halo" not in text and "remade" not in text


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("halo", {"colour": [0, 1], "photograph": True}),
        ("halo", {"colour": [0, 1, 2], "photograph": True}),
        ("halo", {"colour": [0, 1, 1], "photograph": 1}),
        ("halo", {"colour": [0, 1, 1]}),
        ("halo", None),
        ("remade", 1),
        ("remade", None),
    ],
)
def test_impossible_corrections_are_refused(capture, tmp_path, key, value):
    capture.save(tmp_path / "capture.json")
    content = json.loads((tmp_path / "capture.json").read_text())
    content["frames"][1][key] = value
    (tmp_path / "capture.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match=rf"frames\[1\]\.{key}"):
        Capture.load(tmp_path / "capture.json")


@pytest.mark.parametrize("halo", HALOS)
def test_images_are_read_without_halos(capture, halo):
    frame = capture.frames[0]
    expected = without_halo(capture.image8(frame), capture.mask(frame), capture.background, halo)
    np.testing.assert_array_equal(capture.image8(replace(frame, halo=halo)), expected)
    assert (expected != capture.image8(frame)).any()


def test_mattes_are_read_as_they_are_remade(capture):
    frame = capture.frames[0]
    expected = remake_matte(capture.image8(frame), capture.mask8(frame), capture.background).alpha
    np.testing.assert_allclose(capture.foreground(replace(frame, remade=True)), expected, atol=0.51 / 255)
    assert np.abs(expected - capture.foreground(frame)).max() > 0.4
    assert capture.mask8(replace(frame, remade=True, mask=None)) is None
