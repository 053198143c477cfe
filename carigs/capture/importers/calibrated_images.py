"""A capture from images, a calibration and a tracked head."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from carigs.capture.camera import Camera
from carigs.capture.dataset import Capture
from carigs.capture.frame import Frame
from carigs.capture.importers.images import SUFFIXES, FoundImage, camera_of
from carigs.capture.splits import split_single_sequence
from carigs.errors import InputError


def build_capture(
    images: list[FoundImage],
    folders: tuple[Path, Path | None],
    cameras: Mapping[str, Camera],
    timesteps: set[int],
    head_model: Path,
    background: float,
) -> Capture:
    """Put a capture together.

    Args:
        images: The images.
        folders: Their folder, and that of the mattes, which have the same names; None if there are no mattes.
        cameras: Cameras by name, see `camera_of`.
        timesteps: Timesteps at which the head is known.
        head_model: File of the head model.
        background: Grey value that the images were composited on.

    Returns:
        The capture of the images whose head is known, divided as a single sequence. Cameras are numbered in the order
        of their names.

    Raises:
        InputError: If no image is left, or an image has no camera.
    """
    used = [image for image in images if image.timestep in timesteps]
    if len({image.timestep for image in used}) < 2:
        few = ", ".join(map(str, sorted(timesteps)[:8]))
        problem = f"at least two timesteps need both images and a tracked head; the head is known at {few}"
        raise InputError(problem, file=folders[0])
    numbers = {name: i for i, name in enumerate(sorted({image.camera for image in used}))}
    frames, calibrations = [], []
    for image in used:
        mask = _matte(image, *folders)
        calibrations.append(camera_of(image, folders[0], cameras))
        frames.append(
            Frame(
                timestep=image.timestep,
                camera=numbers[image.camera],
                sequence="",
                split="train",
                image=str(image.file.resolve()),
                mask=None if mask is None else str(mask.resolve()),
                parameters="",
                calibration=len(frames),
            )
        )
    return Capture(folders[0], head_model, split_single_sequence(frames), tuple(calibrations), background)


def _matte(image: FoundImage, images: Path, mattes: Path | None) -> Path | None:
    if mattes is None:
        return None
    name = mattes / image.file.relative_to(images)
    found = [file for suffix in SUFFIXES if (file := name.with_suffix(suffix)).is_file()]
    if not found:
        raise InputError("no such matte; an image without one has no matte file only if no image has", file=name)
    return found[0]
