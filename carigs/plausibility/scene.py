"""A few frames of a capture at a low resolution: what the images show, and where cameras and heads are said to be.

The usual mistakes of a capture are found by trying: each hypothesis changes a scene (`hypotheses`), and the misfit of
the changed scene is compared with that of the stated one (`diagnosis`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from carigs.capture import Camera, Capture, Frame
from carigs.errors import CarigsError, InputError
from carigs.head import HeadModel, pose
from carigs.plausibility.images import OPAQUE, read_frame
from carigs.plausibility.selection import spread

TIMESTEPS = 4
CAMERAS = 16
SIZE = 200
"""Longest side of the reduced images in pixels."""


@dataclass(frozen=True)
class Head:
    """The posed mesh of a timestep."""

    vertices: Float[np.ndarray, "v 3"]
    """World points in metres."""
    translation: Float[np.ndarray, "3"]
    """The head parameter; the vertices contain it."""


@dataclass(frozen=True)
class Shot:
    """An image, and what is said of it."""

    frame: Frame
    camera: Camera
    """At the resolution of the image."""
    timestep: int
    """Of the head that the image shows."""
    image: UInt8[np.ndarray, "h w 3"]
    matte: Bool[np.ndarray, "h w"]


@dataclass(frozen=True)
class Scene:
    """Shots and heads."""

    model: HeadModel
    shots: tuple[Shot, ...]
    heads: Mapping[int, Head]
    """By timestep: those of the shots and their neighbours in time."""
    scale: float
    """Resolution of the shots over that of the capture."""

    def with_shots(self, change: Callable[[Shot], Shot]) -> Scene:
        """Change each shot.

        Args:
            change: From the stated shot to the supposed one.

        Returns:
            The changed scene.
        """
        return replace(self, shots=tuple(map(change, self.shots)))

    def with_cameras(self, change: Callable[[Camera], Camera]) -> Scene:
        """Change the camera of each shot.

        Args:
            change: From the stated camera to the supposed one.

        Returns:
            The changed scene.
        """
        return self.with_shots(lambda shot: replace(shot, camera=change(shot.camera)))


def reduced_scene(capture: Capture, *, timesteps: int = TIMESTEPS, size: int = SIZE) -> Scene:
    """Read a few frames, spread evenly over the timesteps and cameras of a capture.

    Args:
        capture: The capture. Files that cannot be read are left out.
        timesteps: Number of timesteps.
        size: Longest side of the images.

    Returns:
        The scene.
    """
    known = sorted(capture.parameter_files)
    chosen = spread(known, timesteps)
    cameras = spread(sorted({frame.camera for frame in capture.frames}), CAMERAS)
    frames = [frame for frame in capture.frames if frame.timestep in chosen and frame.camera in cameras]
    order = {t: i for i, t in enumerate(known)}
    near = {known[i] for t in chosen for i in (order[t] - 1, order[t], order[t] + 1) if 0 <= i < len(known)}
    heads = {t: head for t in sorted(near) if (head := _head(capture, t)) is not None}
    shots = [_shot(capture, frame, size) for frame in frames if frame.timestep in heads]
    longest = max((max(c.width, c.height) for c in capture.cameras.values()), default=size)
    return Scene(capture.model, tuple(shot for shot in shots if shot), heads, min(1.0, size / longest))


def _head(capture: Capture, timestep: int) -> Head | None:
    try:
        parameters = capture.parameters(timestep)
        return Head(pose(capture.model, parameters), parameters.translation)
    except CarigsError:
        return None


def _shot(capture: Capture, frame: Frame, size: int) -> Shot | None:
    try:
        image, matte = read_frame(capture, frame)
    except InputError:
        return None
    factor = min(1.0, size / max(matte.shape))
    camera = resized(capture.cameras[frame.camera], factor)
    image, matte = (cv2.resize(a, (camera.width, camera.height), interpolation=cv2.INTER_AREA) for a in (image, matte))
    return Shot(frame, camera, frame.timestep, image, matte >= OPAQUE)


def resized(camera: Camera, factor: float) -> Camera:
    """The same view with another number of pixels; unlike `Camera.scaled`, exact for sizes that are rounded."""
    width, height = max(1, round(camera.width * factor)), max(1, round(camera.height * factor))
    x, y = width / camera.width, height / camera.height
    return Camera(
        camera.camera_from_world, x * camera.fx, y * camera.fy, x * camera.cx, y * camera.cy, width, height
    )
