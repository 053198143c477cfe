"""Training examples: real frames on the natural mesh, and GT* targets on the caricature mesh of their level."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

from carigs.capture import Camera, Capture, Frame
from carigs.capture.images import read_bits, read_rgb8
from carigs.capture.target_index import TargetSet
from carigs.errors import InputError
from carigs.gtstar.mask_flags import flags_from_names
from carigs.settings import DEFAULT_MASK_FLAGS
from carigs.splat.training.image_cache import ImageCache
from carigs.splat.training.outlines import Outlines


class Example(NamedTuple):
    """One supervised view.

    Attributes:
        timestep: Timestep of the capture.
        camera: The view.
        level: Exaggeration of the mesh that is rendered: 0 for a real frame.
        image: RGB that the rendered image is compared with.
        valid: Pixels that supervise; all if None.
        frozen: Triangles whose surfels are frozen in this step; none if None.
        weight: Factor on the loss.
        emphasis: Factors on the gradient of each pixel; all 1 if None.
    """

    timestep: int
    camera: Camera
    level: float
    image: Float32[np.ndarray, "h w 3"] | UInt8[np.ndarray, "h w 3"]
    valid: Bool[np.ndarray, "h w"] | None
    frozen: Bool[np.ndarray, " f"] | None = None
    weight: float = 1.0
    emphasis: Float32[np.ndarray, "h w"] | None = None


@dataclass
class Supervision:
    """The training examples of a run: real frames, and the GT* targets of every level.

    Masking: masked pixels of GT* targets do not supervise. Freezing: triangles that are masked in all targets of a
    level (hair, eyelids) are marked in `Example.frozen`; in GT* steps the trainer passes the surfels on them to
    `Adam.step` as frozen, which leaves their values and moments unchanged. `kept` triangles are marked in all steps.

    Attributes:
        capture: The captured subject.
        sets: GT* targets, one set per level.
        mask_flags: Names of the mask flags for which pixels are left out and triangles frozen.
        megabytes: Memory for decoded images.
        kept: Triangles whose surfels stay as they are at the start; None if there are none.
        outlines: Factors on pixels near the outline of the mesh; None if all pixels weigh the same.
        replaced: Images that stand for those of real frames, by index: what edits have made of them.

    Raises:
        InputError: If the capture has no training frames.
    """

    capture: Capture
    sets: Sequence[TargetSet] = ()
    mask_flags: tuple[str, ...] = DEFAULT_MASK_FLAGS
    megabytes: int = 2048
    kept: Bool[np.ndarray, " f"] | None = None
    outlines: Outlines | None = None
    replaced: Mapping[int, UInt8[np.ndarray, "h w 3"]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.frames = self.capture.split("train")
        self._excluded = np.uint16(flags_from_names(self.mask_flags).value)
        self._images = ImageCache(self.megabytes)
        if not self.frames:
            raise InputError("no training frames", file=self.capture.root, field="train")
        self.targets = tuple(target for target_set in self.sets for target in target_set.targets)
        frozen = {target_set.level: (target_set.face_flags & self._excluded) > 0 for target_set in self.sets}
        if self.kept is not None:
            frozen = {level: faces | self.kept for level, faces in frozen.items()}
        self._frozen = {level: faces for level, faces in frozen.items() if faces.any()}

    def files(self) -> list[Path]:
        """List the files that a run may read.

        Returns:
            Every image and mask.
        """
        files = [self.capture.root / frame.image for frame in self.frames]
        return files + [file for target in self.targets for file in (target.image, target.mask_flags)]

    def example(self, gtstar: bool, index: int) -> Example:
        """Read a training example.

        Args:
            gtstar: Whether to take a GT* target, not a real frame.
            index: Index of the frame or target.

        Returns:
            The example.

        Raises:
            InputError: If an image is missing or of another size than its camera.
        """
        stored = self.stored_example(gtstar, index)
        return stored._replace(image=np.divide(stored.image, np.float32(255), dtype=np.float32))

    def stored_example(self, gtstar: bool, index: int) -> Example:
        """Read a training example as `example`, with its image in bytes, as it is stored.

        Args:
            gtstar: As in `example`.
            index: As in `example`.

        Returns:
            The example; its image has values from 0 to 255 (uint8).
        """
        if not gtstar:
            frame = self.frames[index]
            camera = self.capture.camera(frame)
            image = self.replaced.get(index)
            if image is None:
                image = self._images.get(self.capture.root / frame.image, partial(self._frame_planes, frame))
            return Example(
                frame.timestep, camera, 0.0, _of_size(image, camera, frame.image), None, self.kept,
                emphasis=self._emphasis(frame, 0.0),
            )  # fmt: skip
        frame, level, file, flags, weight = self.targets[index]
        camera = self.capture.camera(frame)
        image, valid = self._images.get(file, self._read_planes), None
        if self.mask_flags:
            valid = (_of_size(self._images.get(flags, read_bits), camera, flags) & self._excluded) == 0
        return Example(
            frame.timestep, camera, level, _of_size(image, camera, file), valid, self._frozen.get(level), weight,
            self._emphasis(frame, level),
        )  # fmt: skip

    def prefetch(self, gtstar: bool, index: int) -> None:
        """Begin to decode the images of an example in the background.

        Args:
            gtstar: As in `example`.
            index: As in `example`.
        """
        if not gtstar:
            if index in self.replaced:
                return
            frame = self.frames[index]
            self._images.prefetch(self.capture.root / frame.image, partial(self._frame_planes, frame))
            return
        target = self.targets[index]
        self._images.prefetch(target.image, self._read_planes)
        if self.mask_flags:
            self._images.prefetch(target.mask_flags, read_bits)

    def weighted_example(self, gtstar: bool, index: int) -> tuple[Example, Float[np.ndarray, "h w"]]:
        """Read a training example and how much of each pixel belongs to the subject.

        Args:
            gtstar: As in `example`.
            index: As in `example`.

        Returns:
            The example, and its matte; 0 at pixels that do not supervise.
        """
        example = self.example(gtstar, index)
        frame = self.targets[index].frame if gtstar else self.frames[index]
        matte = _of_size(self.capture.foreground(frame), example.camera, frame.mask or frame.image)
        return example, matte if example.valid is None else matte * example.valid

    def _emphasis(self, frame: Frame, level: float) -> Float32[np.ndarray, "h w"] | None:
        if self.outlines is None:
            return None
        return self.outlines.emphasis(frame.timestep, frame.camera, self.capture.camera(frame), level)

    def _frame_planes(self, frame: Frame, _file: Path) -> UInt8[np.ndarray, "h w 3"]:
        """Read the image of a frame as `_read_planes`."""
        return _as_planes(self.capture.image8(frame))

    def _read_planes(self, file: Path) -> UInt8[np.ndarray, "h w 3"]:
        """Read an image with its channels as planes in memory, as the loss needs them."""
        return _as_planes(read_rgb8(file, self.capture.background))


def _as_planes(image: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h w 3"]:
    return np.ascontiguousarray(image.transpose(2, 0, 1)).transpose(1, 2, 0)


def _of_size(pixels: np.ndarray, camera: Camera, file: object) -> np.ndarray:
    """The pixels, if they are as many as the camera's."""
    if pixels.shape[:2] != (camera.height, camera.width):
        size = f"{pixels.shape[1]} x {pixels.shape[0]}"
        raise InputError(f"{size} pixels, its camera has {camera.width} x {camera.height}", file=str(file))
    return pixels
