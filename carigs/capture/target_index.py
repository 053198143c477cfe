"""The targets of one level as training reads them: the index that stage `gtstar` writes beside their folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import UInt16

from carigs.capture import Capture, Frame
from carigs.capture.dataset import read_json
from carigs.errors import InputError


class Target(NamedTuple):
    """A GT* frame on disk."""

    frame: Frame
    """That it was made of."""
    level: float
    image: Path
    reasons: Path
    weight: float
    """Of its loss: below 1 where the frame is off its mesh."""


@dataclass(frozen=True)
class TargetSet:
    """The GT* frames of one level, and what holds for triangles in all of them."""

    level: float
    folder: Path
    targets: tuple[Target, ...]
    of_faces: UInt16[np.ndarray, "f"]
    """Reasons of every triangle."""


def read_targets(index: Path, subject: Capture) -> TargetSet:
    """Raises `InputError` for an index that is broken or of another capture; images are read when they are needed."""
    content = read_json(index)

    def refuse(bad: bool, field: str, problem: str) -> None:
        if bad:
            raise InputError(problem, file=index, field=field)

    refuse(not isinstance(content, dict), "", "expected an object")
    for field, kinds in (("level", (int, float)), ("folder", str), ("targets", list)):
        refuse(not isinstance(content.get(field), kinds), field, "missing, or of another type")
    level, folder = float(content["level"]), index.parent / content["folder"]
    refuse(not content["targets"], "targets", "holds none")
    frames = {(frame.timestep, frame.camera): frame for frame in subject.split("train")}
    targets = []
    for i, entry in enumerate(content["targets"]):
        for key, kinds in (("timestep", int), ("camera", int), ("image", str), ("reasons", str)):
            known = isinstance(entry, dict) and isinstance(entry.get(key), kinds)
            refuse(not known, f"targets[{i}].{key}", "missing, or of another type")
        frame, weight = frames.get((entry["timestep"], entry["camera"])), entry.get("weight", 1.0)
        refuse(frame is None, f"targets[{i}]", "the capture has no such training frame")
        number = isinstance(weight, (int, float)) and 0 <= weight <= 1
        refuse(not number, f"targets[{i}].weight", f"{weight} is no number in [0, 1]")
        targets.append(Target(frame, level, folder / entry["image"], folder / entry["reasons"], float(weight)))
    return TargetSet(level, folder, tuple(targets), _of_faces(folder / "faces.npy", len(subject.model.faces)))


def _of_faces(file: Path, count: int) -> UInt16[np.ndarray, "f"]:
    try:
        reasons = np.load(file)
    except FileNotFoundError as error:
        raise InputError("no such file", file=file) from error
    except (OSError, ValueError, EOFError) as error:
        raise InputError(f"not a readable .npy ({error})", file=file) from error
    if reasons.shape != (count,) or reasons.dtype != np.uint16:
        raise InputError(f"{reasons.dtype} {reasons.shape}, expected 16 bits for each of {count} faces", file=file)
    return reasons
