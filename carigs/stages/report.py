"""Stage `report`: card, images by level, figures, training curves, tables, gaps and settings of a study in one page."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import product
from pathlib import Path
from urllib.parse import quote

import numpy as np

from carigs.capture import Capture
from carigs.capture.frame_index import read_ground_truth
from carigs.capture.held_out_poses import capture_pose_gap
from carigs.capture.images import read_rgb8
from carigs.config import load_settings
from carigs.plausibility.coverage import capture_coverage
from carigs.readers.yaml_files import read_yaml_text
from carigs.runs.summary import logged_warnings
from carigs.settings import Report
from carigs.system.files import writing
from evaluation.card.card import read_card
from evaluation.card.document import card_parts
from evaluation.figures.study_images import IMAGE_HEIGHT, StudyImages
from evaluation.metrics.catalogue import CATALOGUE
from evaluation.report import page as html
from evaluation.report.images import data_uri, fitting_height
from evaluation.report.training_chart import subject_chart
from evaluation.tables.document import without_paths
from evaluation.tables.summary_file import read_summaries
from evaluation.tables.typeset import comparison_tables

FIGURE_WIDTH = 1800
"""Largest width of a figure in the page, in pixels."""
MAX_BYTES = 15e6
"""Largest size of the page. Figures are reduced, then left out, to keep to it."""
NO_FIGURES = f"all figures: with them the page would have more than {MAX_BYTES / 1e6:g} MB"
CAPTIONS = {
    "ablation": "all variants of the study at every level",
    "renderings": "the baseline at the highest level, and the method from level 0 to it (figure 5 of the paper)",
    "alternation": "supervision by original frames, by GT* frames, and by both in turn (figures 10 to 12 of the paper)",
    "hair": "hair at level 0 and at the highest level beside the truth, enlarged",
    "hair_mask": "hair that is masked in GT* frames, and hair that is not (figure 7 of the paper)",
    "local_edits": "one region exaggerated at a time (figure 4 of the paper)",
    "blend_error": "distance between the interpolated and the exactly solved surface by level, in bounding-box "
    "diagonals, with its bound (figure 3 of the paper)",
    "misregistration": "error of warped frames against the true caricature by region and level (figure 9 of the paper)",
}
"""What figures show, by the name of the file."""


def report(
    settings: Report,
    *,
    card: Path,
    table: Path,
    figures: Sequence[Path],
    captures: Sequence[Path],
    frames: Sequence[Path],
    truths: Sequence[Path],
    training: Sequence[Path],
    avatars: Sequence[Path] | None,
    made_with: Sequence[Path],
    subjects: Sequence[str],
    variants: Sequence[str],
    levels: Sequence[str],
    logs: str,
    page: Path,
) -> None:
    """Write the report of a study.

    Args:
        settings: Settings of the stage: there are none.
        card: Benchmark card of the study.
        table: Summary of the study, as the stage `tabulate` writes it.
        figures: Folder with the figures of each subject.
        captures: Index of the capture of each subject.
        frames: Folder of the renderings of each subject and variant, of the first seed.
        truths: Index of the true images of each subject and level.
        training: log.csv of each subject and variant, of the first seed.
        avatars: HTML file of each subject's avatar, of the variant `alternating` and the first seed; None if the study
            lacks the variant.
        made_with: Settings of the stages, `settings/{stage}/{point}.yaml`.
        subjects: Names of the subjects.
        variants: Names of the variants.
        levels: Rendered levels, as in paths.
        logs: Folder of the study's logs.
        page: HTML file to write.

    Raises:
        InputError: An input is malformed.
    """
    made, used = read_card(card), {(file.parent.name, file.stem): file for file in made_with}
    rendered = {point: folder for point, folder in zip(product(subjects, variants), frames, strict=True)}
    true = {point: file for point, file in zip(product(subjects, levels), truths, strict=True)}
    trained = {point: file for point, file in zip(product(subjects, variants), training, strict=True)}
    images, seen = {}, {}
    for subject, capture in zip(subjects, captures, strict=True):
        person = Capture.load(capture)
        seen[subject] = capture_coverage(person), capture_pose_gap(person)
        images[subject] = StudyImages(
            person,
            {variant: rendered[subject, variant] for variant in variants},
            {float(level): read_ground_truth(true[subject, level]) for level in levels},
            load_settings("figures", used["figures", f"subject={subject}"]),
        )
    charts = {subject: subject_chart({v: trained[subject, v] for v in variants}) for subject in subjects}
    no_strips = [f"{subject}, images by level: {found.problem}" for subject, found in images.items() if found.problem]
    skipped = [*_warnings(Path(logs)), *no_strips, *_left_out(figures)]
    content = html.ReportContent(
        study=made.study,
        gamma=made.gamma,
        card=card_parts(made),
        seen=[f"{subject}: {text}." for subject, texts in seen.items() for text in texts if text],
        strips=[],
        avatars={s: _address(f, page.parent) for s, f in zip(subjects, avatars, strict=True)} if avatars else {},
        charts={subject: chart for subject, chart in charts.items() if chart},
        figures=[],
        tables=comparison_tables(read_summaries(table), load_settings("tabulate", used["tabulate", "all"]), CATALOGUE),
        skipped=skipped,
        settings=_settings(made_with),
    )

    def fill(scale: float, with_figures: bool) -> html.ReportContent:
        height = max(round(IMAGE_HEIGHT * scale), 16)
        content.strips = [_strip(subject, found, height) for subject, found in images.items() if not found.problem]
        content.figures = [] if not with_figures else _figures(figures, round(FIGURE_WIDTH * scale))
        content.skipped = skipped if with_figures else [*skipped, NO_FIGURES]
        return content

    text = html.page_within(MAX_BYTES, fill)
    with writing(page) as part:
        part.write_text(text, encoding="utf-8")


def _address(file: Path, folder: Path) -> str:
    """A file as a link in a page of the folder."""
    return quote(Path(os.path.relpath(file, folder)).as_posix())


def _strip(subject: str, images: StudyImages, height: int) -> html.Strip:
    """The images of a subject in one view."""
    levels = []
    for level in images.levels:
        found = {variant: images.rendered(variant, level) for variant in images.variants}
        found["truth"] = images.true(level)
        encoded = {name: data_uri(image, height) for name, image in found.items() if image is not None}
        levels.append(html.LevelImages(f"{level:g}", encoded))
    return html.Strip(subject, levels)


def _figures(folders: Sequence[Path], max_width: int) -> list[html.Figure]:
    found = []
    for folder in folders:
        for file in sorted(folder.glob("*.png")):
            pixels = _figure(file)
            uri = data_uri(pixels, fitting_height(pixels.shape[1], pixels.shape[0], max_width))
            found.append(html.Figure(_below_figures(file), f"{folder.parent.name}: {_caption(file.stem)}.", uri))
    return found


@lru_cache(maxsize=32)  # several sizes may be tried
def _figure(file: Path) -> np.ndarray:
    return read_rgb8(file)


def _caption(name: str) -> str:
    if name.startswith("gamma_strip_"):
        return f"{name.removeprefix('gamma_strip_')} at every level, above the true images and their difference"
    return CAPTIONS.get(name, name.replace("_", " "))


def _left_out(folders: Sequence[Path]) -> list[str]:
    """The figures that were not drawn, by subject."""
    lines = []
    for folder in folders:
        file = folder / "left_out.txt"
        for line in file.read_text("utf-8", "replace").splitlines() if file.is_file() else ():
            lines.append(f"{folder.parent.name}, figure {without_paths(line)}")
    return lines


def _warnings(logs: Path) -> list[str]:
    """The warnings of the jobs, without paths of the machine."""
    found: dict[str, list[Path]] = {}
    for warning, files in logged_warnings(logs).items():
        found.setdefault(without_paths(warning), []).extend(files)
    return [
        f"{warning} (stage {', '.join(sorted({file.parent.name for file in files}))}, {len(files)} "
        f"job{'s' * (len(files) > 1)})"
        for warning, files in found.items()
    ]


def _settings(files: Sequence[Path]) -> Mapping[str, str]:
    """Texts of the settings; equal ones of a stage once."""
    points: dict[tuple[str, str], list[str]] = {}
    for file in files:
        text = "\n".join(without_paths(line) for line in read_yaml_text(file).splitlines())
        points.setdefault((file.parent.name, text), []).append(file.stem)
    return {f"{stage}: {'; '.join(names)}": text for (stage, text), names in points.items()}


def _below_figures(file: Path) -> str:
    """Name of a figure from the folder of the subject on."""
    return Path(*file.parts[-3:]).as_posix()
