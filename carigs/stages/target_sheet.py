"""Stage `target_sheet`: a contact sheet of the GT* targets of one level."""

from __future__ import annotations

from pathlib import Path

from carigs.capture import Capture
from carigs.capture.target_index import read_targets
from carigs.head import read_subject_path
from carigs.settings import TargetSheet
from carigs.system.files import writing
from evaluation.figures.target_sheet import draw_target_sheet


def target_sheet(settings: TargetSheet, *, capture: Path, path: Path, index: Path, level: float, sheet: Path) -> None:
    """Draw some of the targets with their mask flags; for the toy, beside renderings of its true caricature.

    Args:
        settings: Settings of the stage: there are none.
        capture: Input: the index of the capture.
        path: Input: the exaggeration path.
        index: Input: the index of the targets.
        level: Exaggeration level of the targets.
        sheet: Output: PNG file.

    Raises:
        InputError: An input is malformed.
    """
    subject = Capture.load(capture)
    exaggerated = read_subject_path(path, subject.model).at(level)
    with writing(sheet) as part:
        draw_target_sheet(part, subject, read_targets(index, subject).targets, exaggerated)
