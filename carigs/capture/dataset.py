"""The index of a capture: which frames there are, seen by which cameras, posed by which head parameters."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32

from carigs.capture.camera import Camera
from carigs.capture.images import read_grey, read_rgb
from carigs.errors import InputError
from carigs.files import writing
from carigs.head import HeadModel, HeadParameters

FORMAT = "carigs-capture-1"
SPLITS = ("train", "val", "test")


@dataclass(frozen=True)
class Frame:
    """One image of one camera at one timestep; files are relative to the capture's root."""

    timestep: int
    camera: int
    sequence: str
    split: str
    """`train`, `val` (novel view of the training timesteps) or `test` (held-out sequence)."""
    image: str
    mask: str
    parameters: str

    @property
    def name(self) -> str:
        """`{timestep:05d}_{camera:02d}`, the stem of everything made from this frame."""
        return f"{self.timestep:05d}_{self.camera:02d}"


@dataclass(frozen=True)
class Capture:
    """A subject's checked capture; images are read when asked for."""

    root: Path
    head_model: Path
    frames: tuple[Frame, ...]
    cameras: dict[int, Camera]
    background: float
    """Grey value the images were composited on."""

    def split(self, name: str) -> tuple[Frame, ...]:
        """Frames of `train`, `val` or `test`, by timestep, then camera."""
        return tuple(frame for frame in self.frames if frame.split == name)

    @cached_property
    def model(self) -> HeadModel:
        """The head model, read once."""
        return HeadModel.load(self.head_model)

    @cached_property
    def _parameter_files(self) -> dict[int, str]:
        return {frame.timestep: frame.parameters for frame in self.frames}

    def parameters(self, timestep: int) -> HeadParameters:
        """Tracked head parameters of a timestep."""
        return HeadParameters.load(self.root / self._parameter_files[timestep], self.model)

    def image(self, frame: Frame) -> Float32[np.ndarray, "h w 3"]:
        """The frame's colours."""
        return read_rgb(self.root / frame.image)

    def mask(self, frame: Frame) -> Float32[np.ndarray, "h w"]:
        """The frame's foreground matte."""
        return read_grey(self.root / frame.mask)

    @property
    def validation_camera(self) -> int:
        """The novel view; the most frontal camera where the capture holds none out."""
        held_out = self.split("val")
        if held_out:
            return held_out[0].camera
        return max(self.cameras, key=lambda c: self.cameras[c].centre[2] / np.linalg.norm(self.cameras[c].centre))

    def save(self, file: Path) -> None:
        """Write the index; a root or model inside the index's folder is stored relative to it, so that it can move."""
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
        with writing(file) as part:
            part.write_text(json.dumps(content, indent=1))

    @classmethod
    def load(cls, file: Path) -> Capture:
        """Read an index; raises `InputError` if it is missing, broken, or of another format."""
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


def read_json(file: Path) -> Any:
    """Parse a JSON file; raises `InputError` with line and column if it cannot be."""
    try:
        return json.loads(Path(file).read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise InputError("no such file", file=file) from error
    except json.JSONDecodeError as error:
        raise InputError(
            f"broken JSON: {error.msg}", file=file, field=f"line {error.lineno} column {error.colno}"
        ) from error
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot be read ({error})", file=file) from error


def _relative(path: Path, folder: Path) -> str:
    path, folder = path.resolve(), folder.resolve()
    return os.path.relpath(path, folder) if path.is_relative_to(folder) else str(path)
