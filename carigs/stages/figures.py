"""Stage `figures`: strips over the level, the ablation sheet, the blend error (figure 2) and the misregistration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from carigs.capture import Capture
from carigs.capture.frame_index import read_frame_index, read_ground_truth
from carigs.capture.images import read_rgb
from carigs.errors import InputError, SettingsError
from carigs.exaggeration import GammaPath
from carigs.files import writing_folder
from carigs.head import read_subject_path, subject_exaggerator
from carigs.head.teeth import without_teeth
from carigs.settings import Exaggerate, Figures, Gtstar
from evaluation.figures.blend_error import BlendError, blend_errors, plot_blend_errors
from evaluation.figures.misregistration import Misregistration, misregistrations, plot_misregistrations
from evaluation.figures.strips import ablation, gamma_strip
from evaluation.tables.csv_files import write_csv


def figures(
    settings: Figures,
    *,
    indices: Sequence[Path],
    variants: Sequence[str],
    levels: Sequence[float],
    truths: Sequence[Path],
    truth_levels: Sequence[float],
    capture: Path,
    path: Path,
    gtstar: Mapping[str, Any],
    mask_flags: Sequence[str],
    folder: Path,
) -> None:
    """Write `gamma_strip_{variant}.png`, `ablation.png`, and .png and .csv of `blend_error` and `misregistration`.

    A path that no solver made has no exact solution: `blend_error.txt` then says so in place of the other two files.
    Likewise `misregistration.txt` where there is no true caricature.

    Args:
        settings: Camera, timestep and height of the strips, and samples of the blend error.
        indices: Indices of rendered frames.
        variants: Variant of each index.
        levels: Level of each index.
        truths: Indices of true images.
        truth_levels: Level of each of `truths`.
        capture: Index of the capture.
        path: Caricature path of the subject.
        gtstar: Settings of the stage `gtstar`, for the targets of the misregistration.
        mask_flags: Flags whose pixels the training leaves out (`train.mask_flags`).
        folder: Folder to write.

    Raises:
        SettingsError: The settings name no test frame.
        InputError: An input is malformed or lacks the frame of the strips.
    """
    subject = Capture.load(capture)
    gamma_path = read_subject_path(path, subject.model)
    frame = _strip_frame(settings, subject)
    known = {level: read_ground_truth(file) for level, file in zip(truth_levels, truths, strict=True)}
    shown = sorted({*levels, *known})
    files = [known[level].images.get(frame) if level in known else None for level in shown]
    true_images = [file and read_rgb(file) for file in files]
    points = zip(variants, levels, indices, strict=True)
    renders = {(variant, level): _rendered(index, frame) for variant, level, index in points}
    strips = {variant: [renders.get((variant, level)) for level in shown] for variant in variants}
    with writing_folder(folder) as part:
        for variant, images in strips.items():
            file = part / f"gamma_strip_{variant}.png"
            gamma_strip(file, variant, shown, images, true_images, height=settings.image_height)
        ablation(part / "ablation.png", strips, shown, true_images, height=settings.image_height)
        _blend_error(part, without_teeth(gamma_path), subject, settings.blend_error_samples)
        if any(level > 0 and truth.images for level, truth in known.items()):
            records = list(misregistrations(subject, gamma_path, known, Gtstar(**gtstar), mask_flags))
            write_csv(part / "misregistration.csv", records, Misregistration)
            plot_misregistrations(part / "misregistration.png", records)
        else:
            (part / "misregistration.txt").write_text("No true caricature is known.\n")


def _strip_frame(settings: Figures, subject: Capture) -> tuple[int, int]:
    """Timestep and camera of the frame in the strips."""
    camera = subject.validation_camera if settings.camera is None else settings.camera
    for frame in subject.split("test"):
        if frame.camera == camera and settings.timestep in (None, frame.timestep):
            return frame.timestep, frame.camera
    where = f"figures.camera={settings.camera}, figures.timestep={settings.timestep}"
    raise SettingsError(f"{where}: there is no such test frame")


def _rendered(index: Path, frame: tuple[int, int]) -> np.ndarray:
    for rendered in read_frame_index(index):
        if rendered.protocol == "test" and (rendered.timestep, rendered.camera) == frame:
            return read_rgb(rendered.file)
    raise InputError(f"no test frame of timestep {frame[0]}, camera {frame[1]}", file=index)


def _blend_error(folder: Path, path: GammaPath, subject: Capture, samples: int) -> None:
    if path.report.get("source") != "poisson":
        (folder / "blend_error.txt").write_text("The caricature comes from a file: there is no exact path.\n")
        return
    settings = Exaggerate(**path.report.get("settings", {}))
    head = subject_exaggerator(subject.model, path.neutral, settings)

    def exact(level: float) -> np.ndarray:
        # Along the path, regions keep their proportion to the rest.
        share = level / path.gamma_f
        return head.solve(level, {name: share * own for name, own in settings.regions.items()} if level else None)

    # Paths are stored in float32. After a larger difference, the error would describe another path.
    difference = np.abs(exact(path.gamma_f) - path.displacement(path.gamma_f)).max()
    if difference > 1e-4 * np.linalg.norm(np.ptp(path.neutral, axis=0)):
        text = f"Solving again gives another caricature, {1e3 * difference:.2g} mm away: the path was made otherwise."
        (folder / "blend_error.txt").write_text(f"{text}\n")
        return
    errors = blend_errors(path, exact, samples)
    write_csv(folder / "blend_error.csv", errors, BlendError)
    plot_blend_errors(folder / "blend_error.png", errors)
