"""Inputs of the targets: images and mattes of the frames of one timestep, and what their cameras see of the head."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32

from carigs.capture import Capture, Frame
from carigs.capture.images import read_grey, read_rgb
from carigs.errors import InputError
from carigs.gtstar.exchange import why_not_edited
from carigs.raster import Visibility, compute_visibility
from carigs.settings import Gtstar


class CapturedView(NamedTuple):
    """One frame."""

    image: Float32[np.ndarray, "h w 3"]
    foreground: Float32[np.ndarray, "h w"]
    """Matte in [0, 1]."""
    natural: Visibility
    """What the camera sees of the mesh that the image shows."""


class TimestepViews(NamedTuple):
    """The frames of one timestep."""

    vertices: Float[np.ndarray, "v 3"]
    """World points of the mesh that the images show, in metres."""
    views: dict[Frame, CapturedView]
    problems: dict[Frame, str]
    """Why a frame cannot be used."""


def load_views(
    settings: Gtstar, capture: Capture, frames: list[Frame], vertices: Float[np.ndarray, "v 3"]
) -> TimestepViews:
    """Read and check the images of one timestep, and rasterize the mesh for each of their cameras.

    Args:
        settings: Settings of the stage.
        capture: The capture.
        frames: Frames of one timestep.
        vertices: World points of the mesh that the images show, in metres.

    Returns:
        A view of each frame that can be used, and the problems of the others.
    """
    views, problems = {}, {}
    for frame in frames:
        camera = capture.camera(frame)
        try:
            images = _read_images(settings, capture, frame)
        except InputError as error:
            problems[frame] = str(error)
        else:
            views[frame] = CapturedView(*images, compute_visibility(vertices, capture.model.faces, camera))
    return TimestepViews(vertices, views, problems)


def _read_images(
    settings: Gtstar, capture: Capture, frame: Frame
) -> tuple[Float32[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"]]:
    """Image and matte of a frame, or of its edited copy."""
    edited, matte = _edited_files(settings, frame)
    images = (
        capture.image(frame) if edited is None else read_rgb(edited, capture.background),
        capture.foreground(frame) if matte is None else read_grey(matte),
    )
    camera, files = capture.camera(frame), (edited or frame.image, matte or frame.mask or frame.image)
    for image, file in zip(images, files, strict=True):
        if image.shape[:2] != (camera.height, camera.width):
            size = f"{image.shape[1]} x {image.shape[0]} pixels"
            problem = f"{size}, its camera has {camera.width} x {camera.height}"
            raise InputError(problem, file=capture.root / file)
    return images


def _edited_files(settings: Gtstar, frame: Frame) -> tuple[Path | None, Path | None]:
    """The edited copy of an image and its matte, where there are such files."""
    if settings.provider != "precomputed":
        return None, None
    edited = Path(settings.folder) / f"{frame.name}.png"
    if not edited.is_file() and (reason := why_not_edited(edited)):
        raise InputError(reason, file=edited)
    matte = edited.with_name(f"{frame.name}_mask.png")
    return edited, matte if matte.is_file() else None
