"""Images in the forms that programs write: one decision about orientation, opacity and depth."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from miniature import write_ball
from PIL import Image

from carigs.capture import Capture, read_dataset
from carigs.capture.images import read_grey8, read_rgb8
from carigs.errors import InputError
from carigs.plausibility import check_capture
from carigs.readers.images import read_header

RANDOM = np.random.default_rng(0)
COLOURS = np.kron(RANDOM.integers(0, 256, (4, 6, 3)), np.ones((8, 8, 1))).astype(np.uint8)  # flat blocks survive JPEG
OPACITY = RANDOM.integers(0, 256, (32, 48)).astype(np.uint8)


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> Path:
    return write_ball(tmp_path_factory.mktemp("ball"))


@pytest.fixture
def dataset(written, tmp_path) -> Path:
    return Path(shutil.copytree(written, tmp_path / "ball"))


def read(folder: Path) -> Capture:
    return read_dataset(folder, folder / "head_model.npz")


def save(file: Path, pixels: np.ndarray, orientation: int, **options) -> None:
    exif = Image.Exif()
    exif[0x0112] = orientation
    Image.fromarray(pixels).save(file, exif=exif, **options)


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("suffix", ["png", "jpg"])
def test_an_orientation_turns_neither_colours_nor_mattes_nor_sizes(tmp_path, suffix, orientation):
    colour, matte = tmp_path / f"colour.{suffix}", tmp_path / f"matte.{suffix}"
    save(colour, COLOURS, orientation, quality=95)
    save(matte, OPACITY // 128 * 255, orientation, quality=95)
    header = read_header(colour)
    assert (header.width, header.height, header.orientation) == (48, 32, orientation)
    assert read_rgb8(colour).shape == COLOURS.shape and read_grey8(matte).shape == OPACITY.shape
    assert np.median(np.abs(read_rgb8(colour).astype(int) - COLOURS)) <= 2
    assert ((read_grey8(matte) > 127) == (OPACITY > 127)).mean() > 0.9


def test_long_metadata_before_the_orientation_are_passed(tmp_path):
    for suffix in ("png", "jpg"):
        save(tmp_path / f"a.{suffix}", COLOURS, 6, icc_profile=bytes(RANDOM.integers(0, 256, 50_000).astype(np.uint8)))
        assert read_header(tmp_path / f"a.{suffix}")[:4] == (48, 32, False, 6)


@pytest.mark.parametrize("damage", [b"", b"II*\0", b"MM\0*\xff\xff\xff\xff", b"II*\0\x08\0\0\0\xff\xff" + 40 * b"\x12"])
def test_broken_tags_are_no_orientation(tmp_path, damage):
    exif = b"Exif\0\0" + damage
    Image.fromarray(COLOURS).save(tmp_path / "a.jpg", exif=exif)
    assert read_header(tmp_path / "a.jpg").orientation == 1


def turned(folder: Path, orientation: int) -> None:
    """Images become JPEG, and their mattes PNG, with a tag; the pixels stay as they are."""
    for file in (folder / "images").iterdir():
        save(file.with_suffix(".jpg"), np.asarray(Image.open(file)), orientation, quality=95, subsampling=0)
        file.unlink()
    for split in ("train", "val", "test"):
        index = folder / f"transforms_{split}.json"
        index.write_text(index.read_text().replace(".png", ".jpg").replace("fg_masks/", "fg_masks/"))
        content = json.loads(index.read_text())
        for entry in content["frames"]:
            entry["fg_mask_path"] = entry["fg_mask_path"].replace(".jpg", ".png")
        index.write_text(json.dumps(content))


@pytest.mark.parametrize("orientation", [3, 6, 8])
def test_a_capture_with_tags_is_that_without_and_one_warning_says_so(written, dataset, orientation):
    turned(dataset, orientation)
    found, plain = read(dataset), read(written)
    for a, b in zip(found.frames, plain.frames, strict=True):
        assert np.abs(found.image8(a).astype(int) - plain.image8(b)).mean() < 6
        np.testing.assert_array_equal(found.mask8(a), plain.mask8(b))
    lines = check_capture(found).warnings
    (line,) = (line for line in lines if "orientation" in line)
    assert f"EXIF orientation {orientation} is not applied" in line and "12 files" in line
    assert not any("background" in line for line in lines)


def test_a_size_that_the_tag_would_mend_is_refused_with_the_tag(dataset):
    """The camera is calibrated for the image as a viewer shows it."""
    for file in (dataset / "images").iterdir():
        save(file, np.ascontiguousarray(np.rot90(np.asarray(Image.open(file)))), 6)
    with pytest.raises(
        InputError, match=r"00000_00\.png: 48 x 40 pixels, .* 40 x 48 \(its EXIF orientation 6, .*upright"
    ):
        read(dataset)


FORMS = {
    "palette": Image.fromarray(COLOURS).quantize(16),
    "grey": Image.fromarray(OPACITY),
    "bits": Image.fromarray(OPACITY > 127),
    "grey and alpha": Image.fromarray(np.dstack([OPACITY, OPACITY.T.reshape(32, 48)]), "LA"),
    "alpha": Image.fromarray(np.dstack([COLOURS, OPACITY])),
}


@pytest.mark.parametrize("form", [*FORMS, "palette with a transparent colour", "a transparent colour"])
def test_png_files_look_as_pillow_shows_them(tmp_path, form):
    file = tmp_path / "a.png"
    if form == "a transparent colour":
        Image.fromarray(COLOURS).save(file, transparency=tuple(int(c) for c in COLOURS[0, 0]))
    elif form not in FORMS:
        FORMS["palette"].save(file, transparency=FORMS["palette"].getpixel((0, 0)))
    else:
        FORMS[form].save(file)
    with Image.open(file) as image:
        expected = np.asarray(image.convert("RGBA")).astype(float)
        has_alpha = "A" in image.mode or "transparency" in image.info
    alpha = expected[..., 3:] / 255
    assert read_header(file).alpha == has_alpha
    np.testing.assert_allclose(read_rgb8(file, 0.5), expected[..., :3] * alpha + 127.5 * (1 - alpha), atol=0.51)


def test_the_other_forms_of_jpeg_and_png(tmp_path):
    Image.fromarray(COLOURS).convert("CMYK").save(tmp_path / "cmyk.jpg", quality=100, subsampling=0)
    with Image.open(tmp_path / "cmyk.jpg") as image:
        assert np.abs(read_rgb8(tmp_path / "cmyk.jpg").astype(int) - np.asarray(image.convert("RGB"))).max() <= 3
    for name, pixels in (("grey", OPACITY), ("colours", COLOURS), ("alpha", np.dstack([COLOURS, OPACITY]))):
        cv2.imwrite(str(tmp_path / f"{name}8.png"), pixels)
        cv2.imwrite(str(tmp_path / f"{name}16.png"), pixels.astype(np.uint16) * 257)
        np.testing.assert_array_equal(read_rgb8(tmp_path / f"{name}8.png"), read_rgb8(tmp_path / f"{name}16.png"))
        np.testing.assert_array_equal(read_grey8(tmp_path / f"{name}8.png"), read_grey8(tmp_path / f"{name}16.png"))
    Image.fromarray(OPACITY).save(tmp_path / "key.png", transparency=3)
    with pytest.raises(InputError, match=r"key\.png: its transparent grey level is not read"):
        read_rgb8(tmp_path / "key.png")


def test_a_matte_that_was_cut_out_of_the_picture_is_its_opacity(tmp_path):
    cv2.imwrite(str(tmp_path / "cut.png"), np.dstack([COLOURS, OPACITY]))
    np.testing.assert_array_equal(read_grey8(tmp_path / "cut.png"), OPACITY)
    white = np.full_like(OPACITY, 255)
    cv2.imwrite(str(tmp_path / "grey.png"), np.dstack([OPACITY, OPACITY, OPACITY, white]))
    np.testing.assert_array_equal(read_grey8(tmp_path / "grey.png"), OPACITY)


# Mattes that say nothing.


def set_mattes(folder: Path, value: int, kind: str, pattern: str = "*") -> None:
    for file in (folder / "images").glob(f"{pattern}.png"):
        image = cv2.imread(str(file))
        matte = np.full(image.shape[:2], value, np.uint8)
        if kind == "alpha":
            cv2.imwrite(str(file), np.dstack([image, matte]))
        else:
            cv2.imwrite(str(folder / "fg_masks" / file.name), matte)
    if kind == "alpha":
        for split in ("train", "val", "test"):
            index = folder / f"transforms_{split}.json"
            content = json.loads(index.read_text())
            for entry in content["frames"]:
                del entry["fg_mask_path"]
            index.write_text(json.dumps(content))


@pytest.mark.sample(3)
@pytest.mark.parametrize("kind", ["alpha", "files"])
@pytest.mark.parametrize("value", [255, 254, 200, 128])
def test_mattes_that_are_foreground_everywhere_count_as_none(dataset, kind, value):
    set_mattes(dataset, value, kind)
    found = check_capture(read(dataset))
    assert all(frame.mask is None for frame in found.frames)
    name = r"images/00000_00\.png" if kind == "alpha" else r"fg_masks/00000_00\.png"
    assert [line for line in found.warnings if "foreground everywhere" in line and name.replace("\\", "") in line]
    (line,) = (line for line in found.warnings if "frames have no matte" in line)
    assert line.endswith("remedy: export mattes and name them by fg_mask_path")


def test_one_matte_that_says_something_keeps_all(dataset):
    set_mattes(dataset, 255, "files", "0000[123]*")
    found = read(dataset)
    assert all(frame.mask is not None for frame in found.frames) and found.warnings == ()
