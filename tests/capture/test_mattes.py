"""Mattes: a file of their own, the alpha channel of the image, or none."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from miniature import write_ball

from carigs.capture import Capture, read_dataset
from carigs.capture.capture_digest import capture_digest
from carigs.capture.frame_index import read_ground_truth
from carigs.capture.images import read_grey, read_rgb
from carigs.errors import CarigsWarning
from carigs.settings import CaptureSettings, Truth
from carigs.stages.capture import capture as capture_stage
from carigs.stages.truth import truth


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> Path:
    return write_ball(tmp_path_factory.mktemp("ball"))


@pytest.fixture
def dataset(written, tmp_path) -> Path:
    return Path(shutil.copytree(written, tmp_path / "ball"))


def read(folder: Path) -> Capture:
    return read_dataset(folder, folder / "head_model.npz")


def drop_mattes(folder: Path) -> None:
    shutil.rmtree(folder / "fg_masks")
    for split in ("train", "val", "test"):
        file = folder / f"transforms_{split}.json"
        content = json.loads(file.read_text())
        for entry in content["frames"]:
            del entry["fg_mask_path"]
        file.write_text(json.dumps(content))


def add_alpha(folder: Path, depth: type = np.uint8) -> None:
    """Move the mattes into the images, whose hidden pixels become pink."""
    factor = np.iinfo(depth).max // 255
    for file in (folder / "images").iterdir():
        image = cv2.imread(str(file))
        matte = cv2.imread(str(folder / "fg_masks" / file.name), cv2.IMREAD_GRAYSCALE)
        image[matte == 0] = 200, 0, 255
        pixels = np.concatenate([image, matte[..., None]], axis=2).astype(depth) * depth(factor)
        cv2.imwrite(str(file), pixels)
    drop_mattes(folder)


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
def test_an_alpha_channel_is_as_good_as_a_matte(written, dataset, depth):
    add_alpha(dataset, depth)
    ours, theirs = read(dataset), read(written)
    for a, b in zip(ours.frames, theirs.frames, strict=True):
        assert a.mask == a.image
        np.testing.assert_array_equal(ours.image8(a), theirs.image8(b))
        np.testing.assert_array_equal(ours.mask(a), theirs.mask(b))
        np.testing.assert_array_equal(ours.foreground(a), theirs.foreground(b))


def test_partly_opaque_pixels_are_composited_on_the_background(tmp_path):
    pixels = np.zeros((4, 5, 4), np.uint8)
    pixels[..., 2], pixels[..., 3] = 255, 51  # red, 20 % opaque
    cv2.imwrite(str(tmp_path / "a.png"), pixels)
    np.testing.assert_allclose(read_rgb(tmp_path / "a.png", 1.0)[0, 0], [1, 0.8, 0.8], atol=1e-6)
    np.testing.assert_allclose(read_rgb(tmp_path / "a.png", 0.0)[0, 0], [0.2, 0, 0], atol=1e-6)
    np.testing.assert_allclose(read_rgb(tmp_path / "a.png", 0.5)[0, 0], [0.6, 0.4, 0.4], atol=3e-3)


def test_without_a_matte_the_foreground_is_what_differs_from_the_background(written, dataset):
    drop_mattes(dataset)
    ours, theirs = read(dataset), read(written)
    for a, b in zip(ours.frames, theirs.frames, strict=True):
        assert a.mask is None and ours.mask(a) is None
        assert (ours.foreground(a) != theirs.mask(b)).mean() < 0.02


@pytest.mark.parametrize("alpha", [False, True])
def test_the_index_and_the_truth_of_level_0(dataset, tmp_path, alpha):
    (add_alpha if alpha else drop_mattes)(dataset)
    settings = CaptureSettings(
        source="folder", folder=str(dataset), head_model=str(dataset / "head_model.npz"), stride=2, split="EXP-2",
        validation_camera=1,
    )  # fmt: skip
    files = {"index": tmp_path / "capture.json", "dataset": tmp_path / "dataset"}
    if alpha:
        capture_stage(settings, **files)
    else:
        with pytest.warns(CarigsWarning, match="frames have no matte"):
            capture_stage(settings, **files)
    subject = Capture.load(tmp_path / "capture.json")
    assert subject.digest == capture_digest(subject)
    assert subject.split_rule == "EXP-2, validation camera 1; 9 of 12 frames (stride 2)"
    assert {frame.timestep for frame in subject.frames} == {0, 2, 3}
    truth(Truth(), capture=tmp_path / "capture.json", path=tmp_path / "unused.npz", level=0.0,
          frames=tmp_path / "frames", index=tmp_path / "truth.json")  # fmt: skip
    found = read_ground_truth(tmp_path / "truth.json")
    assert len(found.images) == 5
    for key, file in found.images.items():
        frame = subject.frame_at[key]
        np.testing.assert_array_equal(read_rgb(file), subject.image(frame))
        np.testing.assert_array_equal(read_grey(found.masks[key]), subject.foreground(frame))


def test_the_digest_is_of_contents(dataset):
    """Not of times; one pixel, one parameter and a missing frame change it."""
    before = capture_digest(read(dataset))
    frame = read(dataset).frames[0]
    (dataset / frame.image).touch()
    assert capture_digest(read(dataset)) == before
    image = cv2.imread(str(dataset / frame.image), cv2.IMREAD_UNCHANGED)
    image[0, 0, 0] ^= 1
    cv2.imwrite(str(dataset / frame.image), image)
    changed = capture_digest(read(dataset))
    assert changed != before
    with np.load(dataset / frame.parameters) as arrays:
        moved = {**arrays, "translation": arrays["translation"] + np.float32(1e-4)}
    np.savez(dataset / frame.parameters, **moved)
    assert capture_digest(read(dataset)) not in (before, changed)
