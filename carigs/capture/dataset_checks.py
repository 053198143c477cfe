"""Checks of the frames of a dataset: no frame, image or camera twice; head parameters that fit the model."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from carigs.capture.calibration.camera_table import CameraTable
from carigs.capture.frame import Frame
from carigs.capture.image_checks import RESTORE, SoundImages, sound_images
from carigs.errors import InputError, collecting
from carigs.head import HeadModel, HeadParameters

ONCE = "remove one entry"


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
) -> SoundImages:
    """Check the frames of a dataset.

    Args:
        folder: The dataset.
        listed: Its frames.
        table: Its cameras.
        model: The head model; None: head parameters are not read.
        errors: Receives the errors; None to raise the first.

    Returns:
        Frames without an error, with their mattes, and warnings.

    Raises:
        InputError: If a file is missing or broken or does not fit the others, or something is listed twice.
    """
    known, usual, single = _Known(), _usual_poses(listed, table), []
    for entry in listed:
        with collecting(errors, ONCE):
            known.add(entry, folder)
            pose, (most, share) = table.poses[entry.frame.calibration], usual[entry.frame.camera, entry.frame.sequence]
            if pose != most and share > 0.5:
                if pose in table.impossible:  # its error is known
                    continue
                problem = f"camera {entry.frame.camera} stands elsewhere than in the other frames of its sequence"
                remedy = "give the frame the transform_matrix of its camera's other frames"
                raise InputError(problem, file=entry.file, field=f"{entry.where}.transform_matrix", remedy=remedy)
            single.append(entry.frame)
    found = sound_images(folder, single, table.cameras, errors)
    if model is None:
        return found
    heads = set()
    for name in dict.fromkeys(frame.parameters for frame in found.frames):
        with collecting(errors, RESTORE):
            HeadParameters.load(folder / name, model)
            heads.add(name)
    return found._replace(frames=[frame for frame in found.frames if frame.parameters in heads])


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
