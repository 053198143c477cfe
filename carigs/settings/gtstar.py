"""Settings of the GT* frames."""

from __future__ import annotations

from dataclasses import dataclass

from carigs.settings.option import Section, option


@dataclass
class Gtstar(Section, key="gtstar"):
    """GT* frames: every training frame warped to its caricature, and the mask flags of its pixels."""

    threads: int = option(2, ge=1, le=1024, affects_results=False)
    """Timesteps processed in parallel; the result does not depend on it."""
    provider: str = option("lat", choices=("lat", "identity", "precomputed"))
    """Source of the GT* images. `lat`: frames warped by local affine (or perspective) transforms. `identity`: the
    frames themselves. `precomputed`: edited frames from `folder`."""
    folder: str | None = option(None, required_when=("provider", "precomputed"), is_path=True)
    """Edited frames `{timestep:05d}_{camera:02d}.png` and, if their mattes differ, `..._mask.png`."""
    registration_error_limit: float = option(1.5, unit="pixels", ge=0, le=1e9)
    """Frames are refused whose colours are shifted by more than this against those of the other cameras on the same
    mesh."""
    registration_error_tolerance: float = option(0.5, unit="pixels", ge=0, le=1e9)
    """Shift up to which a frame has full weight; above it falls linearly to 0 at `registration_error_limit`."""
    warp: str = option("perspective", choices=("perspective", "affine"))
    """Map of each triangle. `perspective`: the exact homography. `affine`: the paper's equation 5."""
    antialias: bool = False
    """Average over the footprint of a pixel in the frame where triangles shrink."""
    supersampling: int = option(4, ge=1, le=8)
    """Samples per pixel along each axis for the coverage of pixels on the outline of the mesh."""
    depth_tolerance: float = option(0.003, unit="metres", ge=0, le=1)
    """Largest depth difference between a surface point and the pixel it is sampled from."""
    grazing_cosine: float = option(0.1, ge=0, le=1)
    """A triangle is `grazing` if the cosine between view and normal is below this in the frame and more than 1.25 times
    as large in the caricature."""
    max_stretch: float = option(6.0, ge=1, le=1e9)
    """Ratio of a triangle's projected areas, caricature to frame, above which it is `stretched`."""
    relight: str = option("targets_and_surfels", choices=("targets_and_surfels", "targets", "none"))
    """Shading of the caricature. `none`: GT* frames keep the light of the natural surface (the paper). `targets`: GT*
    frames are shaded for the caricature. `targets_and_surfels`: surfels too, whenever they are rendered."""
    relight_strength: float = option(0.85, ge=0, le=1)
    """Exponent of the ratio of new to old irradiance."""
    relight_limit: float = option(2.0, ge=1, le=100)
    """Largest factor on linear colours; the smallest is its inverse."""
    hair_extinction: float = option(30.0, unit="1/metre", ge=0, le=1000)
    """Optical thickness of a metre of opaque hair, which shades the skin; 0: it casts no shadow."""
    hair_dilation: int = option(2, unit="pixels", ge=0, le=1000)
    """Dilation of the hair mask."""
    background_margin: int = option(1, unit="pixels", ge=0, le=1000)
    """Margin around mesh and foreground in which background does not count as known."""
    hair_regions: tuple[str, ...] = ("scalp",)
    """Regions of the flag `hair`: `hair.regions`, unless set here. Names that the model lacks are ignored, here and
    below."""
    mouth_regions: tuple[str, ...] = ("lip_inside",)
    """Regions inside the mouth; everything seen between the lips is added."""
    lid_regions: tuple[str, ...] = ("left_eyelid", "right_eyelid")
    """Regions of the flag `lids`."""
    ear_regions: tuple[str, ...] = ("left_ear", "right_ear")
    """Regions of the flag `ears`."""
    eyeball_regions: tuple[str, ...] = ("left_eyeball", "right_eyeball")
    """Regions of the flag `eyeballs`."""
