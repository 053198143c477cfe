"""The index of a capture (capture.json): frames, cameras and head parameters."""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from carigs.capture.camera import Camera
from carigs.capture.images import read_grey, read_rgb
from carigs.errors import InputError
from carigs.files import write_json
from carigs.head import HeadModel, HeadParameters
from carigs.readers.json_files import read_json

FORMAT = "carigs-capture-1"
SPLITS = ("train", "val", "test")


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
    def _parameter_files(self) -> dict[int, str]:
        return {frame.timestep: frame.parameters for frame in self.frames}

    def parameters(self, timestep: int) -> HeadParameters:
        """Tracked head parameters of a timestep.

        Args:
            timestep: Timestep of a frame of the capture.

        Returns:
            The parameters, checked against the head model.
        """
        return HeadParameters.load(self.root / self._parameter_files[timestep], self.model)

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
            InputError: If the index is missing, broken, or of another format.
        """
        content = read_json(file)
        if not isinstance(content, dict) or content.get("format") != FORMAT:
            raise InputError(f"not a {FORMAT} index", file=file, field="format")
        try:
            return cls(
                root=Path(file).parent / content["root"],
                head_model=Path(file).parent / content["head_model"],
                background=float(content["background"]),
                cameras={
                    int(c): Camera(**{**camera, "camera_from_world": np.array(camera["camera_from_world"])})
                    for c, camera in content["cameras"].items()
                },
                frames=tuple(Frame(**frame) for frame in content["frames"]),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"broken index ({error!r})", file=file) from error


def _relative(path: Path, folder: Path) -> str:
    path, folder = path.resolve(), folder.resolve()
    return os.path.relpath(path, folder) if path.is_relative_to(folder) else str(path)
