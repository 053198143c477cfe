"""Settings of the regions of a head model that several stages treat alike."""

from __future__ import annotations

from dataclasses import dataclass

from carigs.settings.option import Section


@dataclass
class Regions(Section, key="regions"):
    """Regions of the head model by what they show; names that the model lacks are ignored."""

    hair: tuple[str, ...] = ("scalp",)
    """Regions that carry hair: of the search for it, of the flag `hair`, and of the surfels inside it."""
    mouth: tuple[str, ...] = ("lip_inside",)
    """Regions inside the mouth, of the flag `mouth`, to which everything between the lips is added. Hair is not looked
    for there."""
    eyeballs: tuple[str, ...] = ("left_eyeball", "right_eyeball")
    """Regions of the flag `eyeballs`. They shine, so nothing is taken for hair that covers them."""
    lids: tuple[str, ...] = ("left_eyelid", "right_eyelid")
    """Regions of the flag `lids`."""
    ears: tuple[str, ...] = ("left_ear", "right_ear")
    """Regions of the flag `ears`."""
