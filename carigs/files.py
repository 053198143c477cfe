"""Atomic writes of files and folders. `carigs.readers` reads files."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


@contextmanager
def writing(path: str | Path) -> Iterator[Path]:
    """Write a file atomically: under a temporary name first, then renamed.

    Args:
        path: File to create or replace. Its folder is created if necessary.

    Yields:
        Temporary path of the same suffix in the same folder. It is renamed to `path` on success and removed on failure.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def writing_folder(path: str | Path) -> Iterator[Path]:
    """Write a folder atomically, like `writing`.

    Args:
        path: Folder to create or replace.

    Yields:
        Empty temporary folder. It replaces `path` on success and is removed on failure.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    shutil.rmtree(temporary, ignore_errors=True)
    temporary.mkdir(parents=True)
    try:
        yield temporary
        shutil.rmtree(path, ignore_errors=True)
        os.replace(temporary, path)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


@contextmanager
def resuming_folder(path: str | Path, key: str) -> Iterator[tuple[Path, Path]]:
    """Write a folder that replaces `path` on success and that is kept if the run fails or is killed.

    Args:
        path: Folder to create or replace.
        key: Digest of everything that the contents depend on. A partial folder of an earlier run is reused only if its
            key is the same.

    Yields:
        The partial folder, and a second folder for records of which contents are complete. Both are empty unless an
        earlier run with the same key was interrupted.
    """
    path = Path(path)
    state = path.with_name(f".{path.name}.part")
    contents, records, key_file = state / "contents", state / "notes", state / "key"
    if not (key_file.is_file() and key_file.read_text() == key and contents.is_dir()):
        shutil.rmtree(state, ignore_errors=True)
        for folder in (contents, records):
            folder.mkdir(parents=True)
        with writing(key_file) as part:
            part.write_text(key)
    yield contents, records
    shutil.rmtree(path, ignore_errors=True)
    os.replace(contents, path)
    shutil.rmtree(state, ignore_errors=True)


def write_json(file: str | Path, content: Any) -> None:
    """Write JSON atomically, indented by one space.

    Args:
        file: File to create or replace.
        content: Anything that `json.dumps` accepts.
    """
    with writing(file) as part:
        part.write_text(json.dumps(content, indent=1))
