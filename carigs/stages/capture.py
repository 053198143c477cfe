"""Stage `capture`: check and index a dataset; the toy is rendered first."""

from __future__ import annotations

import warnings
from pathlib import Path

from carigs.capture import read_dataset
from carigs.errors import CarigsWarning
from carigs.files import writing_folder
from carigs.plausibility import check_capture
from carigs.settings import Capture


def capture(settings: Capture, *, index: Path, dataset: Path) -> None:
    """Check a dataset and write its index.

    Args:
        settings: Settings of the stage.
        index: Output: the index (capture.json).
        dataset: Output: folder of the toy, empty for other sources.

    Raises:
        SettingsError: For an unknown source, or a folder without a path.
        InputError: If the dataset is broken, or its parts cannot belong together.

    Warns:
        CarigsWarning: Per kind of what is likely to be wrong; the index holds the same lines.
    """
    with writing_folder(dataset) as part:
        if settings.source == "toy":
            from carigs.toy import write_capture

            write_capture(part, settings.toy)
        else:
            found = read_dataset(Path(settings.folder), Path(settings.head_model), background=settings.background)
            checked = check_capture(found)
            for line in checked.warnings:
                warnings.warn(line, CarigsWarning, stacklevel=2)
            checked.save(index)
    if settings.source == "toy":
        read_dataset(dataset, dataset / "head_model.npz", background=settings.background).save(index)
