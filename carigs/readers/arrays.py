"""Checks of an array that comes from a file: shape, kind of numbers, finiteness and range."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from carigs.errors import InputError

_KIND_NAMES = {"b": "booleans", "i": "whole numbers", "u": "whole numbers", "f": "numbers", "U": "texts", "S": "texts"}


def checked_array(
    arrays: Mapping[str, Any],
    name: str,
    shape: tuple[int | None, ...] | None = None,
    dtype: Any = None,
    *,
    below: int | None = None,
    within: tuple[float, float] | None = None,
    file: str | Path,
) -> np.ndarray:
    """Take an array out of a mapping and check it.

    Args:
        arrays: Arrays by name, for example from `read_npz`.
        name: Name of the array.
        shape: Expected shape; None stands for any length, and for any shape if given alone.
        dtype: Type to convert to; None keeps the type. A conversion that would change a value is an error: booleans,
            fractions and numbers beyond the range are no whole numbers, complex numbers are no numbers.
        below: For indices: values must lie in 0..below - 1.
        within: Smallest and largest value that is possible.
        file: Where the arrays come from, for messages.

    Returns:
        The array, finite if it is of floating-point numbers.

    Raises:
        InputError: If the array is missing, has another shape or type, or holds a value that is not finite or not in
            the range.

    Example:
        >>> checked_array({"delta": np.zeros((5, 3))}, "delta", (None, 3), np.float64, file="path.npz").shape
        (5, 3)
    """
    if name not in arrays:
        raise InputError("this array is missing", file=file, field=name)
    try:
        array = np.asarray(arrays[name])
    except (ValueError, TypeError) as error:  # lists of different lengths
        raise InputError("not an array", file=file, field=name) from error
    if dtype is not None:
        array = _converted(array, np.dtype(dtype), file, name)
    if shape is not None and (
        array.ndim != len(shape) or any(n not in (None, m) for n, m in zip(shape, array.shape, strict=True))
    ):
        expected = " x ".join("*" if n is None else str(n) for n in shape) or "one value"
        raise InputError(f"shape {array.shape}, expected {expected}", file=file, field=name)
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        index = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise InputError(f"not a finite number at {index}", file=file, field=name)
    if below is not None and array.size and (array.min() < 0 or array.max() >= below):
        raise InputError(f"indices must lie in 0..{below - 1}", file=file, field=name)
    if within is not None and array.size and not within[0] <= array.min() <= array.max() <= within[1]:
        index = tuple(int(i) for i in np.argwhere((array < within[0]) | (array > within[1]))[0])
        where = f" at {index}" if index else ""
        problem = f"{array[index]:g}{where}, expected values in [{within[0]:g}, {within[1]:g}]"
        raise InputError(problem, file=file, field=name)
    return array


def checked_text(arrays: Mapping[str, Any], name: str, *, file: str | Path) -> str:
    """Take a text out of a mapping of arrays.

    Args:
        arrays: Arrays by name, for example from `read_npz`.
        name: Name of the text.
        file: Where the arrays come from, for messages.

    Returns:
        The text.

    Raises:
        InputError: If it is missing, or is no single text.
    """
    text = checked_array(arrays, name, file=file)
    if text.dtype.kind != "U" or text.ndim:
        what = _KIND_NAMES.get(text.dtype.kind, str(text.dtype)) if text.dtype.kind != "S" else "bytes"
        raise InputError(f"expected one text, found {what} of shape {text.shape}", file=file, field=name)
    return str(text)


def _converted(array: np.ndarray, dtype: np.dtype, file: str | Path, name: str) -> np.ndarray:
    """The array in another type, if that keeps its values (floating-point numbers: to rounding)."""
    if array.dtype == dtype:
        return array
    found, wanted = array.dtype.kind, dtype.kind
    numbers = {"i": "iuf", "u": "iuf", "f": "biuf", "b": "b"}.get(wanted, wanted)
    if found not in numbers and array.size:
        what = _KIND_NAMES.get(found, str(array.dtype))
        raise InputError(f"holds {what}, expected {_KIND_NAMES.get(wanted, str(dtype))}", file=file, field=name)
    with np.errstate(invalid="ignore", over="ignore"):
        converted = array.astype(dtype)
    if wanted in "iu" and array.size:
        limits = np.iinfo(dtype)
        values = array.astype(np.float64) if found == "f" else array
        if not (values.min() >= limits.min and values.max() < float(limits.max) + 1):  # also refuses NaN
            raise InputError(f"values must lie in {limits.min}..{limits.max}", file=file, field=name)
        if found == "f" and (values != np.floor(values)).any():
            raise InputError("holds fractions, expected whole numbers", file=file, field=name)
    elif wanted == "f" and found == "f" and not (np.isfinite(converted) | ~np.isfinite(array)).all():
        raise InputError(f"holds numbers beyond the range of {dtype}", file=file, field=name)
    return converted
