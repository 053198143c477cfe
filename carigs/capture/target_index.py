"""The index of the GT* frames of one level (targets.json) and the folder that it names."""

from __future__ import annotations

from dataclasses import dataclass
from os.path import relpath
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import UInt16

from carigs.capture.dataset import Capture
from carigs.capture.frame import Frame
from carigs.errors import InputError
from carigs.readers.formats import Format, check_format
from carigs.readers.json_files import json_field, read_json
from carigs.readers.npz import read_npy
from carigs.system.files import write_json

FORMAT = Format("carigs-targets", 1, "run the stage gtstar again, as carigs run does")
FACE_FLAGS = "faces.npy"
SHADING = "shading.npz"


class TargetFrame(NamedTuple):
    """A GT* frame on disk."""

    frame: Frame
    """The training frame that it was made from."""
    level: float
    image: Path
    mask_flags: Path
    """Image of the bits of `MaskFlag`."""
    weight: float
    """Weight of its loss, below 1 for frames with a registration error."""


@dataclass(frozen=True)
class TargetSet:
    """The GT* frames of one level."""

    level: float
    folder: Path
    targets: tuple[TargetFrame, ...]
    face_flags: UInt16[np.ndarray, " f"]
    """Bits of `MaskFlag` that hold for a triangle in every frame."""


def read_targets(index: Path, capture: Capture) -> TargetSet:
    """Read targets.json and the flags of the triangles; images are not read.

    Args:
        index: The index.
        capture: The capture that the targets were made from.

    Returns:
        The targets in the order of the index.

    Raises:
        InputError: If the index is broken or belongs to another capture.
    """
    content = read_json(index, dict)
    check_format(content.get("format", "carigs-targets-1"), FORMAT, index)  # the first ones stated none
    level = float(json_field(content, "level", float, file=index))
    if not abs(level) <= 100:
        raise InputError(f"{level:g} is not in [-100, 100]", file=index, field="level")
    folder = index.parent / json_field(content, "folder", str, file=index)
    entries = json_field(content, "targets", list, file=index)
    if not entries:
        raise InputError("no frame has a target; run the stage gtstar again", file=index, field="targets")
    frames = {(frame.timestep, frame.camera): frame for frame in capture.split("train")}
    targets = []
    for i, entry in enumerate(entries):
        where = f"targets[{i}]"
        timestep, camera, image, mask_flags = (
            json_field(entry, key, kind, file=index, where=where)
            for key, kind in (("timestep", int), ("camera", int), ("image", str), ("mask_flags", str))
        )
        weight = json_field({"weight": 1.0, **entry}, "weight", float, file=index, where=where)
        if (timestep, camera) not in frames:
            raise InputError("the capture has no such training frame", file=index, field=where)
        if not 0 <= weight <= 1:
            raise InputError(f"{weight} is not in [0, 1]", file=index, field=f"{where}.weight")
        frame = frames[timestep, camera]
        targets.append(TargetFrame(frame, level, folder / image, folder / mask_flags, float(weight)))
    return TargetSet(level, folder, tuple(targets), _read_face_flags(folder / FACE_FLAGS, len(capture.model.faces)))


def write_targets(
    index: Path, level: float, folder: Path, targets: list[dict[str, Any]], skipped: list[dict[str, Any]]
) -> None:
    """Write targets.json.

    Args:
        index: The index.
        level: Exaggeration level.
        folder: Folder of the images.
        targets: Per GT* frame its timestep, camera, image, mask flags, weight and statistics.
        skipped: Per frame without a target its timestep, camera and the reason (`why`).
    """
    content = {"level": level, "folder": relpath(folder, index.parent), "targets": targets, "left_out": skipped}
    content = {"format": str(FORMAT), **content}
    write_json(index, content)


def _read_face_flags(file: Path, count: int) -> UInt16[np.ndarray, " f"]:
    flags = read_npy(file)
    if flags.shape != (count,) or flags.dtype != np.uint16:
        raise InputError(f"{flags.dtype} {flags.shape}, expected 16 bits for each of {count} faces", file=file)
    return flags
