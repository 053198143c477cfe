"""Labelled renderings of avatars: people by levels by poses, for the training and the test of face recognition."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from carigs.capture.images import write_png
from carigs.errors import InputError, SettingsError
from carigs.library.head_avatar import HeadAvatar
from carigs.library.orbit_cameras import orbit
from carigs.system.files import writing_folder

LABELS = "labels.csv"
COLUMNS = ("file", "person", "level", "pose", "azimuth", "elevation", "timestep")


class Label(NamedTuple):
    """What a rendering shows."""

    file: str
    """Name below the folder."""
    person: str
    level: float
    pose: int
    """Number of the pose. One pose has the same view and expression at all levels."""
    azimuth: float
    """Degrees from the front of the face towards the left of the head."""
    elevation: float
    """Degrees above the horizon."""
    timestep: int
    """Timestep of the capture that the expression is from."""


def draw_labels(
    people: Mapping[str, Sequence[int]],
    levels: Sequence[float],
    poses: int,
    *,
    azimuth: float = 60.0,
    elevation: float = 15.0,
    seed: int = 0,
) -> list[Label]:
    """Draw views and expressions.

    Args:
        people: Timesteps of each person's capture, by name.
        levels: Levels of exaggeration.
        poses: Poses of each person.
        azimuth: Largest angle to either side, in degrees; angles are uniform.
        elevation: The same above and below the horizon.
        seed: Seed of the draws. A person's poses depend on it and on the name alone.

    Returns:
        Labels by person, pose and level.
    """
    labels = []
    for person, timesteps in people.items():
        random = np.random.default_rng([seed, *person.encode()])
        for pose in range(poses):
            around, above = (round(float(random.uniform(-limit, limit)), 3) for limit in (azimuth, elevation))
            timestep = int(random.choice(timesteps))
            for level in levels:
                file = f"{person}/level={level:g}/{pose:04d}.png"
                labels.append(Label(file, person, level, pose, around, above, timestep))
    return labels


def write_labelled_set(
    folder: Path, avatars: Mapping[str, HeadAvatar], labels: Sequence[Label], size: int = 224
) -> Iterator[Label]:
    """Render labels, and write them beside the images; the folder appears when all are written.

    Args:
        folder: Folder to create.
        avatars: The avatars by person.
        labels: What to render, as of `draw_labels`.
        size: Height and width of the images in pixels.

    Yields:
        Each label once its image is written.

    Raises:
        InputError: The folder exists and is not empty.
        SettingsError: A level is beyond what an avatar was made for.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError("exists and is not an empty folder: name another one", file=folder)
    for label in labels:
        if not 0 <= label.level <= avatars[label.person].gamma:
            highest = avatars[label.person].gamma
            raise SettingsError(f"--level {label.level:g}: the avatar of {label.person} was made for 0 to {highest:g}")
    with writing_folder(folder) as part:
        for label in labels:
            avatar = avatars[label.person]
            expression = avatar.avatar.sequence.parameters[label.timestep].expression
            (camera,) = orbit(avatar, 1, azimuth=label.azimuth, elevation=label.elevation, size=size)
            (part / label.file).parent.mkdir(parents=True, exist_ok=True)
            write_png(part / label.file, avatar.render(camera, level=label.level, expression=expression))
            yield label
        with (part / LABELS).open("w", newline="") as stream:
            csv.writer(stream, lineterminator="\n").writerows([COLUMNS, *labels])
