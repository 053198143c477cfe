"""Images of Ava-256 as PNG: out of their archives, with a matte from the labels as alpha channel."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path, PurePosixPath

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from carigs.capture.camera import Camera
from carigs.capture.frame import Frame
from carigs.capture.importers.ava256 import LABELS, Calibration, members_by_number
from carigs.errors import InputError
from carigs.readers.archives import Archive
from carigs.readers.images import parse_avif, parse_pixels
from carigs.readers.limits import MAX_IMAGE_BYTES

BEHIND = (0, 3)
"""Classes that are no part of the person: what has no class, and the chair."""
LABELS_FOLDER = "labels"
"""Folder of the labels in the dataset; `hair.labels` may name it."""
MOST_OPEN = 4
"""Archives that are open at once."""


class UnpackedImages:
    """Writes the images of frames into a dataset; a `Place` of `write_dataset`.

    Args:
        folder: What the paths of the frames are relative to.
        frames: Frames by the path of their image.
        cameras: The cameras of the frames.
        kept: Share of a frame's matte that is kept, for each pixel.
        lenses: Calibrations by the names of the cameras whose images are undistorted.
    """

    def __init__(
        self,
        folder: Path,
        frames: Mapping[str, Frame],
        cameras: tuple[Camera, ...],
        kept: Callable[[Frame], Float[np.ndarray, "h w"]],
        lenses: Mapping[str, Calibration],
    ) -> None:
        self._folder, self._frames, self._cameras = folder, frames, cameras
        self._kept, self._lenses = kept, lenses
        self._open: dict[Path, tuple[Archive, dict[int, str]]] = {}

    def __call__(self, source: Path, part: Path, folder: Path, name: str) -> str:
        """Write an image, and its labels into the folder `labels`.

        Args:
            source: Path of the image, below its archive.
            part: As of `carigs.capture.dataset_writer.copied`.
            folder: Likewise.
            name: Likewise; the suffix becomes that of PNG.

        Returns:
            The path in the dataset.

        Raises:
            InputError: If the image or its labels are missing, broken, or of another size than those of the camera.
        """
        image = source.relative_to(self._folder)
        frame, archive = self._frames[image.as_posix()], Path(*image.parts[:2])
        camera = self._cameras[frame.calibration]
        lens = self._lenses.get(archive.stem.removeprefix("cam"))
        content, file = self._member(self._folder / archive, frame.timestep, ".avif")
        pixels = parse_avif(content, file)[..., ::-1]
        if pixels.shape[:2] != (camera.height, camera.width):
            problem = f"{pixels.shape[1]} x {pixels.shape[0]} pixels"
            raise InputError(f"{problem}, others have {camera.width} x {camera.height}", file=file)
        pixels = _undistorted(np.ascontiguousarray(pixels), camera, lens, cv2.INTER_LINEAR)
        png = PurePosixPath(name).with_suffix(".png")
        if frame.mask is not None:
            content, file = self._member(self._folder / LABELS / archive.name, frame.timestep, ".png")
            labels = parse_pixels(content, file)
            if labels.ndim != 2 or labels.dtype != np.uint8:
                raise InputError("expected a grey image of 8 bits", file=file)
            if labels.shape != pixels.shape[:2]:
                labels = cv2.resize(labels, pixels.shape[1::-1], interpolation=cv2.INTER_NEAREST)
            labels = _undistorted(labels, camera, lens, cv2.INTER_NEAREST)
            alpha = np.rint(255 * self._kept(frame) * ~np.isin(labels, BEHIND)).astype(np.uint8)
            pixels = np.dstack([pixels, alpha])
            _write(part / LABELS_FOLDER / png.name, labels)
        _write(part / png, pixels)
        return png.as_posix()

    def _member(self, file: Path, timestep: int, suffix: str) -> tuple[bytes, Path]:
        """A member of an archive, and its path for messages."""
        if file not in self._open:
            if len(self._open) == MOST_OPEN:
                self._open.pop(next(iter(self._open)))[0].close()
            archive = Archive(file)
            self._open[file] = archive, members_by_number(archive, suffix)
        archive, members = self._open[file]
        name = members[timestep]
        return archive.read(name, MAX_IMAGE_BYTES), file / name


def _write(file: Path, pixels: UInt8[np.ndarray, "h w *c"]) -> None:
    file.parent.mkdir(exist_ok=True)
    file.write_bytes(cv2.imencode(".png", pixels)[1].tobytes())


def _undistorted(
    pixels: UInt8[np.ndarray, "h w *c"], camera: Camera, lens: Calibration | None, interpolation: int
) -> UInt8[np.ndarray, "h w *c"]:
    """The image that the pinhole camera would have taken; the same image without a lens."""
    if lens is None:
        return pixels
    fx, fy, cx, cy = camera.intrinsics
    intrinsics = np.array([[fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1]])
    size = (camera.width, camera.height)
    maps = cv2.initUndistortRectifyMap(intrinsics, lens.distortion, None, intrinsics, size, cv2.CV_32FC1)
    return cv2.remap(pixels, *maps, interpolation, borderMode=cv2.BORDER_CONSTANT)
