"""What a run does with the results of its study before it plans."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from carigs.config import settings_text
from carigs.errors import SettingsError
from carigs.files import clean_results
from carigs.job_lock import remove_free_locks
from carigs.job_record import is_from_future, is_stale, mark_current, mark_stale, set_modification_times
from carigs.settings import STAGES
from carigs.sources import fingerprint


def prepare_results(folder: Path, overrides: Sequence[str]) -> None:
    """Remove what killed processes left, and mark what was made with other settings, code or inputs to be made again.

    Args:
        folder: Folder of the study, `results/{study}`; it need not exist.
        overrides: Hydra overrides of the run.

    Raises:
        InputError: The record of a job is malformed.
    """

    def text(stage: str, point: str) -> str | None:
        try:
            return settings_text(stage, *overrides, *(name for name in point.split(",") if name != "all"))
        except (SettingsError, KeyError):  # a subject or variant that is no longer there
            return None

    clean_results(folder)
    remove_free_locks(folder / "log")
    code = {stage: fingerprint(f"carigs.stages.{stage}") for stage in STAGES}
    for (stage, reason), count in set_modification_times(folder / "log", text, lambda stage: code[stage]).items():
        results = "1 result was" if count == 1 else f"{count} results were"
        print(f"carigs: {folder}: {stage}: {results} {reason}; needed again, made again", file=sys.stderr)
    for stage in STAGES:
        for file in (folder / "settings" / stage).glob("*.yaml"):
            present = text(stage, file.stem)
            if present is None:
                continue
            if present != file.read_bytes().decode("utf-8", "replace"):
                mark_stale(file)
            elif is_stale(file) or is_from_future(file):
                mark_current(file)
