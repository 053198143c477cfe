"""Images by timestep and camera: `{camera}/{timestep}.png`, or `{timestep}_{camera}.png`; JPEG as well."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from carigs.capture.camera import Camera
from carigs.capture.capture_json import MAX_NUMBER
from carigs.errors import InputError
from carigs.readers.folders import listed
from carigs.readers.limits import regular_file_size

SUFFIXES = (".png", ".jpg", ".jpeg")
UNREAD = frozenset(
    {
        ".tif",
        ".tiff",
        ".webp",
        ".bmp",
        ".exr",
        ".heic",
        ".heif",
        ".avif",
        ".jxl",
        ".jp2",
        ".gif",
        ".dng",
        ".tga",
        ".ppm",
    }
)
"""Of images in other formats: they are refused, for the frames of a camera would be missing without a word."""
LONGEST_NUMBER = 100
"""Most digits of a timestep."""
_FLAT = re.compile(r"(\d+)_(.+)", re.DOTALL)


class FoundImage(NamedTuple):
    """An image, its place in time and its camera."""

    file: Path
    timestep: int
    camera: str


def stated_timestep(text: str) -> int | None:
    """The timestep that a name states.

    Args:
        text: Part of a name.

    Returns:
        Its number, if it is a whole number that an index can hold.
    """
    is_number = text.isdecimal() and len(text) <= LONGEST_NUMBER  # Python refuses to parse 4300 digits
    return int(text) if is_number and int(text) <= MAX_NUMBER else None


def find_images(folder: Path) -> list[FoundImage]:
    """List the images of a folder.

    Args:
        folder: Images named `{camera}/{timestep}` or `{timestep}_{camera}` with a suffix of `SUFFIXES`.

    Returns:
        The images, sorted by timestep and camera.

    Raises:
        InputError: If there are none, or a name is neither, or an image has another format.
    """
    found = []
    for file in listed(folder, "**/*"):
        if file.suffix.lower() in UNREAD:
            raise InputError(f"{file.suffix} is not read; convert it to PNG or JPEG", file=file)
        if file.suffix.lower() not in SUFFIXES:
            continue
        parts = file.relative_to(folder).with_suffix("").parts
        flat = _FLAT.fullmatch(parts[-1])
        number, camera = (parts[-1], "/".join(parts[:-1])) if len(parts) > 1 else flat.groups() if flat else ("", "")
        timestep = stated_timestep(number)
        if timestep is None:
            problem = "images are called CAMERA/TIMESTEP or TIMESTEP_CAMERA, with a number for the timestep"
            raise InputError(problem, file=file)
        regular_file_size(file, "image")
        found.append(FoundImage(file, timestep, camera))
    if not found:
        raise InputError(f"holds no images ({', '.join(SUFFIXES)})", file=folder)
    return sorted(found, key=lambda image: (image.timestep, image.camera))


def image_name(image: FoundImage, folder: Path) -> str:
    """Name of an image in a calibration.

    Args:
        image: The image.
        folder: The folder of the images.

    Returns:
        Its path in the folder without suffix.
    """
    return image.file.relative_to(folder).with_suffix("").as_posix()


def camera_of(image: FoundImage, folder: Path, cameras: Mapping[str, Camera]) -> Camera:
    """The calibrated camera of an image.

    Args:
        image: The image.
        folder: The folder of the images.
        cameras: Cameras by name: of this very image, of its camera, or of an image of its camera at one timestep.

    Returns:
        The camera.

    Raises:
        InputError: If no name fits, or several do.
    """
    for name in (image_name(image, folder), image.camera):
        if name in cameras:
            return cameras[name]
    found = [name for name in cameras if _is_of(name, image.camera)]
    if len(found) != 1:
        problem = f"{len(found)} cameras of the calibration fit camera {image.camera}"
        raise InputError(f"{problem}; known: {', '.join(list(cameras)[:8])}", file=image.file)
    return cameras[found[0]]


def _is_of(name: str, camera: str) -> bool:
    """Whether an image's name belongs to a camera: `cam03/00000` or `00000_cam03` to `cam03`."""
    folder, _, stem = name.rpartition("/")
    flat = _FLAT.fullmatch(stem)
    return (folder == camera and stem.isdecimal()) or bool(not folder and flat and flat[2] == camera)
