"""A capture from folders of images and mattes, and cameras by name."""

from __future__ import annotations

import os
from collections.abc import Mapping, Set
from pathlib import Path

from carigs.capture.camera import Camera
from carigs.capture.dataset import Capture
from carigs.capture.frame import Frame
from carigs.capture.image_checks import sound_images
from carigs.capture.importers.images import SUFFIXES, FoundImage, camera_of, find_images
from carigs.capture.splits import split_single_sequence
from carigs.errors import InputError

CALIBRATIONS = ("cameras.json", "sparse/0", "sparse", "colmap")
"""Where a calibration is looked for in the folder."""
IMAGES, MATTES = "images", ("masks", "fg_masks")
FROM_THE_TOP = "opencv: cameras.json and COLMAP models count from the top"


def find_calibration(folder: Path) -> Path | None:
    """Find the calibration of a capture.

    Args:
        folder: The folder.

    Returns:
        cameras.json or the folder of a COLMAP model; None if there is none.
    """
    return next((folder / name for name in CALIBRATIONS if (folder / name).exists()), None)


def read_calibrated_images(
    folder: Path,
    head_model: Path,
    cameras: Mapping[str, Camera],
    *,
    timesteps: Set[int] | None = None,
    background: float = 1.0,
) -> Capture:
    """Index the images of a folder.

    Args:
        folder: Folder with `images/` (see `find_images`), and `masks/` or `fg_masks/` with files of the same names.
            Without mattes, alpha channels of the images count.
        head_model: File of the head model.
        cameras: Cameras by name (`read_cameras`).
        timesteps: Timesteps at which the head is known: images of others are left out. None: all.
        background: Grey value that the images were composited on.

    Returns:
        The capture without files of head parameters, divided as a single sequence. Cameras are numbered in the
        alphabetical order of their names.

    Raises:
        InputError: If images of two timesteps are not left, an image has no camera or another size than its camera, or
            a matte is missing.
    """
    root = folder / IMAGES
    mattes = next((folder / name for name in MATTES if (folder / name).is_dir()), None)
    used = [image for image in find_images(root) if timesteps is None or image.timestep in timesteps]
    if len({image.timestep for image in used}) < 2:
        problem = "holds images of one timestep; at least two are needed"
        if timesteps is not None:
            few = ", ".join(map(str, sorted(timesteps)[:8]))
            problem = f"at least two timesteps need both images and a tracked head; the head is known at {few}"
        raise InputError(problem, file=root)
    numbers = {name: i for i, name in enumerate(sorted({image.camera for image in used}))}
    frames, calibrations = [], []
    for image in used:
        mask = _matte(image, root, mattes)
        calibrations.append(camera_of(image, root, cameras))
        frames.append(
            Frame(
                timestep=image.timestep,
                camera=numbers[image.camera],
                sequence="",
                split="train",
                image=os.path.abspath(image.file),
                mask=None if mask is None else os.path.abspath(mask),
                parameters="",
                calibration=len(frames),
            )
        )
    sound = sound_images(root, frames, calibrations)
    divided = split_single_sequence(sound.frames)
    return Capture(
        root, Path(head_model), divided, tuple(calibrations), background, cy=FROM_THE_TOP, warnings=sound.warnings
    )


def _matte(image: FoundImage, images: Path, mattes: Path | None) -> Path | None:
    if mattes is None:
        return None
    name = mattes / image.file.relative_to(images)
    found = [file for suffix in SUFFIXES if (file := name.with_suffix(suffix)).is_file()]
    if not found:
        raise InputError("no such matte; an image without one has no matte file only if no image has", file=name)
    return found[0]
