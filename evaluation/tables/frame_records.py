"""Values of one avatar's frames as CSV: what the stage `render` measures on the avatar while it renders it.

Beside the images, because opacity, depth, normals and surfels exist only while the avatar is rendered. The stage
`metrics` adds the study point.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from carigs.errors import InputError
from carigs.readers.limits import MAX_TEXT_BYTES, read_bytes
from carigs.readers.text import decode_text
from evaluation.tables.csv_files import write_csv
from evaluation.tables.metric_records import MetricRecord, StudyPoint, metric_record


class FrameRecord(NamedTuple):
    """Value of one metric in one region of one frame; the fields are those of `MetricRecord`."""

    protocol: str
    camera: int | None
    """None in a record that stands for all cameras of the timestep."""
    timestep: int
    region: str
    metric: str
    value: float | None
    reason: str


def write_frame_records(file: Path, records: Iterable[FrameRecord]) -> None:
    """Write records as CSV; values keep nine significant digits.

    Args:
        file: File to write.
        records: Records.
    """
    write_csv(file, records, FrameRecord, digits=9)


def read_frame_records(file: Path, point: StudyPoint) -> list[MetricRecord]:
    """Read records and add the study point.

    Args:
        file: File that `write_frame_records` wrote.
        point: Avatar and level.

    Returns:
        The records.

    Raises:
        InputError: If the file is missing or malformed; names its line and column.
    """
    text = decode_text(read_bytes(file, MAX_TEXT_BYTES, "file of frame records"), file)
    try:
        header, *lines = list(csv.reader(io.StringIO(text, newline=""))) or [[]]
    except csv.Error as error:
        raise InputError(f"cannot be read ({error})", file=file) from error
    if tuple(header) != FrameRecord._fields:
        raise InputError(f"expected the columns {', '.join(FrameRecord._fields)}", file=file, field="line 1")
    return [_metric_record(cells, point, file, f"line {number}") for number, cells in enumerate(lines, start=2)]


def _metric_record(cells: list[str], point: StudyPoint, file: Path, where: str) -> MetricRecord:
    if len(cells) != len(FrameRecord._fields):
        raise InputError(f"{len(cells)} cells, expected {len(FrameRecord._fields)}", file=file, field=where)
    protocol, camera, timestep, region, metric, value, reason = cells

    def number(cell: str, parse: type, column: str) -> float | int:
        try:
            return parse(cell)
        except ValueError as error:
            raise InputError(f"not a number: {cell[:60]!r}", file=file, field=f"{where}, {column}") from error

    frame = number(camera, int, "camera") if camera else None, number(timestep, int, "timestep")
    measured = number(value, float, "value") if value else None
    if measured is None and not reason:
        raise InputError("neither a value nor a reason", file=file, field=f"{where}, value")
    return metric_record(point, protocol, frame, region, metric, measured, reason)
