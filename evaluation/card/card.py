"""The benchmark card of a study, and its JSON file.

docs/card.schema.json is the schema of the file; docs/evaluation.md describes it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from carigs.errors import InputError
from carigs.readers.formats import Format, check_format
from carigs.readers.json_files import json_field, read_json
from carigs.settings import Tabulate
from carigs.system.files import write_json
from evaluation.card.measures import AVATAR_MEASURES, STAGE_MEASURES
from evaluation.tables.bootstrap import CONFIDENCE, RESAMPLES, SEED
from evaluation.tables.document import without_paths
from evaluation.tables.metric import TABLES, Catalogue, Metric

FORMAT = Format("carigs-card", 1, "run the stage card of its study again, as carigs run does")
"""Changes with the meaning or the type of a field; new fields and measures leave it as it is."""
PROTOCOLS = {
    "test": "frames of the held-out sequence, in all cameras of the capture",
    "val": "frames held out for validation, at level 0",
    "orbit": "a novel camera trajectory at a fixed expression",
    "avatar": "the avatar itself",
    "stage": "all jobs of a stage of the study",
}
"""What the values of a card were measured on."""


class CardValue(NamedTuple):
    """One number of a card: a mean over frames, a difference of two, or a cost."""

    measure: str
    """Key of `BenchmarkCard.measures`."""
    subject: str
    """`(all)` for a mean over several subjects; empty for a stage."""
    variant: str
    """Empty for a stage."""
    level: float | None
    """Level that was rendered; None for costs."""
    protocol: str
    """Key of `PROTOCOLS`."""
    region: str
    """Region of the image; the name of the stage for its costs; empty for an avatar."""
    minus: str
    """Variant that was subtracted frame by frame; empty for a plain value."""
    value: float | None
    low: float | None
    """Lower end of the confidence interval; None for a single measurement."""
    high: float | None
    n: int
    """Number of frames, avatars or jobs behind the value."""
    nulls: int
    """Number of records without a value."""
    reason: str
    """Why there is no value, or why `nulls` records have none."""


@dataclass
class BenchmarkCard:
    """Benchmark card of a study."""

    study: str
    gamma: float
    """Level that the avatars are trained for."""
    reference: str
    """Variant that the others are compared with."""
    subjects: list[str]
    variants: list[str]
    training_seeds: list[int]
    """Seeds that every variant was trained with; empty for renderings of another program."""
    levels: list[float]
    intervals: dict[str, Any]
    """Confidence, resamples and seed of the intervals."""
    split: str
    """How captures were divided into training and held-out frames."""
    measures: dict[str, dict[str, Any]]
    """Title, direction, digits, unit and meaning of every measure."""
    values: list[CardValue]
    not_measured: dict[str, str]
    """Kinds of metrics without any record, and why."""
    images: dict[str, list[int]]
    """Width and height of the captured images, by subject."""
    seeds: dict[str, int]
    """Other seeds, by their place in the settings."""
    machine: dict[str, Any]
    versions: dict[str, str]
    commit: dict[str, Any]
    protocols: dict[str, str] = field(default_factory=lambda: dict(PROTOCOLS))
    format: str = str(FORMAT)


def frame_values(summaries: pd.DataFrame) -> list[CardValue]:
    """The means and differences of a study as values of a card.

    Args:
        summaries: Lines with the columns `evaluation.tables.summary.SUMMARY`.

    Returns:
        One value per line, without the paths of the machine in reasons.
    """
    return [
        CardValue(
            line.metric,
            line.subject,
            line.variant,
            float(line.level),
            line.protocol,
            line.region,
            line.minus,
            *(None if pd.isna(number) else float(number) for number in (line.mean, line.low, line.high)),
            int(line.n),
            int(line.nulls),
            without_paths(line.reason),
        )
        for line in summaries.itertuples()
    ]


def make_card(
    summaries: pd.DataFrame,
    costs: Sequence[CardValue],
    settings: Tabulate,
    catalogue: Catalogue,
    *,
    images: Mapping[str, Sequence[int]],
    training_seeds: Sequence[int],
    seeds: Mapping[str, int],
    provenance: Mapping[str, Mapping[str, Any]],
) -> BenchmarkCard:
    """Build the card of one study and gamma.

    Args:
        summaries: Means and intervals, with the columns `evaluation.tables.summary.SUMMARY`.
        costs: Sizes, times and memory.
        settings: Settings of the stage `tabulate`.
        catalogue: The metrics of frames; values of others are left out.
        images: Width and height of the captured images, by subject.
        training_seeds: Seeds that every variant was trained with.
        seeds: Other seeds, by their place in the settings.
        provenance: The fields machine, versions and commit of the card.

    Returns:
        The card.
    """
    values = [value for value in frame_values(summaries) if value.measure in catalogue]
    used = {value.measure for value in [*values, *costs]}
    known = {**catalogue, **AVATAR_MEASURES, **STAGE_MEASURES}
    kinds = {catalogue[value.measure].table for value in values}
    return BenchmarkCard(
        study=str(summaries["study"].iloc[0]),
        gamma=float(summaries["gamma"].iloc[0]),
        reference=settings.reference,
        subjects=sorted(images),
        variants=sorted(set(summaries["variant"]), key=lambda name: (name != settings.reference, name)),
        training_seeds=list(training_seeds),
        levels=sorted({float(level) for level in summaries["level"]}),
        intervals={
            "confidence": CONFIDENCE,
            "resamples": RESAMPLES,
            "seed": SEED,
            "method": "crossed random effects: bootstrap-t, or Student's t where a factor has few levels",
        },
        split="; ".join(sorted(set(summaries["split"]))),
        measures={name: _described(metric) for name, metric in known.items() if name in used},
        values=[*values, *costs],
        not_measured={
            title: "the study has no records of this kind" for kind, title in TABLES.items() if kind not in kinds
        },
        images={subject: list(size) for subject, size in images.items()},
        seeds=dict(seeds),
        **{name: dict(provenance[name]) for name in ("machine", "versions", "commit")},
    )


def _described(metric: Metric) -> dict[str, Any]:
    fields = {"title": metric.title, "better": metric.better, "digits": metric.digits, "unit": metric.unit}
    return {**fields, "meaning": metric.source, "kind": metric.table, "protocol": metric.protocol}


def write_card(file: Path, card: BenchmarkCard) -> None:
    """Write a card as JSON.

    Args:
        file: File to write.
        card: The card.
    """
    content = asdict(card)
    write_json(file, {"format": content.pop("format"), **content, "values": [v._asdict() for v in card.values]})


def read_card(file: Path) -> BenchmarkCard:
    """Read a card.

    Args:
        file: File of `write_card`.

    Returns:
        The card.

    Raises:
        InputError: The file is missing, broken, or of another format.
    """
    content = read_json(file, dict)
    check_format(content.get("format"), FORMAT, file)
    try:
        values = [CardValue(**value) for value in json_field(content, "values", list, file=file)]
        return BenchmarkCard(**{**content, "values": values})
    except TypeError as error:
        raise InputError(f"not the fields of a card ({error})", file=file) from error


def find_values(card: BenchmarkCard, measures: Iterable[str]) -> dict[tuple, CardValue]:
    """Index the plain values of some measures.

    Args:
        card: The card.
        measures: Names of the measures.

    Returns:
        Values by measure, subject, variant, level, protocol and region; differences are left out.
    """
    wanted = set(measures)
    return {value[:6]: value for value in card.values if value.measure in wanted and not value.minus}
