"""Means of metrics over frames with confidence intervals, and paired differences between variants."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd

from carigs.errors import CarigsError, InputError
from carigs.readers.limits import MAX_TEXT_BYTES, read_bytes
from carigs.readers.text import decode_text
from carigs.settings import Tabulate
from evaluation.tables.bootstrap import Interval, mean_interval
from evaluation.tables.factors import FRAME, crossed_factors
from evaluation.tables.metric import Catalogue, Metric
from evaluation.tables.metric_records import REGIONS, MetricRecord

CONDITION = ["study", "gamma", "level", "protocol", "region", "metric", "variant"]
"""Columns that are the same for all frames of a mean."""
SUMMARY = ["subject", *CONDITION, "minus", "mean", "low", "high", "n", "seeds", "nulls", "reason", "split"]
"""Columns of a summary.

`subject` is `ALL` for a mean over several; `minus` is the variant subtracted frame by frame, empty for a plain mean;
`low` and `high` are the ends of the interval; `n` counts rendered frames with a value, `seeds` the trainings of a
subject that they come from, and `nulls` records without; `reason` says why there are nulls. `split` is the rule that
divided the captures of the study into training and held-out frames; rules that differ between subjects are all named.
"""
ALL = "(all)"
"""Stands for all subjects of a study."""
RECORD_NUMBERS = {"seed": int, "gamma": float, "level": float, "camera": int, "timestep": int, "value": float}
"""Columns of records that hold numbers; the others hold texts."""


def read_metrics(files: Iterable[Path]) -> pd.DataFrame:
    """Read files of `write_metrics`.

    Args:
        files: CSV files.

    Returns:
        All records, with the columns of `MetricRecord`; missing values, cameras and timesteps are nan.

    Raises:
        InputError: A file is missing or malformed; names its line and column.
    """
    return pd.concat([_read(Path(file)) for file in files], ignore_index=True)


def summarise(records: pd.DataFrame, settings: Tabulate, catalogue: Catalogue) -> pd.DataFrame:
    """Average every metric over the frames of each condition, with confidence intervals.

    Means are over all seeds, of each subject and, if there are several, of all. Differences are paired by frame and
    seed: the reference minus every other variant, and the one with the best mean minus every other.

    Args:
        records: Metric records, as of `read_metrics`.
        settings: Settings of the stage `tabulate`.
        catalogue: The metrics; of others no variant is the best.

    Returns:
        One line per mean or difference, with the columns `SUMMARY`, sorted by them.

    Raises:
        CarigsError: Two records hold the same metric of the same frame and training.
    """
    _check_unique(records)
    subjects = sorted(set(records["subject"]))
    groups = [(ALL, records)] if len(subjects) > 1 else []
    groups += [(subject, records[records["subject"] == subject]) for subject in subjects]
    splits = {study: "; ".join(sorted(set(group))) for study, group in records.groupby("study")["split"]}
    lines = [
        (subject, *key, *line, splits[key[0]])
        for subject, group in groups
        for key, line in _summaries(group, settings, catalogue).items()
    ]
    order = {region: i for i, region in enumerate(REGIONS)}
    return pd.DataFrame(lines, columns=SUMMARY).sort_values(
        SUMMARY[:9], key=lambda column: column.map(order) if column.name == "region" else column
    )


def _check_unique(records: pd.DataFrame) -> None:
    measured = records[records["value"].notna()]
    for record in measured[measured.duplicated(CONDITION + FRAME)].itertuples():
        frame = f"subject {record.subject}, timestep {record.timestep:g}, camera {record.camera:g}, seed {record.seed}"
        what = f"{record.variant}, level {record.level:g}: {record.metric} of {record.region}"
        raise CarigsError(f"{what} is given twice for {frame}")


def _summaries(records: pd.DataFrame, settings: Tabulate, catalogue: Catalogue) -> dict[tuple, tuple]:
    """Mean, ends of the interval, n, seeds, nulls and reason by condition and `minus`."""
    measured = records.dropna(subset="value").fillna({"timestep": -1, "camera": -1})
    frames = measured.pivot(index=[*CONDITION[:-1], *FRAME], columns="variant", values="value")
    means: dict[tuple, tuple] = {}
    for shared, group in frames.groupby(CONDITION[:-1]):
        for names, values in _comparisons(group, settings.reference, catalogue.get(shared[-1])):
            values = values.dropna()
            if len(values):
                seeds = len(set(values.index.get_level_values("seed")))
                means[(*shared, *names)] = (*_mean(values, shared[3]), len(values), seeds)
    unmeasured = records[records["value"].isna()].groupby(CONDITION)["reason"]
    reasons = {(*condition, ""): (len(group), "; ".join(sorted(set(group)))) for condition, group in unmeasured}
    keys = means.keys() | reasons.keys()
    return {key: (*means.get(key, (np.nan, np.nan, np.nan, 0, 0)), *reasons.get(key, (0, ""))) for key in keys}


def _comparisons(
    frames: pd.DataFrame, reference: str, metric: Metric | None
) -> Iterator[tuple[tuple[str, str], pd.Series]]:
    """Values of each variant, and differences of two, with the names of the variants."""
    for variant in frames:
        yield (variant, ""), frames[variant]
    best = _best_variant(frames.mean().dropna(), metric)
    for first in dict.fromkeys((reference, best)):
        for variant in frames:
            if first in frames and variant != first:
                yield (first, variant), frames[first] - frames[variant]


def _best_variant(means: pd.Series, metric: Metric | None) -> str | None:
    """The variant with the best mean.

    Args:
        means: Means by variant.
        metric: The metric, if it is known.

    Returns:
        The variant; None if the metric is not known or does not rank variants.
    """
    if metric is None or metric.better == "neither" or means.empty:
        return None
    return means.idxmax() if metric.better == "higher" else means.idxmin()


def _mean(values: pd.Series, protocol: str) -> Interval:
    """Mean and interval of values, the last levels of whose index are `FRAME`."""
    return mean_interval(
        values.to_numpy(),
        crossed_factors({name: values.index.get_level_values(name) for name in FRAME}, protocol),
    )


def _read(file: Path) -> pd.DataFrame:
    text = decode_text(read_bytes(file, MAX_TEXT_BYTES, "file of metric records"), file)
    try:
        header, *lines = list(csv.reader(io.StringIO(text, newline=""))) or [[]]
    except csv.Error as error:
        raise InputError(f"cannot be read ({error})", file=file) from error
    if tuple(header) != MetricRecord._fields:
        raise InputError(f"expected the columns {', '.join(MetricRecord._fields)}", file=file, field="line 1")
    for number, cells in enumerate(lines, start=2):
        if len(cells) != len(header):
            raise InputError(f"{len(cells)} cells, expected {len(header)}", file=file, field=f"line {number}")
    table = pd.DataFrame(lines, columns=header, dtype=object)
    for column, parse in RECORD_NUMBERS.items():
        empty = "" if column in ("camera", "timestep", "value") else None
        table[column] = [np.nan if cell == empty else _number(cell, parse, file, f"line {number}, {column}")
                         for number, cell in enumerate(table[column], start=2)]  # fmt: skip
    unexplained = table.index[table["value"].isna() & (table["reason"] == "")]
    if len(unexplained):
        raise InputError("neither a value nor a reason", file=file, field=f"line {unexplained[0] + 2}, value")
    return table


def _number(cell: str, parse: type, file: Path, field: str) -> float:
    try:
        number = parse(cell)
    except ValueError as error:
        raise InputError(f"not a number: {cell!r}", file=file, field=field) from error
    if not abs(number) < 1e300:  # also refuses NaN, and whole numbers beyond the range of floating-point numbers
        raise InputError(f"not a finite number: {cell!r}", file=file, field=field)
    return number
