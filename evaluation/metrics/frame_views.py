"""What metrics read of a rendered frame: its image, the true image, and the mesh as its camera sees it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, UInt8

from carigs.capture import Camera, Capture, Frame
from carigs.capture.frame_index import GroundTruth, RenderedImage
from carigs.capture.images import read_grey, read_rgb8
from carigs.errors import InputError
from carigs.exaggeration import Caricature
from carigs.head import pose
from carigs.raster import Visibility, compute_visibility


@dataclass
class PosedMesh:
    """The head of a timestep at a level; posed when first used."""

    subject: Capture
    timestep: int
    caricature: Caricature

    @cached_property
    def vertices(self) -> Float[np.ndarray, "v 3"]:
        """Vertices of the caricature in world coordinates, in metres."""
        return pose(self.subject.model, self.subject.parameters(self.timestep), self.caricature)

    @cached_property
    def natural(self) -> Float[np.ndarray, "v 3"]:
        """Vertices of the natural head."""
        return pose(self.subject.model, self.subject.parameters(self.timestep))

    def seen_by(self, camera: Camera) -> Visibility:
        """Rasterise the caricature.

        Args:
            camera: The camera.

        Returns:
            The mesh as the camera sees it.
        """
        return compute_visibility(self.vertices, self.subject.model.faces, camera)


@dataclass
class FrameView:
    """A rendered frame. Images are read, and the mesh is rasterised, when first used, and only once."""

    rendered: RenderedImage
    camera: Camera
    head: PosedMesh
    frame: Frame | None
    """Frame of the capture; None for a novel view."""
    truth: Path | None
    """The true image, if there is one."""
    mask: Path | None
    """Foreground of the true image."""

    @cached_property
    def image8(self) -> UInt8[np.ndarray, "h w 3"]:
        """The rendered image."""
        return self._checked(read_rgb8(self.rendered.file), self.rendered.file)

    @cached_property
    def truth8(self) -> UInt8[np.ndarray, "h w 3"] | None:
        """The true image, if there is one."""
        return None if self.truth is None else self._checked(read_rgb8(self.truth), self.truth)

    @property
    def foreground(self) -> Bool[np.ndarray, "h w"] | None:
        """Foreground of the true image, if there is one."""
        return None if self.mask is None else self._checked(read_grey(self.mask) > 0.5, self.mask)

    @cached_property
    def visibility(self) -> Visibility:
        """The mesh at the rendered level as the camera sees it."""
        return self.head.seen_by(self.camera)

    def _checked(self, image: np.ndarray, file: Path) -> np.ndarray:
        if image.shape[:2] != (self.camera.height, self.camera.width):
            size = f"{image.shape[1]} x {image.shape[0]} pixels"
            raise InputError(f"{size}, its camera has {self.camera.width} x {self.camera.height}", file=file)
        return image


def frame_views(
    rendered: Iterable[RenderedImage], truths: GroundTruth, subject: Capture, caricature: Caricature
) -> Iterator[FrameView]:
    """Prepare rendered frames for metrics; frames of one timestep in succession share the posed head.

    Args:
        rendered: Rendered frames, each of a camera of the capture or with its own.
        truths: True images.
        subject: The capture.
        caricature: Caricature at the rendered level.

    Yields:
        One view per frame.

    Raises:
        InputError: The capture lacks the original of a frame.
    """
    head = None
    for image in rendered:
        key = (image.timestep, image.camera)
        frame = None if image.view else subject.frame_at.get(key)
        if frame is None and (image.view is None or image.timestep not in subject.parameter_files):
            missing = f"timestep {image.timestep}, camera {image.camera}"
            raise InputError(f"the capture has no frame of {missing}", file=image.file)
        if head is None or head.timestep != image.timestep:
            head = PosedMesh(subject, image.timestep, caricature)
        camera = image.view or subject.camera(frame)
        files = (None, None) if frame is None else (truths.images.get(key), truths.masks.get(key))
        yield FrameView(image, camera, head, frame, *files)
