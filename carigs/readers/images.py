"""Reader of PNG, JPEG and AVIF images that checks them before they are decoded.

OpenCV allocates what a header claims, and returns pictures of truncated files, partly grey or black, with a warning at
most. Here the size is limited first, and files whose end is missing or whose checksums are wrong are refused.

Pixels are those that are stored: an orientation in the metadata turns neither colours nor sizes, for cameras are
calibrated to stored pixels. `ImageHeader.orientation` says that there is one.
"""

from __future__ import annotations

import io
import os
import re
import zlib
from pathlib import Path
from typing import Literal, NamedTuple

import cv2
import numpy as np
from jaxtyping import Shaped, UInt8

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
_EXIF = b"Exif\0\0"
"""Start of the segment of a JPEG that holds TIFF's tags."""
_ORIENTATION = 0x0112
"""TIFF's tag: 1 for pixels that are stored upright."""
_FRAME_HEADERS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Markers of JPEG's frame headers, which hold the size: start of frame 0 to 15 without DHT, JPG and DAC."""


class ImageHeader(NamedTuple):
    """What the header of an image says."""

    width: int
    """In pixels, as stored."""
    height: int
    alpha: bool = False
    """Whether the pixels have an opacity: an alpha channel, or a transparent colour."""
    orientation: int = 1
    """Of the metadata (EXIF), from 1 to 8; from 5 on, width and height would be exchanged. It is not applied."""


def read_pixels(file: str | Path) -> Shaped[np.ndarray, "h w *channels"]:
    """Decode an image as it is stored.

    Args:
        file: PNG or JPEG file.

    Returns:
        The pixels in OpenCV's order of channels (blue first): grey, three, or four with the opacity, of 8 or 16 bits.

    Raises:
        InputError: If the file is missing, is neither PNG nor JPEG, exceeds a limit, or is damaged.
    """
    return parse_pixels(read_bytes(file, MAX_IMAGE_BYTES, "image"), file)


def parse_pixels(content: bytes, file: str | Path) -> Shaped[np.ndarray, "h w *channels"]:
    """Decode the bytes of an image as they are stored.

    Args:
        content: The file's bytes.
        file: Its name, for messages.

    Returns:
        As for `read_pixels`.

    Raises:
        InputError: As for `read_pixels`.
    """
    width, height, *_ = _header(content, file)
    if width * height > MAX_IMAGE_PIXELS:
        raise InputError(f"{width} x {height} pixels; at most {MAX_IMAGE_PIXELS} are decoded", file=file)
    unpacked = width * height * _bytes_per_pixel(content)
    if unpacked > max_unpacked_bytes(len(content)):
        raise InputError(f"{len(content)} bytes that would become {unpacked}: no picture is as regular", file=file)
    content = content[: _end(content, file)]
    if content.startswith(JPEG_SIGNATURE) and (scans := content.count(_START_OF_SCAN)) > MAX_SCANS:
        raise InputError(f"{scans} scans; at most {MAX_SCANS} are decoded", file=file)
    try:
        pixels = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)  # without orientation
    except cv2.error as error:
        raise InputError(f"not a readable image ({error.err})", file=file) from error
    if pixels is None:
        raise InputError("not a readable image", file=file)
    return pixels


def parse_avif(content: bytes, file: str | Path) -> UInt8[np.ndarray, "h w 3"]:
    """Decode an AVIF image; an opacity is left out.

    Args:
        content: The file's bytes.
        file: Its name, for messages.

    Returns:
        RGB values from 0 to 255.

    Raises:
        InputError: If Pillow was built without AVIF, or if the image is of another format, exceeds a limit, or is
            damaged.
    """
    from PIL import Image, features

    if not features.check("avif"):
        raise InputError("this Pillow reads no AVIF", file=file, remedy="pip install 'pillow>=11.3'")
    try:
        with Image.open(io.BytesIO(content), formats=["AVIF"]) as image:
            width, height = image.size
            if width * height > min(MAX_IMAGE_PIXELS, max_unpacked_bytes(len(content)) // 3):
                raise InputError(f"{width} x {height} pixels are more than are decoded", file=file)
            return np.asarray(image.convert("RGB"))
    except InputError:
        raise
    except Exception as error:  # of the format's library and of Pillow: many types
        raise InputError(f"not a readable AVIF image ({str(error)[:80] or type(error).__name__})", file=file) from error


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
                header = _header(content, file)
            except InputError:  # long metadata stand before the size
                content += stream.read(min(size, MAX_METADATA_BYTES))
                header = _header(content, file)
            stream.seek(-min(size, END_BYTES), os.SEEK_END)
            end = stream.read(END_BYTES)
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", file=file) from error
    is_png = content.startswith(PNG_SIGNATURE)
    if (PNG_END if is_png else JPEG_END) not in end:
        _end(read_bytes(file, MAX_IMAGE_BYTES, "image"), file)
    return header


def _header(content: bytes, file: str | Path) -> ImageHeader:
    """What stands before the pixels."""
    if content.startswith(PNG_SIGNATURE):
        return _png_header(content, file)
    if content.startswith(JPEG_SIGNATURE):
        position, orientation = 2, 1
        for _ in range(MAX_SEGMENTS):
            segment = _SEGMENT.match(content, position, MAX_METADATA_BYTES)
            if segment is None:
                break
            marker, length, height, width = (int.from_bytes(number or b"", "big") for number in segment.groups())
            if marker in _FRAME_HEADERS:
                return ImageHeader(width, height, orientation=orientation)
            tags = segment.start(2) + 2
            if marker == 0xE1 and content.startswith(_EXIF, tags):
                orientation = _orientation(content[tags + len(_EXIF) : segment.start(2) + length])
            if length < 2:  # it counts its own two bytes
                break
            position = segment.start(2) + length
        raise InputError("not a readable image (the JPEG header is cut off)", file=file)
    raise InputError("not a PNG or JPEG image", file=file)


def _png_header(content: bytes, file: str | Path) -> ImageHeader:
    """Size and colour type stand first; a transparent colour and TIFF's tags may follow before the pixels (IDAT)."""
    if len(content) < 26 or content[12:16] != b"IHDR":
        raise InputError("not a readable image (the PNG header is cut off)", file=file)
    width, height, colour_type = *(int.from_bytes(content[i : i + 4], "big") for i in (16, 20)), content[25]
    alpha, orientation, position = colour_type in (4, 6), 1, len(PNG_SIGNATURE)
    for _ in range(MAX_SEGMENTS):
        length, name = int.from_bytes(content[position : position + 4], "big"), content[position + 4 : position + 8]
        if name in (b"IDAT", b"IEND"):
            return ImageHeader(width, height, alpha, orientation)
        if name == b"tRNS":
            if colour_type == 0:
                raise InputError("its transparent grey level is not read; export it with an alpha channel", file=file)
            alpha = True
        elif name == b"eXIf":
            orientation = _orientation(content[position + 8 : position + 8 + length])
        position += 12 + length
        if position + 8 > len(content):
            break
    raise InputError("not a readable image (the PNG header is cut off)", file=file)


def _orientation(tags: bytes) -> int:
    """The orientation in TIFF's tags; 1 if they do not say, or are broken: no pixel depends on them."""
    order: Literal["little", "big"] = "little" if tags.startswith(b"II") else "big"

    def number(position: int, size: int) -> int:
        return int.from_bytes(tags[position : position + size], order)

    first = number(4, 4)
    for i in range(number(first, 2)):
        entry = first + 2 + 12 * i
        if entry + 12 > len(tags):
            break
        if number(entry, 2) == _ORIENTATION:
            found = number(entry + 8, 2)
            return found if 1 <= found <= 8 else 1
    return 1


def _bytes_per_pixel(content: bytes) -> int:
    """Of the decoded picture; for JPEG three."""
    if not content.startswith(PNG_SIGNATURE):
        return 3
    depth, colour_type = content[24:26]
    return PNG_CHANNELS.get(colour_type, 4) * max(depth // 8, 1)


def _first_scan(content: bytes) -> int:
    """Where the coded pixels of a JPEG begin, after the segments before them; -1 if they are missing."""
    position = 2
    for _ in range(MAX_SEGMENTS):
        segment = _SEGMENT.match(content, position)
        if segment is None:
            break
        marker, length = (int.from_bytes(number, "big") for number in segment.groups()[:2])
        if marker == _START_OF_SCAN[1]:
            return segment.start()
        if length < 2:
            break
        position = segment.start(2) + length
    return content.find(_START_OF_SCAN)


def _end(content: bytes, file: str | Path) -> int:
    """Where an image ends; cameras append videos and previews. Truncated files and wrong checksums are refused."""
    if content.startswith(JPEG_SIGNATURE):
        # In the coded pixels no byte 0xFF is followed by that of a marker.
        end = content.find(JPEG_END, max(_first_scan(content), 0))
        if end < 0:
            raise InputError("not a readable image (the end of the JPEG is missing)", file=file)
        return end + len(JPEG_END)
    view, position = memoryview(content), len(PNG_SIGNATURE)
    while position + 12 <= len(content):
        length = int.from_bytes(view[position : position + 4], "big")
        name, end = bytes(view[position + 4 : position + 8]), position + 12 + length
        if end > len(content):
            break
        if zlib.crc32(view[position + 4 : end - 4]) != int.from_bytes(view[end - 4 : end], "big"):
            raise InputError(f"not a readable image (wrong checksum of {name!r} at byte {position})", file=file)
        if name == b"IEND":
            return end
        position = end
    raise InputError("not a readable image (the end of the PNG is missing)", file=file)
