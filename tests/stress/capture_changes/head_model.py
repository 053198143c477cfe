"""Damages of the head model."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from carigs.head.model_arrays import FLAME_NUM_IDENTITY
from stress.capture_changes.edits import edit_arrays
from stress.capture_changes.folder import Change, Folder


def damages() -> Iterator[tuple[str, Change]]:
    """Damages of the arrays of the head model.

    Yields:
        Name and change.
    """
    yield "skinning weights times 7", partial(_edit_model, weights=lambda w: 7 * w)
    yield "skinning weights of zero", partial(_edit_model, weights=lambda w: 0 * w)
    yield "weights of neck and left eye exchanged", partial(_edit_model, weights=_permuted((0, 3, 2, 1, 4), 1))
    yield "weights of jaw and left eye exchanged", partial(_edit_model, weights=_permuted((0, 1, 3, 2, 4), 1))
    yield "a joint regressor of zeros", partial(_edit_model, J_regressor=lambda r: 0 * r)
    yield "joints of jaw and neck exchanged", partial(_edit_model, J_regressor=_permuted((0, 2, 1, 3, 4), 0))
    yield "a region of booleans", partial(_edit_model, mask_scalp=lambda ids: np.isin(np.arange(15602), ids))
    yield "a template in millimetres", partial(_edit_model, v_template=lambda v: 1000 * v)
    yield "blendshapes times 30", partial(_edit_model, shapedirs=lambda s: 30 * s)
    yield "faces are turned over", partial(_edit_model, f=lambda f: f[:, ::-1])
    yield "expressions in another order", partial(_edit_model, shapedirs=_reordered)


def _edit_model(folder: Folder, **values: Callable[[np.ndarray], Any]) -> None:
    """Change arrays of the head model."""
    edit_arrays(folder.model, lambda arrays: arrays.update({k: np.asarray(v(arrays[k])) for k, v in values.items()}))


def _permuted(order: tuple[int, ...], axis: int) -> Callable[[np.ndarray], np.ndarray]:
    return lambda array: np.take(array, order, axis=axis)


def _reordered(shapedirs: np.ndarray) -> np.ndarray:
    """Expressions that are not zero, in another order."""
    used = FLAME_NUM_IDENTITY + np.flatnonzero(np.abs(shapedirs[..., FLAME_NUM_IDENTITY:]).max(axis=(0, 1)))
    shapedirs[..., used] = shapedirs[..., np.roll(used, 7)]
    return shapedirs
