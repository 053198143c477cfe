"""Tables of numbers over time: comma-separated text with names in its first line."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from carigs.errors import InputError
from carigs.motion.motion import MAX_FRAMES
from carigs.readers.limits import MAX_TEXT_BYTES, read_bytes
from carigs.readers.text import decode_text

RATES = (24, 25, 30, 50, 60, 100, 120, 240)
"""Frames per second of which timecodes count."""
_TIMECODE = re.compile(r"(\d+)[:;](\d+)[:;](\d+)[:;.](\d+(?:\.\d+)?)")
_MILLISECONDS = ("timestamp_ms", "time_ms", "timestampms", "milliseconds")
_SECONDS = ("time", "timestamp", "seconds", "t")
IGNORED = ("frame", "blendshapecount", "timecode", "_neutral", "neutral", *_MILLISECONDS, *_SECONDS)
"""Columns that hold no coefficient, in lower case."""


class Table(NamedTuple):
    """Rows of text under names."""

    names: list[str]
    rows: list[list[str]]
    lines: list[int]
    """Line of the file of each row."""


def read_table(file: Path) -> Table:
    """Read a comma-separated file; empty lines and lines that begin with # are skipped.

    Args:
        file: The file.

    Returns:
        Its fields without blanks around them.

    Raises:
        InputError: If it is no such file, has no row, a row of another length, or more than `MAX_FRAMES` rows.
    """
    text = decode_text(read_bytes(file, MAX_TEXT_BYTES, "motion file"), file)
    if text.count("\n") > 2 * MAX_FRAMES:
        raise InputError(f"{text.count(chr(10))} lines; at most {MAX_FRAMES} frames are read", file=file)
    names: list[str] = []
    rows, lines = [], []
    try:
        reader = csv.reader(text.splitlines(), strict=True)
        for row in reader:
            fields = [field.strip() for field in row]
            if not any(fields) or fields[0].startswith("#"):
                continue
            if not names:
                names = fields
            elif len(fields) != len(names):
                raise InputError(
                    f"{len(fields)} fields, the first line has {len(names)}", file=file, field=f"line {reader.line_num}"
                )
            else:
                rows.append(fields)
                lines.append(reader.line_num)
    except csv.Error as error:
        raise InputError(f"not a comma-separated table ({error})", file=file) from error
    if not rows:
        raise InputError("holds no frames: a line of names and a line for each frame are expected", file=file)
    if len(rows) > MAX_FRAMES:
        raise InputError(f"{len(rows)} frames; at most {MAX_FRAMES} are read", file=file)
    lowered = [name.lower() for name in names]
    for name in lowered:
        if name and lowered.count(name) > 1:
            raise InputError("two columns have this name", file=file, field=name)
    return Table(names, rows, lines)


def numbers(table: Table, columns: Sequence[int], file: Path) -> Float[np.ndarray, "t n"]:
    """The numbers of some columns.

    Args:
        table: The table.
        columns: Places of the columns.
        file: The file, for messages.

    Returns:
        The numbers, finite.

    Raises:
        InputError: If a field is no finite number; names the line and the column.
    """
    text = [[row[c] for c in columns] for row in table.rows]
    try:
        values = np.array(text, np.float64).reshape(len(text), len(columns))
    except ValueError:
        values = np.array([[_number(field) for field in row] for row in text]).reshape(len(text), len(columns))
    bad = np.argwhere(~np.isfinite(values))
    if len(bad):
        row, column = bad[0].tolist()
        where = f"line {table.lines[row]}, {table.names[columns[column]]}"
        raise InputError(
            f"{text[row][column][:40] or 'an empty field'!r} is not a finite number", file=file, field=where
        )
    return values


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return np.nan


def times_of(table: Table, file: Path) -> tuple[Float[np.ndarray, " t"], float | None] | None:
    """Times of the rows: the column `Timecode`, one of seconds, or one of milliseconds.

    Args:
        table: The table.
        file: The file, for messages.

    Returns:
        Seconds from the first row, and the frames per second that timecodes count; None without such a column.

    Raises:
        InputError: If a time is broken, or earlier than the one before.
    """
    lowered = [name.lower() for name in table.names]
    rate = None
    if "timecode" in lowered:
        times, rate = _timecodes([row[lowered.index("timecode")] for row in table.rows], table, file)
    else:
        found = [(name, 1.0) for name in _SECONDS if name in lowered]
        found += [(name, 1e-3) for name in _MILLISECONDS if name in lowered]
        if not found:
            return None
        name, unit = found[0]
        times = unit * numbers(table, [lowered.index(name)], file)[:, 0]
    back = np.flatnonzero(np.diff(times) < 0)
    if len(back):
        where = f"line {table.lines[back[0] + 1]}"
        raise InputError("its time is earlier than that of the line before", file=file, field=where)
    return times - times[0], rate


def _timecodes(texts: list[str], table: Table, file: Path) -> tuple[Float[np.ndarray, " t"], float | None]:
    """Times of HH:MM:SS:FF.fff; the rate of FF is the least of `RATES` above the highest FF."""
    matches = [_TIMECODE.fullmatch(text) for text in texts]
    for match, text, line in zip(matches, texts, table.lines, strict=True):
        if match is None:
            problem = f"{text[:40]!r} is no timecode HH:MM:SS:FF.fff"
            raise InputError(problem, file=file, field=f"line {line}, Timecode")
    parts = np.array([[float(number) for number in match.groups()] for match in matches])
    rate = next((rate for rate in RATES if rate > int(parts[:, 3].max())), None)
    if rate is None:  # thousandths of a second
        return parts[:, :3] @ [3600, 60, 1] + parts[:, 3] / 1000, None
    if len(parts) < rate:  # too short to show the highest number: that of Live Link Face
        rate = max(rate, 60)
    return parts[:, :3] @ [3600, 60, 1] + parts[:, 3] / rate, rate
