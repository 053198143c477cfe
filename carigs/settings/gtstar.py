"""Settings of the GT* frames."""

from __future__ import annotations

from dataclasses import dataclass

from carigs.settings.option import Section, option, set_by
from carigs.settings.regions import Regions


@dataclass
class Gtstar(Section, key="gtstar"):
    """GT* frames: every training frame warped to its caricature, and the mask flags of its pixels."""

    provider: str = option("lat", choices=("lat", "identity", "precomputed", "command", "exemplar"))
    """Source of the GT* images. `lat`: frames warped by local affine (or perspective) transforms. `identity`: the
    frames themselves. `precomputed`: edited frames from `folder`. `command`: the program `command` edits the frames.
    `exemplar`: a diffusion model paints them in the style of an image."""
    folder: str | None = option(None, required_when=("provider", ("precomputed",)), is_path=True)
    """Edited frames `{timestep:05d}_{camera:02d}.png` and, if their mattes differ, `..._mask.png`."""
    command: tuple[str, ...] = option((), required_when=("provider", ("command",)), is_program=True)
    """A program and its arguments, such as `[python,stylize.py]`. It is called without a shell, with one more argument:
    a folder that holds the frames and receives the edited ones (docs/tutorials/stylizers.md)."""
    command_timeout: float = option(3600.0, unit="seconds", gt=0, le=1e7)
    """Time without a new edited frame after which the program is ended."""
    exemplar: str | None = option(None, required_when=("provider", ("exemplar",)), is_path=True)
    """An image, such as a drawn caricature, in whose style frames are painted."""
    exemplar_strength: float = option(0.5, gt=0, le=1)
    """How far frames are repainted: share of the noise schedule that is added to them and removed again."""
    registration_error_limit: float = option(1.5, unit="pixels", ge=0, le=1e9)
    """Frames are refused whose colours are shifted by more than this against those of the other cameras on the same
    mesh. Up to a third of it a frame has full weight, which then falls linearly to 0."""
    warp: str = option("perspective", choices=("perspective", "affine"))
    """Map of each triangle. `perspective`: the exact homography. `affine`: the paper's equation 5."""
    supersampling: int = option(4, ge=1, le=8)
    """Samples per pixel along each axis for the coverage of pixels on the outline of the mesh."""
    relight: str = option("targets_and_surfels", choices=("targets_and_surfels", "targets", "none"))
    """Shading of the caricature. `none`: GT* frames keep the light of the natural surface (the paper). `targets`: GT*
    frames are shaded for the caricature. `targets_and_surfels`: surfels too, whenever they are rendered."""
    hair_extinction: float = option(30.0, unit="1/metre", ge=0, le=1000)
    """Optical thickness of a metre of opaque hair, which shades the skin; 0: it casts no shadow."""
    regions: Regions = set_by("regions", Regions)
    """Regions of the head model."""
