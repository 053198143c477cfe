"""Images and mattes of frames: do they have the sizes of their cameras, and do mattes say anything?"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import NamedTuple

from carigs.capture.camera import Camera
from carigs.capture.frame import Frame
from carigs.capture.images import read_frame_matte8
from carigs.errors import InputError, collecting
from carigs.readers.images import ImageHeader, read_header

READERS = 8
"""Threads that read headers: on a network disk, each waits a millisecond for a file."""
BATCH = 256
"""Frames that a thread takes at once."""
OPAQUE = 128
"""Value of a matte from which a pixel is foreground."""
RESTORE = "restore the file or export it again, or remove its frames from transforms_*.json"


class SoundImages(NamedTuple):
    """What `sound_images` finds."""

    frames: list[Frame]
    """Frames without an error. A frame that states no matte has that of its image's alpha channel, if there is one; no
    frame has a matte if all mattes are foreground everywhere."""
    warnings: tuple[str, ...]
    """What is likely to be wrong, one line each."""


def sound_images(
    folder: Path, frames: Sequence[Frame], cameras: Sequence[Camera], errors: list[InputError] | None = None
) -> SoundImages:
    """Compare the sizes of images and mattes with the cameras, and find the mattes.

    Args:
        folder: What paths are relative to.
        frames: The frames.
        cameras: Their cameras, by `Frame.calibration`.
        errors: Receives the errors; None to raise the first.

    Returns:
        The frames without an error, and warnings.

    Raises:
        InputError: If a file is missing or broken, or of another size than its camera.
    """
    sound, turned = [], []
    with ThreadPoolExecutor(READERS) as pool:
        batches = [frames[i : i + BATCH] for i in range(0, len(frames), BATCH)]
        checked = pool.map(lambda batch: _check_batch(folder, cameras, batch), batches)
        for found in chain.from_iterable(checked):
            with collecting(errors, RESTORE):
                if isinstance(found, InputError):
                    raise found
                frame, orientations = found
                turned += orientations.items()
                sound.append(frame)
    warnings = []
    if turned:
        (name, orientation), others = turned[0], f"; {len(turned)} files" if len(turned) > 1 else ""
        problem = f"its EXIF orientation {orientation} is not applied: pixels are used as stored{others}"
        warnings.append(f"{folder / name}: {problem}; if they look turned, store them upright")
    silent = _silent_mattes(folder, sound)
    if silent:
        problem = "is foreground everywhere, as the mattes of all frames: they say nothing and are left out"
        warnings.append(f"{folder / silent}: {problem}; write opacities from 0 (background) to 255 (foreground)")
        sound = [replace(frame, mask=None) for frame in sound]
    return SoundImages(sound, tuple(warnings))


def other_size(header: ImageHeader, camera: Camera, file: Path) -> InputError:
    """The error of an image that has another size than its camera.

    Args:
        header: Header of the image.
        camera: The camera.
        file: The image.

    Returns:
        The error, with the remedy that the two sizes suggest.
    """
    width, height = header.width, header.height
    problem = f"{width} x {height} pixels, its camera has {camera.width} x {camera.height}"
    x, y = width / max(camera.width, 1), height / max(camera.height, 1)
    if header.orientation >= 5 and (height, width) == (camera.width, camera.height):
        problem += f" (its EXIF orientation {header.orientation}, which would turn it, is not applied)"
        remedy = "store the pixels upright, without orientation, or calibrate the stored ones"
    elif abs(x - y) < 0.01 * x:
        remedy = f"the intrinsics belong to images of another resolution: multiply fl_x, fl_y, cx, cy, w, h by {x:.4g}"
    else:
        remedy = "write the size of the images as w and h, and the intrinsics that belong to it"
    return InputError(problem, file=file, remedy=remedy)


def _check_batch(
    folder: Path, cameras: Sequence[Camera], frames: Sequence[Frame]
) -> list[tuple[Frame, dict[str, int]] | InputError]:
    results: list[tuple[Frame, dict[str, int]] | InputError] = []
    for frame in frames:
        try:
            results.append(_check_images(folder, cameras[frame.calibration], frame))
        except InputError as error:
            results.append(error)
    return results


def _check_images(folder: Path, camera: Camera, frame: Frame) -> tuple[Frame, dict[str, int]]:
    """The frame with its matte, and the orientations of its files other than upright, by name."""
    turned = {}
    for name in dict.fromkeys((frame.image, frame.mask)):
        if name is None:
            continue
        header = read_header(folder / name)
        if (header.width, header.height) != (camera.width, camera.height):
            raise other_size(header, camera, folder / name)
        if header.orientation != 1:
            turned[name] = header.orientation
        if frame.mask is None and header.alpha:
            frame = replace(frame, mask=frame.image)
    return frame, turned


def _silent_mattes(folder: Path, frames: Sequence[Frame]) -> str | None:
    """A matte if every matte of all frames is foreground everywhere: such files tell nothing from the background.

    Usually the first matte ends the search.
    """
    masked = [frame for frame in frames if frame.mask is not None]
    for frame in masked:
        try:
            if read_frame_matte8(folder, frame).min() < OPAQUE:
                return None
        except InputError:  # who reads it for its pixels names what is wrong
            return None
    return masked[0].mask if masked else None
