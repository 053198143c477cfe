"""The warp of a frame to the caricature: an inverse warp with one map per triangle and bilinear interpolation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Float64, UInt16

from carigs.errors import SettingsError
from carigs.gtstar import triangle_maps, warp_kernels
from carigs.raster import Visibility
from carigs.settings import Gtstar

GRAZING_COSINE = 0.1
"""A triangle is `grazing` if the cosine between view and normal is below this in the frame and more than 1.25 times as
large in the caricature."""
MAX_STRETCH = 6.0
"""Ratio of a triangle's projected areas, caricature to frame, above which it is `stretched`."""
DEPTH_TOLERANCE = 0.003
"""Largest difference in depth between a surface point and the pixel that it is sampled from, in metres."""


class Warp(NamedTuple):
    """A frame warped to the caricature."""

    colour: Float32[np.ndarray, "h w 3"]
    """Warped colours where the caricature's mesh is visible and the frame shows that point, background elsewhere."""
    mask_flags: UInt16[np.ndarray, "h w"]
    """Bits of `MaskFlag`; 0 off the mesh."""


def warp_frame(
    image: Float32[np.ndarray, "h w 3"],
    natural: Visibility,
    caricature: Visibility,
    face_flags: UInt16[np.ndarray, " f"],
    frame_flags: UInt16[np.ndarray, "h w"],
    settings: Gtstar,
    background: float = 1.0,
) -> Warp:
    """Warp a frame to the caricature by local affine (paper, equation 5) or perspective transformations.

    Every target pixel on the caricature's mesh is mapped to the frame by the map of its triangle (bilinear inverse
    warp). `affine` maps are exact for triangles that are small against their distance, `perspective` maps preserve the
    3D point. Frame pixels that show another surface, or none, get no weight in the interpolation.

    A frame pixel on the outline of which the mesh covers the share a shows c = a s + (1 - a) b, with the surface s
    in front of the background b. The samples are freed of b, and the target is composited with its own share.

    Args:
        image: sRGB colours of the frame.
        natural: What the frame's camera sees of the tracked mesh.
        caricature: What the target's camera sees of the caricature, possibly at another resolution.
        face_flags: Flags of every triangle.
        frame_flags: Flags of every pixel of the frame; a target pixel inherits those of the pixel it comes from.
        settings: Settings of the stage.
        background: Grey value that the image was composited on.

    Returns:
        Colours and mask flags.
    """
    maps = source_maps(natural, caricature, settings.warp)
    flags = triangle_maps.flag_triangles(
        face_flags, natural.camera_points, caricature.camera_points, natural.pixels, caricature.pixels, natural.faces,
        natural.back_facing, caricature.back_facing, GRAZING_COSINE,
        MAX_STRETCH * (caricature.camera.fx / natural.camera.fx) ** 2,
    )  # fmt: skip
    before, after = (seen.coverage(settings.supersampling) for seen in (natural, caricature))
    return Warp(
        *warp_kernels.warp(
            caricature.face, after, maps, flags, natural.inverse_depth, before, natural.depth_planes,
            np.ascontiguousarray(image), frame_flags, DEPTH_TOLERANCE, background,
        )
    )  # fmt: skip


def source_maps(natural: Visibility, caricature: Visibility, kind: str) -> Float64[np.ndarray, "f 3 3"]:
    """Map of every triangle from target pixels to frame pixels.

    Args:
        natural: What the frame's camera sees of the tracked mesh.
        caricature: What the target's camera sees of the caricature.
        kind: `affine` (paper, equation 5) or `perspective`.

    Returns:
        Maps of homogeneous pixel coordinates.

    Raises:
        SettingsError: For an unknown kind.
    """
    if kind == "affine":
        return triangle_maps.affine_maps(natural.pixels, caricature.pixels, natural.faces)
    if kind == "perspective":
        intrinsics = natural.camera.intrinsics, caricature.camera.intrinsics
        return triangle_maps.perspective_maps(
            natural.camera_points, caricature.camera_points, natural.faces, *intrinsics
        )
    raise SettingsError(f"gtstar.warp={kind} is unknown; choose affine or perspective")
