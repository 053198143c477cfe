"""Indexes of images: the rendered frames of an avatar (frames.json) and the ground truth of a level (truth.json)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from carigs.capture.camera import Camera
from carigs.capture.capture_json import camera_from_json
from carigs.errors import InputError
from carigs.readers.file_names import with_slashes
from carigs.readers.formats import Format, check_format
from carigs.readers.json_files import json_field, read_json
from carigs.system.files import write_json

TRUTH = Format("carigs-truth", 1, "run the stage truth again, as carigs run does")


@dataclass(frozen=True)
class RenderedImage:
    """One rendered frame."""

    protocol: str
    """`test` (held-out sequence), `val` (held-out view) or `orbit` (novel camera trajectory)."""
    timestep: int
    camera: int
    """Camera of the capture; for the orbit, the number of the frame."""
    order: int
    """Position among the rendered frames."""
    file: Path
    view: Camera | None = None
    """Camera of a frame of the orbit; None for a camera of the capture."""
    mesh_level: float | None = None
    """Level of the mesh that the frame shows; None for the level of its folder."""


@dataclass(frozen=True)
class GroundTruth:
    """Ground-truth images of one level by (timestep, camera), or the reason why there are none."""

    reason: str | None
    images: dict[tuple[int, int], Path]
    masks: dict[tuple[int, int], Path]


def level_folder(frames: Path, level: float) -> Path:
    """Folder of the images of a level, with their index and the metrics of the avatar's geometry.

    Args:
        frames: Folder with the renderings of an avatar.
        level: Exaggeration level.

    Returns:
        The folder.
    """
    return frames / f"level={level:g}"


def read_frame_index(index: Path) -> list[RenderedImage]:
    """Read frames.json.

    Args:
        index: The index. Names of images are relative to its folder.

    Returns:
        The frames, sorted by protocol and order.

    Raises:
        InputError: If an entry is broken or an image is missing.
    """
    frames = []
    for i, entry in enumerate(read_json(index, list)):
        where = f"[{i}]"
        name = json_field(entry, "file", str, file=index, where=where)
        file = _existing(index.parent / with_slashes(name, index.parent), index, f"{where}.file")
        numbers = {key: json_field(entry, key, int, file=index, where=where) for key in ("timestep", "camera", "order")}
        protocol = json_field(entry, "protocol", str, file=index, where=where)
        view = camera_from_json(entry["view"], f"{where}.view", index) if "view" in entry else None
        mesh_level = json_field(entry, "mesh_level", float, file=index, where=where) if "mesh_level" in entry else None
        frames.append(RenderedImage(protocol=protocol, file=file, view=view, mesh_level=mesh_level, **numbers))
    return sorted(frames, key=lambda frame: (frame.protocol, frame.order))


def write_frame_index(index: Path, entries: Iterable[dict[str, Any]]) -> None:
    """Write frames.json.

    Args:
        index: The index.
        entries: The fields protocol, timestep, camera, sequence and file of each frame, in rendering order, and view
            (`camera_to_json`) if its camera is not one of the capture; mesh_level if its mesh has another level. The
            field order is added.
    """
    write_json(index, [{**entry, "order": i} for i, entry in enumerate(entries)])


def read_ground_truth(index: Path) -> GroundTruth:
    """Read truth.json.

    Args:
        index: The index. Images lie in `frames/` next to it, else in its folder.

    Returns:
        Images and masks by (timestep, camera).

    Raises:
        InputError: If an entry is broken or an image is missing.
    """
    content, images, masks = read_json(index, dict), {}, {}
    check_format(content.get("format", "carigs-truth-1"), TRUTH, index)  # the first ones stated none
    for i, entry in enumerate(json_field(content, "frames", list, file=index)):
        where = f"frames[{i}]"
        key = tuple(json_field(entry, name, int, file=index, where=where) for name in ("timestep", "camera"))
        for name, files in (("image", images), ("mask", masks)):
            file = _next_to(index, json_field(entry, name, str, file=index, where=where))
            files[key] = _existing(file, index, f"{where}.{name}")
    return GroundTruth(reason=content.get("reason"), images=images, masks=masks)


def write_ground_truth(index: Path, level: float, names: Iterable[tuple[int, int]], reason: str | None = None) -> None:
    """Write truth.json.

    Args:
        index: The index.
        level: Exaggeration level.
        names: Timestep and camera of each image; the files are named by `ground_truth_files`.
        reason: Why there are no images, if there are none.
    """
    frames = [{"timestep": t, "camera": c, **ground_truth_files(t, c)} for t, c in names]
    write_json(index, {"format": str(TRUTH), "level": level, "reason": reason, "frames": frames})


def ground_truth_files(timestep: int, camera: int) -> dict[str, str]:
    """File names of a ground-truth image and its mask.

    Args:
        timestep: Timestep of the frame.
        camera: Camera of the frame.

    Returns:
        Names by the keys `image` and `mask`.
    """
    stem = f"{timestep:05d}_{camera:02d}"
    return {"image": f"{stem}.png", "mask": f"{stem}_mask.png"}


def _next_to(index: Path, name: str) -> Path:
    folder = index.parent / "frames"
    file = folder / with_slashes(name, folder)
    return file if _is_file(file) else index.parent / with_slashes(name, index.parent)


def _is_file(file: Path) -> bool:
    try:
        return file.is_file()
    except (OSError, ValueError):  # a name that no file can have
        return False


def _existing(file: Path, index: Path, field: str) -> Path:
    if not _is_file(file):
        raise InputError(f"no such image: {file}", file=index, field=field)
    return file
