"""Images with false sizes and broken markers."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping

import cv2
import numpy as np

from stress.hostile_cases.case import Case


def false_sizes(sound: Mapping[str, bytes]) -> Iterator[Case]:
    """PNG files whose header claims a size that the file does not have.

    Args:
        sound: Content of a sound file of each reader.

    Yields:
        The cases.
    """
    for reader in ("png", "size of png"):
        for width, height in ((60_000, 60_000), (2**31 - 1, 2**31 - 1), (2**32 - 1, 1), (0, 7), (20_000, 20_000)):
            content = bytearray(sound["png"])
            content[16:24] = width.to_bytes(4, "big") + height.to_bytes(4, "big")
            content[29:33] = zlib.crc32(bytes(content[12:29])).to_bytes(4, "big")
            yield Case(f"claims {width} x {height}", reader, bytes(content), must_fail=reader == "png")


def expensive_images(sound: Mapping[str, bytes]) -> Iterator[Case]:
    """Small images that take much time or memory.

    Args:
        sound: Content of a sound file of each reader.

    Yields:
        The cases.
    """
    jpg, png = sound["jpg"], sound["png"]
    for reader in ("jpg", "size of jpg"):
        yield Case("20 MB of fill bytes", reader, jpg[:2] + b"\xff" * (20 << 20) + jpg[2:])
        yield Case("segments without a length", reader, jpg[:2] + b"\xff\xe0\0\0" * 10**6 + jpg[2:], must_fail=True)
        yield Case("10^6 short segments", reader, jpg[:2] + b"\xff\xe0\0\2" * 10**6 + jpg[2:], must_fail=True)
    progressive = cv2.imencode(".jpg", np.zeros((4096, 4096), np.uint8), [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])[1].tobytes()
    scan = progressive[progressive.rindex(b"\xff\xda") : -2]
    yield Case("10^4 scans", "jpg", progressive[:-2] + scan * 10**4 + progressive[-2:], must_fail=True)
    chunks = {
        "text": _chunk(b"tEXt", b"k\0v") * 10**5,
        "packed text": _chunk(b"zTXt", b"k\0\0" + zlib.compress(bytes(10**8))),
    }
    for name, chunk in chunks.items():
        yield Case(name, "png", png[:33] + chunk + png[33:])
    side = 7_000
    header = _chunk(b"IHDR", side.to_bytes(4, "big") * 2 + b"\x10\x06\0\0\0")
    packer = zlib.compressobj(6)
    data = b"".join(packer.compress(bytes(8 * side + 1)) for _ in range(side)) + packer.flush()
    content = png[:8] + header + _chunk(b"IDAT", data) + _chunk(b"IEND", b"")
    yield Case("400 MB of zeros as pixels", "png", content, must_fail=True)


def _chunk(name: bytes, content: bytes) -> bytes:
    return len(content).to_bytes(4, "big") + name + content + zlib.crc32(name + content).to_bytes(4, "big")


def broken_markers(sound: Mapping[str, bytes]) -> Iterator[Case]:
    """JPEG files with bytes of markers at wrong places.

    Args:
        sound: Content of a sound file of each reader.

    Yields:
        The cases.
    """
    for place in range(2, 300, 12):
        content = bytearray(sound["jpg"])
        content[place : place + 4] = b"\xff\xff\xff\xff"
        yield Case(f"0xff at {place}", "jpg", bytes(content))
