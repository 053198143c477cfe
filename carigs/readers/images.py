"""Reader of PNG and JPEG images that checks them before they are decoded.

OpenCV allocates what a header claims, and returns pictures of truncated files, partly grey or black, with a warning at
most. Here the size is limited first, and files whose end is missing or whose checksums are wrong are refused.
"""

from __future__ import annotations

import os
import re
import zlib
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Shaped

from carigs.errors import InputError
from carigs.readers.limits import MAX_IMAGE_BYTES, MAX_IMAGE_PIXELS, max_unpacked_bytes, read_bytes, regular_file_size

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
JPEG_SIGNATURE = b"\xff\xd8\xff"
PNG_END = b"IEND\xaeB`\x82"
JPEG_END = b"\xff\xd9"
HEADER_BYTES = 1 << 12
PNG_CHANNELS = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}
"""Of the decoded picture, by PNG's colour type; a palette holds three."""
END_BYTES = 1 << 12
"""Where the end mark is searched for: some programs append data to images."""
MAX_METADATA_BYTES, MAX_SEGMENTS = 16 << 20, 10_000
"""Of a JPEG before its size, and segments that they make."""
MAX_SCANS = 100
"""Of a JPEG: a progressive one has about ten. Each of them, however short, is a pass over all pixels."""
_START_OF_SCAN = b"\xff\xda"
_SEGMENT = re.compile(rb"\xff+([^\xff])(..)(?:.(..)(..))?", re.DOTALL)
"""Of a JPEG: marker, length, and the height and width of a frame header."""
_FRAME_HEADERS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Markers of JPEG's frame headers, which hold the size: start of frame 0 to 15 without DHT, JPG and DAC."""


class ImageHeader(NamedTuple):
    """What the header of an image says."""

    width: int
    """In pixels, as stored: an orientation in JPEG's metadata is not applied."""
    height: int
    alpha: bool
    """Whether the pixels have an opacity."""


def read_pixels(file: str | Path, mode: int = cv2.IMREAD_UNCHANGED) -> Shaped[np.ndarray, "h w *channels"]:
    """Decode an image.

    Args:
        file: PNG or JPEG file.
        mode: OpenCV's flags for the number of channels and bits.

    Returns:
        The pixels in OpenCV's order of channels (blue first).

    Raises:
        InputError: If the file is missing, is neither PNG nor JPEG, exceeds a limit, or is damaged.
    """
    content = read_bytes(file, MAX_IMAGE_BYTES, "image")
    width, height = _size(content, file)
    if width * height > MAX_IMAGE_PIXELS:
        raise InputError(f"{width} x {height} pixels; at most {MAX_IMAGE_PIXELS} are decoded", file=file)
    unpacked = width * height * _bytes_per_pixel(content)
    if unpacked > max_unpacked_bytes(len(content)):
        raise InputError(f"{len(content)} bytes that would become {unpacked}: no picture is as regular", file=file)
    _check_end(content, file)
    if content.startswith(JPEG_SIGNATURE) and (scans := content.count(_START_OF_SCAN)) > MAX_SCANS:
        raise InputError(f"{scans} scans; at most {MAX_SCANS} are decoded", file=file)
    try:
        pixels = cv2.imdecode(np.frombuffer(content, np.uint8), mode)
    except cv2.error as error:
        raise InputError(f"not a readable image ({error.err})", file=file) from error
    if pixels is None:
        raise InputError("not a readable image", file=file)
    return pixels


def read_header(file: str | Path) -> ImageHeader:
    """Read the header of an image and look for its end, without decoding it.

    Args:
        file: PNG or JPEG file.

    Returns:
        The header.

    Raises:
        InputError: If the file is missing, is neither PNG nor JPEG, or is cut off.
    """
    size = regular_file_size(file, "image")
    try:
        with Path(file).open("rb", buffering=0) as stream:
            content = stream.read(HEADER_BYTES)
            try:
                width, height = _size(content, file)
            except InputError:  # long metadata stand before the size
                content += stream.read(min(size, MAX_METADATA_BYTES))
                width, height = _size(content, file)
            stream.seek(-min(size, END_BYTES), os.SEEK_END)
            end = stream.read(END_BYTES)
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", file=file) from error
    is_png = content.startswith(PNG_SIGNATURE)
    if (PNG_END if is_png else JPEG_END) not in end:
        _check_end(read_bytes(file, MAX_IMAGE_BYTES, "image"), file)
    return ImageHeader(width, height, alpha=is_png and content[25:26] in (b"\x04", b"\x06"))  # PNG's colour types


def _size(content: bytes, file: str | Path) -> tuple[int, int]:
    """Width and height from the header."""
    if content.startswith(PNG_SIGNATURE):
        if len(content) < 26 or content[12:16] != b"IHDR":
            raise InputError("not a readable image (the PNG header is cut off)", file=file)
        return int.from_bytes(content[16:20], "big"), int.from_bytes(content[20:24], "big")
    if content.startswith(JPEG_SIGNATURE):
        position = 2
        for _ in range(MAX_SEGMENTS):
            segment = _SEGMENT.match(content, position, MAX_METADATA_BYTES)
            if segment is None:
                break
            marker, length, height, width = (int.from_bytes(number or b"", "big") for number in segment.groups())
            if marker in _FRAME_HEADERS:
                return width, height
            if length < 2:  # it counts its own two bytes
                break
            position = segment.start(2) + length
        raise InputError("not a readable image (the JPEG header is cut off)", file=file)
    raise InputError("not a PNG or JPEG image", file=file)


def _bytes_per_pixel(content: bytes) -> int:
    """Of the decoded picture; for JPEG three."""
    if not content.startswith(PNG_SIGNATURE):
        return 3
    depth, colour_type = content[24:26]
    return PNG_CHANNELS.get(colour_type, 4) * max(depth // 8, 1)


def _check_end(content: bytes, file: str | Path) -> None:
    """Refuse truncated files and, for PNG, wrong checksums."""
    if content.startswith(JPEG_SIGNATURE):
        if JPEG_END not in content[-END_BYTES:]:
            raise InputError("not a readable image (the end of the JPEG is missing)", file=file)
        return
    view, position = memoryview(content), len(PNG_SIGNATURE)
    while position + 12 <= len(content):
        length = int.from_bytes(view[position : position + 4], "big")
        name, end = bytes(view[position + 4 : position + 8]), position + 12 + length
        if end > len(content):
            break
        if zlib.crc32(view[position + 4 : end - 4]) != int.from_bytes(view[end - 4 : end], "big"):
            raise InputError(f"not a readable image (wrong checksum of {name!r} at byte {position})", file=file)
        if name == b"IEND":
            return
        position = end
    raise InputError("not a readable image (the end of the PNG is missing)", file=file)
