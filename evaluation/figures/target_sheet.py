"""Contact sheet of GT* targets: frame, target and mask flags in colour; of the toy also the truth and the error."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32, UInt16

from carigs.capture import Capture
from carigs.capture.evenly_spread import evenly_spread
from carigs.capture.images import read_bits, read_rgb
from carigs.capture.target_index import TargetFrame
from carigs.exaggeration import Caricature
from carigs.gtstar import MaskFlag, flags_from_names
from carigs.gtstar.flag_colours import FLAG_COLOURS
from carigs.settings import DEFAULT_MASK_FLAGS
from evaluation.figures.sheet import write_sheet
from evaluation.figures.strips import ERROR_SCALE, error_map

HEIGHT = 300
"""Height of each image in pixels."""
ROWS = 5
"""Most targets that are shown, evenly spread over the training frames."""


def draw_target_sheet(file: Path, subject: Capture, targets: Sequence[TargetFrame], exaggerated: Caricature) -> None:
    """Draw some of the targets; for the toy, beside renderings of its true caricature.

    Pixels of the default flags are solid, those of other flags tinted.

    Args:
        file: PNG file to write.
        subject: The capture.
        targets: The targets.
        exaggerated: The caricature of the head.
    """
    shown = evenly_spread(list(targets), ROWS)
    if is_toy := (subject.root / "subject.npz").is_file():
        from carigs.toy import load_subject, render_subject

        toy = load_subject(subject.root)
    excluded, images = flags_from_names(DEFAULT_MASK_FLAGS), []
    for frame, _, image, flags, _ in shown:
        target, mask_flags = read_rgb(image), read_bits(flags)
        images.append([subject.image(frame), target, flag_overlay(target, mask_flags, excluded)])
        if is_toy:
            parameters, camera = subject.parameters(frame.timestep), subject.camera(frame)
            truth, _ = render_subject(toy, parameters, camera, exaggerated)
            images[-1] += [truth, error_map(target, truth)]
    columns, title = ["frame", "target", "mask flags"], "Targets"
    if is_toy:
        columns, title = [*columns, "truth", "error"], f"Targets (error: black 0 to yellow {ERROR_SCALE:g})"
    legend = {flag.name.lower().replace("_", " "): colour for flag, colour in FLAG_COLOURS.items()}
    write_sheet(
        file, images, rows=[target.frame.name for target in shown], height=HEIGHT, legend=legend,
        columns=columns, title=title,
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
    for flag, colour in FLAG_COLOURS.items():
        holds = (mask_flags & np.uint16(flag.value)) > 0
        if flag not in excluded:
            holds &= ~masked
        total[holds] += colour
        count[holds] += 1
    cover = np.where(masked[..., None], 0.85, 0.35) * (count > 0)
    return target * (1 - cover) + cover * total / np.maximum(count, 1)
