"""Stage `capture`: index and check a dataset; the toy is synthesised first."""

from __future__ import annotations

from pathlib import Path

from carigs.capture import read_dataset
from carigs.files import writing_folder
from carigs.settings import Capture


def capture(settings: Capture, *, index: Path, dataset: Path) -> None:
    """Write `index` (capture.json); `dataset` is the folder that the toy is written to, empty for other sources."""
    with writing_folder(dataset) as part:
        if settings.source == "toy":
            from carigs.toy import write_capture

            write_capture(part, settings.toy)
        else:
            read_dataset(Path(settings.folder), Path(settings.head_model), background=settings.background).save(index)
    if settings.source == "toy":
        read_dataset(dataset, dataset / "head_model.npz", background=settings.background).save(index)
