"""The rendered frames and true images of one subject in a study, by variant, level and frame."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from carigs.capture import Capture
from carigs.capture.evenly_spread import evenly_spread
from carigs.capture.frame_index import GroundTruth, level_folder, read_frame_index
from carigs.capture.images import read_rgb
from carigs.errors import InputError, SettingsError
from carigs.settings import Figures
from evaluation.figures.sheet import Image

IMAGE_HEIGHT = 360
"""Height of each image of a figure and of the report, in pixels."""
VIEWS = 3
"""Views of the figures with several."""


@dataclass
class StudyImages:
    """What figures of a subject are made of.

    Attributes:
        subject: The capture.
        frames: Folder of the renderings by variant, of the levels of `truths`.
        truths: True images by level.
        settings: Camera and timestep of figures with one view, if a user names them.
        height: Height of each image in a figure, in pixels.
    """

    subject: Capture
    frames: Mapping[str, Path]
    truths: Mapping[float, GroundTruth]
    settings: Figures
    height: int = IMAGE_HEIGHT

    @property
    def variants(self) -> list[str]:
        """Variants in the order of the study."""
        return [*self.frames]

    @cached_property
    def edited(self) -> list[str]:
        """Variants whose mesh is not exaggerated: an editor has changed their images."""
        indexes = {name: level_folder(folder, self.levels[-1]) / "frames.json" for name, folder in self.frames.items()}
        return [name for name, file in indexes.items() if any(f.mesh_level == 0 for f in read_frame_index(file))]

    @cached_property
    def levels(self) -> list[float]:
        """Levels in ascending order."""
        return sorted(self.truths)

    @cached_property
    def frame(self) -> tuple[int, int]:
        """Timestep and camera of the frame in figures with one view.

        Raises:
            SettingsError: No test frame is rendered, or none of the camera and timestep that a user names.
        """
        return shown_frame(self.settings, self.subject, self._rendered_by_all)

    @property
    def problem(self) -> str | None:
        """Why there is no `frame`, if there is none."""
        try:
            self.frame  # noqa: B018
        except SettingsError as error:
            return str(error)
        return None

    @cached_property
    def views(self) -> list[tuple[int, int]]:
        """Frames of figures with several views: `frame` and others of its timestep, far from each other."""
        timestep, camera = self.frame
        others = sorted({c for t, c in self._rendered_by_all if t == timestep} - {camera})
        return [self.frame, *((timestep, camera) for camera in evenly_spread(others, VIEWS - 1))]

    def rendered(self, variant: str, level: float, frame: tuple[int, int] | None = None) -> Image:
        """Read a rendered test frame.

        Args:
            variant: Name of the variant.
            level: Rendered level.
            frame: Timestep and camera; None for `self.frame`.

        Returns:
            The image.

        Raises:
            InputError: The index is malformed or lacks the frame.
        """
        frame = frame or self.frame
        index = level_folder(self.frames[variant], level) / "frames.json"
        if frame not in (files := self._files(index)):
            raise InputError(f"no test frame of timestep {frame[0]}, camera {frame[1]}", file=index)
        return read_rgb(files[frame])

    def rendered_frames(self, variant: str, level: float) -> set[tuple[int, int]]:
        """Test frames that were rendered: a study may leave out timesteps.

        Args:
            variant: Name of the variant.
            level: Rendered level.

        Returns:
            Timesteps and cameras.
        """
        return set(self._files(level_folder(self.frames[variant], level) / "frames.json"))

    def true(self, level: float, frame: tuple[int, int] | None = None) -> Image | None:
        """Read a true image.

        Args:
            level: Level of the caricature.
            frame: Timestep and camera; None for `self.frame`.

        Returns:
            The image; None if it is not known.
        """
        images = self.truths[level].images if level in self.truths else {}
        file = images.get(frame or self.frame)
        return file and read_rgb(file)

    @cached_property
    def _rendered_by_all(self) -> set[tuple[int, int]]:
        """Test frames of every variant at every level."""
        found = [self.rendered_frames(variant, level) for variant in self.variants for level in self.levels]
        return set.intersection(*found) if found else set()

    def _files(self, index: Path) -> dict[tuple[int, int], Path]:
        if index not in self._known_files:
            frames = read_frame_index(index)
            self._known_files[index] = {(f.timestep, f.camera): f.file for f in frames if f.protocol == "test"}
        return self._known_files[index]

    @cached_property
    def _known_files(self) -> dict[Path, dict[tuple[int, int], Path]]:
        return {}


def shown_frame(settings: Figures, subject: Capture, rendered: Collection[tuple[int, int]]) -> tuple[int, int]:
    """Choose the frame of the figures with one view.

    Args:
        settings: Camera and timestep that a user names, or None.
        subject: The capture.
        rendered: Timestep and camera of the test frames that are rendered.

    Returns:
        Timestep and camera: of the validation camera, or of the camera next to it that has a test frame; the first
        timestep.

    Raises:
        SettingsError: There is no such frame.
    """
    if not rendered:
        unseen = "no test frame is rendered of every variant at every level"
        raise SettingsError(unseen if subject.split("test") else "the capture has no test frame")
    named = {"figures.camera": settings.camera, "figures.timestep": settings.timestep}
    stated = ", ".join(f"{key}={value}" for key, value in named.items() if value is not None)
    found = [(t, c) for t, c in rendered if settings.timestep in (None, t) and settings.camera in (None, c)]
    if not found:
        timesteps, cameras = (", ".join(f"{n}" for n in sorted({frame[i] for frame in rendered})) for i in (0, 1))
        raise SettingsError(f"{stated}: no such test frame; there are cameras {cameras} and timesteps {timesteps}")
    validation = subject.cameras[subject.validation_camera].centre

    def order(frame: tuple[int, int]) -> tuple[float, int, int]:
        timestep, camera = frame
        return float(np.linalg.norm(subject.cameras[camera].centre - validation)), camera, timestep

    return min(found, key=order)
