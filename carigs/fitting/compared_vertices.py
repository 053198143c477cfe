"""Which vertices of a head are compared with the images."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int

from carigs.head import HeadModel

SKIN = ("face", "nose", "lips", "left_ear", "right_ear")
"""Regions that are compared with the images. The scalp is under hair, the neck may be masked."""
SPACING = 0.006
"""Metres between compared vertices."""


def compared_vertices(model: HeadModel) -> Int[np.ndarray, " n"]:
    """Vertices that are compared with the images: of the skin, one per cell of a grid.

    Args:
        model: The head model.

    Returns:
        Indices in ascending order. All vertices are candidates if the model has none of the regions `SKIN`.
    """
    skin = model.vertex_region(*SKIN)
    candidates = np.flatnonzero(skin if skin.any() else np.ones(len(skin), bool))
    cells = np.floor(model.v_template[candidates] / SPACING).astype(int)
    return np.sort(candidates[np.unique(cells, axis=0, return_index=True)[1]])
