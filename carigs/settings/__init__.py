"""The settings of a study: one dataclass per section, the only schema of the YAML in `conf/`.

Defaults, units, meanings and allowed values stand in the fields; docs/configuration.md is generated from them.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

from carigs.settings.capture import CaptureSettings, Toy, Truth
from carigs.settings.edit import Edit
from carigs.settings.exaggerate import DEFAULT_GAMMA, USEFUL_LEVEL, Exaggerate
from carigs.settings.gtstar import Gtstar
from carigs.settings.hair import Hair
from carigs.settings.mask_flags import DEFAULT_MASK_FLAGS, MASK_FLAGS, MaskFlag
from carigs.settings.option import MAX_SEED, OF_PATH, Section, check_section, option, set_by
from carigs.settings.regions import Regions
from carigs.settings.results import Card, Figures, Html, Metrics, Render, Report, Sweep, Tabulate, TargetSheet
from carigs.settings.track import Track
from carigs.settings.train import Density, RefineTracking, Train, combine_mask_flags

__all__ = [
    "DEFAULT_MASK_FLAGS",
    "MASK_FLAGS",
    "STAGES",
    "USEFUL_LEVEL",
    "CaptureSettings",
    "Card",
    "Config",
    "Density",
    "Edit",
    "Exaggerate",
    "Figures",
    "Gtstar",
    "Hair",
    "Html",
    "MaskFlag",
    "Metrics",
    "RefineTracking",
    "Regions",
    "Render",
    "Report",
    "Study",
    "Sweep",
    "Tabulate",
    "TargetSheet",
    "Toy",
    "Track",
    "Train",
    "Truth",
    "check",
    "combine_mask_flags",
]


@dataclass
class Study(Section, key="study"):
    """A set of subjects, variants, seeds and levels that makes one table."""

    name: str = "toy"
    """Folder of the results below `results/`: letters, digits and `._-`."""
    subjects: tuple[str, ...] = ("toy",)
    """Files of `conf/subject`."""
    variants: tuple[str, ...] = ("alternating", "surfhead", "surfhead_lit", "gtstar_only", "no_mask")
    """Files of `conf/variant`, or a mask flag that is removed or added: `no_hair_mask`, `lids_mask`. A pattern such as
    `*_mask` stands for all others that match."""
    seeds: tuple[int, ...] = option((0,), ge=0, le=MAX_SEED)
    """Seeds that every variant is trained with; tables average over them, and figures show the first."""
    levels: tuple[float, ...] = option((0.0, 0.1, 0.15, 0.2, 0.25), ge=0, le=100)
    """Levels to render; 0 and gamma are added, levels above gamma left out."""


@dataclass
class Config(Section, key=""):
    """All settings: gamma, the study, the regions of the head, and one section per stage."""

    gamma: float = option(DEFAULT_GAMMA, ge=1e-4, le=100)
    """gamma_f, the level that is trained for."""
    seed: int = set_by(OF_PATH, 0, ge=0, le=MAX_SEED)
    """Seed of a training, one of `study.seeds`."""
    study: Study = field(default_factory=Study)
    regions: Regions = field(default_factory=Regions)
    track: Track = field(default_factory=Track)
    capture: CaptureSettings = field(default_factory=CaptureSettings)
    hair: Hair = field(default_factory=Hair)
    exaggerate: Exaggerate = field(default_factory=Exaggerate)
    gtstar: Gtstar = field(default_factory=Gtstar)
    target_sheet: TargetSheet = field(default_factory=TargetSheet)
    train: Train = field(default_factory=Train)
    render: Render = field(default_factory=Render)
    html: Html = field(default_factory=Html)
    truth: Truth = field(default_factory=Truth)
    metrics: Metrics = field(default_factory=Metrics)
    tabulate: Tabulate = field(default_factory=Tabulate)
    figures: Figures = field(default_factory=Figures)
    sweep: Sweep = field(default_factory=Sweep)
    card: Card = field(default_factory=Card)
    report: Report = field(default_factory=Report)


STAGES: dict[str, type[Section]] = {
    f.name: f.default_factory for f in fields(Config) if f.name not in ("gamma", "seed", "study", "regions")
}
"""The section of each stage of the workflow."""


def check(stage: str, settings: Any) -> None:
    """Check the values of a stage's section; sections check themselves when they are made, so this is for OmegaConf.

    Args:
        stage: Name of the section.
        settings: The section, as its dataclass or as OmegaConf's mapping.

    Raises:
        SettingsError: One line that names the first wrong key, its value and what is allowed.
    """
    check_section(STAGES[stage], settings)
