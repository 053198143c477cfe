"""Reader of FLAME's .pkl files, without chumpy and without running code from the pickle."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np

from carigs.errors import InputError

_ALLOWED_MODULES = ("numpy", "scipy.sparse", "_codecs", "collections")


class _ChumpyArray:
    """Replacement of chumpy's class `Ch`: keeps its state, whose entry `x` is the array."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self.x = args[0] if args else None

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.x = state.get("x", self.x)

    def __array__(self, dtype: Any = None, copy: Any = None) -> np.ndarray:
        return np.asarray(self.x, dtype)


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        if module.split(".")[0] == "chumpy":
            return _ChumpyArray
        if module.startswith("scipy.sparse"):
            module = "scipy.sparse"  # the private module names have changed over the years
        if not any(module == allowed or module.startswith(f"{allowed}.") for allowed in _ALLOWED_MODULES):
            raise pickle.UnpicklingError(f"refuses to load {module}.{name}")
        return super().find_class(module, name)


def read_pickle(file: Path) -> dict[str, Any]:
    """Read a FLAME pickle, and the regions in `FLAME_masks.pkl` beside it.

    Args:
        file: The .pkl file.

    Returns:
        The arrays by FLAME's names; regions are vertex indices under `mask_<region>`.

    Raises:
        InputError: If either file is not such a pickle.
    """
    arrays = _load(file)
    masks = file.with_name("FLAME_masks.pkl")
    if masks.is_file():
        arrays |= {f"mask_{name}": np.asarray(ids) for name, ids in _load(masks).items()}
    return arrays


def _load(file: Path) -> dict[str, Any]:
    try:
        with file.open("rb") as stream:
            content = _Unpickler(stream, encoding="latin1").load()
    except (pickle.UnpicklingError, EOFError, AttributeError, ImportError, IndexError, ValueError) as error:
        raise InputError(f"not a FLAME pickle ({error})", file=file) from error
    if not isinstance(content, dict):
        raise InputError(f"holds a {type(content).__name__}, expected a dictionary of arrays", file=file)
    return content
