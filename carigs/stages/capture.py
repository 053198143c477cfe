"""Stage `capture`: check and index a dataset; the toy is rendered first."""

from __future__ import annotations

import shutil
import warnings
from dataclasses import replace
from pathlib import Path

from carigs.capture import Capture, read_dataset
from carigs.capture.capture_digest import capture_digest
from carigs.capture.thinning import thin_frames
from carigs.errors import CarigsWarning, InputError
from carigs.plausibility import check_capture, resolve_cy
from carigs.plausibility.coverage import capture_coverage, lost_camera
from carigs.plausibility.diagnosis import diagnose, read_scene
from carigs.plausibility.findings import summarize
from carigs.settings import CaptureSettings
from carigs.system.files import writing_folder


def capture(settings: CaptureSettings, *, index: Path, dataset: Path, tracked: Path | None = None) -> None:
    """Check a dataset and write its index.

    Args:
        settings: Settings of the stage.
        index: Output: the index (capture.json).
        dataset: Output: folder of the toy, or of frames that end below the chin (`settings.body`); else empty.
        tracked: Input: the dataset of a video.

    Raises:
        SettingsError: For an unknown source, or a folder without a path.
        InputError: If the dataset is broken, or its parts cannot belong together.

    Warns:
        CarigsWarning: Per kind of what is likely to be wrong; the index holds the same lines.
    """
    if settings.source == "toy":
        from carigs.toy import write_capture

        with writing_folder(dataset) as part:
            write_capture(part, settings.toy)
        checked = _selected(settings, dataset, dataset / "head_model.npz")
    else:
        checked = _checked(settings, dataset, tracked)
    checked.save(index)
    if coverage := capture_coverage(checked):
        print(coverage)


def _checked(settings: CaptureSettings, dataset: Path, tracked: Path | None) -> Capture:
    """The capture of a folder or a video, with its warnings, which are printed, and the digest of its files."""
    if tracked is not None:
        settings = replace(settings, folder=str(tracked), head_model=str(tracked / "head_model.npz"))
    found = _read_folder(settings)
    if settings.body == "cut":
        found = _without_body(found, dataset)
    else:
        with writing_folder(dataset):
            pass
    checked = check_capture(found, match_exposure=settings.match_exposure, mend=settings.mend_outlines)
    lost = summarize(filter(None, [lost_camera(checked)]))
    checked = replace(checked, warnings=(*checked.warnings, *lost))
    for line in checked.warnings:
        warnings.warn(line, CarigsWarning, stacklevel=2)
    return replace(checked, digest=capture_digest(checked))


def _without_body(capture: Capture, folder: Path) -> Capture:
    """A copy of a capture, with frames and mattes that end below the chin."""
    from carigs.matting.cut_dataset import write_cut_dataset

    if folder.exists():
        shutil.rmtree(folder)
    write_cut_dataset(folder, capture)
    print("frames and mattes end below the chin (capture.body=cut)")
    cut = read_dataset(folder, folder / "head_model.npz", background=capture.background)
    rule = f"{capture.split_rule}; frames end below the chin"
    return replace(cut, split_rule=rule, cy=capture.cy, warnings=capture.warnings)


def _read_folder(settings: CaptureSettings) -> Capture:
    """The dataset with the frames that the settings select, in OpenCV's convention."""
    stated = _selected(settings, Path(settings.folder), Path(settings.head_model))
    try:
        found = resolve_cy(stated, settings.cy)
    except InputError as error:  # another mistake may hide the convention
        diagnosis = diagnose(read_scene(stated))
        raise diagnosis.error(stated.root) if diagnosis.mistakes else error from None
    if not found.cy.startswith("opencv: centred"):
        print(f"cy is read as {found.cy}")
    return found


def _selected(settings: CaptureSettings, folder: Path, head_model: Path) -> Capture:
    found = read_dataset(
        folder,
        head_model,
        background=settings.background,
        split=settings.split,
        validation_camera=settings.validation_camera,
    )
    frames = thin_frames(found.frames, settings.stride, settings.max_frames)
    rule = found.split_rule
    if len(frames) < len(found.frames):
        limit = f", at most {settings.max_frames} per split" if settings.max_frames else ""
        rule += f"; {len(frames)} of {len(found.frames)} frames (stride {settings.stride}{limit})"
    return replace(found, frames=frames, split_rule=rule)
