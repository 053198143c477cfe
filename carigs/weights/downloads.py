"""Downloads with progress, that are continued where they were interrupted, and checked."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn, TransferSpeedColumn

from carigs.errors import InputError
from carigs.readers.download import download
from carigs.readers.weights import MAX_WEIGHTS_BYTES
from carigs.runs.locks import job_lock
from carigs.weights.checksums import check_file, file_checksum, keep_checksum

ATTEMPTS = 5
"""Of a download whose connection breaks; each goes on where the last one ended, and the first without a byte is the
last."""
SECONDS_TO_WAIT = 6 * 3600.0
"""For another process that downloads the same file: jobs of a study start at the same time."""


class Download(NamedTuple):
    """A file to download."""

    url: str
    path: Path
    title: str
    """What it is, for error messages."""
    size: int | None
    """Bytes; None if unknown."""
    sha256: str
    """Checksum or its beginning; empty if unknown."""


def download_files(files: Iterable[Download]) -> None:
    """Download files that are not there yet.

    A file has the temporary name `.{name}.part` until its size and checksum are verified; a download that was
    interrupted goes on from there. The checksum is kept beside the file.

    Args:
        files: What to download, and where to.

    Raises:
        InputError: A file cannot be downloaded, or has another size or checksum than it should.
        CarigsError: Another process has been downloading the same file for hours.
    """
    columns = (BarColumn(), DownloadColumn(), TransferSpeedColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    off = not console.is_terminal
    with Progress(TextColumn("{task.description}"), *columns, console=console, disable=off) as progress:
        for file in files:
            file.path.parent.mkdir(parents=True, exist_ok=True)
            with job_lock(file.path.with_name(f".{file.path.name}.lock"), SECONDS_TO_WAIT):
                if not file.path.is_file():
                    _download(file, progress)


def _download(file: Download, progress: Progress) -> None:
    part = file.path.with_name(f".{file.path.name}.part")
    task = progress.add_task(file.path.name, total=file.size, visible=False)

    def report(done: int, total: int | None) -> None:
        progress.update(task, completed=done, total=total or file.size, visible=True)

    _download_in_parts(file.url, part, report)
    try:
        check_file(part, file.title, size=file.size, sha256=file.sha256, remedy="nothing was kept")
    except InputError as error:
        part.unlink()
        raise InputError(error.problem, file=file.url) from error
    keep_checksum(file.path, file_checksum(part))
    part.rename(file.path)


def _download_in_parts(url: str, part: Path, report: Callable[[int, int | None], None]) -> None:
    """Download a file, and go on where the connection breaks, as long as bytes come."""
    for attempt in range(ATTEMPTS):
        before = _size(part)
        try:
            download(url, part, MAX_WEIGHTS_BYTES, report)
        except InputError:
            if attempt + 1 == ATTEMPTS or _size(part) <= before:
                raise
        else:
            return


def _size(file: Path) -> int:
    return file.stat().st_size if file.is_file() else 0
