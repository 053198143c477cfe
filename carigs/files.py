"""Files: atomic writes, and checked reads that report problems as `InputError` with file and field."""

from __future__ import annotations

import json
import os
import shutil
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from carigs.errors import InputError

BROKEN_ARCHIVE = (OSError, ValueError, EOFError, TypeError, KeyError, BadZipFile, zlib.error)
"""Errors that `np.load` raises for files that are truncated or of another format."""
_JSON_TYPES = {int: "a whole number", float: "a number", str: "a string", list: "a list", dict: "an object"}


@contextmanager
def writing(path: str | Path) -> Iterator[Path]:
    """Write a file atomically: under a temporary name first, then renamed.

    Args:
        path: File to create or replace. Its folder is created if necessary.

    Yields:
        Temporary path of the same suffix in the same folder. It is renamed to `path` on success and removed on failure.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def writing_folder(path: str | Path) -> Iterator[Path]:
    """Write a folder atomically, like `writing`.

    Args:
        path: Folder to create or replace.

    Yields:
        Empty temporary folder. It replaces `path` on success and is removed on failure.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    shutil.rmtree(temporary, ignore_errors=True)
    temporary.mkdir(parents=True)
    try:
        yield temporary
        shutil.rmtree(path, ignore_errors=True)
        os.replace(temporary, path)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


@contextmanager
def resuming_folder(path: str | Path, key: str) -> Iterator[tuple[Path, Path]]:
    """Write a folder that replaces `path` on success and that is kept if the run fails or is killed.

    Args:
        path: Folder to create or replace.
        key: Digest of everything that the contents depend on. A partial folder of an earlier run is reused only if its
            key is the same.

    Yields:
        The partial folder, and a second folder for records of which contents are complete. Both are empty unless an
        earlier run with the same key was interrupted.
    """
    path = Path(path)
    state = path.with_name(f".{path.name}.part")
    contents, records, key_file = state / "contents", state / "notes", state / "key"
    if not (key_file.is_file() and key_file.read_text() == key and contents.is_dir()):
        shutil.rmtree(state, ignore_errors=True)
        for folder in (contents, records):
            folder.mkdir(parents=True)
        with writing(key_file) as part:
            part.write_text(key)
    yield contents, records
    shutil.rmtree(path, ignore_errors=True)
    os.replace(contents, path)
    shutil.rmtree(state, ignore_errors=True)


def load_npz(file: str | Path, kind: str = "file", required: Iterable[str] = ()) -> dict[str, np.ndarray]:
    """Read all arrays of an .npz file; pickled objects are refused.

    Args:
        file: The .npz file.
        kind: What the file is, for the message "no such {kind}".
        required: Names of arrays that must be present.

    Returns:
        Arrays by name.

    Raises:
        InputError: If the file is missing, cannot be read, or lacks a required array.
    """
    with reading_arrays(file, kind), Path(file).open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    for name in required:
        if name not in arrays:
            raise InputError("this array is missing", file=file, field=name)
    return arrays


@contextmanager
def reading_arrays(file: str | Path, kind: str = "file") -> Iterator[None]:
    """Convert the errors of `np.load` within the block to `InputError`.

    Args:
        file: The file that is read.
        kind: What the file is, for the message "no such {kind}".

    Yields:
        None.

    Raises:
        InputError: If the file is missing or cannot be read.
    """
    try:
        yield
    except FileNotFoundError as error:
        raise InputError(f"no such {kind}", file=file) from error
    except BROKEN_ARCHIVE as error:
        raise InputError(f"not a readable {Path(file).suffix} ({error})", file=file) from error


def checked_array(
    arrays: Mapping[str, Any],
    name: str,
    shape: tuple[int | None, ...] | None = None,
    dtype: Any = None,
    *,
    file: str | Path,
) -> np.ndarray:
    """Take an array out of a mapping and check it.

    Args:
        arrays: Arrays by name, for example from `load_npz`.
        name: Name of the array.
        shape: Expected shape; None stands for any length, and for any shape if given alone.
        dtype: Type to convert to; None keeps the type.
        file: Where the arrays come from, for messages.

    Returns:
        The array, finite if it is of floating-point numbers.

    Raises:
        InputError: If the array is missing, has another shape, or holds a value that is not finite.

    Example:
        >>> checked_array({"delta": np.zeros((5, 3))}, "delta", (None, 3), np.float64, file="path.npz").shape
        (5, 3)
    """
    if name not in arrays:
        raise InputError("this array is missing", file=file, field=name)
    array = np.asarray(arrays[name], dtype)
    if shape is not None and (
        array.ndim != len(shape) or any(n not in (None, m) for n, m in zip(shape, array.shape, strict=True))
    ):
        expected = " x ".join("*" if n is None else str(n) for n in shape)
        raise InputError(f"shape {array.shape}, expected {expected}", file=file, field=name)
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        index = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise InputError(f"not a finite number at {index}", file=file, field=name)
    return array


def read_json(file: str | Path, kind: type = object) -> Any:
    """Parse a JSON file.

    Args:
        file: The file, in UTF-8.
        kind: Expected type of its content: `dict`, `list`, or `object` for any.

    Returns:
        The content.

    Raises:
        InputError: If the file is missing, cannot be read, is not JSON (with line and column), or holds another type.
    """
    try:
        content = json.loads(Path(file).read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise InputError("no such file", file=file) from error
    except json.JSONDecodeError as error:
        where = f"line {error.lineno} column {error.colno}"
        raise InputError(f"broken JSON: {error.msg}", file=file, field=where) from error
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot be read ({error})", file=file) from error
    if not isinstance(content, kind):
        raise InputError(f"expected {_JSON_TYPES[kind]}", file=file)
    return content


def json_field(entry: Any, key: str, kind: type, *, file: str | Path, where: str = "") -> Any:
    """Take a field out of a JSON object and check its type.

    Args:
        entry: The object.
        key: Name of the field.
        kind: Expected type: `int`, `float` (also accepts integers), `str`, `list` or `dict`.
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
    if not isinstance(value, kinds) or isinstance(value, bool) or (kind is float and not np.isfinite(value)):
        raise InputError(f"expected {_JSON_TYPES[kind]}, found {value!r}", file=file, field=field)
    return value


def write_json(file: str | Path, content: Any) -> None:
    """Write JSON atomically, indented by one space.

    Args:
        file: File to create or replace.
        content: Anything that `json.dumps` accepts.
    """
    with writing(file) as part:
        part.write_text(json.dumps(content, indent=1))
