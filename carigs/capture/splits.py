"""Splits of a capture into training, validation and test frames.

| rule | test sequence |
|---|---|
| `files` | as transforms_{train,val,test}.json say |
| `released` | the one that GaussianAvatars' released data hold out, drawn from the subject's number |
| a sequence's name | that sequence: `EXP-2` in the paper, `EMO-1` in SurFhead's repository |
| `blocks` | 5 of every 20 timesteps, as `carigs track` holds them out |

The validation frames are those of one camera at the training timesteps; with few cameras, those of all cameras at some
of these timesteps.
"""

from __future__ import annotations

import math
import random
import re
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path

from carigs.capture.frame import Frame
from carigs.errors import InputError

FRONTAL_CAMERA = 8
"""The frontal camera of NeRSemble."""
TRAINED = 0.7
"""Share of the timesteps of a single sequence that are for training, as in VHAP."""
ENOUGH_CAMERAS = 6
"""Cameras from which on one of them may be for validation. Six on a half circle stand 36 degrees apart: skin that only
one of them faces is seen by its neighbours at less than 45 degrees. One of fewer may be the only one that sees an ear,
and would take a fifth or more of the training frames."""
VALIDATED, PERIOD = (9, 10), 20
"""Places of validation timesteps within each so many training timesteps: a tenth of them, in pairs, because neighbours
in time look alike."""
TRAINED_BLOCK, TESTED_BLOCK = 15, 5
"""Timesteps of the two kinds of blocks."""
LAST_SHARE = 0.25
"""Of a clip, for `last_quarter`."""
RELEASED_SEQUENCES = ("EMO-1", "EMO-2", "EMO-3", "EMO-4", "EXP-2", "EXP-3", "EXP-4", "EXP-5", "EXP-8", "EXP-9")


def split_frames(
    frames: Sequence[Frame], rule: str, validation_camera: int | None, folder: Path
) -> tuple[tuple[Frame, ...], str]:
    """Divide frames into splits.

    Args:
        frames: Frames with the splits that the files say.
        rule: `files`, `released`, `blocks`, or the name of the test sequence.
        validation_camera: Camera of the validation frames. None: as the files say, or for another rule camera 8, or
            the last camera if there is no camera 8; of few cameras none, but some timesteps.
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
        held_out, name = {f.timestep for f in frames if f.split == "test"}, rule
    elif rule == "blocks":
        timesteps = sorted({frame.timestep for frame in frames})
        named = zip(timesteps, blocks(len(timesteps)), strict=True)
        held_out, name = {timestep for timestep, split in named if split != "train"}, rule
    else:
        sequence = _find(released_test_sequence(subject_number(folder)) if rule == "released" else rule, frames, folder)
        held_out = {frame.timestep for frame in frames if frame.sequence == sequence}
        name = f"released ({sequence})" if rule == "released" else sequence
    divided = _divided(frames, held_out, validation_camera)
    if not any(frame.split == "train" for frame in divided):
        raise InputError(f"no training frame is left by the split {name}", file=folder, field="capture.split")
    validated = {frame.camera for frame in divided if frame.split == "val"}
    if len(cameras) > 1 and len(validated) == 1:
        return divided, f"{name}, validation camera {validated.pop()}"
    return divided, f"{name}, validation by time" if validated else name


def _divided(frames: Sequence[Frame], held_out: Collection[int], camera: int | None = None) -> tuple[Frame, ...]:
    """The frames with their splits: the timesteps `held_out` are `test`, those of the camera are `val` at others."""
    cameras = sorted({frame.camera for frame in frames})
    if camera is None and len(cameras) >= ENOUGH_CAMERAS:
        camera = FRONTAL_CAMERA if FRONTAL_CAMERA in cameras else cameras[-1]
    rest = {frame.timestep for frame in frames} - set(held_out)
    validated = validation_timesteps(rest) if camera is None else set()

    def split(frame: Frame) -> str:
        if frame.timestep in held_out:
            return "test"
        return "val" if frame.camera == camera or frame.timestep in validated else "train"

    return tuple(replace(frame, split=split(frame)) for frame in frames)


def validation_timesteps(timesteps: Collection[int]) -> set[int]:
    """Choose the timesteps of the validation frames before few cameras.

    Args:
        timesteps: Those that are not for tests.

    Returns:
        A tenth of them; none of fewer than ten.
    """
    return {timestep for i, timestep in enumerate(sorted(timesteps)) if i % PERIOD in VALIDATED}


def split_single_sequence(frames: Sequence[Frame]) -> tuple[Frame, ...]:
    """Divide the frames of a single sequence as VHAP does.

    Args:
        frames: The frames.

    Returns:
        The frames with their splits: the last three tenths of the timesteps are `test`; of the others, camera 8, or
        the last camera, is `val`, and before few cameras some timesteps. There is always a timestep for training.
    """
    timesteps = sorted({f.timestep for f in frames})
    trained = max(1, min(len(timesteps) - 1, math.ceil(TRAINED * len(timesteps))))
    return _divided(frames, timesteps[trained:])


def blocks(count: int) -> list[str]:
    """Hold out 5 of every 20 timesteps.

    Held-out frames then show what training frames show. The end of a short clip often asks for poses that no training
    frame has.

    Args:
        count: Number of timesteps.

    Returns:
        `train` or `test` for each timestep; the middle one of each block is `val`. Of a clip that is shorter than two
        blocks, the last quarter is held out.
    """
    period = TRAINED_BLOCK + TESTED_BLOCK
    if count < period:
        return last_quarter(count)
    names = ["train" if i % period < TRAINED_BLOCK else "test" for i in range(count)]
    for middle in range(TRAINED_BLOCK + TESTED_BLOCK // 2, count, period):
        names[middle] = "val"
    return names


def last_quarter(count: int) -> list[str]:
    """Hold out the end of a clip, as published figures of monocular avatars do.

    Args:
        count: Number of timesteps.

    Returns:
        `train` or `test` for each; `val` for every fifth one of the end.
    """
    first, middle = count - round(LAST_SHARE * count), TESTED_BLOCK // 2
    return ["train" if i < first else "val" if (i - first) % TESTED_BLOCK == middle else "test" for i in range(count)]


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
