"""A dataset whose frames and mattes end below the chin: a bust of a person with shoulders and clothes."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, Float32

from carigs.capture import Capture, Frame
from carigs.capture.dataset_writer import write_dataset
from carigs.capture.images import read_rgb8, write_png
from carigs.errors import InputError
from carigs.head import HeadModel, neutral, pose
from carigs.matting.neck_cut import NeckCut
from carigs.readers.images import read_pixels

CHIN = 8
"""Of 68 landmarks."""
BELOW_LIPS = 0.03
"""Metres from the lower lip down to the chin, of a head model without landmarks."""


def write_cut_dataset(folder: Path, capture: Capture) -> None:
    """Copy a capture; its frames fade to the background below the chin, and its mattes to 0.

    Args:
        folder: Folder to create.
        capture: The capture.

    Raises:
        InputError: If the head model does not say where the chin is, or the folder holds something.
    """
    timesteps = sorted({frame.timestep for frame in capture.frames})
    parameters = {timestep: capture.parameters(timestep) for timestep in timesteps}
    model, rest = capture.model, neutral(capture.model, parameters[timesteps[0]])
    cut = NeckCut(rest, model.faces, _chin(model, rest, capture.head_model))
    by_file = {capture.root / name: frame for frame in capture.frames for name in (frame.image, frame.mask) if name}

    @lru_cache(maxsize=1)  # an image and its matte follow each other
    def share(frame: Frame) -> Float32[np.ndarray, "h w"]:
        return cut.kept_share(pose(model, parameters[frame.timestep]), capture.camera(frame))

    def place(source: Path, part: Path, folder: Path, name: str) -> str:
        frame = by_file[source]
        name = str(Path(name).with_suffix(".png"))
        if source == capture.root / frame.image:
            _write_image(part / name, capture, frame, share(frame))
        else:
            write_png(part / name, capture.mask(frame) * share(frame))
        return name

    write_dataset(folder, capture, model, parameters, place=place)


def _write_image(file: Path, capture: Capture, frame: Frame, share: Float32[np.ndarray, "h w"]) -> None:
    """Write an image that fades to the background; where the matte is its alpha channel, that fades alone."""
    source = capture.root / frame.image
    if frame.mask == frame.image:
        pixels = read_pixels(source)
        pixels[..., 3] = np.rint(pixels[..., 3] * share)
        file.write_bytes(cv2.imencode(".png", pixels)[1].tobytes())
        return
    image = read_rgb8(source, capture.background).astype(np.float32) / 255
    write_png(file, image * share[..., None] + capture.background * (1 - share[..., None]))


def _chin(model: HeadModel, rest: Float[np.ndarray, "v 3"], file: Path) -> float:
    """Height of the chin in metres."""
    if model.landmarks68 is not None:
        return float(model.landmarks68.interpolate(rest)[CHIN, 1])
    lips = model.vertex_region("lips")
    if not lips.any():
        raise InputError(
            "has neither 68 landmarks nor a region `lips`, and does not say where the chin is",
            file=file, remedy="set capture.body=keep",
        )  # fmt: skip
    return float(rest[lips, 1].min()) - BELOW_LIPS
