"""Contact sheet of GT* targets: frame, target, mask flags in colour, and the true caricature where it is known."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, UInt16
from matplotlib.colors import hsv_to_rgb

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
# Flags without a colour above get one from their bit: hues a golden ratio apart.
COLOURS |= {f: hsv_to_rgb((0.618 * f.bit_length() % 1, 0.6, 0.8)) for f in MaskFlag if f not in COLOURS}


class TargetRow(NamedTuple):
    """One row of the sheet: a frame and its target."""

    name: str
    frame: Float32[np.ndarray, "h w 3"]
    target: Float32[np.ndarray, "h w 3"]
    mask_flags: UInt16[np.ndarray, "h w"]
    truth: Float32[np.ndarray, "h w 3"] | None


def target_sheet(file: Path, rows: Sequence[TargetRow], excluded: MaskFlag, *, height: int = 300) -> None:
    """Draw the sheet; pixels of `excluded` flags are solid, those of other flags tinted.

    Args:
        file: PNG file to write.
        rows: Frames with their targets.
        excluded: Flags whose pixels the training leaves out.
        height: Height of each image in pixels.
    """
    images = [
        [row.frame, row.target, flag_overlay(row.target, row.mask_flags, excluded), row.truth,
         error_map(row.target, row.truth)] for row in rows
    ]  # fmt: skip
    legend = {flag.name.lower().replace("_", " "): colour for flag, colour in COLOURS.items()}
    write_sheet(
        file, images, rows=[row.name for row in rows], columns=["frame", "target", "mask flags", "truth", "error"],
        title=f"Targets (error: black 0 to yellow {ERROR_SCALE:g})", height=height, legend=legend,
    )  # fmt: skip


def flag_overlay(
    target: Float32[np.ndarray, "h w 3"], mask_flags: UInt16[np.ndarray, "h w"], excluded: MaskFlag
) -> Float[np.ndarray, "h w 3"]:
    """Blend a target with the mean colour of each pixel's flags: solid where one excludes it, otherwise tinted.

    Args:
        target: Target image.
        mask_flags: Mask flags of the pixels.
        excluded: Flags whose pixels the training leaves out.

    Returns:
        The image.
    """
    total, count = np.zeros(target.shape), np.zeros((*mask_flags.shape, 1))
    masked = (mask_flags & np.uint16(excluded.value)) > 0
    for flag, colour in COLOURS.items():
        holds = (mask_flags & np.uint16(flag.value)) > 0
        if flag not in excluded:
            holds &= ~masked
        total[holds] += colour
        count[holds] += 1
    cover = np.where(masked[..., None], 0.85, 0.35) * (count > 0)
    return target * (1 - cover) + cover * total / np.maximum(count, 1)
