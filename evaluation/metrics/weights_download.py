"""Downloads of network weights, with progress, continued where they were interrupted, and checked."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn, TransferSpeedColumn

from carigs.errors import InputError
from carigs.job_lock import job_lock
from carigs.readers.download import download
from carigs.readers.weights import MAX_WEIGHTS_BYTES
from evaluation.metrics.checksums import keep_checksum
from evaluation.metrics.weights import Weights, WeightsFile, verify


def download_weights(weights: Weights, folder: Path) -> Path:
    """Download weights.

    A file has the temporary name `.{name}.part` until its size and checksum are verified; a download that was
    interrupted goes on from there. The checksum is kept beside the file.

    Args:
        weights: Entry of the registry.
        folder: Where they go; created if necessary.

    Returns:
        The file, or the folder of a network of several files.

    Raises:
        InputError: A file cannot be downloaded, or has another size or checksum than the registry states.
        CarigsError: Another process downloads the same file.
    """
    root = folder / weights.folder
    columns = (BarColumn(), DownloadColumn(), TransferSpeedColumn(), TimeRemainingColumn())
    with Progress(TextColumn("{task.description}"), *columns, console=Console(stderr=True)) as progress:
        for file in weights.wanted:
            path = root / file.name
            path.parent.mkdir(parents=True, exist_ok=True)
            with job_lock(path.with_name(f".{path.name}.lock"), seconds=0):
                if not path.is_file():
                    _download(weights, file, path, progress)
    return root if weights.folder else path


def _download(weights: Weights, file: WeightsFile, path: Path, progress: Progress) -> None:
    part = path.with_name(f".{path.name}.part")
    task = progress.add_task(path.name, total=file.bytes)

    def report(done: int, total: int | None) -> None:
        progress.update(task, completed=done, total=total)

    download(file.url, part, MAX_WEIGHTS_BYTES, report)
    try:
        verify(weights, file, part)
    except InputError as error:
        part.unlink()
        raise InputError(f"what was downloaded is not {weights.title}: {error.problem}", file=file.url) from error
    part.rename(path)
    keep_checksum(path)
