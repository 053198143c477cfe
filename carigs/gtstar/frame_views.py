"""Inputs of the targets: images and mattes of the frames of one timestep, and what their cameras see of the head."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32

from carigs.capture import Camera, Capture, Frame
from carigs.capture.images import read_grey, read_rgb
from carigs.errors import InputError
from carigs.raster import Visibility, compute_visibility
from carigs.settings import Gtstar


class FrameView(NamedTuple):
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
    views: dict[Frame, FrameView]
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
        camera, (image, matte) = capture.cameras[frame.camera], _image_files(settings, capture, frame)
        try:
            images = _checked(read_rgb(image), image, camera), _checked(read_grey(matte), matte, camera)
        except InputError as error:
            problems[frame] = str(error)
        else:
            views[frame] = FrameView(*images, compute_visibility(vertices, capture.model.faces, camera))
    return TimestepViews(vertices, views, problems)


def _checked(image: np.ndarray, file: Path, camera: Camera) -> np.ndarray:
    if image.shape[:2] != (camera.height, camera.width):
        size = f"{image.shape[1]} x {image.shape[0]} pixels"
        raise InputError(f"{size}, its camera has {camera.width} x {camera.height}", file=file)
    return image


def input_files(settings: Gtstar, capture: Capture) -> list[Path]:
    """Files that the targets depend on, apart from the index of the capture and the exaggeration path.

    Args:
        settings: Settings of the stage.
        capture: The capture.

    Returns:
        Paths without duplicates.
    """
    files = [capture.head_model]
    for frame in capture.split("train"):
        files += [capture.root / frame.parameters, *_image_files(settings, capture, frame)]
    return list(dict.fromkeys(files))


def _image_files(settings: Gtstar, capture: Capture, frame: Frame) -> tuple[Path, Path]:
    """Image and matte of a frame, or of its edited copy."""
    image, matte = capture.root / frame.image, capture.root / frame.mask
    if settings.provider == "precomputed":
        image = Path(settings.folder) / f"{frame.name}.png"
        edited_matte = image.with_name(f"{frame.name}_mask.png")
        matte = edited_matte if edited_matte.is_file() else matte
    return image, matte
