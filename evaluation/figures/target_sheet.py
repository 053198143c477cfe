"""The contact sheet of a subject's targets: frame, target, reasons in colour, and the truth where it is known."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, UInt16

from carigs.gtstar import MaskFlag
from evaluation.figures.sheet import write_sheet
from evaluation.figures.strips import ERROR_SCALE, error_map

COLOURS = {
    MaskFlag.NEWLY_VISIBLE: (0.90, 0.10, 0.10),
    MaskFlag.OCCLUDED: (1.00, 0.50, 0.05),
    MaskFlag.GRAZING: (1.00, 0.85, 0.10),
    MaskFlag.STRETCHED: (0.75, 0.75, 0.20),
    MaskFlag.OUTSIDE_IMAGE: (0.20, 0.20, 0.20),
    MaskFlag.OUTSIDE_MESH: (0.55, 0.55, 0.55),
    MaskFlag.HAIR: (0.20, 0.40, 0.90),
    MaskFlag.MOUTH: (0.85, 0.20, 0.60),
    MaskFlag.LIDS: (0.10, 0.75, 0.75),
    MaskFlag.BROWS: (0.50, 0.25, 0.75),
    MaskFlag.EARS: (0.20, 0.65, 0.30),
    MaskFlag.EYEBALLS: (0.00, 0.90, 0.95),
}


class Shown(NamedTuple):
    """One row of the sheet."""

    name: str
    frame: Float32[np.ndarray, "h w 3"]
    target: Float32[np.ndarray, "h w 3"]
    reasons: UInt16[np.ndarray, "h w"]
    truth: Float32[np.ndarray, "h w 3"] | None


def target_sheet(file: Path, rows: Sequence[Shown], excluded: MaskFlag, *, height: int = 300) -> None:
    """Write a PNG: pixels that the `excluded` reasons leave out are solid, those of other reasons tinted."""
    images = [
        [r.frame, r.target, coloured(r.target, r.reasons, excluded), r.truth, error_map(r.target, r.truth)]
        for r in rows
    ]
    legend = {reason.name.lower().replace("_", " "): colour for reason, colour in COLOURS.items()}
    write_sheet(
        file, images, rows=[row.name for row in rows], columns=["frame", "target", "reasons", "truth", "error"],
        title=f"Targets (error: black 0 to yellow {ERROR_SCALE:g})", height=height, legend=legend,
    )  # fmt: skip


def coloured(
    target: Float32[np.ndarray, "h w 3"], reasons: UInt16[np.ndarray, "h w"], excluded: MaskFlag
) -> Float[np.ndarray, "h w 3"]:
    """The target under the mean colour of each pixel's reasons: solid where one excludes it, else a tint."""
    total, count = np.zeros(target.shape), np.zeros((*reasons.shape, 1))
    out = (reasons & np.uint16(excluded.value)) > 0
    for reason, colour in COLOURS.items():
        holds = (reasons & np.uint16(reason.value)) > 0
        if reason not in excluded:
            holds &= ~out
        total[holds] += colour
        count[holds] += 1
    cover = np.where(out[..., None], 0.85, 0.35) * (count > 0)
    return target * (1 - cover) + cover * total / np.maximum(count, 1)
