"""What supervises each step: a real frame on the natural mesh, or a GT* target on the caricature's."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt8

from carigs.capture import Camera, Capture
from carigs.capture.images import read_bits, read_rgb8
from carigs.errors import InputError
from carigs.settings import EXCLUDED
from carigs.splat.image_cache import ImageCache
from carigs.target.reasons import as_bits


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
    exclude: tuple[str, ...] = EXCLUDED
    """Names of the reasons for which pixels are left out and triangles rest."""
    megabytes: int = 2048

    def __post_init__(self) -> None:
        self.frames = self.capture.split("train")
        self._excluded = np.uint16(as_bits(self.exclude).value)
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
        if self.targets is None or not self.exclude:
            return None
        file = self.targets / "faces.npy"
        if not file.is_file():
            raise InputError("no such file", file=file)
        reasons = np.load(file)
        if reasons.shape != (len(self.capture.model.faces),) or reasons.dtype != np.uint16:
            raise InputError(f"{reasons.dtype} {reasons.shape}, expected 16 bits per face", file=file)
        frozen = (reasons & self._excluded) > 0
        return frozen if frozen.any() else None

    def files(self) -> list[Path]:
        """Every image and mask that may be read."""
        root = self.capture.root
        files = [root / f.image for f in self.frames]
        return files + [self.targets / f"{f.name}{end}.png" for f in self.target_frames for end in ("", "_reasons")]

    def example(self, caricature: bool, index: int) -> Example:
        """Training frame or target number `index`."""
        frame = self.target_frames[index] if caricature else self.frames[index]
        camera = self.capture.cameras[frame.camera]
        if not caricature:
            image = self._images.get(self.capture.root / frame.image, _read_planes)
            return Example(frame.timestep, camera, 0.0, _as_float(image, camera, frame.image), None)
        file = self.targets / f"{frame.name}.png"
        image, valid = self._images.get(file, _read_planes), None
        if self.exclude:
            valid = (self._images.get(file.with_name(f"{frame.name}_reasons.png"), read_bits) & self._excluded) == 0
        return Example(frame.timestep, camera, self.gamma_f, _as_float(image, camera, file), valid)

    def decode_ahead(self, caricature: bool, index: int) -> None:
        """Say which example will be wanted soon."""
        if not caricature:
            self._images.ask(self.capture.root / self.frames[index].image, _read_planes)
            return
        file = self.targets / f"{self.target_frames[index].name}.png"
        self._images.ask(file, _read_planes)
        if self.exclude:
            self._images.ask(file.with_name(f"{file.stem}_reasons.png"), read_bits)

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
