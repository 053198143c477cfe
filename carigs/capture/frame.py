"""A frame: one image of a capture."""

from __future__ import annotations

from dataclasses import dataclass

from carigs.capture.corrections.colour_gains import Gains
from carigs.capture.corrections.halo import Halo


@dataclass(frozen=True, slots=True)
class Frame:
    """One image of one camera at one timestep. File names are relative to the capture's root."""

    timestep: int
    camera: int
    """Number of the camera in the dataset."""
    sequence: str
    split: str
    """`train`, `val` (held-out view of the training timesteps) or `test` (held-out sequence)."""
    image: str
    mask: str | None
    """The matte: a grey image, the image itself if the matte is its alpha channel, or None if there is no matte."""
    parameters: str
    calibration: int
    """Position in `Capture.calibrations`."""
    gains: Gains | None = None
    """Factors on the light of the image (`carigs.capture.corrections`); None to leave it as it is stored."""
    halo: Halo | None = None
    """The old background at the outline of the image, which is removed; None if there is none."""
    remade: bool = False
    """Whether the matte is made anew near its outline."""

    @property
    def name(self) -> str:
        """`{timestep:05d}_{camera:02d}`, the stem of the names of all files derived from this frame."""
        return f"{self.timestep:05d}_{self.camera:02d}"
