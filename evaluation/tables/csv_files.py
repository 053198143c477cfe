"""CSV files of named tuples: floats with a fixed number of significant digits, None as an empty cell.

Written without pandas, whose import takes 0.3 s: a study runs one `metrics` job per avatar and level.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Iterable
from pathlib import Path
from typing import TypeVar

from carigs.system.files import writing

Record = TypeVar("Record", bound=tuple)


def write_csv(file: Path, records: Iterable[Record], record_type: type[Record], *, digits: int = 6) -> None:
    """Write records to a CSV file, which appears only once it is complete.

    Args:
        file: File to write.
        records: Named tuples, one per line.
        record_type: Their type; its fields are the columns.
        digits: Significant digits of floats.
    """
    with writing(file) as part:
        list(_written(part, records, record_type, digits))


def stream_csv(file: Path, records: Iterable[Record], record_type: type[Record], *, digits: int = 6) -> list[Record]:
    """Write records to a CSV file as they are produced.

    The lines go to `.NAME.part.csv`, renamed when all are written. A killed run leaves that file with its results.

    Args:
        file: File to write.
        records: Named tuples, one per line.
        record_type: Their type; its fields are the columns.
        digits: Significant digits of floats.

    Returns:
        The records.
    """
    part = file.with_name(f".{file.stem}.part{file.suffix}")
    file.parent.mkdir(parents=True, exist_ok=True)
    complete = list(_written(part, records, record_type, digits))
    os.replace(part, file)
    return complete


def _written(file: Path, records: Iterable[Record], record_type: type[Record], digits: int) -> Iterable[Record]:
    with file.open("w", newline="", encoding="utf-8", buffering=1) as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(record_type._fields)
        for record in records:
            # The writer leaves cells of None empty.
            writer.writerow([f"{cell:.{digits}g}" if isinstance(cell, float) else cell for cell in record])
            yield record
