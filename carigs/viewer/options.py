"""What a client looks at and how."""

from __future__ import annotations

from dataclasses import dataclass

from carigs.errors import SettingsError
from carigs.viewer.drives import CAPTURED

MODES = ("splats", "exact")
OVERLAYS = ("none", "mesh", "curvature", "mask flags", "error")
SPLITS = ("off", "natural head", "stored values", "second avatar", "captured image")


@dataclass(frozen=True)
class Options:
    """What a client looks at and how; not part of undo."""

    mode: str = "splats"
    overlay: str = "none"
    split: str = "off"
    divider: float = 0.5
    """Column of the divider over the width of the image."""
    camera: int | None = None
    """Camera of the capture that the client looks through."""
    playing: bool = False
    speed: float = 1.0
    motion: str = CAPTURED
    """Name of the motion that is shown."""

    def __post_init__(self) -> None:
        for name, known in (("mode", MODES), ("overlay", OVERLAYS), ("split", SPLITS)):
            if getattr(self, name) not in known:
                raise SettingsError(f"{name}: one of {', '.join(known)}")
        for name, low, high in (("divider", 0.0, 1.0), ("speed", 0.05, 8.0)):
            value = getattr(self, name)
            if not isinstance(value, int | float) or not low <= value <= high:
                raise SettingsError(f"{name}: expected a number from {low:g} to {high:g}")

    @property
    def is_exact(self) -> bool:
        """Whether the server renders: the browser can neither split the view nor compare it with an image."""
        return self.mode == "exact" or self.split != "off" or self.overlay == "error"
