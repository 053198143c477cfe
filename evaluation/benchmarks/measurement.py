"""Records of a benchmark, and their CSV file."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from evaluation.tables.csv_files import stream_csv


class Measurement(NamedTuple):
    """One measured number."""

    case: str
    quantity: str
    unit: str
    value: float
    reference: float | None = None
    """Number that `value` is compared with, from the same run; None if there is none."""


def write_measurements(file: Path, measurements: Iterable[Measurement]) -> list[Measurement]:
    """Write measurements as CSV while they are taken; numbers keep six significant digits.

    Args:
        file: File to write. A killed run leaves what it measured in `.NAME.part.csv`.
        measurements: Records, usually of a generator that measures.

    Returns:
        The records.
    """
    return stream_csv(file, Measurement._fields, measurements)
