"""Small video files, and changes of their headers that recorders and strangers make."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np

PARENTS = (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stsd")
"""Boxes around the sample entry of an MP4."""


def write_video(file: Path, images: Iterable[np.ndarray], codec: str = "mp4v", fps: float = 25.0) -> Path:
    images = list(images)
    height, width = images[0].shape[:2]
    video = cv2.VideoWriter(str(file), cv2.CAP_FFMPEG, cv2.VideoWriter_fourcc(*codec), fps, (width, height))
    assert video.isOpened()
    for image in images:
        video.write(np.ascontiguousarray(image[..., ::-1]))
    video.release()
    return file


def quadrants(count: int = 12, width: int = 160, height: int = 120) -> list[np.ndarray]:
    """Red above left, green above right, blue below; a grey square below right grows darker with time."""
    images = []
    for number in range(count):
        image = np.zeros((height, width, 3), np.uint8)
        image[: height // 2, : width // 2] = 255, 0, 0
        image[: height // 2, width // 2 :] = 0, 255, 0
        image[height // 2 :] = 0, 0, 255
        image[-height // 2 :, -width // 2 :] = 250 - 12 * number
        images.append(image)
    return images


def turned(content: bytes, quarter_turns: int) -> bytes:
    """The same MP4 with the matrix of a phone that was held otherwise."""
    a, b = ((1, 0), (0, 1), (-1, 0), (0, -1))[quarter_turns]
    start = content.index(b"tkhd") + 4 + 40
    return content[:start] + struct.pack(">5i", a << 16, b << 16, 0, -b << 16, a << 16) + content[start + 20 :]


def with_long_times(content: bytes) -> bytes:
    """The same MP4 with times of 64 bits in the header of its track. The index must follow the pictures."""
    start = content.index(b"tkhd") + 4
    made, changed, number, _, duration = struct.unpack(">5I", content[start + 4 : start + 24])
    header = b"\1" + content[start + 1 : start + 4] + struct.pack(">QQIIQ", made, changed, number, 0, duration)
    longer = bytearray(content[:start] + header + content[start + 24 :])
    for name in (b"moov", b"trak", b"tkhd"):
        place = content.index(name, content.index(b"moov")) - 4
        size = int.from_bytes(content[place : place + 4], "big")
        longer[place : place + 4] = struct.pack(">I", size + len(longer) - len(content))
    return bytes(longer)


def with_colours(content: bytes, primaries: int, transfer: int, matrix: int) -> bytes:
    """The same MP4 with a box `colr` in its sample entry (ITU-T H.273). The index must follow the pictures."""
    colours = b"colrnclx" + struct.pack(">HHHB", primaries, transfer, matrix, 0)
    box = struct.pack(">I", len(colours) + 4) + colours
    entry = content.index(b"mp4v", content.index(b"stsd")) - 4
    changed = bytearray(content)
    end = entry + int.from_bytes(content[entry : entry + 4], "big")
    changed[end:end] = box
    for start in [entry, *(content.index(name, content.index(b"moov")) - 4 for name in PARENTS)]:
        size = int.from_bytes(content[start : start + 4], "big")
        changed[start : start + 4] = struct.pack(">I", size + len(box))
    return bytes(changed)


def index_first(content: bytes) -> bytes:
    """The same MP4 with its index before the pictures, as streaming services write it."""
    moov, mdat = content.index(b"moov") - 4, content.index(b"mdat") - 4
    index, pictures = bytearray(content[moov:]), content[mdat:moov]
    table = index.index(b"stco") + 4
    for i in range(int.from_bytes(index[table + 4 : table + 8], "big")):
        place = table + 8 + 4 * i
        offset = int.from_bytes(index[place : place + 4], "big")
        index[place : place + 4] = struct.pack(">I", offset + len(index))
    return content[:mdat] + bytes(index) + pictures
