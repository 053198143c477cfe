"""Stage `figures`: strips over the level, the ablation sheet, and the blend error."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from carigs.capture import Capture
from carigs.capture.frame_index import GroundTruth, read_frame_index, read_ground_truth
from carigs.capture.images import read_rgb
from carigs.errors import InputError, SettingsError
from carigs.exaggeration import GammaPath
from carigs.files import writing_folder
from carigs.head import exaggerator
from carigs.head.teeth import without_teeth
from carigs.settings import Exaggerate, Figures
from evaluation.figures.blend_error import blend_errors, plot_blend_errors, write_blend_errors
from evaluation.figures.misregistration import misregistrations, plot_misregistrations, write_misregistrations
from evaluation.figures.strips import ablation, gamma_strip


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
    folder: Path,
) -> None:
    """Write `gamma_strip_{variant}.png`, `ablation.png`, and .png and .csv of `blend_error` and `misregistration`.

    `variants` and `levels` belong to `indices` one by one, `truth_levels` to `truths`.  A path that no solver made has
    no blend error: `blend_error.txt` then says so, and `misregistration.txt` where there is no truth.
    """
    if settings.samples < 3 or settings.height < 1:
        raise SettingsError(
            f"figures.samples={settings.samples} must be at least 3, figures.height={settings.height} at least 1"
        )
    subject = Capture.load(capture)
    frame = _shown_frame(settings, subject)
    true_images = dict.fromkeys(sorted(set(levels)))
    for level, file in zip(truth_levels, truths, strict=True):
        image = read_ground_truth(file).images.get(frame)
        true_images[level] = None if image is None else read_rgb(image)
    shown = sorted(true_images)
    truth_row = [true_images[level] for level in shown]
    renders = {variant: dict.fromkeys(shown) for variant in variants}
    for index, variant, level in zip(indices, variants, levels, strict=True):
        renders[variant][level] = _rendered(index, frame)
    rows = {variant: list(images.values()) for variant, images in renders.items()}
    with writing_folder(folder) as part:
        for variant, images in rows.items():
            file = part / f"gamma_strip_{variant}.png"
            gamma_strip(file, variant, shown, images, truth_row, height=settings.height)
        ablation(part / "ablation.png", rows, shown, truth_row, height=settings.height)
        _blend_error(part, without_teeth(GammaPath.load(path)), subject, settings.samples)
        known = {level: read_ground_truth(file) for level, file in zip(truth_levels, truths, strict=True)}
        _misregistration(part, subject, GammaPath.load(path), known)


def _shown_frame(settings: Figures, subject: Capture) -> tuple[int, int]:
    """Timestep and camera of the frame in the strips."""
    camera = subject.validation_camera if settings.camera is None else settings.camera
    frames = [(frame.timestep, frame.camera) for frame in subject.split("test") if frame.camera == camera]
    if settings.timestep is not None:
        frames = [frame for frame in frames if frame[0] == settings.timestep]
    if not frames:
        raise SettingsError(
            f"figures.camera={settings.camera}, figures.timestep={settings.timestep}: there is no such test frame"
        )
    return frames[0]


def _rendered(index: Path, frame: tuple[int, int]) -> np.ndarray:
    for rendered in read_frame_index(index):
        if rendered.protocol == "test" and (rendered.timestep, rendered.camera) == frame:
            return read_rgb(rendered.file)
    raise InputError(f"no test frame of timestep {frame[0]}, camera {frame[1]}", file=index)


def _misregistration(folder: Path, subject: Capture, path: GammaPath, truths: dict[float, GroundTruth]) -> None:
    if not any(level > 0 and known.images for level, known in truths.items()):
        (folder / "misregistration.txt").write_text("No true caricature is known.\n")
        return
    rows = list(misregistrations(subject, path, truths))
    write_misregistrations(folder / "misregistration.csv", rows)
    plot_misregistrations(folder / "misregistration.png", rows)


def _blend_error(folder: Path, path: GammaPath, subject: Capture, samples: int) -> None:
    if path.report.get("source") != "poisson":
        (folder / "blend_error.txt").write_text("The caricature comes from a file: there is no exact path.\n")
        return
    settings = Exaggerate(**path.report.get("settings", {}))
    head = exaggerator(subject.model, path.neutral, settings)

    def exact(level: float) -> np.ndarray:
        # Along the path, regions keep their proportion to the rest.
        share = level / path.gamma_f
        return head.solve(level, {name: share * own for name, own in settings.regions.items()} if level else None)

    # Stored in float32; a larger difference means that the path was made otherwise, and the error would mislead.
    difference = np.abs(exact(path.gamma_f) - path.displacement(path.gamma_f)).max()
    if difference > 1e-4 * np.linalg.norm(np.ptp(path.neutral, axis=0)):
        (folder / "blend_error.txt").write_text(
            f"Solving again gives another caricature, {1e3 * difference:.2g} mm away: the path was made otherwise.\n"
        )
        return
    errors = blend_errors(path, exact, samples)
    write_blend_errors(folder / "blend_error.csv", errors)
    plot_blend_errors(folder / "blend_error.png", errors)
