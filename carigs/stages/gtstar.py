"""Stage `gtstar`: the GT* targets of all training frames at one level."""

from __future__ import annotations

import warnings
from pathlib import Path

from carigs.capture import Capture
from carigs.capture.target_index import write_targets
from carigs.errors import CarigsWarning, InputError
from carigs.gtstar.provider import check_settings
from carigs.gtstar.target_set import TargetEntries, make_target_set
from carigs.hair import load_hair
from carigs.head import read_subject_path
from carigs.settings import Gtstar
from carigs.system.files import resuming_folder


def gtstar(
    settings: Gtstar,
    *,
    capture: Path,
    path: Path,
    hair: Path | None = None,
    level: float,
    targets: Path,
    index: Path,
    resume_key: str,
    threads: int = 1,
) -> None:
    """Write the targets of a level and their index; an interrupted run is resumed, with the same result.

    Args:
        settings: Settings of the stage.
        capture: Input: the index of the capture.
        path: Input: the exaggeration path.
        hair: Input: what covers the head (`carigs.hair`); None if nothing does.
        level: Exaggeration level.
        targets: Output: folder of colours, and of mask flags of pixels and triangles.
        index: Output: per frame its registration error, its weight, the share of each mask flag, or why it is skipped.
        resume_key: Digest of all that the outputs depend on; targets that a run with another one has left are not used.
        threads: Timesteps processed in parallel; the result does not depend on it.

    Warns:
        CarigsWarning: Frames are skipped or have a reduced weight.

    Raises:
        InputError: If no frame can be used.
    """
    check_settings(settings)
    subject = Capture.load(capture)
    found = None if hair is None else load_hair(hair, len(subject.model.faces))
    exaggerated = read_subject_path(path, subject.model).at(level)
    with resuming_folder(targets, resume_key) as (folder, records):
        entries = make_target_set(settings, subject, exaggerated, folder, records, found, threads, level)
        _report(entries, len(subject.split("train")))
        if not entries.targets:
            raise InputError(f"no frame can be used; the first: {entries.skipped[0]['why']}", file=capture)
        write_targets(index, level, targets, *entries)


def _report(entries: TargetEntries, count: int) -> None:
    """Print which frames are skipped or have a reduced weight, and warn of their number."""
    for entry in entries.skipped:
        print(f"GT*: frame {entry['timestep']:05d}_{entry['camera']:02d} is skipped: {entry['why']}")
    if entries.skipped:
        why = entries.skipped[0]["why"]
        warnings.warn(f"{len(entries.skipped)} of {count} frames have no targets: {why}", CarigsWarning, stacklevel=2)
    reduced = [entry for entry in entries.targets if entry["weight"] < 1]
    for entry in reduced:
        error = f"{entry['pixels_off']:.1f} pixels off the others"
        print(f"GT*: frame {Path(entry['image']).stem} is {error}: its weight is {entry['weight']:.2f}")
    if reduced:
        problem = "have a reduced weight, because they are shifted against the others"
        warnings.warn(f"{len(reduced)} of {count} frames {problem}", CarigsWarning, stacklevel=2)
