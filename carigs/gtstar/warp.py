"""The local warp: every pixel of the caricature fetches its colour from the real frame."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Float64, UInt16

from carigs.capture import Camera
from carigs.errors import SettingsError
from carigs.gtstar import triangle_maps as maps
from carigs.gtstar import warp_kernels as trace
from carigs.raster import Visibility
from carigs.settings import Gtstar


class Warp(NamedTuple):
    """A frame warped onto the caricature, and what speaks against its pixels."""

    colour: Float32[np.ndarray, "h w 3"]
    """Warped colours on the caricature mesh where the frame shows that point, background elsewhere."""
    reasons: UInt16[np.ndarray, "h w"]
    """Bits of `Reason`; 0 off the mesh, of which the warp knows nothing."""


def warp_frame(
    image: Float32[np.ndarray, "h w 3"],
    natural: Visibility,
    caricature: Visibility,
    of_faces: UInt16[np.ndarray, "f"],
    of_frame: UInt16[np.ndarray, "h w"],
    settings: Gtstar,
    background: float = 1.0,
) -> Warp:
    """Warp a frame by the maps between the two projected meshes.

    `natural` is what the frame's camera sees of the tracked mesh, `caricature` of the exaggerated one (possibly at
    another resolution).  `affine` is the paper's equation 5: exact where a triangle is small against its distance;
    `perspective` keeps the 3D point.  Pixels of the frame that show another surface, or none, are not sampled: the
    others share their weight.  `of_faces` and `of_frame` are reasons that each triangle and each pixel of the frame
    bring along.

    A frame's pixel on the outline, of which the mesh covers the share a, shows c = a s + (1 - a) b: surface s before
    background b.  The target gets its own share of s, so that outlines are neither blended twice nor not at all.
    """
    source = source_maps(natural, caricature, settings.warp)
    reasons, samples = maps.flag_triangles(
        of_faces, natural.points, caricature.points, natural.pixel, caricature.pixel, natural.faces, natural.back,
        caricature.back, settings.grazing_cosine,
        settings.max_stretch * (caricature.camera.fx / natural.camera.fx) ** 2,
    )  # fmt: skip
    if not settings.antialias:
        samples[:] = 1
    before, after = (seen.coverage(settings.supersampling) for seen in (natural, caricature))
    return Warp(
        *trace.warp(
            caricature.face, after, source, reasons, samples, natural.nearness, before, natural.slope,
            np.ascontiguousarray(image), of_frame, settings.depth_tolerance, background,
        )
    )  # fmt: skip


def source_pixels(natural: Visibility, caricature: Visibility, kind: str) -> Float32[np.ndarray, "h w 2"]:
    """Where in the frame each mesh pixel comes from (x, y; pixel centres at +0.5); nan off the mesh."""
    return trace.source_pixels(caricature.face, source_maps(natural, caricature, kind))


def source_maps(natural: Visibility, caricature: Visibility, kind: str) -> Float64[np.ndarray, "f 3 3"]:
    """Per face the map of homogeneous caricature pixels to those of the frame; `kind`: `affine` or `perspective`."""
    if kind == "affine":
        return maps.affine_maps(natural.pixel, caricature.pixel, natural.faces)
    if kind == "perspective":
        lenses = [_lens(seen.camera) for seen in (natural, caricature)]
        return maps.perspective_maps(natural.points, caricature.points, natural.faces, *lenses)
    raise SettingsError(f"gtstar.warp={kind} is unknown; choose affine or perspective")


def _lens(camera: Camera) -> tuple[float, float, float, float]:
    return float(camera.fx), float(camera.fy), float(camera.cx), float(camera.cy)
