"""Checks of the frames of a dataset: no frame, image or camera twice; files that exist and fit their cameras."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import NamedTuple

from carigs.capture.camera import Camera
from carigs.capture.camera_table import CameraTable
from carigs.capture.frame import Frame
from carigs.errors import InputError, collecting
from carigs.head import HeadModel, HeadParameters
from carigs.readers.images import read_header

READERS = 8
"""Threads that read headers: on a network disk, each waits a millisecond for a file."""
BATCH = 256
"""Frames that a thread takes at once."""


class ListedFrame(NamedTuple):
    """A frame and where it is listed."""

    frame: Frame
    file: Path
    where: str
    """Position in the file."""


def sound_frames(
    folder: Path,
    listed: Sequence[ListedFrame],
    table: CameraTable,
    model: HeadModel | None,
    errors: list[InputError] | None = None,
) -> list[Frame]:
    """Check the frames of a dataset.

    Args:
        folder: The dataset.
        listed: Its frames.
        table: Its cameras.
        model: The head model; None: head parameters are not read.
        errors: Receives the errors; None to raise the first.

    Returns:
        Frames without an error. A frame that states no matte has that of its image's alpha channel, if there is one.

    Raises:
        InputError: If a file is missing or broken or does not fit the others, or something is listed twice.
    """
    known, usual, single = _Known(), _usual_poses(listed, table), []
    for entry in listed:
        with collecting(errors):
            known.add(entry, folder)
            pose, (most, share) = table.poses[entry.frame.calibration], usual[entry.frame.camera, entry.frame.sequence]
            if pose != most and share > 0.5:
                if pose in table.impossible:  # its error is known
                    continue
                problem = f"camera {entry.frame.camera} stands elsewhere than in the other frames of its sequence"
                raise InputError(problem, file=entry.file, field=f"{entry.where}.transform_matrix")
            single.append(entry.frame)
    frames = sound_images(folder, single, table.cameras, errors)
    if model is None:
        return frames
    heads = set()
    for name in dict.fromkeys(frame.parameters for frame in frames):
        with collecting(errors):
            HeadParameters.load(folder / name, model)
            heads.add(name)
    return [frame for frame in frames if frame.parameters in heads]


def sound_images(
    folder: Path, frames: Sequence[Frame], cameras: Sequence[Camera], errors: list[InputError] | None = None
) -> list[Frame]:
    """Compare the sizes of images and mattes with the cameras.

    Args:
        folder: What paths are relative to.
        frames: The frames.
        cameras: Their cameras, by `Frame.calibration`.
        errors: Receives the errors; None to raise the first.

    Returns:
        Frames without an error. A frame that states no matte has that of its image's alpha channel, if there is one.

    Raises:
        InputError: If a file is missing or broken, or of another size than its camera.
    """
    sound = []
    with ThreadPoolExecutor(READERS) as pool:
        batches = [frames[i : i + BATCH] for i in range(0, len(frames), BATCH)]
        checked = pool.map(lambda batch: _check_batch(folder, cameras, batch), batches)
        for found in chain.from_iterable(checked):
            with collecting(errors):
                if isinstance(found, InputError):
                    raise found
                sound.append(found)
    return sound


class _Known:
    """What earlier frames have used up."""

    def __init__(self) -> None:
        self._frames: set[tuple[int, int]] = set()
        self._images: dict[str, str] = {}
        self._cameras: dict[tuple[int, int], int] = {}
        self._heads: dict[int, tuple[str, str]] = {}

    def add(self, entry: ListedFrame, folder: Path) -> None:
        frame = entry.frame
        if (frame.timestep, frame.camera) in self._frames:
            problem = f"timestep and camera appear twice: {frame.name}"
            raise InputError(problem, file=entry.file, field=f"{entry.where}.camera_index")
        other = self._images.setdefault(os.path.normpath(frame.image), frame.name)
        if other != frame.name:
            problem = f"is the image of two frames, {other} and {frame.name}"
            raise InputError(problem, file=folder / frame.image, field="file_path")
        twin = self._cameras.setdefault((frame.timestep, frame.calibration), frame.camera)
        if twin != frame.camera:  # two cameras cannot stand in one place
            problem = f"cameras {twin} and {frame.camera} are the same camera: equal transform_matrix and intrinsics"
            raise InputError(problem, file=entry.file, field=f"{entry.where}.camera_index")
        parameters, sequence = self._heads.setdefault(frame.timestep, (frame.parameters, frame.sequence))
        if parameters != frame.parameters:
            problem = f"timestep {frame.timestep} has two parameter files"
            raise InputError(problem, file=folder / frame.parameters, field="flame_param_path")
        if sequence != frame.sequence:
            problem = f"timestep {frame.timestep} belongs to two sequences, {sequence} and {frame.sequence}"
            raise InputError(problem, file=entry.file, field=f"{entry.where}.sequence")
        self._frames.add((frame.timestep, frame.camera))


def _usual_poses(listed: Sequence[ListedFrame], table: CameraTable) -> dict[tuple[int, str], tuple[int, float]]:
    """The most frequent pose of each camera in each sequence, and its share of the frames.

    A camera whose poses all differ is moved by hand; one that leaves its place in few frames is a mistake.
    """
    poses: dict[tuple[int, str], Counter[int]] = {}
    for frame, _, _ in listed:
        poses.setdefault((frame.camera, frame.sequence), Counter())[table.poses[frame.calibration]] += 1
    usual = {}
    for key, counts in poses.items():
        pose, count = counts.most_common(1)[0]
        usual[key] = pose, count / counts.total()
    return usual


def _check_batch(folder: Path, cameras: Sequence[Camera], frames: Sequence[Frame]) -> list[Frame | InputError]:
    results: list[Frame | InputError] = []
    for frame in frames:
        try:
            results.append(_check_images(folder, cameras[frame.calibration], frame))
        except InputError as error:
            results.append(error)
    return results


def _check_images(folder: Path, camera: Camera, frame: Frame) -> Frame:
    """Compare the sizes of image and matte with the camera, and find the matte."""
    for name in (frame.image, frame.mask):
        if name is not None:
            header = read_header(folder / name)
            if (header.width, header.height) != (camera.width, camera.height):
                problem = f"{header.width} x {header.height} pixels, its camera has {camera.width} x {camera.height}"
                raise InputError(problem, file=folder / name)
            if frame.mask is None and header.alpha:
                return replace(frame, mask=frame.image)
    return frame
