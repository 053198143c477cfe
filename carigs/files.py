"""Writing files so that nothing half-written is ever seen: under a temporary name first, then renamed."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def writing(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path of the same suffix beside `path`; renamed onto it on success, removed on failure."""
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
    """The same for a folder: yields an empty one that takes the place of `path` on success."""
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
    """A folder that takes the place of `path` on success and outlives a run that is killed or fails.

    Yields it, and one beside it for notes on what is already whole; both are empty unless the run before had this
    `key`, which has to tell apart all that the contents depend on.
    """
    path = Path(path)
    state = path.with_name(f".{path.name}.part")
    contents, notes, mark = state / "contents", state / "notes", state / "key"
    if not (mark.is_file() and mark.read_text() == key and contents.is_dir()):
        shutil.rmtree(state, ignore_errors=True)
        for folder in (contents, notes):
            folder.mkdir(parents=True)
        with writing(mark) as part:
            part.write_text(key)
    yield contents, notes
    shutil.rmtree(path, ignore_errors=True)
    os.replace(contents, path)
    shutil.rmtree(state, ignore_errors=True)
