"""Reader of JSON files with limits and one type of error."""

from __future__ import annotations

import json
import math
from collections import Counter
from pathlib import Path
from typing import Any

from carigs.errors import InputError
from carigs.readers.limits import MAX_TEXT_BYTES, read_bytes
from carigs.readers.text import decode_text

_TYPES = {
    int: "a whole number",
    float: "a number",
    str: "a string",
    bool: "true or false",
    list: "a list",
    dict: "an object",
}
LARGEST_NUMBER = 2**63
"""Whole numbers must be smaller, without their sign."""


def read_json(file: str | Path, kind: type = object) -> Any:
    """Parse a JSON file.

    Args:
        file: The file, in UTF-8.
        kind: Expected type of its content: `dict`, `list`, or `object` for any.

    Returns:
        The content. Numbers are finite and smaller than 2^63; no object has two fields of one name.

    Raises:
        InputError: If the file is missing, exceeds a limit, is in another encoding, is not JSON (with line and column),
            is nested more deeply than Python's parser can follow, or holds another type.
    """
    content = parse_json(read_bytes(file, MAX_TEXT_BYTES), file)
    if not isinstance(content, kind):
        raise InputError(f"expected {_TYPES[kind]}", file=file)
    return content


def parse_json(text: str | bytes, file: str | Path, field: str | None = None) -> Any:
    """Parse JSON.

    Args:
        text: The JSON, as text or in UTF-8.
        file: Where it comes from, for messages.
        field: Field of the file that holds it, for messages.

    Returns:
        The content, as for `read_json`.

    Raises:
        InputError: As for `read_json`.
    """
    try:
        return json.loads(
            decode_text(text, file, field) if isinstance(text, bytes) else text,
            object_pairs_hook=_object,
            parse_constant=_no_constant,
            parse_int=_whole_number,
            parse_float=_number,
        )
    except json.JSONDecodeError as error:
        where = f"line {error.lineno} column {error.colno}"
        raise InputError(f"broken JSON: {error.msg}", file=file, field=field or where) from error
    except RecursionError as error:
        raise InputError("broken JSON: nested too deeply", file=file, field=field) from error
    except ValueError as error:
        raise InputError(f"broken JSON: {error}", file=file, field=field) from error


def json_field(entry: Any, key: str, kind: type, *, file: str | Path, where: str = "") -> Any:
    """Take a field out of a JSON object and check its type.

    Args:
        entry: The object.
        key: Name of the field.
        kind: Expected type: `int`, `float` (also accepts integers), `bool`, `str`, `list`, `dict`.
        file: The JSON file, for messages.
        where: Position of the object in the file, for messages, for example `frames[3]`.

    Returns:
        The value.

    Raises:
        InputError: If the field is missing, of another type, or not a finite number.
    """
    field = f"{where}.{key}" if where else key
    if not isinstance(entry, dict) or key not in entry:
        raise InputError("this key is missing", file=file, field=field)
    value = entry[key]
    kinds = (int, float) if kind is float else kind
    wrong = not isinstance(value, kinds) or isinstance(value, bool) != (kind is bool)
    if wrong or (kind is float and not math.isfinite(value)):
        raise InputError(f"expected {_TYPES[kind]}, found {repr(value)[:60]}", file=file, field=field)
    return value


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    fields = dict(pairs)
    if len(fields) < len(pairs):
        (name, _), *_ = Counter(name for name, _ in pairs).most_common(1)
        raise ValueError(f"two fields are called {name[:60]}")
    return fields


def _no_constant(text: str) -> float:
    raise ValueError(f"{text} is not a finite number")


def _number(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text[:20]} is not a finite number")
    return value


def _whole_number(text: str) -> int:
    if len(text) > 20 or abs(int(text)) >= LARGEST_NUMBER:
        raise ValueError(f"{text[:20]} has too many digits")
    return int(text)
