"""Files from outside: what is checked before a reader opens one, and limits that hold for all kinds."""

from __future__ import annotations

import stat
from pathlib import Path

from carigs.errors import InputError

MAX_ARRAY_BYTES = 4 << 30
"""Largest sum of the arrays of one file, in bytes."""
MAX_TEXT_BYTES = 512 << 20
"""Largest text file (JSON, OBJ), in bytes."""
MAX_IMAGE_BYTES = 512 << 20
"""Largest image file, in bytes."""
MAX_IMAGE_PIXELS = 1 << 27
"""Most pixels of an image: 11 585 x 11 585."""

SMALL_BYTES, MAX_EXPANSION = 256 << 20, 200


def max_unpacked_bytes(size: int, expansion: int = MAX_EXPANSION) -> int:
    """Most bytes that a compressed file may unpack to, or an array that is stored without its zeros.

    Deflate shrinks zeros to 1 / 1030. Files that are no attack hold other data beside them, or are small when unpacked.

    Args:
        size: Of the file or of the stored array, in bytes.
        expansion: Bytes for each of its bytes.

    Returns:
        `SMALL_BYTES`, and `expansion` for each byte.
    """
    return SMALL_BYTES + expansion * size


def read_bytes(file: str | Path, limit: int, kind: str = "file") -> bytes:
    """Read a regular file of limited size.

    Args:
        file: The file; a symbolic link to a regular file is followed.
        limit: Largest size in bytes.
        kind: What the file is, for the message "no such {kind}".

    Returns:
        Its content.

    Raises:
        InputError: If the file is missing, too large, or cannot be read, or if it is no regular file. A named pipe, for
            example, would block until somebody writes to it.
    """
    size = regular_file_size(file, kind)
    if size > limit:
        raise InputError(f"{size} bytes; at most {limit} are read", file=file)
    try:
        with Path(file).open("rb") as stream:
            return stream.read(size)
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", file=file) from error


def regular_file_size(file: str | Path, kind: str = "file") -> int:
    """Size of a regular file.

    Args:
        file: The file; a symbolic link to a regular file is followed.
        kind: What the file is, for the message "no such {kind}".

    Returns:
        Bytes.

    Raises:
        InputError: If there is no such file, or it is a folder, a named pipe, a socket or a device.
    """
    try:
        status = Path(file).stat()
    except (FileNotFoundError, NotADirectoryError) as error:
        raise InputError(f"no such {kind}", file=file) from error
    except (OSError, ValueError) as error:  # ValueError: a NUL character in the path
        raise InputError(f"cannot be read ({getattr(error, 'strerror', None) or error})", file=file) from error
    if not stat.S_ISREG(status.st_mode):
        raise InputError("not a regular file", file=file)
    return status.st_size
