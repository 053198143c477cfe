"""Datasets in the folder layout of GaussianAvatars and VHAP: transforms_{train,val,test}.json and what they name."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

from carigs.capture.calibration.camera_checks import check_field_of_view
from carigs.capture.calibration.camera_table import CameraTable, Intrinsics
from carigs.capture.calibration.keys import TRANSFORMS, CalibrationKeys
from carigs.capture.capture_json import MAX_NUMBER
from carigs.capture.dataset import Capture
from carigs.capture.dataset_checks import ListedFrame, sound_frames
from carigs.capture.dataset_paths import file_inside
from carigs.capture.frame import Frame
from carigs.capture.splits import split_frames
from carigs.errors import InputError, collecting
from carigs.head import HeadModel
from carigs.readers.file_names import INDEXES
from carigs.readers.json_files import json_field, read_json

SEQUENCE = re.compile(r"(?:EMO|EXP|SEN)-\d[^_]*|FREE|HAIR|GLASSES")
"""Sequences of NeRSemble."""
MEND = "mend the field, or remove its frames from transforms_*.json"
RESTORE = "restore the file; it lists the frames"


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
        remedy = "name the folder of transforms_train.json"
        raise InputError("no such dataset folder", file=folder, remedy=remedy)
    model, table, keys = HeadModel.load(head_model), CameraTable(errors), CalibrationKeys(TRANSFORMS)
    needed, listed = ("train", "test") if split == "files" else ("train",), []
    for name, index in INDEXES.items():
        file = folder / index
        if name in needed or file.exists():
            listed += read_index(file, name, table, keys, errors, may_be_empty=name not in needed)
    frames, warnings = sound_frames(folder, listed, table, model, errors)
    frames.sort(key=lambda frame: (frame.timestep, frame.camera))
    if not frames and errors:
        divided, rule = (), split
    else:
        divided, rule = split_frames(frames, split, validation_camera, folder)
    return Capture(
        folder,
        Path(head_model),
        divided,
        tuple(table.cameras),
        background,
        rule,
        warnings=(*keys.warnings(), *warnings),
    )


def read_index(
    file: Path,
    split: str,
    table: CameraTable,
    keys: CalibrationKeys,
    errors: list[InputError] | None = None,
    *,
    may_be_empty: bool = True,
    with_heads: bool = True,
) -> list[ListedFrame]:
    """Read the frames of an index.

    Args:
        file: The index.
        split: The split of its frames.
        table: Receives the cameras.
        keys: Receives the keys that carigs does not read.
        errors: Receives what is wrong with single entries; None to raise the first error.
        may_be_empty: Whether the index may list no frames.
        with_heads: Whether entries name files of head parameters; else `Frame.parameters` is empty.

    Returns:
        The frames.

    Raises:
        InputError: If the file cannot be read or lists no frames, a field is missing or not valid, or a key cannot be
            honoured.
    """
    listed: list[ListedFrame] = []
    with collecting(errors, RESTORE):
        content = read_json(file, dict)
        with collecting(errors):
            keys.check(content, file)
        entries = json_field(content, "frames", list, file=file)
        if not entries and not may_be_empty:
            remedy = "list frames in that file, or choose another split (--split)"
            raise InputError(f"the {split} split is empty", file=file, field="frames", remedy=remedy)
        for i, entry in enumerate(entries):
            where = f"frames[{i}]"
            with collecting(errors, MEND):
                if not isinstance(entry, dict):
                    raise InputError("expected an object", file=file, field=where)
                keys.check(entry, file, where)
                frame = _read_frame(entry, content, split, file, where, table, errors, with_heads)
                listed.append(ListedFrame(frame, file, where))
    return listed


def _read_frame(
    entry: dict[str, Any],
    defaults: dict[str, Any],
    split: str,
    file: Path,
    where: str,
    table: CameraTable,
    errors: list[InputError] | None,
    with_heads: bool,
) -> Frame:
    """Read an entry; `defaults` are numbers of the camera that it lacks."""

    def field(key: str, kind: type) -> Any:
        return json_field(entry, key, kind, file=file, where=where)

    def path(key: str) -> str:
        return file_inside(field(key, str), file, f"{where}.{key}")

    timestep, camera = (_whole(field(key, float), file, f"{where}.{key}") for key in ("timestep_index", "camera_index"))
    image, parameters = path("file_path"), path("flame_param_path") if with_heads else ""
    mask = path("fg_mask_path") if entry.get("fg_mask_path") is not None else None
    intrinsics, angles = _read_intrinsics(entry, defaults, file, where)
    calibration = table.number(field("transform_matrix", list), intrinsics, file, where)
    with collecting(errors):
        for stated in angles:
            check_field_of_view(*stated, file)
    sequence = str(entry.get("sequence") or _sequence_of(image, file.parent))
    return Frame(timestep, camera, sequence, split, image, mask, parameters, calibration)


def _read_intrinsics(
    entry: dict[str, Any], defaults: dict[str, Any], file: Path, where: str
) -> tuple[Intrinsics, list[tuple[float, float, int, str]]]:
    """The intrinsics; and focal length, field of view, size and field wherever an object states both.

    What an entry states counts more than what the file does, a focal length as much as a field of view.
    """

    def number(key: str, default: float | None = None) -> float:
        if key in entry:
            return float(json_field(entry, key, float, file=file, where=where))
        if key in defaults or default is None:
            return float(json_field(defaults, key, float, file=file, where="" if key in defaults else where))
        return default

    angles: list[tuple[float, float, int, str]] = []

    def focal(axis: str, size: int, default: float | None) -> float:
        length, angle = f"fl_{axis}", f"camera_angle_{axis}"
        for stated, place in ((entry, where), (defaults, "")):
            given = [key for key in (length, angle) if key in stated]
            found = {key: float(json_field(stated, key, float, file=file, where=place)) for key in given}
            if len(found) == 2:
                angles.append((found[length], found[angle], size, f"{place}.{angle}" if place else angle))
            if length in found:
                return found[length]
            if angle in found:
                return size / (2 * math.tan(found[angle] / 2 or math.nan))
        return number(length, default)

    width, height = (_whole(number(key), file, f"{where}.{key}") for key in ("w", "h"))
    fx = focal("x", width, None)
    fy = focal("y", height, fx)
    # The principal point defaults to the centre. (VHAP flips cy since November 2024, which does not matter there.)
    return (fx, fy, number("cx", width / 2), number("cy", height / 2), width, height), angles


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
