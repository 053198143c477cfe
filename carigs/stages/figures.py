"""Stage `figures`: the figures of the paper that show results, from the renderings of one subject."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from carigs.capture import Capture
from carigs.capture.frame_index import GroundTruth, read_ground_truth
from carigs.exaggeration import Exaggerator, GammaPath
from carigs.files import writing_folder
from carigs.hair import load_hair
from carigs.head import read_subject_path, subject_exaggerator
from carigs.head.teeth import without_teeth
from carigs.settings import Exaggerate, Figures, Gtstar
from evaluation.figures import strips
from evaluation.figures.blend_error import BlendError, blend_errors, plot_blend_errors
from evaluation.figures.local_edits import local_edits, write_local_edits
from evaluation.figures.misregistration import Misregistration, misregistrations, plot_misregistrations
from evaluation.figures.study_images import StudyImages, strip_frame
from evaluation.tables.csv_files import write_csv


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

    A figure that cannot be drawn is left out, and `left_out.txt` says why.

    Args:
        settings: Camera, timestep and height of the images, and samples of the blend error.
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

    Raises:
        SettingsError: The settings name no test frame.
        InputError: An input is malformed or lacks a frame.
    """
    subject, warp = Capture.load(capture), Gtstar(**gtstar)
    gamma_path = read_subject_path(path, subject.model)
    known = {level: read_ground_truth(file) for level, file in zip(levels, truths, strict=True)}
    rendered = dict(zip(variants, frames, strict=True))
    images = StudyImages(subject, rendered, known, strip_frame(settings, subject), settings.image_height)
    solver = _solver(subject, gamma_path)
    with writing_folder(folder) as part:
        for variant in images.variants:
            strips.gamma_strip(part / f"gamma_strip_{variant}.png", images, variant)
        strips.ablation(part / "ablation.png", images)
        reasons = {
            "renderings": strips.renderings(part / "renderings.png", images),
            "alternation": strips.alternation(part / "alternation.png", images),
            "hair": strips.hair(part / "hair.png", images, gamma_path, warp.hair_regions),
            "mouth": strips.mouth(part / "mouth.png", images, gamma_path),
            "hair_mask": strips.hair_mask(part / "hair_mask.png", images, gamma_path, warp.hair_regions),
            "local_edits": _local_edits(part, images, gamma_path, solver, avatar),
            "blend_error": _blend_error(part, without_teeth(gamma_path), solver, settings.blend_error_samples),
            "misregistration": _misregistration(part, subject, gamma_path, known, warp, mask_flags, hair),
        }
        lines = [f"{name}: {reason}\n" for name, reason in reasons.items() if reason]
        if lines:
            (part / "left_out.txt").write_text("".join(lines), encoding="utf-8")


def _solver(subject: Capture, path: GammaPath) -> tuple[Exaggerator, Exaggerate] | str:
    """The solver that made a path, with its settings; a reason if there is none."""
    if path.report.get("source") != "poisson":
        return "the caricature comes from a file: there is no equation to solve"
    settings = Exaggerate(**path.report.get("settings", {}))
    return subject_exaggerator(subject.model, without_teeth(path).neutral, settings), settings


def _blend_error(
    folder: Path, path: GammaPath, solver: tuple[Exaggerator, Exaggerate] | str, samples: int
) -> str | None:
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
    errors = blend_errors(path, exact, samples)
    write_csv(folder / "blend_error.csv", errors, BlendError)
    plot_blend_errors(folder / "blend_error.png", errors)
    return None


def _local_edits(
    folder: Path,
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

    person, views = load_avatar(avatar), images.views[:2]
    person.sequence.path = path
    cameras = [images.subject.camera(images.subject.frame_at[view]) for view in views]
    edits = local_edits(person, solver[0], path.gamma_f, views[0][0], cameras)
    numbers = [camera for _, camera in views]
    write_local_edits(folder / "local_edits.png", edits, numbers, path.gamma_f, height=images.height)
    return None


def _misregistration(
    folder: Path,
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
    write_csv(folder / "misregistration.csv", records, Misregistration)
    plot_misregistrations(folder / "misregistration.png", records)
    return None
