"""Figures of the paper that compare rendered images: levels, the baseline, and the ablations.

Each function writes a sheet, or returns the reason why it is left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from carigs.exaggeration import GammaPath
from carigs.head import pose
from carigs.mouth import lip_gap, lip_line
from evaluation.figures.region_window import region_window
from evaluation.figures.sheet import Image, write_sheet
from evaluation.figures.study_images import StudyImages

ERROR_SCALE = 0.25
"""Absolute error (mean of the channels) of the brightest colour."""
METHOD, BASELINE = "alternating", "surfhead"
SUPERVISION = {"original only": BASELINE, "GT* only": "gtstar_only", "alternating": METHOD}
"""Variants of the ablation of alternating supervision, by their name in the paper."""
NO_HAIR_MASK = ("no_hair_mask", "no_mask")
"""Variants without a mask on hair; the first one of the study is drawn."""
NO_HAIR = "no hair of the head model is in view"
LIPS = ("lips",)


def gamma_strip(file: Path, images: StudyImages, variant: str) -> None:
    """Draw one variant at each level, the true images, and their difference (figures 10 to 12 of the paper).

    Args:
        file: PNG file to write.
        images: Images of the subject.
        variant: Name of the variant.
    """
    rows: dict[str, list[Image | None]] = {variant: [images.rendered(variant, level) for level in images.levels]}
    rows["truth"] = [images.true(level) for level in images.levels]
    rows["error"] = [error_map(*pair) for pair in zip(*rows.values(), strict=True)]
    footnote = f"error: mean absolute difference of the channels, black 0 to yellow {ERROR_SCALE:g} or more"
    _write_rows(file, images, rows, _labels(images.levels), variant, footnote)


def ablation(file: Path, images: StudyImages) -> None:
    """Draw all variants (rows) at each level (columns), above the true images.

    Args:
        file: PNG file to write.
        images: Images of the subject.
    """
    rows = {variant: [images.rendered(variant, level) for level in images.levels] for variant in images.variants}
    rows["truth"] = [images.true(level) for level in images.levels]
    _write_rows(file, images, rows, _labels(images.levels), "Ablation")


def alternation(file: Path, images: StudyImages) -> str | None:
    """Draw the three kinds of supervision at each level (figures 10 to 12 of the paper in one).

    Args:
        file: PNG file to write.
        images: Images of the subject.

    Returns:
        Why it is left out, if it is.
    """
    if missing := [variant for variant in SUPERVISION.values() if variant not in images.variants]:
        return f"the study lacks the variant {' and '.join(missing)}"
    rows = {name: [images.rendered(variant, level) for level in images.levels] for name, variant in SUPERVISION.items()}
    rows["truth"] = [images.true(level) for level in images.levels]
    _write_rows(file, images, rows, _labels(images.levels), "Alternating supervision")
    return None


def renderings(file: Path, images: StudyImages) -> str | None:
    """Draw the baseline at gamma_f beside the method at each level, from several views (figure 5 of the paper).

    Args:
        file: PNG file to write.
        images: Images of the subject.

    Returns:
        Why it is left out, if it is.
    """
    if missing := [variant for variant in (BASELINE, METHOD) if variant not in images.variants]:
        return f"the study lacks the variant {' and '.join(missing)}"
    end, rows = images.levels[-1], {}
    for timestep, camera in images.views:
        view = (timestep, camera)
        row = [images.rendered(BASELINE, end, view), *(images.rendered(METHOD, level, view) for level in images.levels)]
        rows[f"camera {camera}"] = [*row, images.true(end, view)]
    columns = [f"{BASELINE}, γ = {end:g}", *_labels(images.levels), f"truth, γ = {end:g}"]
    if all(row[-1] is None for row in rows.values()):
        columns, rows = columns[:-1], {name: row[:-1] for name, row in rows.items()}
    _write_rows(file, images, rows, columns, f"{BASELINE}, and {METHOD} from level 0 to {end:g}")
    return None


def editing(file: Path, images: StudyImages) -> None:
    """Draw edited avatars beside the avatar of real frames, the method and the truth (figure 6 of the paper).

    Args:
        file: PNG file to write.
        images: Images of the subject; some variants are edited.
    """
    start, end = images.levels[0], images.levels[-1]
    candidates = [(BASELINE, start), *((name, end) for name in images.edited), (METHOD, end)]
    shown = [(name, level) for name, level in candidates if name in images.variants]
    rows: dict[str, list[Image | None]] = {
        f"camera {camera}": [
            *(images.rendered(name, level, (timestep, camera)) for name, level in shown),
            images.true(end, (timestep, camera)),
        ]
        for timestep, camera in images.views
    }
    edited = set(images.edited)
    columns = [name if name in edited else f"{name}, γ = {level:g}" for name, level in shown]
    columns.append(f"truth, γ = {end:g}")
    if all(row[-1] is None for row in rows.values()):
        columns, rows = columns[:-1], {name: row[:-1] for name, row in rows.items()}
    _write_rows(file, images, rows, columns, "Edited avatars, and caricatures")


def hair_mask(file: Path, images: StudyImages, path: GammaPath, hair_regions: Sequence[str]) -> str | None:
    """Draw the hair with and without its mask at gamma_f (figure 7 of the paper).

    Args:
        file: PNG file to write.
        images: Images of the subject.
        path: Caricature path of the subject.
        hair_regions: Regions of the head model with hair.

    Returns:
        Why it is left out, if it is.
    """
    without = next((variant for variant in NO_HAIR_MASK if variant in images.variants), None)
    if METHOD not in images.variants or without is None:
        return f"it needs the variants {METHOD} and {' or '.join(NO_HAIR_MASK)}"
    end = images.levels[-1]
    rows: dict[str, list[Image | None]] = {"masked": [], without: [], "truth": []}
    for view in images.views:
        window = _window(images, path, hair_regions, end, view)
        if window is None:
            return NO_HAIR
        whole = images.rendered(METHOD, end, view), images.rendered(without, end, view), images.true(end, view)
        for row, image in zip(rows.values(), whole, strict=True):
            row.append(None if image is None else image[window])
    columns = [f"camera {camera}" for _, camera in images.views]
    _write_rows(file, images, rows, columns, f"Hair mask, γ = {end:g}")
    return None


def hair(file: Path, images: StudyImages, path: GammaPath, hair_regions: Sequence[str]) -> str | None:
    """Draw the hair at level 0 and at gamma_f beside the truth, enlarged: outline, fringe and ears.

    Args:
        file: PNG file to write.
        images: Images of the subject.
        path: Caricature path of the subject.
        hair_regions: Regions of the head model with hair.

    Returns:
        Why it is left out, if it is.
    """
    if METHOD not in images.variants:
        return f"the study lacks the variant {METHOD}"
    windows = [
        {view: _window(images, path, hair_regions, level, view) for view in images.views}
        for level in (images.levels[0], images.levels[-1])
    ]
    if any(window is None for shown in windows for window in shown.values()):
        return NO_HAIR
    _write_beside_truth(file, images, windows, "Hair")
    return None


def mouth(file: Path, images: StudyImages, path: GammaPath) -> str | None:
    """Draw the widest open mouth of the rendered test frames at level 0 and at gamma_f beside the truth, enlarged.

    Args:
        file: PNG file to write.
        images: Images of the subject.
        path: Caricature path of the subject.

    Returns:
        Why it is left out, if it is.
    """
    if METHOD not in images.variants:
        return f"the study lacks the variant {METHOD}"
    subject = images.subject
    if lip_line(subject.model, path.neutral) is None:
        return "the head model has no landmarks of the lips"
    ends = images.levels[0], images.levels[-1]
    rendered = set.intersection(*(images.rendered_frames(METHOD, level) for level in ends))
    timesteps = sorted({timestep for timestep, _ in rendered})
    gaps = {t: lip_gap(subject.model, pose(subject.model, subject.parameters(t))) for t in timesteps}
    widest = max(timesteps, key=lambda t: gaps[t])
    views = [(widest, camera) for _, camera in images.views if (widest, camera) in rendered]
    windows = [{view: _window(images, path, LIPS, level, view) for view in views} for level in ends]
    seen = [view for view in views if all(shown[view] is not None for shown in windows)]
    if not seen:
        return "no lips of the head model are in view"
    _write_beside_truth(file, images, [{view: shown[view] for view in seen} for shown in windows], "Open mouth")
    return None


def _write_beside_truth(
    file: Path, images: StudyImages, windows: Sequence[Mapping[tuple[int, int], tuple[slice, slice]]], title: str
) -> None:
    """Write parts of the method's images at level 0 and gamma_f, each beside the truth if that is known."""
    ends = images.levels[0], images.levels[-1]
    rows: dict[str, list[Image | None]] = {f"camera {camera}": [] for _, camera in windows[0]}
    for level, shown in zip(ends, windows, strict=True):
        for (view, window), row in zip(shown.items(), rows.values(), strict=True):
            truth = images.true(level, view)
            row += [images.rendered(METHOD, level, view)[window], None if truth is None else truth[window]]
    columns = [f"{name}, γ = {level:g}" for level in ends for name in (METHOD, "truth")]
    known = [j for j in range(len(columns)) if any(row[j] is not None for row in rows.values())]
    shown = {name: [row[j] for j in known] for name, row in rows.items()}
    _write_rows(file, images, shown, [columns[j] for j in known], title)


def _window(
    images: StudyImages, path: GammaPath, regions: Sequence[str], level: float, view: tuple[int, int]
) -> tuple[slice, slice] | None:
    """Rows and columns of a view that show some regions at a level; None if they are not in view."""
    subject = images.subject
    vertices = pose(subject.model, subject.parameters(view[0]), path.at(level))
    return region_window(subject.model, vertices, subject.camera(subject.frame_at[view]), regions)


def error_map(image: Image | None, truth: Image | None) -> Image | None:
    """Mean absolute difference of the channels in colours, black to yellow.

    Args:
        image: Image.
        truth: True image.

    Returns:
        The colours; None if either image is missing.
    """
    if image is None or truth is None:
        return None
    from matplotlib import colormaps

    error = np.abs(image - truth).mean(axis=2) / ERROR_SCALE
    return colormaps["inferno"](np.clip(error, 0, 1))[:, :, :3]


def _write_rows(
    file: Path, images: StudyImages, rows: Mapping[str, Sequence[Image | None]], columns: Sequence[str], title: str,
    footnote: str = "",
) -> None:  # fmt: skip
    """Write a sheet of the rows that have an image, all reduced or enlarged to the same size."""
    shown = {name: row for name, row in rows.items() if any(image is not None for image in row)}
    footnote = footnote if "error" in shown else ""
    write_sheet(
        file, list(shown.values()), rows=list(shown), columns=columns, title=title, height=images.height,
        footnote=footnote,
    )  # fmt: skip


def _labels(levels: Sequence[float]) -> list[str]:
    return [f"γ = {level:g}" for level in levels]
