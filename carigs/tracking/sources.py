"""What a user gives to track: one video, one for each camera, or photographs of one moment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain, islice
from pathlib import Path

import numpy as np

from carigs.detection import FaceNetworks
from carigs.detection.upright import ENOUGH, quarter_turns
from carigs.errors import InputError
from carigs.footage import Footage, Selection, read_footage, read_photographs, read_video
from carigs.footage.photographs import OTHER_SUFFIXES, photograph
from carigs.footage.photographs import SUFFIXES as IMAGES
from carigs.readers.folders import is_system_file, listed, natural_order
from carigs.readers.video_header import read_video_header

VIDEOS = (".mp4", ".m4v", ".mov", ".mkv", ".webm", ".avi", ".gif")
"""Names of videos; others are told by their content."""
SHOWN = 3
"""Files that a message names."""
SHORTEST = 1.0
"""Seconds."""
OUT_OF_STEP = 0.25
"""Seconds by which recordings of one moment may differ in length."""
LOOKED_AT = 4
"""Every n-th frame is searched for faces that are not upright; all frames of a short clip."""


def camera_sources(path: Path) -> list[Path]:
    """The recordings of all cameras.

    Args:
        path: A video; a folder of images; or a folder that holds one video, or one folder of images, for each camera.

    Returns:
        One file or folder for each camera, in the natural order of their names.

    Raises:
        InputError: If the folder is empty, or holds neither images nor recordings.
    """
    if not path.is_dir():
        return [path]
    inside = sorted((file for file in listed(path) if not is_system_file(file.name)), key=natural_order)
    if not inside:
        raise InputError("is empty; a video, images, or a recording of each camera are expected", file=path)
    if any(file.is_file() and file.suffix.lower() in (*IMAGES, *OTHER_SUFFIXES) for file in inside):
        return [path]
    if not any(map(_may_be_recording, inside)):
        names = ", ".join(file.name for file in inside[:SHOWN]) + (", ..." if len(inside) > SHOWN else "")
        raise InputError(f"holds no images and no videos: {names}", file=path)
    return inside


def _may_be_recording(path: Path) -> bool:
    """Whether something is a folder or a video, by its name or by its content; a damaged video is one, too."""
    if path.is_dir() or path.suffix.lower() in VIDEOS:
        return True
    try:
        read_video_header(path)
    except InputError:
        return False
    return True


def chosen_frames(source: Path, frame_rate: float, largest_side: int) -> Footage:
    """Choose every n-th frame of a video, so that there are no more per second than wanted.

    Args:
        source: The video; or a folder of its frames, which are all used.
        frame_rate: Most frames per second; that of a folder's frames.
        largest_side: Larger frames are scaled down to this number of pixels.

    Returns:
        The frames.

    Raises:
        InputError: If the video cannot be read, or is shorter than a second.
    """
    if source.is_dir():
        footage = _images(source, frame_rate, largest_side)
    else:
        footage = read_video(source, Selection(frame_rate=frame_rate, largest_side=largest_side))
    if footage.duration < SHORTEST:
        raise InputError(f"{footage.duration:.2f} s long; at least {SHORTEST:g} s are needed", file=source)
    return footage


def frames_in_step(sources: Sequence[Path], frame_rate: float, largest_side: int) -> list[Footage]:
    """Choose the frames of cameras that recorded the same moments.

    Those of the first camera are chosen as `chosen_frames` does; of the others, the frames nearest to them in time.

    Args:
        sources: The recordings: videos that begin at the same moment, or folders with the same number of frames.
        frame_rate: As of `chosen_frames`.
        largest_side: As of `chosen_frames`.

    Returns:
        As many frames of every camera.

    Raises:
        InputError: If a recording cannot be read, or is longer or shorter than the first one.
    """
    first = chosen_frames(sources[0], frame_rate, largest_side)
    found = [first]
    for source in sources[1:]:
        since_first = first.times - first.times[0]
        if source.is_dir():
            other = _images(source, frame_rate, largest_side)
        else:
            other = read_video(source, Selection(at=tuple(since_first.tolist()), largest_side=largest_side))
        difference = other.duration - first.duration
        if abs(difference) > (OUT_OF_STEP if source.is_file() else 0.5 / frame_rate):
            raise InputError(
                f"{other.duration:.2f} s long, but {sources[0].name} {first.duration:.2f} s",
                file=source,
                remedy="cut the recordings of all cameras to the same moments",
            )
        found.append(replace(other, times=first.times))
    return found


def _images(source: Path, frame_rate: float, largest_side: int) -> Footage:
    """All images of a folder, which have the wanted rate."""
    images = read_photographs(source, Selection(largest_side=largest_side))
    times = np.arange(len(images)) / frame_rate
    return replace(images, times=times, fps=frame_rate, duration=float(times[-1]))


def set_upright(footage: Footage, networks: FaceNetworks) -> Footage:
    """Turn the frames of a recording whose metadata do not say that it lies on its side, or is upside down.

    Args:
        footage: The frames.
        networks: That find faces.

    Returns:
        The footage; its warnings say so if it is turned.
    """
    every = max(min(LOOKED_AT, len(footage) // ENOUGH), 1)
    return _turned(footage, quarter_turns(islice(footage.decode(), 0, None, every), networks))


def set_photographs_upright(photographs: Sequence[Footage], networks: FaceNetworks) -> list[Footage]:
    """Turn photographs whose metadata do not say that they lie on the side, or upside down.

    Args:
        photographs: One frame each. Those of one size were taken alike.
        networks: That find faces.

    Returns:
        The photographs; the warnings of those that are turned say so.
    """
    sizes = [(photograph.width, photograph.height) for photograph in photographs]
    alike = {size: [p for p, other in zip(photographs, sizes, strict=True) if other == size] for size in {*sizes}}
    turns = {
        size: quarter_turns(chain.from_iterable(photograph.decode() for photograph in those), networks)
        for size, those in alike.items()
    }
    return [_turned(photograph, turns[size]) for photograph, size in zip(photographs, sizes, strict=True)]


def _turned(footage: Footage, turns: int) -> Footage:
    """Footage after quarter turns clockwise, with a line that says why."""
    if not turns:
        return footage
    lies = "upside down" if turns == 2 else "on the side"
    why = f"{footage.source}: turned by {(90, 180, -90)[turns - 1]} degrees, because its faces are {lies}"
    return footage.turned(turns, why)


def scaled_focal_length(footage: Footage, focal_length: float) -> float:
    """Scale a focal length to footage that is smaller than it was recorded.

    Args:
        footage: What was read of a video, of a folder of frames, or of a photograph.
        focal_length: In pixels as they were recorded.

    Returns:
        In pixels of the footage.
    """
    source = footage.source
    if source.is_file() and source.suffix.lower() in IMAGES:
        recorded = photograph(source, 0, Selection())
    else:
        recorded = read_footage(source, Selection(max_frames=1))
    return focal_length * max(footage.width, footage.height) / max(recorded.width, recorded.height)
