"""Frames of a folder of photographs."""

import numpy as np
import pytest
from PIL import Image

from carigs.errors import InputError
from carigs.footage import Selection, read_footage
from carigs.footage.photographs import each_photograph


def photograph(file, image, orientation=1, focal_length=None):
    exif = Image.Exif()
    exif[0x0112] = orientation
    if focal_length:
        exif[0x8769] = {0xA405: focal_length}
    Image.fromarray(image).save(file, exif=exif, quality=100, subsampling=0)


def test_names_are_ordered_as_people_count(tmp_path):
    for number in (1, 2, 10):
        Image.fromarray(np.full((20, 30, 3), 10 * number, np.uint8)).save(tmp_path / f"image_{number}.png")
    (tmp_path / ".DS_Store").write_bytes(b"")
    (tmp_path / "notes.txt").write_text("left out")
    footage = read_footage(tmp_path)
    assert [int(frame.image[0, 0, 0]) for frame in footage] == [10, 20, 100]
    assert footage.fps is None and footage.focal_length is None


@pytest.mark.parametrize("orientation", range(1, 9))
def test_orientations_are_those_that_pillow_applies(tmp_path, orientation):
    image = np.zeros((24, 32, 3), np.uint8)
    image[:12, :16], image[12:, :16] = 255, (250, 10, 10)
    photograph(tmp_path / "a.jpg", image, orientation)
    from PIL import ImageOps

    expected = np.array(ImageOps.exif_transpose(Image.open(tmp_path / "a.jpg")))
    frame = next(iter(read_footage(tmp_path)))
    assert frame.image.shape == expected.shape and np.abs(frame.image.astype(int) - expected).max() <= 3


def test_the_focal_length_scales_with_the_frames(tmp_path):
    photograph(tmp_path / "a.jpg", np.zeros((300, 400, 3), np.uint8), focal_length=26)
    assert read_footage(tmp_path).focal_length == pytest.approx(26 / 43.27 * 500)
    assert read_footage(tmp_path, Selection(largest_side=200)).focal_length == pytest.approx(26 / 43.27 * 250)


def test_a_folder_that_cannot_be_one_camera_is_refused(tmp_path):
    with pytest.raises(InputError, match="no PNG or JPEG"):
        read_footage(tmp_path)
    for name, size in (("a.png", (20, 30)), ("b.png", (30, 20))):
        Image.fromarray(np.zeros((*size, 3), np.uint8)).save(tmp_path / name)
    with pytest.raises(InputError, match=r"b\.png: 20 x 30 pixels, but a\.png has 30 x 20"):
        read_footage(tmp_path)
    (tmp_path / "c.HEIC").write_bytes(b"")
    with pytest.raises(InputError, match=r"c\.HEIC.*convert"):
        read_footage(tmp_path)


def test_each_photograph_has_its_own_size_and_lens(tmp_path):
    photograph(tmp_path / "a.jpg", np.zeros((300, 400, 3), np.uint8), focal_length=26)
    photograph(tmp_path / "b.jpg", np.full((400, 200, 3), 90, np.uint8))
    wide, tall = each_photograph(tmp_path, Selection(largest_side=200))
    assert (wide.width, wide.height, tall.width, tall.height) == (200, 150, 100, 200)
    assert wide.focal_length == pytest.approx(26 / 43.27 * 250) and tall.focal_length is None
    [frame] = tall
    assert frame.number == 1 and int(frame.image.mean()) == 90
