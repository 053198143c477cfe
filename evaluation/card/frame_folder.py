"""Renderings of another program: the images of the frames that a protocol asks for."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from carigs.capture.dataset_paths import file_inside
from carigs.errors import InputError, collecting
from carigs.readers.folders import listed
from carigs.readers.images import read_header
from carigs.readers.json_files import json_field, read_json

SHOWN = 3
"""Files that a message names; of others it gives the number."""
Key = tuple[str, int, int]
"""Protocol, timestep and camera of a frame; on the orbit, the number of the frame in place of the camera."""


class Wanted(NamedTuple):
    """A frame that has to be there."""

    key: Key
    name: str
    """Its file below the folder of a level."""
    size: tuple[int, int]
    """Width and height in pixels."""


def find_frames(
    folder: Path, wanted: Mapping[str, Sequence[Wanted]], protocols: Collection[str]
) -> dict[str, dict[Key, Path]]:
    """Find the images of all levels, and everything that is wrong with them.

    The frames of a level are PNG files `level={level}/{protocol}/{timestep:05d}_{camera:02d}.png`, or files that an
    index `level={level}/frames.json` lists.

    Args:
        folder: Folder with a folder per level.
        wanted: Frames of all protocols by level; levels as in names of folders.
        protocols: Protocols whose frames are needed; frames of others may be there or not.

    Returns:
        The file of each frame of these protocols, by level and frame.

    Raises:
        InputError: Images are missing, are there although nothing asks for them, or have another size; one error names
            all three kinds. Or an index is broken.
    """
    if not folder.is_dir():
        raise InputError("no such folder", file=folder)
    found, problems, broken = {}, {"missing": [], "not asked for": [], "of another size": []}, []
    for level, frames in wanted.items():
        place = folder / f"level={level}"
        files: dict[Key, Path] = {}
        with collecting(broken):
            files = _listed(place) if (place / "frames.json").is_file() else _named(place, frames, problems)
        found[level] = {}
        for frame in frames:
            file = files.pop(frame.key, None)
            if frame.key[0] not in protocols:
                continue
            if file is None or not file.is_file():
                problems["missing"].append(f"level={level}/{frame.name}")
                continue
            found[level][frame.key] = file
            with collecting(broken):
                header = read_header(file)
                if (header.width, header.height) != frame.size:
                    sizes = f"{header.width} x {header.height}, not {frame.size[0]} x {frame.size[1]}"
                    problems["of another size"].append(f"level={level}/{frame.name}: {sizes}")
        problems["not asked for"] += [
            f"level={level}/{file.name} ({protocol})" for (protocol, *_), file in files.items()
        ]
    parts = [f"{len(names)} {problem} ({_some(names)})" for problem, names in problems.items() if names]
    parts += [str(error) for error in broken[:SHOWN]]
    if parts:
        raise InputError("images: " + "; ".join(parts), file=folder)
    return found


def _named(place: Path, frames: Iterable[Wanted], problems: dict[str, list[str]]) -> dict[Key, Path]:
    """Images by their names."""
    names = {frame.name: frame.key for frame in frames}
    files = {file.relative_to(place).as_posix(): file for file in listed(place, "**/*.png")}
    problems["not asked for"] += [f"{place.name}/{name}" for name in files.keys() - names.keys()]
    return {key: files[name] for name, key in names.items() if name in files}


def _listed(place: Path) -> dict[Key, Path]:
    """Images by the index of a level."""
    index, files = place / "frames.json", {}
    for i, entry in enumerate(read_json(index, list)):
        where = f"[{i}]"
        numbers = (json_field(entry, name, int, file=index, where=where) for name in ("timestep", "camera"))
        key = (json_field(entry, "protocol", str, file=index, where=where), *numbers)
        if key in files:
            raise InputError("this frame is listed twice", file=index, field=where)
        name = json_field(entry, "file", str, file=index, where=where)
        files[key] = place / file_inside(name, index, f"{where}.file")
    return files


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return ", ".join(sorted(names)[:SHOWN]) + more
