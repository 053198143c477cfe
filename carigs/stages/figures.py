"""Stage `figures`: the figures of the paper that show results, from the renderings of one subject."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from carigs.capture import Capture
from carigs.capture.frame_index import GroundTruth, read_ground_truth
from carigs.errors import CarigsWarning, MeshError, SettingsError
from carigs.exaggeration import Exaggerator, GammaPath
from carigs.hair import load_hair
from carigs.head import read_subject_path, subject_exaggerator
from carigs.head.teeth import without_teeth
from carigs.settings import Exaggerate, Figures, Gtstar
from carigs.system.files import writing_folder
from evaluation.figures import strips
from evaluation.figures.blend_error import BlendError, blend_errors, plot_blend_errors
from evaluation.figures.local_edits import local_edits, write_local_edits
from evaluation.figures.misregistration import Misregistration, misregistrations, plot_misregistrations
from evaluation.figures.study_images import StudyImages
from evaluation.tables.csv_files import write_csv

BLEND_ERROR_SAMPLES = 26
"""Levels at which the blend error is evaluated."""


def figures(
    settings: Figures,
    *,
    frames: Sequence[Path],
    variants: Sequence[str],
    levels: Sequence[float],
    truths: Sequence[Path],
    capture: Path,
    path: Path,
    hair: Path | None = None,
    avatar: Path | None,
    gtstar: Mapping[str, Any],
    mask_flags: Sequence[str],
    folder: Path,
) -> None:
    """Write the figures as PNG files; plots also as PDF, and their numbers as CSV.

    A figure that cannot be drawn is left out, and `left_out.txt` says why in a line.

    Args:
        settings: Camera and timestep of the images.
        frames: Folders of renderings, as the stage `render` writes them, of one seed.
        variants: Variant of each folder.
        levels: Rendered levels.
        truths: Index of the true images of each level.
        capture: Index of the capture.
        path: Caricature path of the subject.
        hair: What covers the head, for the masks of the misregistration; None if nothing does.
        avatar: The avatar for local edits, of the variant `alternating`; None if the study lacks it.
        gtstar: Settings of the stage `gtstar`, for the targets of the misregistration.
        mask_flags: Flags whose pixels the training leaves out (`train.mask_flags`).
        folder: Folder to write.

    Warns:
        CarigsWarning: There is no test frame, or none of the camera and timestep that the settings name.

    Raises:
        InputError: An input is malformed or lacks a frame.
    """
    subject, warp = Capture.load(capture), Gtstar(**gtstar)
    gamma_path = read_subject_path(path, subject.model)
    known = {level: read_ground_truth(file) for level, file in zip(levels, truths, strict=True)}
    rendered = dict(zip(variants, frames, strict=True))
    images = StudyImages(subject, rendered, known, settings)
    solver = _solver(subject, gamma_path)
    with writing_folder(folder) as part:
        figure: dict[str, Callable[[Path], str | None]] = {
            **{f"gamma_strip_{name}": partial(_gamma_strip, images, name) for name in images.variants},
            "ablation": lambda file: strips.ablation(file, images),
            "renderings": lambda file: strips.renderings(file, images),
            "alternation": lambda file: strips.alternation(file, images),
            "hair": lambda file: strips.hair(file, images, gamma_path, warp.regions.hair),
            "mouth": lambda file: strips.mouth(file, images, gamma_path),
            "hair_mask": lambda file: strips.hair_mask(file, images, gamma_path, warp.regions.hair),
            "local_edits": lambda file: _local_edits(file, images, gamma_path, solver, avatar),
            "blend_error": lambda file: _blend_error(file, without_teeth(gamma_path), solver),
            "misregistration": lambda file: _misregistration(file, subject, gamma_path, known, warp, mask_flags, hair),
        }
        if images.edited:
            figure["editing"] = lambda file: strips.editing(file, images)
        reasons = {name: _reason(draw, part / f"{name}.png") for name, draw in figure.items()}
        lines = [f"{name}: {reason}\n" for name, reason in reasons.items() if reason]
        if lines:
            (part / "left_out.txt").write_text("".join(lines), encoding="utf-8")
    if images.problem:
        warnings.warn(f"figures of test frames are left out: {images.problem}", CarigsWarning, stacklevel=2)


def _reason(draw: Callable[[Path], str | None], file: Path) -> str | None:
    """Draw a figure; why it is left out, if it is. One that cannot be drawn must not end a study that is trained."""
    try:
        return draw(file)
    except (SettingsError, MeshError) as error:
        return str(error)


def _gamma_strip(images: StudyImages, variant: str, file: Path) -> None:
    strips.gamma_strip(file, images, variant)


def _solver(subject: Capture, path: GammaPath) -> tuple[Exaggerator, Exaggerate] | str:
    """The solver that made a path, with its settings; a reason if there is none."""
    if path.report.get("source") != "poisson":
        return "the caricature comes from a file: there is no equation to solve"
    settings = Exaggerate(**path.report.get("settings", {}))
    return subject_exaggerator(subject.model, without_teeth(path).neutral, settings), settings


def _blend_error(file: Path, path: GammaPath, solver: tuple[Exaggerator, Exaggerate] | str) -> str | None:
    if isinstance(solver, str):
        return solver
    head, settings = solver

    def exact(level: float) -> np.ndarray:
        # Along the path, regions keep their proportion to the rest.
        share = level / path.gamma_f
        return head.solve(level, {name: share * own for name, own in settings.regions.items()} if level else None)

    # Paths are stored in float32. After a larger difference, the error would describe another path.
    difference = np.abs(exact(path.gamma_f) - path.displacement(path.gamma_f)).max()
    if difference > 1e-4 * np.linalg.norm(np.ptp(path.neutral, axis=0)):
        return f"solving again gives another caricature, {1e3 * difference:.2g} mm away: the path was made otherwise"
    errors = blend_errors(path, exact, BLEND_ERROR_SAMPLES)
    write_csv(file.with_suffix(".csv"), errors, BlendError)
    plot_blend_errors(file, errors)
    return None


def _local_edits(
    file: Path,
    images: StudyImages,
    path: GammaPath,
    solver: tuple[Exaggerator, Exaggerate] | str,
    avatar: Path | None,
) -> str | None:
    if avatar is None:
        return f"the study lacks the variant {strips.METHOD}"
    if isinstance(solver, str):
        return solver
    from carigs.splat.avatar import load_avatar

    # Every frame of the capture can be rendered, so that a capture without test frames has this figure, too.
    person, views = load_avatar(avatar), images.views[:2] if images.subject.split("test") else _any_view(images.subject)
    person.sequence.path = path
    cameras = [images.subject.camera(images.subject.frame_at[view]) for view in views]
    edits = local_edits(person, solver[0], path.gamma_f, views[0][0], cameras)
    numbers = [camera for _, camera in views]
    write_local_edits(file, edits, numbers, path.gamma_f, height=images.height)
    return None


def _any_view(subject: Capture) -> list[tuple[int, int]]:
    """The first frame of the validation camera."""
    return [(f.timestep, f.camera) for f in subject.frames if f.camera == subject.validation_camera][:1]


def _misregistration(
    file: Path,
    subject: Capture,
    path: GammaPath,
    known: Mapping[float, GroundTruth],
    warp: Gtstar,
    mask_flags: Sequence[str],
    hair: Path | None,
) -> str | None:
    if not any(level > 0 and truth.images for level, truth in known.items()):
        return "no true caricature is known"
    covered = None if hair is None else load_hair(hair, len(subject.model.faces)).covered
    records = list(misregistrations(subject, path, known, warp, mask_flags, covered))
    write_csv(file.with_suffix(".csv"), records, Misregistration)
    plot_misregistrations(file, records)
    return None
