"""Recordings of cameras: which files they are, their frames in step, and what cannot be in step."""

import numpy as np
import pytest
from clips import quadrants, write_video
from PIL import Image

import carigs.tracking.sources as sources
from carigs.detection.upright import FEWEST
from carigs.errors import InputError
from carigs.footage import Selection
from carigs.footage.photographs import each_photograph
from carigs.tracking.sources import (
    camera_sources,
    chosen_frames,
    frames_in_step,
    scaled_focal_length,
    set_photographs_upright,
    set_upright,
)


def fading(count):
    """Frames whose brightness tells their number."""
    return [np.full((120, 160, 3), 4 * number, np.uint8) for number in range(count)]


def grey_levels(footage):
    return np.array([int(image.mean()) for image in footage.decode()])


def write_images(folder, images):
    folder.mkdir(parents=True)
    for number, image in enumerate(images):
        Image.fromarray(image).save(folder / f"{number}.png")
    return folder


def test_a_folder_holds_the_recordings_of_cameras_or_the_images_of_one(tmp_path):
    videos = [write_video(tmp_path / f"cam_{n}.avi", quadrants(12), codec="MJPG") for n in (10, 9)]
    assert camera_sources(tmp_path) == videos[::-1]
    assert camera_sources(videos[0]) == [videos[0]]
    images = write_images(tmp_path / "frames" / "0", quadrants(2))
    assert camera_sources(images) == [images] and camera_sources(tmp_path / "frames") == [images]
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="is empty"):
        camera_sources(tmp_path / "empty")
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "a.txt").write_text("nothing to see")
    with pytest.raises(InputError, match=r"notes: holds no images and no videos: a\.txt$"):
        camera_sources(tmp_path / "notes")
    # A name says nothing against a video, and a damaged one is refused by its reader.
    (tmp_path / "notes" / "clip").write_bytes(videos[0].read_bytes())
    assert camera_sources(tmp_path / "notes") == [tmp_path / "notes" / "a.txt", tmp_path / "notes" / "clip"]
    (tmp_path / "damaged").mkdir()
    (tmp_path / "damaged" / "clip.mp4").write_bytes(b"no video")
    assert camera_sources(tmp_path / "damaged") == [tmp_path / "damaged" / "clip.mp4"]
    # Photographs of a format that is not read are no videos: whoever reads them says that they are to be converted.
    (tmp_path / "phone").mkdir()
    (tmp_path / "phone" / "IMG_1.HEIC").touch()
    assert camera_sources(tmp_path / "phone") == [tmp_path / "phone"]


def test_frames_of_other_rates_are_those_of_the_same_moments(tmp_path):
    fast, slow = fading(60), fading(60)[::2]
    sources = [
        write_video(tmp_path / "slow.avi", slow, codec="MJPG", fps=15),
        write_video(tmp_path / "fast.avi", fast, codec="MJPG", fps=30),
    ]
    first, second = frames_in_step(sources, 7.5, 160)
    assert len(first) == len(second) == 15
    np.testing.assert_array_equal(first.times, second.times)
    assert np.abs(grey_levels(first) - grey_levels(second)).max() <= 4
    assert first.numbers == tuple(range(0, 30, 2)) and second.numbers == tuple(range(0, 60, 4))


def test_folders_of_frames_have_the_wanted_rate(tmp_path):
    folders = [write_images(tmp_path / name, quadrants(15)) for name in ("left", "right")]
    for footage in frames_in_step(folders, 10, 80):
        assert footage.width == 80
        np.testing.assert_allclose(footage.times, np.arange(15) / 10)


def test_recordings_of_other_lengths_are_one_line_that_names_both(tmp_path):
    videos = [write_video(tmp_path / f"{n}.avi", fading(n), codec="MJPG", fps=10) for n in (30, 20)]
    with pytest.raises(InputError, match=r"20\.avi: 1\.90 s long, but 30\.avi 2\.90 s; remedy: cut"):
        frames_in_step(videos, 10, 160)
    folders = [write_images(tmp_path / f"f{n}", quadrants(n)) for n in (13, 12)]
    with pytest.raises(InputError, match="f12: "):
        frames_in_step(folders, 10, 160)


def test_a_focal_length_is_that_of_the_frames_as_they_were_recorded(tmp_path):
    video = write_video(tmp_path / "v.avi", quadrants(12), codec="MJPG", fps=10)
    [footage] = frames_in_step([video], 10, 40)
    assert scaled_focal_length(footage, 400) == pytest.approx(100)


@pytest.mark.parametrize(
    ("turns", "degrees", "lies"), [(1, 90, "on the side"), (2, 180, "upside down"), (3, -90, "on")]
)
def test_footage_that_is_not_upright_is_turned_and_says_so(tmp_path, monkeypatch, turns, degrees, lies):
    footage = chosen_frames(write_video(tmp_path / "a.avi", quadrants(20), codec="MJPG", fps=10), 10, 640)
    monkeypatch.setattr(sources, "quarter_turns", lambda images, networks: turns * (len([*images]) >= FEWEST))
    upright = set_upright(footage, None)
    images = list(upright.decode())
    assert images[0].shape[:2] == (upright.height, upright.width)
    np.testing.assert_array_equal(images[3], np.rot90(list(footage.decode())[3], -turns))
    assert f"a.avi: turned by {degrees} degrees, because its faces are {lies}" in upright.warnings[0]
    assert scaled_focal_length(upright, 700) == 700
    monkeypatch.setattr(sources, "quarter_turns", lambda images, networks: 0)
    assert set_upright(footage, None) is footage


def test_photographs_of_one_size_are_turned_together(tmp_path, monkeypatch):
    images = [np.random.default_rng(i).integers(0, 256, (32, 48 if i else 40, 3), np.uint8) for i in range(4)]
    for i, image in enumerate(images):
        Image.fromarray(image).save(tmp_path / f"{i}.png")
    photographs = each_photograph(tmp_path, Selection())
    monkeypatch.setattr(sources, "quarter_turns", lambda images, networks: int(len([*images]) == 3))
    upright = set_photographs_upright(photographs, None)
    assert upright[0] is photographs[0]
    for before, after in zip(photographs[1:], upright[1:], strict=True):
        np.testing.assert_array_equal(next(iter(after.decode())), np.rot90(next(iter(before.decode())), -1))
        assert "turned by 90 degrees, because its faces are on the side" in after.warnings[0]
