"""Splits of a capture into training, validation and test frames.

| rule | test sequence |
|---|---|
| `files` | as transforms_{train,val,test}.json say |
| `released` | the one that GaussianAvatars' released data hold out, drawn from the subject's number |
| a sequence's name | that sequence: `EXP-2` in the paper, `EMO-1` in SurFhead's repository |

The validation frames are those of one camera at the training timesteps.
"""

from __future__ import annotations

import math
import random
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from carigs.capture.frame import Frame
from carigs.errors import InputError

FRONTAL_CAMERA = 8
"""The frontal camera of NeRSemble."""
TRAINED = 0.7
"""Share of the timesteps of a single sequence that are for training, as in VHAP."""
RELEASED_SEQUENCES = ("EMO-1", "EMO-2", "EMO-3", "EMO-4", "EXP-2", "EXP-3", "EXP-4", "EXP-5", "EXP-8", "EXP-9")


def split_frames(
    frames: Sequence[Frame], rule: str, validation_camera: int | None, folder: Path
) -> tuple[tuple[Frame, ...], str]:
    """Divide frames into splits.

    Args:
        frames: Frames with the splits that the files say.
        rule: `files`, `released`, or the name of the test sequence.
        validation_camera: Camera of the validation frames. None: as the files say, or for another rule camera 8, or
            the last camera if there is no camera 8; none if there is only one camera.
        folder: The dataset. For `released`, its name must hold the subject's number.

    Returns:
        The frames in their order, and the rule in words.

    Raises:
        InputError: If there is no such sequence or camera, or if no frame is left for training.
    """
    cameras = sorted({frame.camera for frame in frames})
    if validation_camera is not None and validation_camera not in cameras:
        problem = f"there is no camera {validation_camera}; cameras: {', '.join(map(str, cameras))}"
        raise InputError(problem, file=folder, field="capture.validation_camera")
    if rule == "files":
        if validation_camera is None:
            return tuple(frames), rule
        held_out, sequence, name = {f.timestep for f in frames if f.split == "test"}, "", rule
    else:
        sequence = _find(released_test_sequence(subject_number(folder)) if rule == "released" else rule, frames, folder)
        held_out = {frame.timestep for frame in frames if frame.sequence == sequence}
        name = f"released ({sequence})" if rule == "released" else sequence
        if validation_camera is None and len(cameras) > 1:
            validation_camera = FRONTAL_CAMERA if FRONTAL_CAMERA in cameras else cameras[-1]

    def split(frame: Frame) -> str:
        if frame.timestep in held_out:
            return "test"
        return "val" if frame.camera == validation_camera else "train"

    divided = tuple(replace(frame, split=split(frame)) for frame in frames)
    if not any(frame.split == "train" for frame in divided):
        raise InputError(f"no training frame is left by the split {name}", file=folder, field="capture.split")
    return divided, name if validation_camera is None else f"{name}, validation camera {validation_camera}"


def split_single_sequence(frames: Sequence[Frame]) -> tuple[Frame, ...]:
    """Divide the frames of a single sequence as VHAP does.

    Args:
        frames: The frames.

    Returns:
        The frames with their splits: the last three tenths of the timesteps are `test`; of the others, camera 8, or
        the last camera, is `val`. There is no `val` with one camera, and always a timestep for training.
    """
    timesteps, cameras = sorted({f.timestep for f in frames}), sorted({f.camera for f in frames})
    trained = set(timesteps[: max(1, min(len(timesteps) - 1, math.ceil(TRAINED * len(timesteps))))])
    held_out = FRONTAL_CAMERA if FRONTAL_CAMERA in cameras else cameras[-1]

    def split(frame: Frame) -> str:
        if frame.timestep not in trained:
            return "test"
        return "val" if frame.camera == held_out and len(cameras) > 1 else "train"

    return tuple(replace(frame, split=split(frame)) for frame in frames)


def released_test_sequence(subject: str) -> str:
    """The sequence that GaussianAvatars' released data of a NeRSemble subject hold out.

    Args:
        subject: The subject's number as it is written, for example "074".

    Returns:
        One of `RELEASED_SEQUENCES`: Python's generator, seeded with the number, draws its position.
    """
    return RELEASED_SEQUENCES[int(len(RELEASED_SEQUENCES) * random.Random(subject).uniform(0, 1))]


def subject_number(folder: Path) -> str:
    """The number of a NeRSemble subject in the name of its folder.

    Args:
        folder: For example `UNION10_306_EMO1234EXP234589_...` or `306_EMO-1_...`.

    Returns:
        For example "306".

    Raises:
        InputError: If the name holds no part of three digits.
    """
    found = re.search(r"(?:^|_)(\d{3})(?:_|$)", folder.resolve().name)
    if found is None:
        problem = "the folder's name has no subject number of three digits, which capture.split=released needs"
        raise InputError(f"{problem}; name the test sequence instead", file=folder, field="capture.split")
    return found[1]


def _find(name: str, frames: Sequence[Frame], folder: Path) -> str:
    """The sequence of this name; `EXP-2` also finds `EXP-2-eyes`."""
    sequences = dict.fromkeys(frame.sequence for frame in frames)
    found = [sequence for sequence in sequences if sequence == name] or [
        sequence for sequence in sequences if sequence.startswith(f"{name}-")
    ]
    if len(found) != 1:
        known = ", ".join(sequence or "(without a name)" for sequence in sequences)
        raise InputError(f"there is no sequence {name}; sequences: {known}", file=folder, field="capture.split")
    return found[0]
