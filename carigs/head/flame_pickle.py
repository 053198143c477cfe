"""FLAME's .pkl files and the regions beside them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from carigs.readers.pickles import read_pickle


def read_flame_pickle(file: Path) -> dict[str, Any]:
    """Read a FLAME pickle, and the regions in `FLAME_masks.pkl` beside it.

    Args:
        file: The .pkl file.

    Returns:
        The arrays by FLAME's names; regions are vertex indices under `mask_<region>`.

    Raises:
        InputError: If either file is not such a pickle.
    """
    arrays = read_pickle(file, "head model")
    masks = file.with_name("FLAME_masks.pkl")
    if masks.is_file() and masks != file:
        arrays |= {f"mask_{name}": np.asarray(ids) for name, ids in read_pickle(masks, "file of regions").items()}
    return arrays
