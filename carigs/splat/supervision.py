"""What supervises each step: a real frame on the natural mesh, or a GT* target on the caricature's."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt8

from carigs.capture import Camera, Capture
from carigs.capture.images import read_grey, read_rgb8
from carigs.errors import InputError
from carigs.splat.image_cache import ImageCache


class Example(NamedTuple):
    """One supervised view."""

    timestep: int
    camera: Camera
    level: float
    """Level of the mesh that is rendered."""
    image: Float32[np.ndarray, "h w 3"]
    valid: Bool[np.ndarray, "h w"] | None
    """Pixels that may supervise; all of them if None."""


class Schedule(NamedTuple):
    """Which example each step takes: fixed before the first step, so that a resumed run sees the same."""

    caricature: Bool[np.ndarray, "n"]
    index: Int[np.ndarray, "n"]
    """Into the training frames, or into the targets."""


def draw_schedule(iterations: int, frames: int, targets: int, caricature_share: float, seed: int) -> Schedule:
    """A Bernoulli draw per step; within each kind every example once in random order, then all over again."""
    rng = np.random.default_rng([seed, 0])
    caricature = rng.random(iterations) < caricature_share
    index = np.zeros(iterations, np.int64)
    for kind, count in ((False, frames), (True, targets)):
        steps = np.flatnonzero(caricature == kind)
        if len(steps):
            epochs = -(-len(steps) // count)
            index[steps] = np.concatenate([rng.permutation(count) for _ in range(epochs)])[: len(steps)]
    return Schedule(caricature, index)


@dataclass
class Supervision:
    """The examples of a run."""

    capture: Capture
    targets: Path | None
    gamma_f: float
    masks: bool = True
    megabytes: int = 2048

    def __post_init__(self) -> None:
        self.frames = self.capture.split("train")
        self._images = ImageCache(self.megabytes)
        if not self.frames:
            raise InputError("no training frames", file=self.capture.root, field="train")
        self.target_frames = ()
        if self.targets is not None:
            self.target_frames = tuple(f for f in self.frames if (self.targets / f"{f.name}.png").is_file())
            if not self.target_frames:
                raise InputError("holds no targets of the training frames", file=self.targets)

    def frozen_faces(self) -> Bool[np.ndarray, "f"] | None:
        """Faces whose surfels rest in caricature steps; None if there are none."""
        if self.targets is None or not self.masks:
            return None
        file = self.targets / "frozen.npy"
        if not file.is_file():
            raise InputError("no such file", file=file)
        frozen = np.load(file)
        if frozen.shape != (len(self.capture.model.faces),) or frozen.dtype != bool:
            raise InputError(f"{frozen.dtype} {frozen.shape}, expected one bool per face", file=file)
        return frozen if frozen.any() else None

    def files(self) -> list[Path]:
        """Every image and mask that may be read."""
        root = self.capture.root
        files = [root / f.image for f in self.frames]
        return files + [self.targets / f"{f.name}{end}.png" for f in self.target_frames for end in ("", "_mask")]

    def example(self, caricature: bool, index: int) -> Example:
        """Training frame or target number `index`."""
        frame = self.target_frames[index] if caricature else self.frames[index]
        camera = self.capture.cameras[frame.camera]
        if not caricature:
            image = self._images.get(self.capture.root / frame.image, _read_planes)
            return Example(frame.timestep, camera, 0.0, _as_float(image, camera, frame.image), None)
        file = self.targets / f"{frame.name}.png"
        image, valid = self._images.get(file, _read_planes), None
        if self.masks:
            valid = self._images.get(file.with_name(f"{frame.name}_mask.png"), _read_mask).view(bool)
        return Example(frame.timestep, camera, self.gamma_f, _as_float(image, camera, file), valid)

    def decode_ahead(self, caricature: bool, index: int) -> None:
        """Say which example will be wanted soon."""
        if not caricature:
            self._images.ask(self.capture.root / self.frames[index].image, _read_planes)
            return
        file = self.targets / f"{self.target_frames[index].name}.png"
        self._images.ask(file, _read_planes)
        if self.masks:
            self._images.ask(file.with_name(f"{file.stem}_mask.png"), _read_mask)

    def first_view(self, caricature: bool, index: int) -> tuple[Example, Float[np.ndarray, "h w"]]:
        """An example, and how far each of its pixels may be taken for the person's: the matte, or the mask's."""
        example = self.example(caricature, index)
        frame = self.target_frames[index] if caricature else self.frames[index]
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


def _read_mask(file: Path) -> UInt8[np.ndarray, "h w"]:
    return (read_grey(file) > 0.5).astype(np.uint8)
