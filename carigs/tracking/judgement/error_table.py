"""Median and large errors of the regions of a face, as text."""

from __future__ import annotations

import numpy as np

from carigs.tracking.judgement.quality import TrackedFrames

PERCENTILE = 90
"""Of the column of large errors."""


def error_table(frames: TrackedFrames) -> str:
    """Errors of the landmarks, one line for each region and one for all.

    Args:
        frames: The frames of one camera.

    Returns:
        Lines of aligned columns; a region without landmarks has dashes.
    """
    rows = [("region", "median", f"{PERCENTILE} % below", "worst frame")]
    for region, errors in {**frames.errors, "all": frames.error}.items():
        if np.isfinite(errors).any():
            values = (np.nanmedian(errors), np.nanpercentile(errors, PERCENTILE))
            rows.append((region, *(f"{v:.2f} px" for v in values), str(frames.numbers[np.nanargmax(errors)])))
        else:
            rows.append((region, "-", "-", "-"))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = [
        [row[0].ljust(widths[0]), *(cell.rjust(w) for cell, w in zip(row[1:], widths[1:], strict=True))] for row in rows
    ]
    return "\n".join("  ".join(line) for line in lines)
