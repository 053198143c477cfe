"""The table of a sweep: a row per combination of values and variant, from the tables of the combinations."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from carigs.runs.job_record import Costs
from carigs.system.files import writing
from evaluation.tables.document import NO_VALUE, Cell, Document, Table
from evaluation.tables.metric import Catalogue, Metric
from evaluation.tables.summary import ALL
from evaluation.tables.typeset import ARROWS

COSTS: Catalogue = {
    "train_cpu_seconds": Metric(
        "Training",
        "lower",
        1,
        "CPU s",
        "processor time of all threads of a training, mean over the avatars; the first one compiles kernels",
    ),
    "train_peak_memory_mb": Metric(
        "Memory", "lower", 0, "MB", "largest resident memory of a training, over the avatars"
    ),
}
"""Columns of costs; `n` of a cost is the number of trainings whose costs are recorded."""
PARTS = ("", "_low", "_high", "_n")
"""Columns of a measure: its value, the ends of its interval, and the number of frames or trainings behind it."""


class CombinationResults(NamedTuple):
    """What is known of one combination of values."""

    values: tuple[str, ...]
    """Text of the value of each key."""
    seeds: tuple[str, ...]
    """Seeds of its trainings, as in paths."""
    results: str
    """Folder of its study."""
    summaries: pd.DataFrame
    """Lines with the columns `evaluation.tables.summary.SUMMARY`, of one gamma."""
    costs: Costs
    """Costs of the jobs of its study."""


def sweep_table(
    keys: Sequence[str], combinations: Iterable[CombinationResults], level: float | None, catalogue: Catalogue
) -> pd.DataFrame:
    """Collect the means of all metrics over the whole image, and what the trainings have cost.

    Args:
        keys: Keys with several values.
        combinations: The combinations.
        level: Level whose renderings are compared; None: the gamma of each combination.
        catalogue: The metrics; others are left out.

    Returns:
        A row per combination and variant. Columns: the keys, with texts; `results`, `variant`, `level`; the columns
        `PARTS` of each metric with a value in one of the rows, and of `COSTS`. Means are of all subjects together.
        Missing values are nan.
    """
    rows = [row for combination in combinations for row in _rows(keys, combination, level, catalogue)]
    table = pd.DataFrame(rows)
    measured = [name for name in catalogue if name in table and table[name].notna().any()]
    columns = [f"{name}{part}" for name in (*measured, *COSTS) for part in PARTS]
    return table.reindex(columns=[*keys, "results", "variant", "level", *columns])


def _rows(
    keys: Sequence[str], combination: CombinationResults, level: float | None, catalogue: Catalogue
) -> Iterator[dict[str, Any]]:
    """A row per variant of a combination."""
    summaries, gamma = combination.summaries, float(combination.summaries["gamma"].iloc[0])
    shown = f"{gamma if level is None else level:g}"
    subjects = sorted(set(summaries["subject"]))  # `ALL` is the first
    chosen = summaries[
        (summaries["subject"] == subjects[0])
        & (summaries["minus"] == "")
        & (summaries["region"] == "full")
        & (summaries["level"].map("{:g}".format) == shown)
    ]
    for variant in dict.fromkeys(summaries["variant"]):
        row = dict(zip(keys, combination.values, strict=True))
        row |= {"results": combination.results, "variant": variant, "level": shown}
        for line in chosen[chosen["variant"] == variant].itertuples():
            if line.metric in catalogue and line.protocol == catalogue[line.metric].protocol:
                numbers = (line.mean, line.low, line.high, line.n)
                row |= {f"{line.metric}{part}": number for part, number in zip(PARTS, numbers, strict=True)}
        own = product([subject for subject in subjects if subject != ALL], combination.seeds)
        points = [f"{subject},gamma={gamma:g},{variant},seed={seed}" for subject, seed in own]
        yield row | _training_costs(combination.costs, points)


def _training_costs(costs: Costs, points: Iterable[str]) -> dict[str, float]:
    """The columns `COSTS` of a variant, over its avatars, by the names of the logs of their trainings."""
    found = [costs["train", point] for point in points if ("train", point) in costs]
    memory = [cost.peak_memory_mb for cost in found if cost.peak_memory_mb is not None]
    seconds = [cost.cpu_seconds for cost in found]
    return {
        "train_cpu_seconds": np.mean(seconds) if seconds else np.nan,
        "train_cpu_seconds_n": len(seconds),
        "train_peak_memory_mb": max(memory, default=np.nan),
        "train_peak_memory_mb_n": len(memory),
    }


def write_sweep(file: Path, table: pd.DataFrame) -> None:
    """Write the table of a sweep as CSV, with six significant digits.

    Args:
        file: File to write.
        table: As made by `sweep_table`.
    """
    with writing(file) as part:
        table.to_csv(part, index=False, float_format="%.6g", lineterminator="\n")


def measures(table: pd.DataFrame, metrics: Iterable[str], catalogue: Catalogue) -> Mapping[str, Metric]:
    """The measures that a reader is shown.

    Args:
        table: As made by `sweep_table`.
        metrics: Names of metrics.
        catalogue: The metrics.

    Returns:
        Those of the metrics that have a value in the table, and the costs that have one.
    """
    known = {name: catalogue[name] for name in metrics} | dict(COSTS)
    return {name: metric for name, metric in known.items() if name in table and table[name].notna().any()}


def sweep_document(
    table: pd.DataFrame, keys: Sequence[str], shown: Mapping[str, Metric], left_out: Iterable[str]
) -> Document:
    """Arrange the table of a sweep for readers.

    Args:
        table: As made by `sweep_table`.
        keys: Keys with several values.
        shown: The measures, as from `measures`.
        left_out: Titles of metrics that were asked for and have no value.

    Returns:
        One table, with a line per combination and variant.
    """
    levels = sorted({*table["level"]}, key=float)
    explanation = [
        "Means over frames with the confidence intervals of the tables of the combinations, of renderings at level "
        f"{', '.join(levels)}; and what the trainings have cost.",
        "↑: higher is better, ↓: lower is better, no arrow: values cannot be ranked by themselves. n: number of "
        "frames, or of trainings.",
    ]
    counts = {name: {int(n) for n in table[f"{name}_n"].dropna()} - {0} for name in shown}
    header = [_heading(metric, counts[name]) for name, metric in shown.items()]
    lines = [
        (
            ", ".join([*(f"{key}={row[key]}" for key in keys), row["variant"]]),
            [_cell(row, name, metric, len(counts[name]) > 1) for name, metric in shown.items()],
        )
        for row in table.to_dict("records")
    ]
    definitions = [f"{metric.title}: {metric.source}." for metric in shown.values()]
    if missing := ", ".join(left_out):
        definitions.append(f"Without a value in all combinations: {missing}. The tables of the combinations say why.")
    return Document(explanation, [Table(f"Sweep over {', '.join(keys)}", header, [("", lines)])], {}, definitions)


def _heading(metric: Metric, counts: set[int]) -> str:
    details = ", ".join(filter(None, (metric.unit, f"n={min(counts)}" if len(counts) == 1 else "")))
    return f"{metric.title}{ARROWS[metric.better]}" + (f" ({details})" if details else "")


def _cell(row: Mapping[str, Any], name: str, metric: Metric, with_count: bool) -> Cell:
    value, low, high, n = (row[f"{name}{part}"] for part in PARTS)
    if pd.isna(value):
        return Cell(NO_VALUE)
    pattern = f"{{:.{metric.digits}f}}"
    interval = "" if pd.isna(low) else f"[{pattern}, {pattern}]".format(low, high)
    return Cell(pattern.format(value), interval, f"n={n:.0f}" if with_count else "")
