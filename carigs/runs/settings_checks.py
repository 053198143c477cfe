"""What a run says of its settings before it plans."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from itertools import product
from pathlib import Path

from omegaconf import DictConfig, OmegaConf

from carigs.config import compose, compose_study, compose_variant, left_out_levels, rendered_levels
from carigs.errors import SettingsError
from carigs.runs.outside_files import outside_files
from carigs.settings import STAGES, USEFUL_LEVEL, Edit

STUDIES_THAT_READ = {
    "video": {"video": "video"},
    "folder": {"folder": "own"},
    "head_model": {"folder": "own", "video": "video"},
}
"""For each file of a capture: the kinds of captures that read it, each with a study of that kind."""
PROVIDERS_THAT_READ = {"folder": "precomputed", "command": "command", "exemplar": "exemplar"}
"""For each input of GT* frames, the provider that reads it."""


def check_study(combinations: Sequence[Sequence[str]]) -> None:
    """Compose all settings of a study.

    Args:
        combinations: Hydra overrides of each combination of a sweep whose results are in the folder of the study: they
            differ in gamma. One for a study without a sweep.

    Raises:
        SettingsError: For wrong settings; for those of a stage that depend on gamma where the paths of its files do not
            have it, if there are several gammas.
    """
    last = combinations[-1]
    for overrides in combinations:
        study = compose_study(*overrides).study
        for subject, variant in product(study.subjects, study.variants):
            point = f"subject={subject}"
            settings = compose_variant(variant, *overrides, point)
            shared = settings if overrides is last else compose_variant(variant, *last, point)
            for stage in STAGES.keys() - {"exaggerate", "render"}:  # whose settings have gamma in their path
                if settings[stage] != shared[stage]:
                    problem = f"gamma has several values, and settings of {stage} depend on it"
                    raise SettingsError(f"{problem}: run one study per gamma, each with a study.name of its own")


def settings_warnings(overrides: Sequence[str]) -> list[str]:
    """What is likely to be wrong with the settings, or is left out by them.

    Args:
        overrides: Hydra overrides of the run.

    Returns:
        One line each for gamma and levels of regions beyond `USEFUL_LEVEL`, for levels above gamma, for files and
        programs that nothing reads, for settings of edits where no variant edits, for each file of a subject and each
        program that is not where it should be, and for a folder of weights that is not there.
    """
    config, lines = compose_study(*overrides), []
    regions = {f"exaggerate.regions.{name}": level for name, level in config.exaggerate.regions.items()}
    for name, level in {"gamma": config.gamma, **regions}.items():
        if abs(level) > USEFUL_LEVEL:
            torn = f"outside [-{USEFUL_LEVEL:g}, {USEFUL_LEVEL:g}] the surface is torn"
            lines.append(f"{name}={level:g}: {torn}; about 0.5 is the most that is useful")
    if levels := left_out_levels(config):
        lines.append(f"study.levels: {', '.join(levels)} left out; gamma={config.gamma:g} is the highest level")
    shown = rendered_levels(config)[1:]
    missing: dict[tuple[str, Path], list[str]] = {}
    points = []
    for subject, variant in product(config.study.subjects, config.study.variants):
        settings = compose(*overrides, f"subject={subject}", f"variant={variant}")
        points.append(settings)
        for stage in ("capture", "exaggerate", "hair", "gtstar", "train"):
            for key, path in outside_files(stage, settings[stage]).items():
                if not path.exists():
                    missing.setdefault((key, path), []).append(subject)
        program = settings.gtstar.command[0] if settings.gtstar.provider == "command" else None
        if program is not None and shutil.which(program) is None:
            missing.setdefault(("gtstar.command", Path(program)), []).append(subject)
    for (key, path), subjects in missing.items():
        lines.append(f"{key}: there is no {path}; {', '.join(dict.fromkeys(subjects))} cannot be made")
    lines += _captures_that_nothing_reads(overrides, config.study.subjects)
    lines += _inputs_of_targets_that_nothing_reads(points) + _edits_that_nothing_does(points)
    for subject in config.study.subjects:
        truth = compose(*overrides, f"subject={subject}").truth.folder
        if truth and not any(Path(truth.replace("{level}", level)).is_dir() for level in shown):
            folder = truth.replace("{level}", shown[-1])
            lines.append(f"truth.folder: no folder {folder}; {subject} is compared with no true caricature")
    weights = config.metrics.weights
    if weights and not Path(weights).is_dir():
        lines.append(f"metrics.weights: there is no folder {weights}; weights are searched for in the other places")
    return lines


def _captures_that_nothing_reads(overrides: Sequence[str], subjects: Sequence[str]) -> list[str]:
    """A line for each file of a capture that is given, while all subjects are of kinds that do not read it."""
    captures, lines = [compose(*overrides, f"subject={subject}").capture for subject in subjects], []
    for key, studies in STUDIES_THAT_READ.items():
        (value, *_), kinds = [capture[key] for capture in captures], {capture.source for capture in captures}
        if value is not None and not kinds & studies.keys():
            remedy = " or ".join(f"study={study}" for study in studies.values())
            lines.append(f"capture.{key}={value}: the study's {', '.join(subjects)} does not read it; add {remedy}")
    return lines


def _inputs_of_targets_that_nothing_reads(points: Sequence[DictConfig]) -> list[str]:
    """A line for each input of GT* frames that is given, while no variant has the provider that reads it."""
    lines, sections = [], [point.gtstar for point in points]
    for key, provider in PROVIDERS_THAT_READ.items():
        if any(section[key] for section in sections) and provider not in {section.provider for section in sections}:
            lines.append(f"gtstar.{key}: nothing reads it; add gtstar.provider={provider}")
    return lines


def _edits_that_nothing_does(points: Sequence[DictConfig]) -> list[str]:
    """A line for each setting of edits that is given, while no variant edits frames."""
    sections = [point.train.edit for point in points]
    if any(section.editor != "none" for section in sections):
        return []
    default = OmegaConf.structured(Edit)
    given = [key for key in default if any(section[key] != default[key] for section in sections)]
    return [f"train.edit.{key}: no variant of the study edits frames; add train.edit.editor" for key in given]
