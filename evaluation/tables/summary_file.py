"""The summary of a study as a CSV file: what the stage `tabulate` writes, and cards and reports read."""

from __future__ import annotations

import io
from pathlib import Path

import pandas as pd

from carigs.errors import InputError
from carigs.readers.limits import MAX_TEXT_BYTES, read_bytes
from carigs.system.files import writing
from evaluation.tables.summary import SUMMARY

NUMBERS = ("gamma", "level", "mean", "low", "high", "n", "seeds", "nulls")
"""Columns of `SUMMARY` that hold numbers; the others hold texts."""


def write_summaries(file: Path, summaries: pd.DataFrame) -> None:
    """Write a summary with six significant digits.

    Args:
        file: File to write.
        summaries: Lines with the columns `SUMMARY`.
    """
    with writing(file) as part:
        summaries.to_csv(part, index=False, float_format="%.6g", lineterminator="\n")


def read_summaries(file: Path) -> pd.DataFrame:
    """Read a summary.

    Args:
        file: File of `write_summaries`.

    Returns:
        Lines with the columns `SUMMARY`; missing numbers are nan, missing texts empty.

    Raises:
        InputError: The file is missing, malformed or without a line.
    """
    content = io.BytesIO(read_bytes(file, MAX_TEXT_BYTES, "summary"))
    try:
        table = pd.read_csv(content, dtype=str, keep_default_na=False, encoding="utf-8")
        if list(table.columns) != SUMMARY:
            raise InputError(f"expected the columns {', '.join(SUMMARY)}", file=file, field="line 1")
        for column in NUMBERS:
            table[column] = pd.to_numeric(table[column].mask(table[column] == ""))
    except ValueError as error:  # also pandas' errors of parsing, and of encodings
        raise InputError(f"cannot be read ({error})", file=file) from error
    if table.empty:
        raise InputError("no line", file=file)
    return table
