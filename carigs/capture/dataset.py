"""A capture, and its index (capture.json): frames, cameras and head parameters."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32, UInt8

from carigs.capture.camera import Camera
from carigs.capture.capture_json import cameras_from_json, cameras_to_json, frames_from_json, frames_to_json
from carigs.capture.corrections.colour_gains import with_gains
from carigs.capture.corrections.halo import without_halo
from carigs.capture.corrections.known_background import remake_matte
from carigs.capture.frame import Frame
from carigs.capture.images import differs_from_background, read_frame_matte8, read_rgb8
from carigs.errors import InputError
from carigs.head import HeadModel, HeadParameters
from carigs.readers.formats import Format, check_format
from carigs.readers.json_files import json_field, read_json
from carigs.system.files import write_json

FORMAT = Format("carigs-capture", 2, "run the stage capture again, as carigs run does")


@dataclass(frozen=True)
class Capture:
    """A capture of a subject. Images and parameters are read on demand."""

    root: Path
    head_model: Path
    frames: tuple[Frame, ...]
    calibrations: tuple[Camera, ...]
    """Distinct cameras. A camera of the dataset may have several: the trackers of some datasets move the cameras with
    the mean head of each sequence, and intrinsics may differ from frame to frame."""
    background: float
    """Grey value the images were composited on."""
    split_rule: str = "files"
    """How frames were divided into splits (`carigs.capture.splits`)."""
    cy: str = "opencv"
    """Convention of the files for cy, and how it was found. In memory it is always OpenCV's."""
    digest: str = ""
    """Of the contents of the dataset's files (`capture_digest`): stages that read images run again when it changes."""
    warnings: tuple[str, ...] = ()
    """What is likely to be wrong with the files, one line each."""

    def split(self, name: str) -> tuple[Frame, ...]:
        """Frames of a split.

        Args:
            name: `train`, `val` or `test`.

        Returns:
            Frames sorted by timestep, then camera.
        """
        return tuple(frame for frame in self.frames if frame.split == name)

    def camera(self, frame: Frame) -> Camera:
        """The camera of a frame.

        Args:
            frame: A frame of the capture.

        Returns:
            The camera, as calibrated for this frame.
        """
        return self.calibrations[frame.calibration]

    @cached_property
    def frame_at(self) -> dict[tuple[int, int], Frame]:
        """Frames by timestep and camera."""
        return {(frame.timestep, frame.camera): frame for frame in self.frames}

    @cached_property
    def cameras(self) -> dict[int, Camera]:
        """Each numbered camera as calibrated for its first frame: for what needs no more than where cameras stand."""
        numbered: dict[int, Camera] = {}
        for frame in self.frames:
            numbered.setdefault(frame.camera, self.calibrations[frame.calibration])
        return dict(sorted(numbered.items()))

    @cached_property
    def model(self) -> HeadModel:
        """The head model, read once."""
        return HeadModel.load(self.head_model)

    @cached_property
    def parameter_files(self) -> dict[int, str]:
        """File of the head parameters of each timestep, in the order of the frames."""
        return {frame.timestep: frame.parameters for frame in self.frames}

    def parameters(self, timestep: int) -> HeadParameters:
        """Tracked head parameters of a timestep.

        Args:
            timestep: Timestep of a frame of the capture.

        Returns:
            The parameters, checked against the head model.
        """
        return HeadParameters.load(self.root / self.parameter_files[timestep], self.model)

    def image8(self, frame: Frame) -> UInt8[np.ndarray, "h w 3"]:
        """Read the image of a frame; one with an alpha channel is composited on the background.

        Args:
            frame: A frame of the capture.

        Returns:
            sRGB colours from 0 to 255, without the halo and with the gains of the frame.
        """
        image = read_rgb8(self.root / frame.image, self.background)
        if frame.halo is not None:
            image = without_halo(image, self._foreground(frame, image), self.background, frame.halo)
        if frame.gains is None:
            return image
        return with_gains(image, self._foreground(frame, image), self.background, frame.gains)

    def image(self, frame: Frame) -> Float32[np.ndarray, "h w 3"]:
        """Read the image of a frame, as `image8`.

        Args:
            frame: A frame of the capture.

        Returns:
            sRGB colours in [0, 1].
        """
        return self.image8(frame).astype(np.float32) / 255

    def mask8(self, frame: Frame) -> UInt8[np.ndarray, "h w"] | None:
        """Read the foreground matte of a frame; one that does not fit the image is made anew near its outline.

        Args:
            frame: A frame of the capture.

        Returns:
            Opacity of the foreground from 0 to 255; None if the frame has no matte.
        """
        matte = read_frame_matte8(self.root, frame)
        if matte is None or not frame.remade:
            return matte
        image = read_rgb8(self.root / frame.image, self.background)
        return np.rint(255 * remake_matte(image, matte, self.background).alpha).astype(np.uint8)

    def mask(self, frame: Frame) -> Float32[np.ndarray, "h w"] | None:
        """Read the foreground matte of a frame, as `mask8`.

        Args:
            frame: A frame of the capture.

        Returns:
            Opacity of the foreground in [0, 1]; None if the frame has no matte.
        """
        matte = self.mask8(frame)
        return None if matte is None else matte.astype(np.float32) / 255

    def foreground(self, frame: Frame) -> Float32[np.ndarray, "h w"]:
        """The matte of a frame, or an estimate.

        Args:
            frame: A frame of the capture.

        Returns:
            Opacity of the foreground in [0, 1]. Without a matte, 1 where the image differs from the stated background.
        """
        return self._foreground(frame, None)

    def _foreground(self, frame: Frame, stored: UInt8[np.ndarray, "h w 3"] | None) -> Float32[np.ndarray, "h w"]:
        """The matte, or an estimate from the image as it is stored: gains would change what differs by a tolerance."""
        matte = self.mask(frame)
        if matte is not None:
            return matte
        image = read_rgb8(self.root / frame.image, self.background) if stored is None else stored
        return differs_from_background(image, self.background).astype(np.float32)

    @property
    def validation_camera(self) -> int:
        """The camera of the `val` split; the most frontal camera if that split has none or several."""
        held_out = {frame.camera for frame in self.split("val")}
        if len(held_out) == 1:
            return held_out.pop()
        return max(self.cameras, key=lambda c: self.cameras[c].centre[2] / np.linalg.norm(self.cameras[c].centre))

    def save(self, file: Path) -> None:
        """Write the index.

        A root or head model inside the folder of the index is stored as a relative path, so that the folder can move.

        Args:
            file: Path of capture.json.
        """
        content = {
            "format": str(FORMAT),
            "root": _relative(self.root, file.parent),
            "head_model": _relative(self.head_model, file.parent),
            "background": self.background,
            "split_rule": self.split_rule,
            "cy": self.cy,
            "digest": self.digest,
            "warnings": list(self.warnings),
            "cameras": cameras_to_json(self.calibrations),
            **frames_to_json(self.frames),
        }
        write_json(file, content)

    @classmethod
    def load(cls, file: Path) -> Capture:
        """Read an index.

        Args:
            file: Path of capture.json.

        Returns:
            The capture.

        Raises:
            InputError: If the index is missing, broken, or of another format, or if a value is of another type or not
                possible.
        """
        content = read_json(file, dict)
        check_format(content.get("format"), FORMAT, file)

        def field(key: str, kind: type) -> Any:
            return json_field(content, key, kind, file=file)

        background = float(field("background", float))
        if not 0 <= background <= 1:
            raise InputError(f"{background:g} is not in [0, 1]", file=file, field="background")
        cameras = cameras_from_json(field("cameras", list), file)
        return cls(
            root=Path(file).parent / field("root", str),
            head_model=Path(file).parent / field("head_model", str),
            background=background,
            calibrations=cameras,
            frames=frames_from_json(content, file, len(cameras)),
            split_rule=field("split_rule", str),
            cy=field("cy", str),
            digest=field("digest", str),
            warnings=tuple(map(str, field("warnings", list))) if "warnings" in content else (),
        )


def _relative(path: Path, folder: Path) -> str:
    path, folder = path.resolve(), folder.resolve()
    return os.path.relpath(path, folder) if path.is_relative_to(folder) else str(path)
