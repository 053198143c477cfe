"""Images by timestep and camera: `{camera}/{timestep}.png`, or `{timestep}_{camera}.png`; JPEG as well."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from carigs.capture.camera import Camera
from carigs.errors import InputError

SUFFIXES = (".png", ".jpg", ".jpeg")
_FLAT = re.compile(r"(\d+)_(.+)")


class FoundImage(NamedTuple):
    """An image, its place in time and its camera."""

    file: Path
    timestep: int
    camera: str


def find_images(folder: Path) -> list[FoundImage]:
    """List the images of a folder.

    Args:
        folder: Images named `{camera}/{timestep}` or `{timestep}_{camera}` with a suffix of `SUFFIXES`.

    Returns:
        The images, sorted by timestep and camera.

    Raises:
        InputError: If there are none, or a name is neither.
    """
    found = []
    for file in sorted(folder.rglob("*")):
        if file.suffix.lower() not in SUFFIXES:
            continue
        parts = file.relative_to(folder).with_suffix("").parts
        flat = _FLAT.fullmatch(parts[-1])
        if len(parts) == 1 and flat:
            found.append(FoundImage(file, int(flat[1]), flat[2]))
        elif len(parts) > 1 and parts[-1].isdecimal():
            found.append(FoundImage(file, int(parts[-1]), "/".join(parts[:-1])))
        else:
            problem = "images are called CAMERA/TIMESTEP or TIMESTEP_CAMERA, with a number for the timestep"
            raise InputError(problem, file=file)
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
