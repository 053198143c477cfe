"""Datasets in the folder layout of GaussianAvatars and VHAP: transforms_{train,val,test}.json and what they name."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

from carigs.capture.camera_table import CameraTable
from carigs.capture.capture_json import MAX_NUMBER
from carigs.capture.dataset import Capture
from carigs.capture.dataset_checks import ListedFrame, sound_frames
from carigs.capture.dataset_paths import file_inside
from carigs.capture.frame import Frame
from carigs.capture.splits import split_frames
from carigs.errors import InputError, collecting
from carigs.head import HeadModel
from carigs.readers.file_names import INDEXES, SPLITS
from carigs.readers.json_files import json_field, read_json

SEQUENCE = re.compile(r"(?:EMO|EXP|SEN)-\d[^_]*|FREE|HAIR|GLASSES")
"""Sequences of NeRSemble."""


def read_dataset(
    folder: Path,
    head_model: Path,
    *,
    background: float = 1.0,
    split: str = "files",
    validation_camera: int | None = None,
    errors: list[InputError] | None = None,
) -> Capture:
    """Index a dataset and check all of it: files, image sizes, cameras and head parameters.

    Args:
        folder: The dataset. If the files divide the frames, `train` and `test` must have some; `val` may be empty or
            missing.
        head_model: File of the head model.
        background: Grey value that the images were composited on.
        split: How frames are divided, see `split_frames`.
        validation_camera: Camera of the validation frames, see `split_frames`.
        errors: Receives what is wrong with single frames and files, and such frames are left out, unless their cameras
            alone are impossible; None to raise the first error.

    Returns:
        The capture, with frames sorted by timestep, then camera.

    Raises:
        InputError: If anything is missing or inconsistent; names file and field. Without folder or head model, and
            where the split cannot be made, also if `errors` is given.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError("no such dataset folder", file=folder)
    model, table = HeadModel.load(head_model), CameraTable(errors)
    needed = ("train", "test") if split == "files" else ("train",)
    listed = [entry for name in SPLITS for entry in _read_split(folder, name, name in needed, table, errors)]
    frames = sound_frames(folder, listed, table, model, errors)
    frames.sort(key=lambda frame: (frame.timestep, frame.camera))
    if not frames and errors:
        divided, rule = (), split
    else:
        divided, rule = split_frames(frames, split, validation_camera, folder)
    return Capture(folder, Path(head_model), divided, tuple(table.cameras), background, rule)


def _read_split(
    folder: Path, split: str, is_needed: bool, table: CameraTable, errors: list[InputError] | None
) -> list[ListedFrame]:
    file, listed = folder / INDEXES[split], []
    if not is_needed and not file.exists():
        return listed
    with collecting(errors):
        content = read_json(file, dict)
        entries = json_field(content, "frames", list, file=file)
        if not entries and is_needed:
            raise InputError(f"the {split} split is empty", file=file, field="frames")
        for i, entry in enumerate(entries):
            with collecting(errors):
                frame = read_frame(entry, content, split, file, f"frames[{i}]", table)
                listed.append(ListedFrame(frame, file, f"frames[{i}]"))
    return listed


def read_frame(entry: Any, defaults: dict[str, Any], split: str, file: Path, where: str, table: CameraTable) -> Frame:
    """Read an entry of an index.

    Args:
        entry: The entry.
        defaults: Top level of the file: numbers of the camera that the entry lacks.
        split: The split of the file.
        file: The index.
        where: Position of the entry, for messages.
        table: Receives the camera.

    Returns:
        The frame.

    Raises:
        InputError: If a field is missing or not valid.
    """
    if not isinstance(entry, dict):
        raise InputError("expected an object", file=file, field=where)

    def field(key: str, kind: type) -> Any:
        return json_field(entry, key, kind, file=file, where=where)

    def path(key: str) -> str:
        return file_inside(field(key, str), file, f"{where}.{key}")

    timestep, camera = (_whole(field(key, float), file, f"{where}.{key}") for key in ("timestep_index", "camera_index"))
    image, parameters = path("file_path"), path("flame_param_path")
    mask = path("fg_mask_path") if entry.get("fg_mask_path") is not None else None
    intrinsics = _read_intrinsics(entry, defaults, file, where)
    calibration = table.number(field("transform_matrix", list), intrinsics, file, where)
    sequence = str(entry.get("sequence") or _sequence_of(image, file.parent))
    return Frame(timestep, camera, sequence, split, image, mask, parameters, calibration)


def _read_intrinsics(
    entry: dict[str, Any], defaults: dict[str, Any], file: Path, where: str
) -> tuple[float, float, float, float, int, int]:
    """fx, fy, cx, cy, width, height. Without focal lengths, the horizontal field of view holds."""

    def number(key: str, default: float | None = None) -> float:
        if key in entry:
            return float(json_field(entry, key, float, file=file, where=where))
        if key in defaults or default is None:
            return float(json_field(defaults, key, float, file=file, where="" if key in defaults else where))
        return default

    width, height = (_whole(number(key), file, f"{where}.{key}") for key in ("w", "h"))
    has_angle = "fl_x" not in entry and "fl_x" not in defaults and "camera_angle_x" in entry.keys() | defaults.keys()
    fx = width / (2 * math.tan(number("camera_angle_x") / 2 or math.nan)) if has_angle else number("fl_x")
    # The principal point defaults to the centre. (VHAP flips cy since November 2024, which does not matter there.)
    return fx, number("fl_y", fx), number("cx", width / 2), number("cy", height / 2), width, height


def _whole(value: float, file: Path, field: str) -> int:
    if value != int(value) or value < 0:
        raise InputError(f"expected a whole number, 0 or larger, found {value}", file=file, field=field)
    if value > MAX_NUMBER:
        raise InputError(f"{value:g} is larger than {MAX_NUMBER}", file=file, field=field)
    return int(value)


def _sequence_of(image: str, folder: Path) -> str:
    """The sequence of an image: NeRSemble's name for it in the name of a folder, else the folder of a union.

    Union folders name the sequence in the neighbouring folder: `../306_EMO-1_v16_.../images/...` -> EMO-1.
    """
    parts = Path(image).parts
    neighbour = parts[1] if len(parts) > 2 and parts[0] == ".." else ""
    for part in (*parts[:-1], folder.name):
        found = [name for name in part.split("_") if SEQUENCE.fullmatch(name)]
        if found:
            return found[0]
    return neighbour
