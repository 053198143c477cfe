"""Stage `capture`: check and index a dataset; the toy is rendered first."""

from __future__ import annotations

from pathlib import Path

from carigs.capture import read_dataset
from carigs.errors import SettingsError
from carigs.files import writing_folder
from carigs.settings import Capture


def capture(settings: Capture, *, index: Path, dataset: Path) -> None:
    """Check a dataset and write its index.

    Args:
        settings: Settings of the stage.
        index: Output: the index (capture.json).
        dataset: Output: folder of the toy, empty for other sources.

    Raises:
        SettingsError: For an unknown source, or a folder without a path.
    """
    with writing_folder(dataset) as part:
        if settings.source == "toy":
            from carigs.toy import write_capture

            write_capture(part, settings.toy)
        elif settings.source == "folder":
            for name in ("folder", "head_model"):
                if not getattr(settings, name):
                    raise SettingsError(f"capture.{name} must be set when capture.source is folder")
            read_dataset(Path(settings.folder), Path(settings.head_model), background=settings.background).save(index)
        else:
            raise SettingsError(f"capture.source={settings.source} is unknown; choose toy or folder")
    if settings.source == "toy":
        read_dataset(dataset, dataset / "head_model.npz", background=settings.background).save(index)
