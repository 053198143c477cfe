"""Files from outside of a study that its settings name: has one of them changed since a job read it?

Names, sizes and modification times tell, without reading images.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import fields
from hashlib import sha256
from pathlib import Path
from typing import Any

from carigs.readers.file_names import BESIDE_FLAME, INDEXES, TRUE_FRAMES, with_slashes
from carigs.readers.folders import is_system_file, listed
from carigs.readers.limits import MAX_TEXT_BYTES
from carigs.settings import STAGES
from carigs.settings.option import option_of


def outside_files(stage: str, settings: Any, level: float | None = None) -> dict[str, Path]:
    """The files and folders that the settings of a stage name.

    They are values of the fields with the option `is_path`, and words that are files here of those with `is_program`.

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
        if not ((allowed.is_path or allowed.is_program) and name):
            continue
        if allowed.required_when and getattr(settings, allowed.required_when[0]) not in allowed.required_when[1]:
            continue
        if allowed.is_program:  # of its words, those that are files, such as a script
            named |= {f"{stage}.{f.name}[{i}]": Path(word) for i, word in enumerate(name) if _is_file(word)}
            continue
        for placeholder, value in values.items():
            name = name if value is None else name.replace(placeholder, f"{value:g}")
        named[f"{stage}.{f.name}"] = Path(name)
    return named


def files_digest(path: str | Path) -> str:
    """Digest of the names, sizes and modification times of a file or of the files of a folder.

    Of a dataset, or a folder of true caricatures, the indexes and all files that they name count, else all files
    directly in the folder but hidden ones; of a folder that holds folders alone, as those of several cameras' frames,
    the files in these. With a head model (.pkl) the files beside it count that are read with it.

    Args:
        path: The file or folder.

    Returns:
        Hexadecimal digits; empty if there is nothing of this name.
    """
    path = Path(path)
    if path.is_dir():
        indexes = [file for name in (*INDEXES.values(), TRUE_FRAMES) if (file := path / name).is_file()]
        named = {path / with_slashes(name, path) for index in indexes for name in _named_files(index)}
        lines = {line for file in (*indexes, *named) for line in _entry(file)} if indexes else {*_entries(path)}
        lines = lines or {line for folder in listed(path) for line in _entries(folder)}
    elif path.exists():
        beside = [path.with_name(name) for name in BESIDE_FLAME] if path.suffix == ".pkl" else []
        if path.suffix.lower() == ".gltf":  # buffers in files of their own
            beside = [path.parent / name for name in _named_files(path)]
        lines = {line for file in (path, *beside) for line in _entry(file)}
    else:
        return ""
    return sha256("\n".join(sorted(lines)).encode("utf-8", "surrogateescape")).hexdigest()[:32]


def _is_file(word: str) -> bool:
    """Whether a word of a command names a file; it may be any text."""
    return os.path.isfile(word) if "\0" not in word else False


def _named_files(index: Path) -> set[str]:
    """Texts in an index that may name files, whatever their keys: the index is parsed as its readers parse it.

    An index that cannot be parsed names none; the stage that reads it says why.
    """
    try:
        if index.stat().st_size > MAX_TEXT_BYTES:
            return set()
        values = [json.loads(index.read_bytes())]
    except (OSError, ValueError, RecursionError):
        return set()
    names = set()
    while values:
        value = values.pop()
        if isinstance(value, dict):
            values.extend(value.values())
        elif isinstance(value, list):
            values.extend(value)
        elif isinstance(value, str) and "." in value:
            names.add(value)
    return names


def _entries(folder: Path) -> Iterator[str]:
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                if entry.is_file() and not is_system_file(entry.name):
                    yield _line(entry.path, entry.stat())
    except (OSError, ValueError):
        return


def _entry(file: Path) -> Iterator[str]:
    """The line of a file; none if there is no such file."""
    try:
        yield _line(str(file), file.stat())
    except (OSError, ValueError):  # ValueError: a NUL character in the path
        return


def _line(path: str, status: os.stat_result) -> str:
    return f"{path} {status.st_size} {status.st_mtime_ns}"
