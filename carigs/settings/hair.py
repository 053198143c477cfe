"""Settings of the search for hair."""

from __future__ import annotations

from dataclasses import dataclass

from carigs.settings.option import Section, option, set_by
from carigs.settings.regions import Regions


@dataclass
class Hair(Section, key="hair"):
    """What covers the head in the frames: the triangles under hair, and the space that hair fills."""

    regions: Regions = set_by("regions", Regions)
    """Regions of the head model."""
    labels: str | None = option(None, is_path=True)
    """Folder of semantic labels, as a face parser writes them: per frame a grey PNG `{timestep:05d}_{camera:02d}.png`
    with the class of each pixel. Triangles that most labels call covered are covered, also brows and lids. Some frames
    may be missing."""
    label_classes: tuple[int, ...] = option((6, 9, 15, 16, 17, 18), ge=0, le=255)
    """Values of the classes that cover the head. By default those of glasses, earrings, necklaces, cloth, hair and hats
    in the order of face parsers with BiSeNet (hair is 17); in that of CelebAMask-HQ's list (hair is 13) they are
    `[3,13,14,15,16,18]`."""
