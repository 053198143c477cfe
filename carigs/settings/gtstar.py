"""Settings of the GT* frames."""

from __future__ import annotations

from dataclasses import dataclass

from carigs.settings.option import Section, option


@dataclass
class Gtstar(Section, key="gtstar"):
    """GT* frames: every training frame warped to its caricature, and the mask flags of its pixels."""

    threads: int = option(2, "Timesteps processed in parallel; the result does not depend on it.", ge=1)
    provider: str = option(
        "lat",
        "Source of the GT* images. `lat`: frames warped by local affine (or perspective) transforms. `identity`:"
        " the frames themselves. `precomputed`: edited frames from `folder`.",
        choices=("lat", "identity", "precomputed"),
    )
    folder: str | None = option(
        None,
        "Edited frames `{timestep:05d}_{camera:02d}.png` and, if their mattes differ, `..._mask.png`.",
        required_when=("provider", "precomputed"),
    )
    registration_error_limit: float = option(
        1.5,
        "Frames are refused whose colours are shifted by more than this against those of the other cameras on the same"
        " mesh.",
        "pixels",
        ge=0,
    )
    registration_error_tolerance: float = option(
        0.5,
        "Shift up to which a frame has full weight; above it the weight falls linearly to 0 at"
        " `registration_error_limit`.",
        "pixels",
        ge=0,
    )
    warp: str = option(
        "perspective",
        "Map of each triangle. `perspective`: the exact homography. `affine`: the paper's equation 5.",
        choices=("perspective", "affine"),
    )
    antialias: bool = option(False, "Average over the footprint of a pixel in the frame where triangles shrink.")
    supersampling: int = option(
        4, "Samples per pixel along each axis for the coverage of pixels on the outline of the mesh.", ge=1, le=8
    )
    depth_tolerance: float = option(
        0.003,
        "Largest depth difference between a surface point and the pixel it is sampled from.",
        "metres",
        ge=0,
        le=1,
    )
    grazing_cosine: float = option(
        0.1,
        "Smallest cosine between view and normal in the frame; below it a pixel is `grazing`, unless the caricature is"
        " seen equally obliquely.",
        ge=0,
        le=1,
    )
    max_stretch: float = option(
        6.0, "Ratio of a triangle's projected areas, caricature to frame, above which it is `stretched`.", ge=1
    )
    relight: str = option(
        "targets_and_surfels",
        "Shading of the caricature. `none`: GT* frames keep the light of the natural surface (the paper). `targets`:"
        " GT* frames are shaded for the caricature. `targets_and_surfels`: surfels too, whenever they are rendered.",
        choices=("targets_and_surfels", "targets", "none"),
    )
    relight_strength: float = option(0.85, "Exponent of the ratio of new to old irradiance.", ge=0, le=1)
    relight_limit: float = option(2.0, "Largest factor on linear colours; the smallest is its inverse.", ge=1, le=100)
    hair_dilation: int = option(2, "Dilation of the hair mask.", "pixels", ge=0)
    background_margin: int = option(
        1, "Margin around mesh and foreground in which background does not count as known.", "pixels", ge=0
    )
    hair_regions: tuple[str, ...] = option(
        ("scalp",), "Regions of the head model with hair; names that the model lacks are ignored, here and below."
    )
    mouth_regions: tuple[str, ...] = option(
        ("lip_inside",), "Regions inside the mouth; everything seen between the lips is added."
    )
    lid_regions: tuple[str, ...] = option(("left_eyelid", "right_eyelid"), "Regions of the flag `lids`.")
    brow_regions: tuple[str, ...] = option(("brows",), "Regions of the flag `brows`.")
    ear_regions: tuple[str, ...] = option(("left_ear", "right_ear"), "Regions of the flag `ears`.")
    eyeball_regions: tuple[str, ...] = option(("left_eyeball", "right_eyeball"), "Regions of the flag `eyeballs`.")
