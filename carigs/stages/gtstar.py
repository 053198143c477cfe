"""Stage `gtstar`: the GT* targets of all training frames at one level."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from carigs.capture import Capture
from carigs.capture.images import read_bits, read_rgb
from carigs.capture.target_index import write_targets
from carigs.errors import InputError
from carigs.exaggeration import Caricature, GammaPath
from carigs.files import resuming_folder
from carigs.gtstar import flags_from_names
from carigs.gtstar.provider import check_settings
from carigs.gtstar.target_set import TargetEntries, make_target_set, resume_key
from carigs.settings import DEFAULT_MASK_FLAGS, Gtstar
from evaluation.figures.target_sheet import TargetRow, target_sheet

SHEET_ROWS = 5
"""Frames on the contact sheet."""


def gtstar(settings: Gtstar, *, capture: Path, path: Path, level: float, targets: Path, index: Path) -> None:
    """Write the targets of a level and their index; an interrupted run is resumed, with the same result.

    Args:
        settings: Settings of the stage.
        capture: Input: the index of the capture.
        path: Input: the exaggeration path.
        level: Exaggeration level.
        targets: Output: folder of colours, mask flags of pixels and triangles, and a contact sheet.
        index: Output: per frame its registration error, its weight, the share of each mask flag, or why it is skipped.

    Raises:
        InputError: If no frame can be used.
    """
    check_settings(settings)
    subject, exaggerated = Capture.load(capture), GammaPath.load(path).at(level)
    with resuming_folder(targets, resume_key(settings, subject, exaggerated, capture)) as (folder, records):
        entries = make_target_set(settings, subject, exaggerated, folder, records)
        _report(entries, len(subject.split("train")))
        if not entries.targets:
            raise InputError(f"no frame can be used; the first: {entries.skipped[0]['why']}", file=capture)
        _write_contact_sheet(folder, subject, entries.targets, exaggerated)
        write_targets(index, level, targets, *entries)


def _report(entries: TargetEntries, count: int) -> None:
    """Print which frames are skipped or have a reduced weight."""
    for entry in entries.skipped:
        print(f"GT*: frame {entry['timestep']:05d}_{entry['camera']:02d} is skipped: {entry['why']}")
    if entries.skipped:
        print(f"GT*: {len(entries.skipped)} of {count} frames are skipped")
    reduced = [entry for entry in entries.targets if entry["weight"] < 1]
    for entry in reduced:
        error = f"{entry['pixels_off']:.1f} pixels off the others"
        print(f"GT*: frame {Path(entry['image']).stem} is {error}: its weight is {entry['weight']:.2f}")
    if reduced:
        print(f"GT*: {len(reduced)} of {count} frames have a reduced weight")


def _write_contact_sheet(
    folder: Path, subject: Capture, entries: list[dict[str, Any]], exaggerated: Caricature
) -> None:
    """Show some of the written targets; for the toy, next to renderings of its true caricature."""
    frames = subject.split("train")
    selected = {frames[i].name: frames[i] for i in np.linspace(0, len(frames) - 1, SHEET_ROWS).astype(int)}
    toy = None
    if (subject.root / "subject.npz").is_file():
        from carigs.toy import load_subject, render_subject

        toy = load_subject(subject.root)
    rows = []
    for entry in entries:
        frame, truth = selected.get(Path(entry["image"]).stem), None
        if frame is None:
            continue
        if toy is not None:
            parameters, camera = subject.parameters(frame.timestep), subject.cameras[frame.camera]
            truth, _ = render_subject(toy, parameters, camera, exaggerated)
        target, mask_flags = read_rgb(folder / entry["image"]), read_bits(folder / entry["mask_flags"])
        rows.append(TargetRow(frame.name, subject.image(frame), target, mask_flags, truth))
    if rows:
        target_sheet(folder / "inspection.png", rows, flags_from_names(DEFAULT_MASK_FLAGS))
