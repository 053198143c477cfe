"""The folder in which frames go to a program that edits them, and come back: see docs/tutorials/stylizers.md."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from carigs.capture import Capture, Frame
from carigs.capture.images import write_png
from carigs.errors import InputError
from carigs.exaggeration import Caricature
from carigs.head import pose
from carigs.readers.formats import Format
from carigs.readers.images import read_header
from carigs.readers.limits import read_bytes
from carigs.system.files import write_json, writing

FORMAT = Format("carigs-exchange", 1, "run the stage gtstar again, as carigs run does")
EDITED = "edited"
"""The folder below it that the program writes to."""
MAX_REASON_BYTES = 100_000
"""Largest text of a program that says why it made no frame; its first line is quoted."""


def write_exchange(
    folder: Path, capture: Capture, exaggerated: Caricature, level: float | None, frames: list[Frame]
) -> None:
    """Write what a program gets: frames, mattes, cameras, and the meshes that they show and are to show.

    Args:
        folder: The exchange folder. Files that an earlier run has written are kept.
        capture: The capture.
        exaggerated: The caricature of the level.
        level: The level; None if it is not known.
        frames: The frames that are to be edited: those that frames.json lists.
    """
    (folder / EDITED).mkdir(parents=True, exist_ok=True)
    _once(folder / "faces.npy", lambda part: np.save(part, capture.model.faces))
    entries = []
    for frame in frames:
        camera, timestep = capture.camera(frame), f"{frame.timestep:05d}"
        files = {
            "image": f"frames/{frame.name}.png",
            "mask": f"masks/{frame.name}.png",
            "mesh": f"meshes/{timestep}.npz",
        }
        _once(folder / files["image"], lambda part, frame=frame: write_png(part, capture.image(frame)))
        _once(folder / files["mask"], lambda part, frame=frame: write_png(part, capture.foreground(frame)))
        _once(folder / files["mesh"], lambda part, frame=frame: _write_meshes(part, capture, exaggerated, frame))
        entries.append(
            {
                "name": frame.name,
                "timestep": frame.timestep,
                "camera": frame.camera,
                **files,
                "edited": f"{EDITED}/{frame.name}.png",
                "size": [camera.width, camera.height],
                "intrinsics": list(camera.intrinsics),
                "camera_from_world": camera.camera_from_world.tolist(),
            }
        )
    write_json(folder / "frames.json", {"format": str(FORMAT), "level": level, "frames": entries})


def frames_to_edit(folder: Path, capture: Capture, frames: tuple[Frame, ...]) -> list[Frame]:
    """Find the frames that have no edited image yet, or a broken one, or one of another size.

    Args:
        folder: The exchange folder.
        capture: The capture.
        frames: All frames.

    Returns:
        Those frames; what is wrong of them is removed, and the reasons that an earlier run gave.
    """
    missing = []
    for frame in frames:
        edited, camera = folder / EDITED / f"{frame.name}.png", capture.camera(frame)
        try:
            header = read_header(edited)
            sound = (header.width, header.height) == (camera.width, camera.height)
        except InputError:
            sound = False
        if not sound:
            missing.append(frame)
            for file in (edited, edited.with_name(f"{frame.name}_mask.png"), edited.with_suffix(".txt")):
                file.unlink(missing_ok=True)
    return missing


def why_not_edited(edited: Path) -> str:
    """What a program says of a frame that it did not make.

    Args:
        edited: Where the frame would be.

    Returns:
        The first line of the text file of the same name; empty if there is none.
    """
    file = edited.with_suffix(".txt")
    if not file.is_file():
        return ""
    try:
        lines = read_bytes(file, MAX_REASON_BYTES, "text").decode("utf-8", "replace").split("\n")
    except InputError as error:
        return error.problem
    return f"the program says: {lines[0].strip()[:200]}"


def _write_meshes(part: Path, capture: Capture, exaggerated: Caricature, frame: Frame) -> None:
    parameters = capture.parameters(frame.timestep)
    natural, caricature = (pose(capture.model, parameters, shape) for shape in (None, exaggerated))
    with part.open("wb") as stream:
        np.savez(stream, natural=natural, caricature=caricature)


def _once(file: Path, write: Callable[[Path], None]) -> None:
    """Write a file that is not there yet."""
    if not file.is_file():
        with writing(file) as part:
            write(part)
