"""Reader of PNG and JPEG images that checks them before they are decoded.

OpenCV allocates what a header claims, and returns pictures of truncated files, partly grey or black, with a warning at
most. Here the size is limited first, and files whose end is missing or whose checksums are wrong are refused.
"""

from __future__ import annotations

import os
import zlib
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Shaped

from carigs.errors import InputError
from carigs.readers.limits import MAX_IMAGE_BYTES, MAX_IMAGE_PIXELS, read_bytes, regular_file_size

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
JPEG_SIGNATURE = b"\xff\xd8\xff"
PNG_END = b"IEND\xaeB`\x82"
JPEG_END = b"\xff\xd9"
HEADER_BYTES = 1 << 12
END_BYTES = 1 << 12
"""Where the end mark is searched for: some programs append data to images."""
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
    _check_end(content, file)
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
                content += stream.read(min(size, MAX_IMAGE_BYTES))
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
        if len(content) < 24 or content[12:16] != b"IHDR":
            raise InputError("not a readable image (the PNG header is cut off)", file=file)
        return int.from_bytes(content[16:20], "big"), int.from_bytes(content[20:24], "big")
    if content.startswith(JPEG_SIGNATURE):
        position = 2
        while position + 9 <= len(content) and content[position] == 0xFF:
            marker = content[position + 1]
            if marker in _FRAME_HEADERS:
                height, width = content[position + 5 : position + 7], content[position + 7 : position + 9]
                return int.from_bytes(width, "big"), int.from_bytes(height, "big")
            position += 1 if marker == 0xFF else 2 + int.from_bytes(content[position + 2 : position + 4], "big")
        raise InputError("not a readable image (the JPEG header is cut off)", file=file)
    raise InputError("not a PNG or JPEG image", file=file)


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
