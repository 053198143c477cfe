"""Small files that would take a lot of time or memory are refused, or read, at once."""

from __future__ import annotations

import io
import time
import zipfile
import zlib
from collections.abc import Callable

import cv2
import numpy as np
import pytest

from carigs.errors import InputError
from carigs.readers.images import read_header, read_pixels
from carigs.readers.json_files import read_json
from carigs.readers.npz import read_npy, read_npz

SECONDS = 2.0
JPEG = cv2.imencode(".jpg", np.zeros((24, 32), np.uint8))[1].tobytes()
PNG = cv2.imencode(".png", np.zeros((24, 32), np.uint8))[1].tobytes()


def npz(content: bytes, method: int) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as archive:
        archive.writestr("v.npy", content)
    return stream.getvalue()


def npy(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def scans() -> bytes:
    """A progressive JPEG whose last scan, of a few bytes, is repeated: each is a pass over all pixels."""
    content = cv2.imencode(".jpg", np.zeros((64, 64), np.uint8), [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])[1].tobytes()
    scan = content[content.rindex(b"\xff\xda") : -2]
    return content[:-2] + 1000 * scan + content[-2:]


def chunk(name: bytes, content: bytes) -> bytes:
    return len(content).to_bytes(4, "big") + name + content + zlib.crc32(name + content).to_bytes(4, "big")


def zeros_as_pixels() -> bytes:
    """Some of a gigabyte of pixels, which OpenCV allocates."""
    header = chunk(b"IHDR", (11_000).to_bytes(4, "big") * 2 + b"\x10\x06\0\0\0")
    return PNG[:8] + header + chunk(b"IDAT", zlib.compress(bytes(10**7))) + chunk(b"IEND", b"")


def no_entries(shape: tuple[int, ...]) -> bytes:
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode()


def many_fields() -> bytes:
    return b"{" + b"".join(b'"%d":0,' % i for i in range(50_000)) + b'"49999":0}'


REFUSED: dict[str, tuple[Callable, bytes | Callable[[], bytes], str]] = {
    "packed by bzip2": (read_npz, npz(npy(np.zeros(3)), zipfile.ZIP_BZIP2), "v: compressed in another way"),
    "packed by lzma": (read_npz, npz(npy(np.zeros(3)), zipfile.ZIP_LZMA), "v: compressed in another way"),
    "2^40 rows of nothing": (read_npy, no_entries((2**40, 0)), "impossible shape"),
    "nothing of 2^62 columns": (read_npy, no_entries((0, 2**62)), "impossible shape"),
    "the last of many fields twice": (read_json, many_fields, "two fields are called 49999"),
    "many scans": (read_pixels, scans, "scans; at most 100"),
    "zeros as pixels": (read_pixels, zeros_as_pixels, "bytes that would become 968000000"),
    "segments without a length": (
        read_header, JPEG[:2] + 1_000_000 * b"\xff\xe0\0\0" + JPEG[2:], "the JPEG header is cut off",
    ),
    "10^6 segments": (read_header, JPEG[:2] + 1_000_000 * b"\xff\xe0\0\2" + JPEG[2:], "the JPEG header is cut off"),
    "metadata without an end": (
        read_header, JPEG[:2] + 300 * (b"\xff\xe0\xff\xff" + bytes(65_533)) + JPEG[2:], "JPEG header is cut off",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_it_is_refused_at_once(name, tmp_path):
    read, content, says = REFUSED[name]
    (tmp_path / "a").write_bytes(content() if callable(content) else content)
    start = time.process_time()
    with pytest.raises(InputError, match=says):
        read(tmp_path / "a")
    assert time.process_time() - start < SECONDS


def test_fill_bytes_of_a_jpeg_are_skipped(tmp_path):
    """The standard allows any number of 0xff before a marker."""
    (tmp_path / "a").write_bytes(JPEG[:2] + b"\xff" * (10 << 20) + JPEG[2:])
    start = time.process_time()
    assert read_header(tmp_path / "a")[:2] == (32, 24)
    assert time.process_time() - start < SECONDS


def test_what_repeats_a_lot_is_read_if_it_is_small_or_has_other_data_beside_it(tmp_path):
    np.savez_compressed(tmp_path / "zeros.npz", offset=np.zeros((1000, 5143, 3), np.float32))
    assert read_npz(tmp_path / "zeros.npz")["offset"].shape == (1000, 5143, 3)
    (tmp_path / "a.png").write_bytes(cv2.imencode(".png", np.zeros((4000, 4000, 3), np.uint8))[1].tobytes())
    assert not read_pixels(tmp_path / "a.png").any()


@pytest.mark.parametrize("progressive", [0, 1])
def test_what_a_camera_appends_to_a_jpeg_is_no_part_of_it(progressive, tmp_path):
    """A motion photo: the video after the picture holds every pair of bytes, those of markers too."""
    pixels = np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8)
    picture = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_PROGRESSIVE, progressive])[1].tobytes()
    video = np.random.default_rng(1).integers(0, 256, 10_000_000, np.uint8).tobytes()
    for name, content in {"plain": picture, "motion": picture + video, "previewed": picture + JPEG}.items():
        (tmp_path / f"{name}.jpg").write_bytes(content)
    expected = read_pixels(tmp_path / "plain.jpg")
    for name in ("motion", "previewed"):
        assert read_header(tmp_path / f"{name}.jpg")[:2] == (64, 48)
        np.testing.assert_array_equal(read_pixels(tmp_path / f"{name}.jpg"), expected)
    (tmp_path / "cut.jpg").write_bytes(picture[:-100])
    with pytest.raises(InputError, match="the end of the JPEG is missing"):
        read_header(tmp_path / "cut.jpg")
