"""A few frames of a capture at a low resolution: what the images show, and where cameras and heads are said to be.

The usual mistakes of a capture are found by trying: each hypothesis changes a scene (`hypotheses`), and the misfit of
the changed scene is compared with that of the stated one (`diagnosis`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from carigs.capture import Camera, Capture, Frame
from carigs.capture.evenly_spread import evenly_spread
from carigs.capture.image_checks import OPAQUE
from carigs.capture.images import differs_from_background
from carigs.errors import CarigsError, InputError
from carigs.head import HeadModel, pose
from carigs.mesh.triangle_mesh import vertex_normals
from carigs.plausibility.images import read_frame

TIMESTEPS, CAMERAS = 4, 16
SIZE = 200
"""Longest side of the reduced images in pixels."""
LARGEST_FOREGROUND = 0.8
"""Without a matte, the foreground is what differs from the background, unless it is more than this share."""


@dataclass(frozen=True)
class Head:
    """The posed mesh of a timestep."""

    vertices: Float[np.ndarray, "v 3"]
    """World points in metres."""
    normals: Float[np.ndarray, "v 3"]
    translation: Float[np.ndarray, "3"]
    """The head parameter; the vertices contain it."""


@dataclass(frozen=True, eq=False)
class Shot:
    """An image at a low resolution, and what is said of it."""

    frame: Frame
    camera: Camera
    """At the resolution of the capture."""
    timestep: int
    """Of the head that the image shows."""
    image: UInt8[np.ndarray, "h w 3"]
    matte: Bool[np.ndarray, "h w"] | None

    @cached_property
    def image_camera(self) -> Camera:
        """The camera at the resolution of the image."""
        height, width = self.image.shape[:2]
        camera, x, y = self.camera, width / self.camera.width, height / self.camera.height
        return Camera(
            camera.camera_from_world, x * camera.fx, y * camera.fy, x * camera.cx, y * camera.cy, width, height
        )


@dataclass(frozen=True)
class Scene:
    """Shots and heads."""

    model: HeadModel
    shots: tuple[Shot, ...]
    heads: Mapping[int, Head]
    """By timestep: those of the shots and their neighbours in time."""

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

    def spread(self, count: int) -> Scene:
        """Keep some of the shots.

        Args:
            count: Number of shots.

        Returns:
            The scene with shots that are spread over timesteps and cameras.
        """
        order = np.argsort(np.random.default_rng(0).random(len(self.shots)))[:count]
        return replace(self, shots=tuple(self.shots[i] for i in sorted(order)))


def read_scene(capture: Capture, *, timesteps: int = TIMESTEPS, size: int = SIZE, enlarge: bool = False) -> Scene:
    """Read a few frames, spread evenly over the timesteps and cameras of a capture.

    Args:
        capture: The capture. Files that cannot be read are left out.
        timesteps: Number of timesteps.
        size: Longest side of the images in pixels.
        enlarge: Whether smaller images are enlarged to that size.

    Returns:
        The scene.
    """
    known = sorted(capture.parameter_files)
    chosen = evenly_spread(known, timesteps)
    cameras = evenly_spread(sorted(capture.cameras), CAMERAS)
    order = {t: i for i, t in enumerate(known)}
    near = {known[i] for t in chosen for i in (order[t] - 1, order[t], order[t] + 1) if 0 <= i < len(known)}
    heads = {t: head for t in sorted(near) if (head := _head(capture, t))}
    frames = [frame for frame in capture.frames if frame.timestep in chosen and frame.camera in cameras]
    shots = [_shot(capture, frame, size, enlarge) for frame in frames if frame.timestep in heads]
    return Scene(capture.model, tuple(shot for shot in shots if shot), heads)


def _head(capture: Capture, timestep: int) -> Head | None:
    try:
        parameters = capture.parameters(timestep)
        vertices = pose(capture.model, parameters)
    except CarigsError:
        return None
    return Head(vertices, vertex_normals(vertices, capture.model.faces), parameters.translation)


def _shot(capture: Capture, frame: Frame, size: int, enlarge: bool) -> Shot | None:
    try:
        image, matte = read_frame(capture, frame)
    except InputError:
        return None
    if matte is None:
        matte = 255 * differs_from_background(image, capture.background).astype(np.uint8)
        matte = matte if (matte > 0).mean() < LARGEST_FOREGROUND else None
    factor = size / max(image.shape) if enlarge else min(1.0, size / max(image.shape))
    method = cv2.INTER_AREA if factor < 1 else cv2.INTER_LINEAR
    resized = max(1, round(image.shape[1] * factor)), max(1, round(image.shape[0] * factor))
    image = cv2.resize(image, resized, interpolation=method)
    if matte is not None:
        foreground = cv2.resize(matte, resized, interpolation=method) >= OPAQUE
        matte = foreground if foreground.any() else None
    return Shot(frame, capture.camera(frame), frame.timestep, image, matte)
