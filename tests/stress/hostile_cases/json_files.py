"""JSON files with wrong fields, and texts that are no JSON."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from typing import Any

from stress.hostile_cases.case import Case

VALUES: tuple[Any, ...] = (None, -1, 1e308, "", "x" * 5000, "\0", [], {}, True, 2**62, "../" * 40 + "etc/passwd")


def wrong_fields(reader: str, content: bytes) -> Iterator[Case]:
    """Each field of a JSON file replaced.

    Args:
        reader: The reader.
        content: A sound file of it.

    Yields:
        The cases.
    """
    sound = json.loads(content)
    for place in _places(sound):
        for value in VALUES:
            changed = copy.deepcopy(sound)
            inner = changed
            for key in place[:-1]:
                inner = inner[key]
            inner[place[-1]] = value
            name = ".".join(map(str, place))
            yield Case(f"{name} = {json.dumps(value)[:20]}", reader, json.dumps(changed).encode())


def broken_texts() -> Iterator[Case]:
    """Texts that nest deeply, have numbers out of range, or are no JSON.

    Yields:
        The cases.
    """
    many = b"".join(b'"%d":0,' % i for i in range(10**5))
    for text in (
        b"[" * 100_000, b"[" * 10**6, b'{"a":[' * 10**6, b"{" + many + b'"99999":0}',
        b'{"a":' * 100_000, b"[" + b"9" * 400 + b"]", b"[NaN]", b"[1e999]", b'{"a": 1, "a": 2}',
        b"[1,]",
        "[1]".encode("utf-16"), b"\xff\xfe", b"'a'", b"[1] 2", b'"\x00"', b"[" + b"1e5" * 9 + b"]", b"",
    ):  # fmt: skip
        yield Case(repr(text[:20]), "json", text, must_fail=True)


def _places(value: Any, at: tuple = ()) -> Iterator[tuple]:
    """Paths to all values; of a matrix only those of one row."""
    if at:
        yield at
    items = value.items() if isinstance(value, dict) else enumerate(value[:1]) if isinstance(value, list) else ()
    for key, item in items:
        yield from _places(item, (*at, key))
