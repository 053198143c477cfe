"""The tidy rows that metrics are written as, and their CSV file."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from carigs.errors import InputError
from carigs.files import writing


class Scene(NamedTuple):
    """What was rendered: the same for all rows of one file."""

    study: str
    subject: str
    variant: str
    gamma: float
    level: float


class Row(NamedTuple):
    """One metric of one region of one frame; `value` is None where it could not be measured, and `reason` says why."""

    study: str
    subject: str
    variant: str
    gamma: float
    level: float
    protocol: str
    camera: int | None
    """None (as for `timestep`) where the row stands for all frames of the protocol."""
    timestep: int | None
    region: str
    metric: str
    value: float | None
    reason: str


def row(scene: Scene, protocol: str, frame: tuple[int | None, int | None], region: str, metric: str,
        value: float | None, reason: str = "") -> Row:  # fmt: skip
    """A row of `scene`; `frame` is (camera, timestep); a value that is not finite becomes null with a reason."""
    if value is not None and not math.isfinite(value):
        value, reason = None, reason or ("infinite: both images agree exactly" if value > 0 else "not a number")
    return Row(*scene, protocol, *frame, region, metric, value, reason)


def write_rows(file: Path, rows: Iterable[Row]) -> None:
    """Write rows as CSV; values keep nine significant digits."""
    with writing(file) as part, part.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(Row._fields)
        for item in rows:
            value = "" if item.value is None else f"{item.value:.9g}"
            plain = item._replace(gamma=f"{item.gamma:g}", level=f"{item.level:g}", value=value)
            writer.writerow(["" if cell is None else cell for cell in plain])


def read_rows(file: Path) -> list[Row]:
    """Read what `write_rows` wrote; raises `InputError` naming line and column for anything else."""
    try:
        with Path(file).open(newline="", encoding="utf-8") as stream:
            reader = csv.reader(stream)
            header = next(reader, [])
            if tuple(header) != Row._fields:
                raise InputError(f"expected the columns {', '.join(Row._fields)}", file=file, field="line 1")
            return [_parse(cells, file, reader.line_num) for cells in reader]
    except FileNotFoundError as error:
        raise InputError("no such file of metric rows", file=file) from error
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"cannot be read ({error})", file=file) from error


def _parse(cells: list[str], file: Path, line: int) -> Row:
    if len(cells) != len(Row._fields):
        raise InputError(f"{len(cells)} cells, expected {len(Row._fields)}", file=file, field=f"line {line}")
    raw = Row(*cells)

    def number(column: str, kind: type):
        text = getattr(raw, column)
        try:
            value = kind(text)
        except ValueError as error:
            raise InputError(f"not a number: {text!r}", file=file, field=f"line {line}, {column}") from error
        if not math.isfinite(value):
            raise InputError(f"not a finite number: {text!r}", file=file, field=f"line {line}, {column}")
        return value

    if not raw.value and not raw.reason:
        raise InputError("neither a value nor a reason", file=file, field=f"line {line}, value")
    return raw._replace(
        gamma=number("gamma", float),
        level=number("level", float),
        camera=number("camera", int) if raw.camera else None,
        timestep=number("timestep", int) if raw.timestep else None,
        value=number("value", float) if raw.value else None,
    )
