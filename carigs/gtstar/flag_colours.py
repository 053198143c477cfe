"""Colours of the mask flags in figures and in the viewer."""

from __future__ import annotations

from colorsys import hsv_to_rgb

from carigs.settings import MaskFlag

_CHOSEN = {
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
FLAG_COLOURS = _CHOSEN | {f: hsv_to_rgb(0.618 * f.bit_length() % 1, 0.6, 0.8) for f in MaskFlag if f not in _CHOSEN}
"""RGB in [0, 1] of every flag. Those that nobody chose follow from their bit: hues a golden ratio apart."""
