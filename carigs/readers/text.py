"""Text of files from outside: one place decides in which encoding it is, and where its lines end.

Text is UTF-8. A byte order mark at its beginning is no part of it. Text in UTF-16 or UTF-32 is refused by name: it is
never read by halves, as characters with NUL bytes between them.
"""

from __future__ import annotations

import codecs
import re
from pathlib import Path

from carigs.errors import InputError

BYTE_ORDER_MARKS = {
    codecs.BOM_UTF32_LE: "UTF-32",  # begins with the mark of UTF-16
    codecs.BOM_UTF32_BE: "UTF-32",
    codecs.BOM_UTF16_LE: "UTF-16",
    codecs.BOM_UTF16_BE: "UTF-16",
}
"""Bytes at the beginning of text in the other encodings of Unicode."""
_UNMARKED = {
    re.compile(rb"\0\0\0[^\0]|[^\0]\0\0\0"): "UTF-32",
    re.compile(rb"\0[^\0]|[^\0]\0"): "UTF-16",
}
"""Files of every kind that is read begin with a character of ASCII, which shows where the other bytes of it are 0."""
_LINE_END = re.compile(r"\r\n|\r|\n")


def decode_text(content: bytes, file: str | Path, field: str | None = None, *, any_bytes: bool = False) -> str:
    """Decode the content of a text file.

    Args:
        content: The file's bytes, in UTF-8, with or without a byte order mark.
        file: Its name, for messages.
        field: Field of the file that holds the text, for messages.
        any_bytes: For formats whose keywords and numbers are ASCII: keep bytes that are not UTF-8, as in a comment in
            Latin-1, as lone surrogates. `encode_text` turns them into the same bytes again.

    Returns:
        The text without a byte order mark.

    Raises:
        InputError: If it is in another encoding, which the message names where the file shows it, or holds NUL
            characters, as a crash leaves them at the end of a file.
    """
    content = without_byte_order_mark(content, file, field)
    if (at := content.find(b"\0")) >= 0:
        line = len(split_lines(content[:at].decode("latin1")))
        raise InputError(f"line {line} holds a NUL character: damaged, or no text", file=file, field=field)
    try:
        return content.decode("utf-8", "surrogateescape" if any_bytes else "strict")
    except UnicodeDecodeError as error:
        line = len(split_lines(content[: error.start].decode("utf-8")))
        problem = f"not text in UTF-8 but perhaps in Latin-1 ({error.reason} in line {line})"
        raise InputError(f"{problem}; save it as UTF-8", file=file, field=field) from error


def without_byte_order_mark(content: bytes, file: str | Path, field: str | None = None) -> bytes:
    """Remove the byte order mark of UTF-8, and refuse text in other encodings of Unicode.

    Args:
        content: Bytes of a file that begins with text.
        file: Its name, for messages.
        field: Field of the file that holds the text, for messages.

    Returns:
        The bytes that follow the mark.

    Raises:
        InputError: If the text is in UTF-16 or UTF-32.
    """
    found = [name for mark, name in BYTE_ORDER_MARKS.items() if content.startswith(mark)]
    found += [name for pattern, name in _UNMARKED.items() if pattern.match(content)]
    if found:
        raise InputError(f"not text in UTF-8 but in {found[0]}; save it as UTF-8", file=file, field=field)
    return content.removeprefix(codecs.BOM_UTF8)


def encode_text(text: str) -> bytes:
    """Encode text that `decode_text` made.

    Args:
        text: The text.

    Returns:
        Bytes in UTF-8, and those that were not UTF-8.
    """
    return text.encode("utf-8", "surrogateescape")


def split_lines(text: str) -> list[str]:
    """Split text where a line of any system ends: at CR LF, LF or CR.

    Args:
        text: The text.

    Returns:
        The lines without their ends; an empty one after the last end.
    """
    return _LINE_END.split(text)
