"""Photographs in a folder: frames of one moment, or of a video that another program has decoded."""

from __future__ import annotations

from collections.abc import Iterator
from math import hypot
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from carigs.capture.images import read_rgb8
from carigs.errors import InputError
from carigs.footage.footage import Footage
from carigs.footage.selection import Selection, scaled_down
from carigs.readers.exif import focal_length_35mm
from carigs.readers.folders import listed, natural_order
from carigs.readers.images import ImageHeader, read_header
from carigs.readers.limits import MAX_IMAGE_PIXELS

SUFFIXES = (".png", ".jpg", ".jpeg")
OTHER_SUFFIXES = (".heic", ".heif", ".avif", ".webp", ".tif", ".tiff", ".bmp", ".dng", ".jxl")
"""Images that are not read: to leave some of a folder's pictures out would be a surprise."""
DIAGONAL_35MM = 43.27
"""Of a frame of 36 mm x 24 mm, in millimetres: what "35 mm equivalent" refers to (CIPA DCG-001)."""


def read_photographs(folder: Path, selection: Selection | None = None) -> Footage:
    """Find the photographs of a folder.

    Args:
        folder: PNG and JPEG images of one size, in the natural order of their names.
        selection: Images that are used, and their size; `start` and `end` count images. None for all as they are.

    Returns:
        The footage. Orientations of the metadata are applied.

    Raises:
        InputError: If the folder has no images, images of several sizes, or of formats that are not read; or if one is
            damaged.
    """
    folder, selection = Path(folder), selection or Selection()
    files = image_files(folder)
    headers = [read_header(file) for file in files]
    width, height = sizes = _upright_size(headers[0])
    for file, header in zip(files, headers, strict=True):
        if (other := _upright_size(header)) != sizes:
            problem = f"{other[0]} x {other[1]} pixels, but {files[0].name} has {width} x {height}"
            raise InputError(problem, file=file, remedy="images of one camera have one size; split the folder")
    if width * height > MAX_IMAGE_PIXELS:
        raise InputError(f"{width} x {height} pixels; at most {MAX_IMAGE_PIXELS} are decoded", file=files[0])
    times = np.arange(len(files), dtype=np.float64)
    numbers = selection.frames(times)
    if not numbers:
        raise InputError(f"no images between start and end: there are {len(files)}", file=folder)
    size = selection.size(width, height)
    millimetres = next(filter(None, map(focal_length_35mm, files)), None)
    return Footage(
        folder,
        *size,
        tuple(numbers),
        times[numbers],
        fps=None,
        duration=None,
        focal_length=millimetres and millimetres / DIAGONAL_35MM * hypot(*size),
        decode=lambda: _images([(files[n], headers[n]) for n in numbers], size),
    )


def image_files(folder: Path) -> list[Path]:
    """Find the images of a folder.

    Args:
        folder: The folder.

    Returns:
        PNG and JPEG files in the natural order of their names.

    Raises:
        InputError: If there are none, or images of other formats.
    """
    files = sorted((path for path in listed(folder) if path.is_file()), key=natural_order)
    others = [path for path in files if path.suffix.lower() in OTHER_SUFFIXES]
    if others:
        raise InputError("images are read as PNG and JPEG; convert those of other formats", file=others[0])
    files = [path for path in files if path.suffix.lower() in SUFFIXES]
    if not files:
        raise InputError("no PNG or JPEG images", file=folder)
    return files


def each_photograph(folder: Path, selection: Selection | None = None) -> list[Footage]:
    """Find the photographs of a folder, which may come from several cameras.

    Args:
        folder: PNG and JPEG images of any sizes.
        selection: Largest side; None for the images as they are.

    Returns:
        Footage of one frame for each, in the natural order of their names. Its number is the position in the folder;
        all have the same time.

    Raises:
        InputError: If the folder has no images or images of formats that are not read, or if one is damaged.
    """
    selection = selection or Selection()
    return [photograph(file, number, selection) for number, file in enumerate(image_files(Path(folder)))]


def photograph(file: Path, number: int, selection: Selection) -> Footage:
    """Find one photograph.

    Args:
        file: PNG or JPEG image.
        number: Its number as a frame.
        selection: Largest side.

    Returns:
        Footage of one frame. Orientations of the metadata are applied.

    Raises:
        InputError: If it is damaged or too large.
    """
    header = read_header(file)
    width, height = _upright_size(header)
    if width * height > MAX_IMAGE_PIXELS:
        raise InputError(f"{width} x {height} pixels; at most {MAX_IMAGE_PIXELS} are decoded", file=file)
    size, millimetres = selection.size(width, height), focal_length_35mm(file)
    return Footage(
        file,
        *size,
        (number,),
        np.zeros(1),
        fps=None,
        duration=None,
        focal_length=millimetres and millimetres / DIAGONAL_35MM * hypot(*size),
        decode=lambda: _images([(file, header)], size),
    )


def _upright_size(header: ImageHeader) -> tuple[int, int]:
    """Width and height after the orientation is applied."""
    size = header.width, header.height
    return size if header.orientation < 5 else size[::-1]


def _images(found: list[tuple[Path, ImageHeader]], size: tuple[int, int]) -> Iterator[UInt8[np.ndarray, "h w 3"]]:
    for file, header in found:
        yield scaled_down(upright(read_rgb8(file), header.orientation), size)


def upright(image: UInt8[np.ndarray, "h w 3"], orientation: int) -> UInt8[np.ndarray, "h2 w2 3"]:
    """Turn and mirror an image as its metadata say.

    Args:
        image: As it is stored.
        orientation: From 1 to 8 (EXIF 2.32, tag 0x0112).

    Returns:
        The upright image.
    """
    # 5 and 7 are mirrored after a quarter turn; 2 and 4 are mirrored alone.
    turn = {
        3: cv2.ROTATE_180,
        4: cv2.ROTATE_180,
        5: cv2.ROTATE_90_CLOCKWISE,
        6: cv2.ROTATE_90_CLOCKWISE,
        7: cv2.ROTATE_90_COUNTERCLOCKWISE,
        8: cv2.ROTATE_90_COUNTERCLOCKWISE,
    }
    if orientation in turn:
        image = cv2.rotate(image, turn[orientation])
    return cv2.flip(image, 1) if orientation in (2, 4, 5, 7) else image
