"""The arrays of a page, unpacked as `page.data.js` says, for tests."""

from __future__ import annotations

import zlib

import numpy as np


def unpacked(layouts: list[dict], content: bytes) -> dict[str, np.ndarray]:
    """Tables of numbers by name."""
    rest, arrays = np.frombuffer(zlib.decompress(content), np.uint8), {}
    for layout in layouts:
        size = layout["rows"], layout["columns"], layout["planes"]
        own, rest = rest[: np.prod(size)], rest[np.prod(size) :]
        planes = own.reshape(size[1], size[2], size[0]).astype(np.int64)
        bits = sum(planes[:, p] << 8 * p for p in range(size[2])).T
        if layout["exact"]:
            arrays[layout["name"]] = bits.astype(np.uint32).view(np.float32)
            continue
        numbers = np.where(bits % 2 == 1, -(bits // 2) - 1, bits // 2) if layout["signed"] else bits
        arrays[layout["name"]] = (np.cumsum(numbers, axis=0) if layout["delta"] else numbers) * layout["step"]
    assert not len(rest)
    return arrays
