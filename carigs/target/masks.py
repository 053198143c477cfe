"""Which pixels of a target can be trusted, and which triangles must not learn from it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32

from carigs.head import HeadModel
from carigs.settings import Gtstar
from carigs.target.warp import Warp

INNER_LIPS = slice(60, 68)


@dataclass(frozen=True)
class Validity:
    """Pixels that may supervise, and the reasons against the others (which may overlap)."""

    valid: Bool[np.ndarray, "h w"]
    invisible: Bool[np.ndarray, "h w"]
    """On the mesh, but the frame does not see that point: hidden, turned away, or outside the image."""
    hair: Bool[np.ndarray, "h w"]
    """Hair on the scalp's triangles, or in the band around hair that sticks out of the mesh."""
    region: Bool[np.ndarray, "h w"]
    """In a region that is masked by name, or between the lips, where teeth do not follow the mesh."""
    outside: Bool[np.ndarray, "h w"]
    """Off the caricature mesh and not known to be background."""


def frozen_faces(model: HeadModel, settings: Gtstar) -> Bool[np.ndarray, "f"]:
    """Triangles that targets never supervise: their surfels are frozen in GT* steps."""
    names = (*(settings.hair_regions if settings.hair else ()), *settings.regions)
    return model.face_region(*names)


def validity(warp: Warp, foreground: Float32[np.ndarray, "h w"], model: HeadModel, settings: Gtstar) -> Validity:
    """Judge each pixel of a warped frame; `foreground` is the frame's matte.

    Source pixels are looked up at the nearest pixel centre.  Off the caricature mesh, by `background_ring` pixels, is
    background where the frame shows background, and also where it shows skin: that has moved away.  Only hair, and
    whatever else sticks out of the mesh, may be anywhere within its own length of where it is or of the scalp.
    """
    in_frame = warp.natural.face >= 0
    on_mesh = warp.caricature.face >= 0
    height, width = on_mesh.shape
    x, y = np.where(on_mesh[..., None], warp.source_pixel, 0).transpose(2, 0, 1)
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    source = (np.clip(y, 0, height - 1).astype(np.intp), np.clip(x, 0, width - 1).astype(np.intp))

    invisible = np.zeros_like(on_mesh)
    if settings.invisible:
        seen = warp.source_depth <= warp.natural.depth[source] + settings.depth_tolerance
        invisible = on_mesh & ~(inside & seen & in_frame[source])

    # In the frame: the scalp as it is seen, and what sticks out of the mesh by more than the outline's own blur.
    hair_faces = model.face_region(*settings.hair_regions)
    stray = (foreground > 0.5) & ~_dilate(in_frame, 1)
    source_hair = _on(hair_faces, warp.natural.face) | stray
    target_hair = _on(hair_faces, warp.caricature.face)
    hair = np.zeros_like(on_mesh)
    if settings.hair:
        band = settings.hair_band
        hair = on_mesh & (_dilate(source_hair, band)[source] | _dilate(target_hair, band))

    region = _on(model.face_region(*settings.regions), warp.caricature.face)
    if settings.mouth and model.landmarks68 is not None:
        region |= _between_lips(warp.caricature_pixel, model, on_mesh.shape) | (
            on_mesh & _between_lips(warp.natural_pixel, model, on_mesh.shape)[source]
        )
    reach = settings.hair_band + _distance(in_frame)[stray].max(initial=0)
    maybe_hair = (_distance(source_hair | target_hair) <= reach) & _dilate(foreground > 0, settings.background_ring)
    outside = ~on_mesh & (maybe_hair | _dilate(on_mesh, settings.background_ring))
    return Validity(
        valid=~(invisible | hair | region | outside), invisible=invisible, hair=hair, region=region, outside=outside
    )


def _on(faces: Bool[np.ndarray, "f"], face_image: np.ndarray) -> Bool[np.ndarray, "h w"]:
    return (face_image >= 0) & faces[face_image]


def _between_lips(pixel: Float[np.ndarray, "v 2"], model: HeadModel, shape: tuple[int, int]) -> Bool[np.ndarray, "h w"]:
    """Pixels within the outline of the inner lips (iBUG landmarks 60..67)."""
    inside = np.zeros(shape, np.uint8)
    cv2.fillPoly(inside, [np.rint(pixel[model.landmarks68[INNER_LIPS]] - 0.5).astype(np.int32)], 1)
    return inside > 0


def _distance(mask: Bool[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
    """Pixels to the nearest one of the mask (infinite where there is none)."""
    if not mask.any():
        return np.full(mask.shape, np.inf, np.float32)
    return cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)


def _dilate(mask: Bool[np.ndarray, "h w"], radius: int) -> Bool[np.ndarray, "h w"]:
    if radius <= 0:
        return mask
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    return cv2.dilate(mask.astype(np.uint8), disc) > 0
