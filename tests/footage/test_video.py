"""Frames of videos: what recorders do to them, and what strangers may."""

import os
import struct

import cv2
import numpy as np
import pytest
from clips import index_first, quadrants, turned, with_colours, with_long_times, write_video
from PIL import Image

import carigs.footage.video as video
from carigs.errors import InputError, SettingsError
from carigs.footage import Selection, read_footage
from carigs.footage.stored import stored


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    return write_video(tmp_path_factory.mktemp("clip") / "clip.mp4", quadrants())


def corner(image):
    """The grey square below right."""
    height, width = image.shape[:2]
    return image[3 * height // 4, 3 * width // 4].astype(float)


@pytest.mark.parametrize(
    ("suffix", "codec"), [("mp4", "mp4v"), ("mov", "MJPG"), ("mkv", "FFV1"), ("webm", "VP90"), ("avi", "MJPG")]
)
def test_frames_have_the_colours_and_times_that_were_written(tmp_path, suffix, codec):
    footage = read_footage(write_video(tmp_path / f"clip.{suffix}", quadrants(), codec))
    frames = list(footage)
    assert [frame.number for frame in frames] == list(range(12)) == list(footage.numbers)
    assert [frame.time for frame in frames] == pytest.approx(np.arange(12) / 25, abs=1e-3)
    assert footage.fps == pytest.approx(25) and footage.duration == pytest.approx(11 / 25) and not footage.warnings
    for number, frame in enumerate(frames):
        assert frame.image.shape == (120, 160, 3) and frame.image.dtype == np.uint8
        assert corner(frame.image) == pytest.approx([250 - 12 * number] * 3, abs=6)
        assert frame.image[20, 20] == pytest.approx([255, 0, 0], abs=30)


@pytest.fixture(scope="module")
def first(clip):
    """The first frame as it is stored."""
    return next(iter(read_footage(clip))).image


@pytest.mark.parametrize(("turns", "long_times"), [(0, False), (1, False), (2, False), (3, False), (3, True)])
def test_a_phone_that_was_turned_gives_upright_frames(tmp_path, clip, first, turns, long_times):
    """Also where the header has times of 64 bits before the matrix."""
    file, content = tmp_path / "phone.mp4", turned(clip.read_bytes(), turns)
    file.write_bytes(with_long_times(content) if long_times else content)
    assert (next(iter(read_footage(file))).image == np.rot90(first, -turns)).all()


def test_a_selection_takes_the_frames_that_it_names(clip):
    footage = read_footage(clip, Selection(every=2, start=0.08, end=0.36, largest_side=80))
    frames = list(footage)
    assert [frame.number for frame in frames] == [2, 4, 6, 8]
    assert [corner(frame.image)[0] for frame in frames] == pytest.approx([226, 202, 178, 154], abs=6)
    assert (footage.width, footage.height) == (80, 60) == frames[0].image.shape[1::-1]
    assert read_footage(clip, Selection(max_frames=3)).numbers == (0, 5, 11)
    assert read_footage(clip, Selection(largest_side=4000)).width == 160


def test_scaling_down_keeps_the_mean(tmp_path):
    noise = np.random.default_rng(0).integers(0, 256, (96, 128, 1), np.uint8).repeat(3, axis=2)
    file = write_video(tmp_path / "noise.avi", [noise] * 10, "FFV1")
    small = next(iter(read_footage(file, Selection(largest_side=16)))).image
    means = cv2.resize(noise, (16, 12), interpolation=cv2.INTER_AREA)
    assert np.abs(small.astype(int) - means).max() <= 6  # the rounding of a codec with halved chroma


@pytest.mark.parametrize("values", [{"every": 0}, {"start": -1.0}, {"start": 2.0, "end": 1.0}, {"largest_side": 0}])
def test_a_selection_without_meaning_is_refused(values):
    with pytest.raises(SettingsError):
        Selection(**values)


def test_odd_sizes_are_kept(tmp_path):
    images = [np.full((61, 83, 3), 20 * i, np.uint8) for i in range(10)]
    assert next(iter(read_footage(write_video(tmp_path / "odd.avi", images, "FFV1")))).image.shape == (60, 82, 3)


def test_a_file_that_was_cut_off_gives_the_frames_before_the_cut(tmp_path):
    rng = np.random.default_rng(0)
    images = [rng.integers(0, 256, (64, 64, 3), np.uint8) for _ in range(40)]
    content = index_first(write_video(tmp_path / "clip.mp4", images).read_bytes())
    file = tmp_path / "cut.mp4"
    file.write_bytes(content[: len(content) * 6 // 10])
    footage = read_footage(file)
    assert 9 < len(footage) < 30 and len(list(footage)) == len(footage)
    assert f"of 40 frames can be decoded: the file is cut off or damaged; the first {len(footage)} are" in str(
        footage.warnings
    )
    file.write_bytes(content[: len(content) // 8])
    with pytest.raises(InputError, match=r"of 40 frames can be decoded; at least 10 are needed"):
        read_footage(file)


def test_a_variable_rate_keeps_its_times_and_is_said(tmp_path):
    images = [Image.fromarray(np.full((60, 80, 3), 20 * i, np.uint8)) for i in range(12)]
    durations = [40] * 12
    durations[4] = 200
    images[0].save(tmp_path / "a.gif", save_all=True, append_images=images[1:], duration=durations)
    footage = read_footage(tmp_path / "a.gif")
    assert np.diff(footage.times) == pytest.approx(np.array(durations[:-1]) / 1000)
    assert "variable frame rate: 40 to 200 ms" in str(footage.warnings)


@pytest.mark.parametrize(("transfer", "name", "white"), [(18, "HLG", 0.75), (16, "PQ", 0.58)])
def test_high_dynamic_range_is_converted_and_said(tmp_path, monkeypatch, transfer, name, white):
    grey = [np.full((64, 64, 3), round(255 * white), np.uint8)] * 12
    file = write_video(tmp_path / "hdr.mp4", grey)
    file.write_bytes(with_colours(file.read_bytes(), 9, transfer, 9))
    if int(cv2.__version__.split(".")[0]) >= video.HDR_SINCE:
        footage = read_footage(file)
        assert f"high dynamic range ({name})" in str(footage.warnings)
        assert next(iter(footage)).image.min() > 225  # white paper, which was coded as 0.58 or 0.75
    monkeypatch.setattr(video, "HDR_SINCE", 1000)
    with pytest.raises(InputError, match=rf"high dynamic range \({name}\)"):
        read_footage(file)


def test_what_is_no_video_is_refused_in_a_line(tmp_path, clip):
    content = clip.read_bytes()
    cases = {
        "list.mp4": (b"#EXTM3U\n#EXTINF:10,\n" + str(clip).encode(), "a playlist"),
        "concat.mp4": (b"ffconcat version 1.0\nfile " + str(clip).encode(), "a playlist"),
        "text.mp4": (b"hello", "not a video"),
        "empty.mp4": (b"", "not a video"),
        "no_index.mp4": (content[: content.index(b"moov") - 4], "the index .moov. is missing"),
        "half_index.mp4": (content[: content.index(b"stbl")], "the index .moov. is missing"),
        "sound.m4a": (content.replace(b"vide", b"soun"), "sound alone"),
        "noise.mkv": (b"\x1a\x45\xdf\xa3" + os.urandom(5000), "cannot open"),
        "noise.avi": (b"RIFF\0\0\0\0AVI " + bytes(5000), "cannot open"),
    }
    for name, (bad, message) in cases.items():
        (tmp_path / name).write_bytes(bad)
        with pytest.raises(InputError, match=message):
            read_footage(tmp_path / name)


def test_addresses_pipes_and_devices_are_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe.mp4")
    for source in (
        "http://127.0.0.1:9/a.mp4",
        "concat:a.mp4|b.mp4",
        tmp_path / "pipe.mp4",
        "/dev/null",
        tmp_path / "no",
    ):
        with pytest.raises(InputError):
            read_footage(source)


def test_the_decoder_opens_no_playlist_even_if_asked(tmp_path, clip):
    # `read_video_header` refuses them first; the process has limits of its own.
    (tmp_path / "list.m3u8").write_text(f"#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n{clip}\n#EXT-X-ENDLIST\n")
    with (
        pytest.raises(InputError, match="cannot open"),
        video._decoding(tmp_path / "list.m3u8", video.VideoHeader("mp4"), None, None),
    ):
        pass


def test_a_huge_size_in_the_header_allocates_nothing(tmp_path):
    # Version, then height and width in the sample entry. A codec without a header of its own believes them.
    small = write_video(tmp_path / "small.mov", quadrants(), "MJPG")
    content = bytearray(small.read_bytes())
    size = content.index(b"jpeg", content.index(b"stsd")) + 28
    assert content[size : size + 4] == struct.pack(">2H", 160, 120)
    content[size : size + 4] = struct.pack(">2H", 60000, 60000)
    small.write_bytes(content)
    try:
        frames = [frame.image.shape for frame in read_footage(small)]
    except InputError as error:
        assert "pixels" in str(error) or "decode" in str(error)
    else:
        assert set(frames) == {(120, 160, 3)}


def test_frames_beyond_the_limit_are_refused(clip, monkeypatch):
    monkeypatch.setattr(video, "MAX_FRAME_PIXELS", 1000)
    with pytest.raises(InputError, match="more than 1000 pixels"):
        read_footage(clip)


def test_frames_can_be_left_early_and_read_again(clip, first):
    footage = read_footage(clip)
    for _ in range(2):
        assert (next(iter(footage)).image == first).all()


def test_a_frame_rate_takes_every_nth_frame(clip):
    assert read_footage(clip, Selection(frame_rate=12.5)).numbers == (0, 2, 4, 6, 8, 10)
    assert read_footage(clip, Selection(frame_rate=12)).numbers == (0, 3, 6, 9)  # not more often than that
    assert len(read_footage(clip, Selection(frame_rate=100))) == 12


def test_stored_frames_are_those_that_were_decoded(tmp_path, clip):
    footage = read_footage(clip, Selection(every=3))
    expected, found = list(footage), stored(footage, footage.decode(), tmp_path / "frames")
    two = found.at([1, 3])
    for frame, same in zip(expected, found, strict=True):
        assert (frame.number, frame.time) == (same.number, same.time)
        np.testing.assert_array_equal(frame.image, same.image)
    assert [frame.number for frame in two] == [3, 9]
    np.testing.assert_array_equal([frame.image for frame in two], [expected[i].image for i in (1, 3)])
