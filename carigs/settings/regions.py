"""Settings of the regions of a head model that several stages treat alike."""

from __future__ import annotations

from dataclasses import dataclass

from carigs.settings.option import Section


@dataclass
class Regions(Section, key="regions"):
    """Regions of the head model by what they show; names that the model lacks are ignored."""

    hair: tuple[str, ...] = ("scalp",)
    """Regions that carry hair: of the search for it, of the flag `hair`, and of the surfels inside it."""
