"""Reader of COLMAP's sparse models: cameras and images, as text or binary files."""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from carigs.errors import InputError
from carigs.readers.limits import MAX_TEXT_BYTES, read_bytes
from carigs.readers.text import decode_text, split_lines

MODELS = (
    "SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV", "FOV",
    "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE",
)  # fmt: skip
"""Camera models in the order of their numbers in binary files."""
PARAMETERS = {
    "SIMPLE_PINHOLE": 3, "PINHOLE": 4, "SIMPLE_RADIAL": 4, "RADIAL": 5, "OPENCV": 8, "FULL_OPENCV": 12,
}  # fmt: skip
"""Numbers of the models that are pinholes if what follows focal lengths and principal point, the distortion, is 0."""
ONE_FOCAL_LENGTH = ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")
UNDISTORT = "undistort the images (colmap image_undistorter), and name the model that it writes"
MAX_PIXELS = 1_000_000
"""Largest width and height of a camera."""
POINT_BYTES = 24
"""Of an image point in images.bin: x, y, number of its 3D point."""


class ColmapCamera(NamedTuple):
    """Intrinsics of a camera without distortion, in pixels with pixel centres at +0.5."""

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int


class ColmapImage(NamedTuple):
    """Pose of an image."""

    name: str
    camera: ColmapCamera
    quaternion: tuple[float, ...]
    """Rotation from world to camera, wxyz."""
    translation: tuple[float, ...]
    """From world to camera, in the unit of the model."""


def read_colmap(folder: str | Path) -> list[ColmapImage]:
    """Read the images of a sparse model; points are ignored.

    Args:
        folder: Folder with cameras.txt and images.txt, or cameras.bin and images.bin.

    Returns:
        The images in the order of the file.

    Raises:
        InputError: If a file is missing or broken, or a camera has lens distortion.
    """
    folder = Path(folder)
    kind = "bin" if (folder / "images.bin").is_file() else "txt"
    files = folder / f"cameras.{kind}", folder / f"images.{kind}"
    contents = [read_bytes(file, MAX_TEXT_BYTES) for file in files]
    parse_cameras, parse_images = (_binary_cameras, _binary_images) if kind == "bin" else (_text_cameras, _text_images)
    if kind == "txt":
        contents = [decode_text(content, file) for content, file in zip(contents, files, strict=True)]
    cameras: dict[int, ColmapCamera] = {}
    try:
        for number, *values in parse_cameras(contents[0]):
            if number in cameras:
                raise InputError("there are two cameras of this number", file=files[0], field=f"camera {number}")
            cameras[number] = _camera(*values, files[0], number)
    except (ValueError, IndexError, struct.error) as error:
        raise InputError(f"not a readable file of COLMAP's cameras ({error})", file=files[0]) from error
    images = []
    try:
        for number, name, camera, pose in parse_images(contents[1]):
            if camera not in cameras:
                raise InputError(f"there is no camera {camera}", file=files[1], field=f"image {number}")
            if len(pose) != 7 or not all(map(math.isfinite, pose)):
                raise InputError("expected seven finite numbers as pose", file=files[1], field=f"image {number}")
            images.append(ColmapImage(name, cameras[camera], pose[:4], pose[4:]))
    except (ValueError, IndexError, struct.error) as error:
        raise InputError(f"not a readable file of COLMAP's images ({error})", file=files[1]) from error
    if not images:
        raise InputError("holds no images", file=files[1])
    return images


def _camera(
    model: str, width: int, height: int, parameters: tuple[float, ...], file: Path, number: int
) -> ColmapCamera:
    if model not in PARAMETERS:
        problem = f"the camera model {model[:40]} has lens distortion, which carigs has no model of"
        raise InputError(problem, file=file, field=f"camera {number}", remedy=UNDISTORT)
    if len(parameters) != PARAMETERS[model]:
        problem = f"{len(parameters)} parameters, expected {PARAMETERS[model]}"
        raise InputError(problem, file=file, field=f"camera {number}")
    if model in ONE_FOCAL_LENGTH:
        parameters = (parameters[0], *parameters)
    (fx, fy, cx, cy), distortion = parameters[:4], parameters[4:]
    if any(distortion):
        shown = " ".join(f"{x:g}" for x in distortion)
        problem = f"{model} with {shown} is lens distortion, which carigs has no model of"
        raise InputError(problem, file=file, field=f"camera {number}", remedy=UNDISTORT)
    if not (0 < width <= MAX_PIXELS and 0 < height <= MAX_PIXELS):
        raise InputError(f"{width} x {height} pixels", file=file, field=f"camera {number}")
    return ColmapCamera(fx, fy, cx, cy, width, height)


def _lines(text: str) -> list[str]:
    return [line for line in split_lines(text) if not line.startswith("#")]


def _check_stated_count(text: str, kind: str, count: int) -> None:
    """Compare with the comment in which COLMAP states how many there are: a file that was cut off has fewer."""
    stated = re.search(rf"^# Number of {kind}: ([0-9]{{1,9}})\b", text.replace("\r", "\n"), re.MULTILINE)
    if stated and int(stated[1]) != count:
        raise ValueError(f"{count} {kind}, its comment states {int(stated[1])}")


def _text_cameras(text: str) -> Iterator[tuple]:
    lines = [line for line in _lines(text) if line.strip()]
    for line in lines:
        number, model, width, height, *parameters = line.split()
        yield int(number), model, int(width), int(height), tuple(map(float, parameters))
    _check_stated_count(text, "cameras", len(lines))


def _text_images(text: str) -> Iterator[tuple]:
    """Every second line lists the image's points, three numbers each, and may be empty."""
    lines, count = _lines(text), 0
    for i in range(0, len(lines), 2):
        if not lines[i].strip():
            continue
        number, *pose, camera, name = lines[i].split(maxsplit=9)
        points = lines[i + 1].split() if i + 1 < len(lines) else []
        if len(points) % 3 or (points and not re.fullmatch(r"-?\d+", points[-1])):
            raise ValueError(f"the line after image {number} lists no points; write an empty one there")
        count += 1
        yield int(number), name.strip(), int(camera), tuple(map(float, pose))
    _check_stated_count(text, "images", count)


def _binary_cameras(content: bytes) -> Iterator[tuple]:
    (count,), position = struct.unpack_from("<Q", content), 8
    for _ in range(count):
        number, model, width, height = struct.unpack_from("<IiQQ", content, position)
        name = MODELS[model] if 0 <= model < len(MODELS) else f"number {model}"
        size = PARAMETERS.get(name, 0)  # the file is not read beyond a camera that is refused
        yield number, name, width, height, struct.unpack_from(f"<{size}d", content, position + 24)
        position += 24 + 8 * size
    _check_end(content, position)


def _binary_images(content: bytes) -> Iterator[tuple]:
    (count,), position = struct.unpack_from("<Q", content), 8
    for _ in range(count):
        number, *pose, camera = struct.unpack_from("<I7dI", content, position)
        end = content.index(b"\0", position + 64)
        (points,) = struct.unpack_from("<Q", content, end + 1)
        name, position = content[position + 64 : end].decode("utf-8"), end + 9 + POINT_BYTES * points
        if position > len(content):
            raise ValueError("the end is missing")
        yield number, name, camera, tuple(pose)
    _check_end(content, position)


def _check_end(content: bytes, position: int) -> None:
    if position < len(content):
        raise ValueError(f"{len(content) - position} bytes more than its count claims")
