"""What the viewer shows: one avatar or two, and the capture and the truth that they are compared with."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32

from carigs.capture import Camera, Capture
from carigs.capture.frame_index import read_ground_truth
from carigs.capture.images import read_rgb
from carigs.errors import InputError
from carigs.head import HeadModel
from carigs.library import HeadAvatar, orbit
from carigs.motion import Motion
from carigs.readers.json_files import json_field, read_json
from carigs.viewer.controls import Control, controls_of
from carigs.viewer.drives import drives_of
from carigs.viewer.overlays import curvature_colours, flag_colours
from carigs.viewer.scene import HeadScene
from carigs.viewer.state import Values, is_level, region_levels, timestep_of

IMAGES = 32
"""Captured images that are kept."""


class Subject:
    """The avatars with their capture. `lock` must be held by whoever uses `scenes` or an overlay.

    Attributes:
        scenes: One avatar or two.
        controls: The controls of the first avatar.
        capture: The capture, or None.
        lock: Held while something is computed.
    """

    def __init__(
        self, avatar: HeadAvatar, second: HeadAvatar | None = None, capture: Capture | None = None,
        truth: Path | None = None, motions: Mapping[str, Motion] | None = None, driver: HeadModel | None = None,
    ) -> None:  # fmt: skip
        """Take avatars.

        Args:
            avatar: The avatar.
            second: Another one to compare it with.
            capture: Their capture.
            truth: Index of the ground truth at a level (truth.json).
            motions: Motions that the avatars can show, besides the built-in ones, by name.
            driver: Head model that the motions belong to, if names do not suffice.

        Raises:
            InputError: If the index cannot be read.
            SettingsError: If a motion cannot be transferred.
        """
        avatars = [one for one in (avatar, second) if one is not None]
        self.scenes = [HeadScene(one, drives_of(one, motions or {}, driver)) for one in avatars]
        self.controls: tuple[Control, ...] = controls_of(avatar)
        self.capture, self.lock = capture, threading.RLock()
        self._truth_level, self._truth = 0.0, {}
        if truth is not None:
            self._truth = read_ground_truth(truth).images
            self._truth_level = float(json_field(read_json(truth, dict), "level", float, file=truth))
        self._image = lru_cache(IMAGES)(self._read)
        self._overlays: dict[str, Float32[np.ndarray, "f 3"]] = {}

    @property
    def avatar(self) -> HeadAvatar:
        """The first avatar."""
        return self.scenes[0].avatar

    @property
    def cameras(self) -> dict[int, Camera]:
        """Cameras of the capture by number; none without a capture."""
        return {} if self.capture is None else self.capture.cameras

    def first_camera(self) -> Camera:
        """Where a client begins.

        Returns:
            A camera in front of the head.
        """
        return orbit(self.avatar, 1, size=720)[0]

    def face_colours(self, overlay: str, scene: int = 0) -> Float32[np.ndarray, "f 3"] | None:
        """Colours of an overlay.

        Args:
            overlay: `curvature` or `mask flags`; for others there are none.
            scene: Number of the avatar.

        Returns:
            RGB of every triangle, or None.
        """
        make: Any = {"curvature": curvature_colours, "mask flags": flag_colours}.get(overlay)
        if make is None:
            return None
        key = f"{overlay} {scene}"
        if key not in self._overlays:
            self._overlays[key] = make(self.scenes[scene].avatar)
        return self._overlays[key]

    def camera_at(self, camera: int, values: Values) -> Camera | None:
        """A camera of the capture as calibrated for a timestep.

        Args:
            camera: Number of the camera.
            values: Values of the controls.

        Returns:
            The camera, or None if there is no such camera.
        """
        if self.capture is None or camera not in self.capture.cameras:
            return None
        frame = self.capture.frame_at.get((timestep_of(self.avatar, values), camera))
        return self.capture.cameras[camera] if frame is None else self.capture.camera(frame)

    def captured(self, camera: int, values: Values) -> Float32[np.ndarray, "h w 3"] | None:
        """The captured image of a camera at the timestep.

        Args:
            camera: Number of the camera.
            values: Values of the controls.

        Returns:
            RGB in [0, 1], or None if there is none.
        """
        timestep = timestep_of(self.avatar, values)
        if self.capture is None or (timestep, camera) not in self.capture.frame_at:
            return None
        return self._image("captured", timestep, camera)

    def truth(self, camera: int, values: Values) -> Float32[np.ndarray, "h w 3"] | None:
        """What an image should be: the captured one for the natural head, the ground truth at its level.

        Args:
            camera: Number of the camera.
            values: Values of the controls.

        Returns:
            RGB in [0, 1], or None where there is no truth: at other levels, or if expression or joints were changed.
        """
        posed = any(value for name, value in values.items() if name != "frame" and not is_level(name))
        if posed or region_levels(values):
            return None
        if values["level"] == 0:
            return self.captured(camera, values)
        timestep = timestep_of(self.avatar, values)
        if abs(values["level"] - self._truth_level) > 1e-6 or (timestep, camera) not in self._truth:
            return None
        return self._image("truth", timestep, camera)

    def _read(self, kind: str, timestep: int, camera: int) -> Float32[np.ndarray, "h w 3"] | None:
        try:
            if kind == "truth":
                return read_rgb(self._truth[timestep, camera], self.avatar.avatar.background)
            return self.capture.image(self.capture.frame_at[timestep, camera])
        except InputError:  # removed meanwhile
            return None
