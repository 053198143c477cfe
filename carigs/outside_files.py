"""Files from outside of a study that its settings name: has one of them changed since a job read it?

Names, sizes and modification times tell, without reading images.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import fields
from hashlib import sha256
from pathlib import Path
from typing import Any

from carigs.readers.limits import MAX_TEXT_BYTES
from carigs.settings import STAGES
from carigs.settings.option import option_of

INDEXES = ("transforms_train.json", "transforms_val.json", "transforms_test.json", "frames.json")
"""Files that list the files of a dataset, or of true caricatures, which may lie in other folders."""
BESIDE = (
    "FLAME_masks.pkl", "uv_masks.npz", "head_template_mesh.obj",
    "landmark_embedding_with_eyes.npy", "landmark_embedding.npy",
)  # fmt: skip
"""What `carigs.head.flame_files` reads beside a .pkl file."""
_FOLDER = re.compile(rb'"((?:[^"\\\n]{1,4000}/)?)[^"/\\\n]{1,300}\.(?:png|jpe?g|npz)"', re.IGNORECASE)
"""Paths of images and parameters in an index, with their folder as group."""


def outside_files(stage: str, settings: Any, level: float | None = None) -> dict[str, Path]:
    """The files and folders that the settings of a stage name: values of the fields with the option `is_path`.

    Args:
        stage: Name of the stage.
        settings: Its section, as dataclass or as OmegaConf's mapping.
        level: Exaggeration level of the job, for `{level}` in a name; `{gamma}` is a field of the section.

    Returns:
        Those that the settings use, by key; they need not exist.
    """
    values = {"{gamma}": getattr(settings, "gamma", None), "{level}": level}
    named = {}
    for f in fields(STAGES[stage]):
        allowed, name = option_of(f), getattr(settings, f.name)
        if not (allowed.is_path and name):
            continue
        if allowed.required_when and getattr(settings, allowed.required_when[0]) != allowed.required_when[1]:
            continue
        for placeholder, value in values.items():
            name = name if value is None else name.replace(placeholder, f"{value:g}")
        named[f"{stage}.{f.name}"] = Path(name)
    return named


def files_digest(path: str | Path) -> str:
    """Digest of the names, sizes and modification times of a file or of the files of a folder.

    Of a folder with indexes (`INDEXES`) these and all files in the folders that they name count, else all files
    directly in it. With a head model (.pkl) the files `BESIDE` it count.

    Args:
        path: The file or folder.

    Returns:
        Hexadecimal digits; empty if there is nothing of this name.
    """
    path = Path(path)
    if path.is_dir():
        indexes = [path / name for name in INDEXES]
        lines = {line for file in indexes for line in _entry(file)}
        folders = {path / os.fsdecode(part) for file in indexes for part in _folders(file)} if lines else {path}
        for folder in folders:
            lines.update(_entries(folder))
    else:
        beside = [path.with_name(name) for name in BESIDE] if path.suffix == ".pkl" else []
        lines = {line for file in (path, *beside) for line in _entry(file)}
        if not path.exists():
            return ""
    return sha256("\n".join(sorted(lines)).encode("utf-8", "surrogateescape")).hexdigest()[:32]


def _folders(index: Path) -> set[bytes]:
    """Folders of the files that an index names."""
    try:
        if index.stat().st_size > MAX_TEXT_BYTES:
            return set()
        return {match[1] for match in _FOLDER.finditer(index.read_bytes())}
    except OSError:
        return set()


def _entries(folder: Path) -> Iterator[str]:
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                if entry.is_file():
                    yield _line(entry.path, entry.stat())
    except (OSError, ValueError):
        return


def _entry(file: Path) -> Iterator[str]:
    try:
        yield _line(str(file), file.stat())
    except (OSError, ValueError):  # ValueError: a NUL character in the path
        return


def _line(path: str, status: os.stat_result) -> str:
    return f"{path} {status.st_size} {status.st_mtime_ns}"
