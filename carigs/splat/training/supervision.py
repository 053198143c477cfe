"""What supervises each step: a real frame on the natural mesh, or a GT* target on the mesh of its level."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt8

from carigs.capture import Camera, Capture
from carigs.capture.images import read_bits, read_rgb8
from carigs.capture.target_index import TargetSet
from carigs.errors import InputError
from carigs.gtstar.mask_flags import flags_from_names
from carigs.settings import DEFAULT_MASK_FLAGS
from carigs.splat.training.image_cache import ImageCache


class Example(NamedTuple):
    """One supervised view."""

    timestep: int
    camera: Camera
    level: float
    """Level of the mesh that is rendered."""
    image: Float32[np.ndarray, "h w 3"]
    valid: Bool[np.ndarray, "h w"] | None
    """Pixels that may supervise; all of them if None."""
    frozen: Bool[np.ndarray, "f"] | None = None
    """Faces whose surfels rest in this step; none if None."""
    weight: float = 1.0
    """Of the loss."""


class Schedule(NamedTuple):
    """Which example each step takes: fixed before the first step, so that a resumed run sees the same."""

    caricature: Bool[np.ndarray, "n"]
    index: Int[np.ndarray, "n"]
    """Into the training frames, or into the targets of all levels."""


def draw_schedule(iterations: int, frames: int, targets: int, gtstar_probability: float, seed: int) -> Schedule:
    """A Bernoulli draw per step; within each kind every example once in random order, then all over again."""
    rng = np.random.default_rng([seed, 0])
    caricature = rng.random(iterations) < gtstar_probability
    index = np.zeros(iterations, np.int64)
    for kind, count in ((False, frames), (True, targets)):
        steps = np.flatnonzero(caricature == kind)
        if len(steps):
            epochs = -(-len(steps) // count)
            index[steps] = np.concatenate([rng.permutation(count) for _ in range(epochs)])[: len(steps)]
    return Schedule(caricature, index)


@dataclass
class Supervision:
    """The examples of a run: training frames, and the targets of each level."""

    capture: Capture
    sets: Sequence[TargetSet] = ()
    mask_flags: tuple[str, ...] = DEFAULT_MASK_FLAGS
    """Names of the reasons for which pixels are left out and triangles rest."""
    megabytes: int = 2048

    def __post_init__(self) -> None:
        self.frames = self.capture.split("train")
        self._excluded = np.uint16(flags_from_names(self.mask_flags).value)
        self._images = ImageCache(self.megabytes)
        if not self.frames:
            raise InputError("no training frames", file=self.capture.root, field="train")
        self.targets = tuple(target for level in self.sets for target in level.targets)
        self._frozen: dict[float, Bool[np.ndarray, "f"]] = {}
        for level in self.sets:
            frozen = (level.face_flags & self._excluded) > 0
            if frozen.any():
                self._frozen[level.level] = frozen

    def files(self) -> list[Path]:
        """Every image and mask that may be read."""
        root = self.capture.root
        files = [root / f.image for f in self.frames]
        return files + [file for target in self.targets for file in (target.image, target.mask_flags)]

    def example(self, caricature: bool, index: int) -> Example:
        """Training frame or target number `index`."""
        if not caricature:
            frame = self.frames[index]
            camera = self.capture.cameras[frame.camera]
            image = self._images.get(self.capture.root / frame.image, _read_planes)
            return Example(frame.timestep, camera, 0.0, _as_float(image, camera, frame.image), None)
        frame, level, file, reasons, weight = self.targets[index]
        camera = self.capture.cameras[frame.camera]
        image, valid = self._images.get(file, _read_planes), None
        if self.mask_flags:
            valid = (self._images.get(reasons, read_bits) & self._excluded) == 0
        return Example(
            frame.timestep, camera, level, _as_float(image, camera, file), valid, self._frozen.get(level), weight
        )

    def decode_ahead(self, caricature: bool, index: int) -> None:
        """Say which example will be wanted soon."""
        if not caricature:
            self._images.ask(self.capture.root / self.frames[index].image, _read_planes)
            return
        target = self.targets[index]
        self._images.ask(target.image, _read_planes)
        if self.mask_flags:
            self._images.ask(target.mask_flags, read_bits)

    def first_view(self, caricature: bool, index: int) -> tuple[Example, Float[np.ndarray, "h w"]]:
        """An example, and how far each of its pixels may be taken for the person's: the matte, or the mask's."""
        example = self.example(caricature, index)
        frame = self.targets[index].frame if caricature else self.frames[index]
        matte = self.capture.mask(frame)
        return example, matte if example.valid is None else matte * example.valid


def _as_float(pixels: UInt8[np.ndarray, "h w 3"], camera: Camera, file: object) -> Float32[np.ndarray, "h w 3"]:
    if pixels.shape[:2] != (camera.height, camera.width):
        size = f"{pixels.shape[1]} x {pixels.shape[0]}"
        raise InputError(f"{size} pixels, its camera has {camera.width} x {camera.height}", file=str(file))
    return np.divide(pixels, np.float32(255), dtype=np.float32)


def _read_planes(file: Path) -> UInt8[np.ndarray, "h w 3"]:
    """As planes in memory, which is how the loss takes them."""
    return np.ascontiguousarray(read_rgb8(file).transpose(2, 0, 1)).transpose(1, 2, 0)
