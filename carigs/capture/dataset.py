"""The index of a capture (capture.json): frames, cameras and head parameters."""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32

from carigs.capture.camera import Camera
from carigs.capture.camera_checks import check_intrinsics, check_rigid
from carigs.capture.images import read_grey, read_rgb
from carigs.errors import InputError
from carigs.files import write_json
from carigs.head import HeadModel, HeadParameters
from carigs.readers.arrays import checked_array
from carigs.readers.json_files import json_field, read_json
from carigs.readers.limits import MAX_IMAGE_PIXELS

FORMAT = "carigs-capture-1"
SPLITS = ("train", "val", "test")
MAX_NUMBER = 1_000_000_000
"""Largest number of a timestep or camera."""


@dataclass(frozen=True)
class Frame:
    """One image of one camera at one timestep. File names are relative to the capture's root."""

    timestep: int
    camera: int
    sequence: str
    split: str
    """`train`, `val` (held-out view of the training timesteps) or `test` (held-out sequence)."""
    image: str
    mask: str
    parameters: str

    @property
    def name(self) -> str:
        """`{timestep:05d}_{camera:02d}`, the stem of the names of all files derived from this frame."""
        return f"{self.timestep:05d}_{self.camera:02d}"


@dataclass(frozen=True)
class Capture:
    """A capture of a subject. Images and parameters are read on demand."""

    root: Path
    head_model: Path
    frames: tuple[Frame, ...]
    cameras: dict[int, Camera]
    background: float
    """Grey value the images were composited on."""
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

    def image(self, frame: Frame) -> Float32[np.ndarray, "h w 3"]:
        """Read the image of a frame.

        Args:
            frame: A frame of the capture.

        Returns:
            sRGB colours in [0, 1].
        """
        return read_rgb(self.root / frame.image)

    def mask(self, frame: Frame) -> Float32[np.ndarray, "h w"]:
        """Read the foreground matte of a frame.

        Args:
            frame: A frame of the capture.

        Returns:
            Opacity of the foreground in [0, 1].
        """
        return read_grey(self.root / frame.mask)

    @property
    def validation_camera(self) -> int:
        """The camera of the `val` split; the most frontal camera if that split is empty."""
        held_out = self.split("val")
        if held_out:
            return held_out[0].camera
        return max(self.cameras, key=lambda c: self.cameras[c].centre[2] / np.linalg.norm(self.cameras[c].centre))

    def save(self, file: Path) -> None:
        """Write the index.

        A root or head model inside the folder of the index is stored as a relative path, so that the folder can move.

        Args:
            file: Path of capture.json.
        """
        content = {
            "format": FORMAT,
            "root": _relative(self.root, file.parent),
            "head_model": _relative(self.head_model, file.parent),
            "background": self.background,
            "warnings": list(self.warnings),
            "cameras": {
                str(c): {**asdict(camera), "camera_from_world": camera.camera_from_world.tolist()}
                for c, camera in self.cameras.items()
            },
            "frames": [asdict(frame) for frame in self.frames],
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
        if content.get("format") != FORMAT:
            raise InputError(f"not a {FORMAT} index", file=file, field="format")

        def field(key: str, kind: type) -> Any:
            return json_field(content, key, kind, file=file)

        background = float(field("background", float))
        if not 0 <= background <= 1:
            raise InputError(f"{background:g} is not in [0, 1]", file=file, field="background")
        cameras = {number: _camera(entry, number, file) for number, entry in field("cameras", dict).items()}
        frames = tuple(_frame(entry, i, file) for i, entry in enumerate(field("frames", list)))
        seen = set()
        for i, frame in enumerate(frames):
            if str(frame.camera) not in cameras:
                raise InputError(f"there is no camera {frame.camera}", file=file, field=f"frames[{i}].camera")
            if (frame.timestep, frame.camera) in seen:
                raise InputError("timestep and camera appear twice", file=file, field=f"frames[{i}]")
            seen.add((frame.timestep, frame.camera))
        return cls(
            root=Path(file).parent / field("root", str),
            head_model=Path(file).parent / field("head_model", str),
            background=background,
            cameras={int(number): camera for number, camera in cameras.items()},
            frames=frames,
            warnings=tuple(map(str, field("warnings", list))) if "warnings" in content else (),
        )


def _camera(entry: Any, number: str, file: Path) -> Camera:
    """A camera of the index: a rigid transform and positive sizes, which kernels rely on."""
    where = f"cameras.{number[:20]}"
    if not (number.isascii() and number.isdigit() and str(int(number)) == number):
        raise InputError("expected a whole number as name", file=file, field=where)
    fx, fy, cx, cy = (float(json_field(entry, key, float, file=file, where=where)) for key in ("fx", "fy", "cx", "cy"))
    width, height = (json_field(entry, key, int, file=file, where=where) for key in ("width", "height"))
    if not (width > 0 and height > 0 and width * height <= MAX_IMAGE_PIXELS):
        raise InputError(f"{width} x {height} pixels are impossible", file=file, field=where)
    rows = {f"{where}.camera_from_world": json_field(entry, "camera_from_world", list, file=file, where=where)}
    pose = checked_array(rows, f"{where}.camera_from_world", (4, 4), np.float64, file=file)
    check_rigid(pose, file, f"{where}.camera_from_world")
    camera = Camera(pose, fx, fy, cx, cy, width, height)
    check_intrinsics(camera, file, where)
    return camera


def _frame(entry: Any, i: int, file: Path) -> Frame:
    where = f"frames[{i}]"
    values = {
        f.name: json_field(entry, f.name, int if f.name in ("timestep", "camera") else str, file=file, where=where)
        for f in fields(Frame)
    }
    for key in ("timestep", "camera"):
        if not 0 <= values[key] <= MAX_NUMBER:
            raise InputError(f"{values[key]} is not in 0..{MAX_NUMBER}", file=file, field=f"{where}.{key}")
    if values["split"] not in SPLITS:
        problem = f"{values['split'][:60]} is unknown; known: {', '.join(SPLITS)}"
        raise InputError(problem, file=file, field=f"{where}.split")
    return Frame(**values)


def _relative(path: Path, folder: Path) -> str:
    path, folder = path.resolve(), folder.resolve()
    return os.path.relpath(path, folder) if path.is_relative_to(folder) else str(path)
