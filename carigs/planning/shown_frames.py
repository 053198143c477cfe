"""Frames that the settings of figures name: are they in the capture? Asked before any work starts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from omegaconf import DictConfig

from carigs.capture.calibration.camera_table import CameraTable
from carigs.capture.calibration.keys import TRANSFORMS, CalibrationKeys
from carigs.capture.frame import Frame
from carigs.capture.gaussian_avatars import read_index
from carigs.capture.splits import split_frames
from carigs.capture.thinning import thin_frames
from carigs.errors import InputError, SettingsError
from carigs.readers.file_names import INDEXES
from carigs.toy import scene


def check_shown_frames(config: DictConfig) -> None:
    """Refuse a camera, timestep or sequence that the subject's capture lacks, where the settings name one.

    Args:
        config: Composed settings of a subject.

    Raises:
        SettingsError: `figures.camera` or `figures.timestep` is not in the capture. A capture that cannot be read is
            not checked here: the stage `capture` says what is wrong with it.
        InputError: `capture.split` or `capture.validation_camera` is not in the capture, or nothing is left to train.
    """
    figures, render = config.figures, config.render
    try:
        frames = listed_frames(config.capture)
    except InputError as error:
        if (error.field or "").startswith("capture."):
            raise
        return
    camera, timestep = figures.camera, figures.timestep
    if camera is None and timestep is None:
        return
    from carigs.stages.render import spread_test_frames  # planning a study without named frames imports no stage

    test = spread_test_frames(tuple(frame for frame in frames if frame.split == "test"), render.test_timesteps)
    found = any(camera in (None, frame.camera) and timestep in (None, frame.timestep) for frame in test)
    if not found:
        cameras, timesteps = _ranges({frame.camera for frame in test}), _ranges({frame.timestep for frame in test})
        stated = f"figures.camera={camera}" if camera is not None else ""
        stated += f"{', ' if stated else ''}figures.timestep={timestep}" if timestep is not None else ""
        known = f"there are cameras {cameras} and timesteps {timesteps}"
        raise SettingsError(f"{stated}: the capture has no such test frame; {known}")


def listed_frames(capture: DictConfig) -> tuple[Frame, ...]:
    """The frames that the settings select of a capture, without a look at its images.

    Args:
        capture: Composed section `capture`.

    Returns:
        Frames with their splits, sorted by timestep, then camera.

    Raises:
        InputError: The indexes of the dataset are missing or malformed, or it cannot be split.
    """
    if capture.source == "video":
        raise InputError("its frames are known when it is tracked", file=capture.video)
    folder = Path(capture.folder or "")
    frames = _toy_frames(capture) if capture.source == "toy" else _folder_frames(folder)
    divided, _ = split_frames(frames, capture.split, capture.validation_camera, folder)
    return thin_frames(divided, capture.stride, capture.max_frames)


def _toy_frames(capture: DictConfig) -> list[Frame]:
    """The frames of the toy, as `carigs.toy.write_capture` lists them."""
    sequences = [step.sequence for step in scene.timesteps(capture.toy, np.zeros(300))]
    return [
        Frame(t, c, sequences[t], split, "", None, "", c)
        for t, names in enumerate(scene.split_names(sequences, scene.studio_cameras(capture.toy)))
        for c, split in enumerate(names)
    ]


def _folder_frames(folder: Path) -> list[Frame]:
    table, keys = CameraTable(None), CalibrationKeys(TRANSFORMS)
    files = {split: folder / name for split, name in INDEXES.items()}
    listed = [
        entry
        for split, file in files.items()
        if split == "train" or file.exists()
        for entry in read_index(file, split, table, keys)
    ]
    return sorted((entry.frame for entry in listed), key=lambda frame: (frame.timestep, frame.camera))


def _ranges(numbers: set[int]) -> str:
    """Numbers in words: 0 to 8, or 0, 3, 7."""
    ordered = sorted(numbers)
    if not ordered:
        return "none"
    if len(ordered) > 2 and ordered == [*range(ordered[0], ordered[-1] + 1)]:
        return f"{ordered[0]} to {ordered[-1]}"
    return ", ".join(map(str, ordered[:10])) + (f" and {len(ordered) - 10} more" if len(ordered) > 10 else "")
