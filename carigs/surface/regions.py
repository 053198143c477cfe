"""Regions of a surface: from vertices to faces."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Int


def face_region(faces: Int[np.ndarray, "f 3"], vertex_ids: Int[np.ndarray, " n"], v: int) -> Bool[np.ndarray, " f"]:
    """Whether all three corners of each face are among `vertex_ids`; `v` is the number of vertices of the mesh."""
    inside = np.zeros(v, bool)
    inside[vertex_ids] = True
    return inside[faces].all(axis=1)
