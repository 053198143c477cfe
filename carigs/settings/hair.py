"""Settings of the search for hair."""

from __future__ import annotations

from dataclasses import dataclass

from carigs.settings.option import Section, option


@dataclass
class Hair(Section, key="hair"):
    """What covers the head in the frames: the triangles under hair, and the space that hair fills."""

    threads: int = option(2, ge=1, le=1024)
    """Timesteps read in parallel; the result does not depend on it."""
    regions: tuple[str, ...] = ("scalp",)
    """Regions of the head model that carry hair; names that the model lacks are ignored, here and below."""
    eyeball_regions: tuple[str, ...] = ("left_eyeball", "right_eyeball")
    """Regions that are never covered, because they shine."""
    mouth_regions: tuple[str, ...] = ("lip_inside",)
    """Regions inside the mouth, which are not looked at."""
    texture_limit: float = option(0.03, ge=0, le=1)
    """Contrast of what moves against a triangle, in sRGB values without the noise of the images, above which the
    triangle is covered."""
