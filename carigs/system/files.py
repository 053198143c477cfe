"""Atomic writes of files and folders. `carigs.readers` reads files.

What is being written has a temporary name with the process that writes it, so that the next writer can tell what a
process that was killed has left.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from typing import Any

from carigs.system.processes import ProcessName, is_alive, is_known, this_process

DAYS_OF_STATE = 14
"""How long the state of an interrupted job is kept for the next run."""
_PARTIAL = re.compile(r"\..+\.(?P<pid>\d+)-(?P<start>\d+)-(?P<system>[0-9a-f]{8})-(?P<host>[^/]*)\.part(\.\w+)?")


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
    remove_dead_partial(path.parent)
    temporary = _temporary(path, path.stem, path.suffix)
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
    path.parent.mkdir(parents=True, exist_ok=True)
    remove_dead_partial(path.parent)
    temporary = _temporary(path, path.name)
    shutil.rmtree(temporary, ignore_errors=True)
    temporary.mkdir()
    try:
        yield temporary
        _replace_folder(path, temporary)
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
    remove_partial(state)
    yield contents, records
    _replace_folder(path, contents)
    shutil.rmtree(state, ignore_errors=True)


def write_json(file: str | Path, content: Any) -> None:
    """Write JSON atomically, indented by one space.

    Args:
        file: File to create or replace.
        content: Anything that `json.dumps` accepts.
    """
    with writing(file) as part:
        part.write_text(json.dumps(content, indent=1))


def remove_dead_partial(folder: Path) -> None:
    """Remove what processes that are known to have ended were writing in a folder; not in the folders below it.

    Args:
        folder: The folder.
    """
    for name in os.listdir(folder):
        process = partial_writer(name)
        if process and is_known(process) and not is_alive(process):
            _remove(folder / name)


def remove_partial(folder: Path) -> None:
    """Remove everything that is half-written in a folder and below it, by whichever process.

    Args:
        folder: A folder that nobody else may write to.
    """
    for directory, folders, files in os.walk(folder):
        for name in filter(partial_writer, [*folders, *files]):
            _remove(Path(directory, name))
        folders[:] = [name for name in folders if not partial_writer(name)]


def clean_results(folder: Path, no_job_runs: bool = False) -> None:
    """Remove what processes that have ended left in the results of a study, and states that nobody has taken up.

    Args:
        folder: Folder of the study; it need not exist.
        no_job_runs: Whether the locks say that no job of the study runs, on any host. Then what unknown processes have
            left is removed, too: those of other hosts and containers, and of the time before this system was started.
    """
    oldest = time.time() - DAYS_OF_STATE * 24 * 3600
    for directory, folders, files in os.walk(folder):
        for name in [*folders, *files]:
            path, process = Path(directory, name), partial_writer(name)
            if process:
                dead = not is_alive(process) and (no_job_runs or is_known(process))
            else:
                state = (name.startswith(".") and name.endswith(".part")) or name.endswith(".checkpoint")
                dead = state and _last_change(path) < oldest
            if dead:
                _remove(path)
        folders[:] = [name for name in folders if not name.startswith(".")]


def partial_writer(name: str) -> ProcessName | None:
    """The process that a temporary name stands for.

    Args:
        name: Name of a file or folder, without its folder.

    Returns:
        The process; None for other names.
    """
    found = _PARTIAL.fullmatch(name)
    if not found:
        return None
    return ProcessName(found["host"], found["system"], int(found["pid"]), int(found["start"]))


def _temporary(path: Path, stem: str, suffix: str = "") -> Path:
    host, system, pid, start = this_process()
    short = stem if len(stem.encode()) <= 100 else sha256(stem.encode()).hexdigest()[:16]
    return path.with_name(f".{short}.{pid}-{start}-{system}-{host}.part{suffix}")


def _replace_folder(path: Path, new: Path) -> None:
    """Replace a folder by another one; at no time a part of the old one has the name."""
    old = _temporary(path, f"{path.name}.old")
    if path.is_dir():
        os.replace(path, old)
    os.replace(new, path)
    shutil.rmtree(old, ignore_errors=True)


def _last_change(path: Path) -> float:
    """The newest modification time of a file, or of a folder and its entries."""
    try:
        return max(entry.stat().st_mtime for entry in [path, *(path.iterdir() if path.is_dir() else ())])
    except OSError:  # removed meanwhile
        return time.time()


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        try:
            path.unlink(missing_ok=True)
        except OSError:  # a folder that is read-only: the next write says so
            pass
