"""The gamma path of a head: a file of it must belong to the head."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float

from carigs.errors import InputError
from carigs.exaggeration.gamma_path import GammaPath
from carigs.head.model import HeadModel
from carigs.head.model_arrays import LARGEST_COORDINATE
from carigs.mesh.triangle_mesh import diagonal

NEUTRAL_TOLERANCE = 1e-4
"""Of the vertices of two neutral heads that are one, as a share of the head's diagonal: 0.04 mm. Files hold float32."""


def read_subject_path(file: str | Path, model: HeadModel, neutral: Float[np.ndarray, "v 3"] | None = None) -> GammaPath:
    """Read a path and check that it belongs to a head.

    Args:
        file: The .npz file.
        model: The head model.
        neutral: Vertices of the subject's neutral head in metres; None if any subject's will do.

    Returns:
        The path.

    Raises:
        InputError: If the file is missing or broken, or is the path of another head.
    """
    path = GammaPath.load(file)
    check_subject_path(path, model, file, neutral=neutral)
    return path


def check_subject_path(
    path: GammaPath,
    model: HeadModel,
    file: str | Path,
    prefix: str = "",
    *,
    neutral: Float[np.ndarray, "v 3"] | None = None,
) -> None:
    """Check that a path belongs to a head: vertices, faces, and the blendshapes that it changes.

    Args:
        path: The path.
        model: The head model.
        file: Where the path comes from, for messages.
        prefix: What precedes the names of its arrays there.
        neutral: Vertices of the subject's neutral head in metres; None if any subject's will do.

    Raises:
        InputError: If it is the path of another head, or moves vertices too far.
    """
    if path.neutral.shape != model.v_template.shape:
        problem = f"{len(path.neutral)} vertices, the head has {len(model.v_template)}: was it made for another head?"
        raise InputError(problem, file=file, field=f"{prefix}neutral")
    if neutral is not None:
        apart = float(np.abs(path.neutral - neutral).max(initial=0))
        if apart > NEUTRAL_TOLERANCE * diagonal(neutral):
            problem = (
                f"differs from the subject's neutral head by up to {apart:.3g} m: was it made for another subject?"
            )
            raise InputError(problem, file=file, field=f"{prefix}neutral")
    if not np.array_equal(path.faces, model.faces):
        raise InputError("not the faces of the head: was it made for another one?", file=file, field=f"{prefix}faces")
    for name, values in (("displacements", path.displacements), ("changes", path.changes)):
        if values is not None and values.size and max(-values.min(), values.max()) > LARGEST_COORDINATE:
            problem = f"moves a vertex by more than {LARGEST_COORDINATE:g} m"
            raise InputError(problem, file=file, field=f"{prefix}{name}")
    blendshapes = model.num_expressions + model.posedirs.shape[2]
    if path.columns is not None and path.columns.size and path.columns.max() >= blendshapes:
        raise InputError(f"indices must lie in 0..{blendshapes - 1}", file=file, field=f"{prefix}columns")
