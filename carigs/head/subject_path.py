"""The gamma path of a head: a file of it must belong to the head."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from carigs.errors import InputError
from carigs.exaggeration.gamma_path import GammaPath
from carigs.head.model import HeadModel


def read_subject_path(file: str | Path, model: HeadModel) -> GammaPath:
    """Read a path and check that it belongs to a head.

    Args:
        file: The .npz file.
        model: The head model.

    Returns:
        The path.

    Raises:
        InputError: If the file is missing or broken, or is the path of another head.
    """
    path = GammaPath.load(file)
    check_subject_path(path, model, file)
    return path


def check_subject_path(path: GammaPath, model: HeadModel, file: str | Path, prefix: str = "") -> None:
    """Check that a path belongs to a head: vertices, faces, and the blendshapes that it changes.

    Args:
        path: The path.
        model: The head model.
        file: Where the path comes from, for messages.
        prefix: What precedes the names of its arrays there.

    Raises:
        InputError: If it is the path of another head.
    """
    if path.neutral.shape != model.v_template.shape:
        problem = f"{len(path.neutral)} vertices, the head has {len(model.v_template)}: was it made for another head?"
        raise InputError(problem, file=file, field=f"{prefix}neutral")
    if not np.array_equal(path.faces, model.faces):
        raise InputError("not the faces of the head: was it made for another one?", file=file, field=f"{prefix}faces")
    blendshapes = model.num_expressions + model.posedirs.shape[2]
    if path.columns is not None and path.columns.size and path.columns.max() >= blendshapes:
        raise InputError(f"indices must lie in 0..{blendshapes - 1}", file=file, field=f"{prefix}columns")
