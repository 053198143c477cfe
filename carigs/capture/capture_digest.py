"""Digest of the contents of a capture's files."""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path

from carigs.capture.dataset import Capture

TAIL = 4096
"""Bytes. The end of a .png or .npz holds checksums of its contents; that of a .jpg depends on what comes before."""


def capture_digest(capture: Capture) -> str:
    """Digest of the sizes and ends of a capture's images, mattes and parameters, and of its head model.

    Other than `carigs.runs.outside_files.files_digest`, it does not change when files are copied or touched.

    Args:
        capture: The capture.

    Returns:
        Hexadecimal digits.
    """
    files = {capture.head_model}
    for frame in capture.frames:
        files |= {capture.root / name for name in (frame.image, frame.mask, frame.parameters) if name is not None}
    digest = sha256()
    for file in sorted(files):
        digest.update(_end(file))
    return digest.hexdigest()[:32]


def _end(file: Path) -> bytes:
    with file.open("rb") as stream:
        size = stream.seek(0, 2)
        stream.seek(max(0, size - TAIL))
        return size.to_bytes(8, "little") + stream.read()
