"""Stage `card`: the benchmark card of a study, as JSON and as Markdown."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import yaml

from carigs.capture import Capture
from carigs.config import load_settings, project_root
from carigs.readers.yaml_files import read_yaml_text
from carigs.runs.job_record import Costs, job_costs
from carigs.settings import Card
from evaluation.card.card import CardValue, make_card, write_card
from evaluation.card.costs import RecordedJob, RenderingJob, avatar_values, stage_values
from evaluation.card.document import write_markdown
from evaluation.card.provenance import commit, find_seeds, machine, versions
from evaluation.metrics.catalogue import CATALOGUE
from evaluation.tables.summary_file import read_summaries

NOT_NAMED = {"processor": "not named (card.machine=false)", "cores": None, "memory_gb": None, "system": ""}
"""The machine of a card that shall not name it."""
TRAINED = ("train", "render", "metrics")
"""Stages with one job for each seed; jobs without a seed, or of one level, are of earlier versions of carigs."""


def card(
    settings: Card,
    *,
    table: Path,
    captures: Sequence[Path],
    avatars: Sequence[Path],
    made_with: Sequence[Path],
    subjects: Sequence[str],
    variants: Sequence[str],
    seeds: Sequence[str],
    levels: Sequence[str],
    gamma: str,
    logs: str,
    card: Path,
    markdown: Path,
) -> None:
    """Write the card of a study.

    Args:
        settings: Whether the machine is named.
        table: Summary of the study, as the stage `tabulate` writes it.
        captures: Index of the capture of each subject.
        avatars: Avatar of each subject, variant and seed.
        made_with: Settings of the stages, `settings/{stage}/{point}.yaml`.
        subjects: Names of the subjects.
        variants: Names of the variants.
        seeds: Seeds of the trainings, as in paths.
        levels: Rendered levels, as in paths.
        gamma: Level that the avatars are trained for, as in paths.
        logs: Folder of the study's logs and records of jobs.
        card: JSON file to write.
        markdown: Markdown file to write.

    Raises:
        InputError: An input is malformed.
    """
    costs = job_costs(Path(logs))
    tabulated = load_settings("tabulate", next(file for file in made_with if file.parent.name == "tabulate"))
    files = dict(zip(product(subjects, variants, seeds), avatars, strict=True))
    values = []
    for subject, variant in product(subjects, variants):
        trained = {int(seed): files[subject, variant, seed] for seed in seeds}
        renderings = [
            RenderingJob(
                RecordedJob("render", f"{subject},gamma={gamma},{variant},seed={seed}"), int(seed), float(level)
            )
            for seed, level in product(seeds, levels)
        ]
        values += avatar_values(subject, variant, trained, renderings, costs)
    values += stage_costs(costs, {*subjects, *variants, f"gamma={gamma}", *(f"seed={seed}" for seed in seeds)})
    images = {subject: _image_size(file) for subject, file in zip(subjects, captures, strict=True)}
    provenance = {
        "machine": machine() if settings.machine else NOT_NAMED,
        "versions": versions(),
        "commit": commit(project_root()),
    }
    made = make_card(
        read_summaries(table),
        values,
        tabulated,
        CATALOGUE,
        images=images,
        training_seeds=[int(seed) for seed in seeds],
        seeds=_other_seeds(made_with),
        provenance=provenance,
    )
    write_card(card, made)
    write_markdown(markdown, made)


def _image_size(file: Path) -> list[int]:
    """Width and height of the captured images, of the first camera."""
    capture = Capture.load(file)
    camera = next(iter(capture.cameras.values()))
    return [camera.width, camera.height]


def _other_seeds(made_with: Sequence[Path]) -> dict[str, int]:
    """Seeds in the settings of a study but those of trainings; equal ones of a stage once, under its name."""
    found: dict[str, dict[str, int]] = {}
    for file in (file for file in made_with if file.parent.name != "train"):
        content: Any = yaml.safe_load(read_yaml_text(file)) or {}
        for place, seed in find_seeds(content, file.parent.name):
            found.setdefault(place, {})[file.stem] = seed
    return {
        place if len(set(by_point.values())) == 1 else f"{place} ({point})": seed
        for place, by_point in found.items()
        for point, seed in by_point.items()
    }


def stage_costs(costs: Costs, names: Collection[str]) -> list[CardValue]:
    """Sum the costs of the stages over some of the jobs.

    Args:
        costs: Costs of jobs.
        names: Subjects, variants, gamma and seeds of the jobs that count, as in the names of their logs.

    Returns:
        One value per stage and measure.
    """
    stages: dict[str, list[RecordedJob]] = {}
    for stage, point in costs:
        parts = point.split(",")
        keys = {part.partition("=")[0] for part in parts}
        is_current = stage not in TRAINED or ("seed" in keys and "level" not in keys)
        if is_current and {part for part in parts if not part.startswith("level=")} <= names:
            stages.setdefault(stage, []).append(RecordedJob(stage, point))
    order = ("track", "capture", "hair", "exaggerate", "truth", "gtstar", "train", "render", "metrics")
    order += ("tabulate", "figures")
    return stage_values({stage: stages[stage] for stage in order if stage in stages}, costs)
