"""Images with false sizes and broken markers."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping

from evaluation.stress.hostile_cases.case import Case


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
