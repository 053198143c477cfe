"""Why a pixel of a target cannot be trusted: a bit field, and what the head model and the frame say of it."""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntFlag
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float32, UInt16

from carigs.errors import SettingsError
from carigs.head import HeadModel
from carigs.raster import Visibility
from carigs.settings import Gtstar
from carigs.target import trace

INNER_LIPS = slice(60, 68)


class Reason(IntFlag):
    """One bit each, so that reasons can overlap; stored as 16-bit grey values."""

    NEWLY_VISIBLE = 1
    """Turned away from the camera in the frame, and no longer in the caricature."""
    OCCLUDED = 2
    """Hidden by something nearer in the frame."""
    GRAZING = 4
    """Seen too obliquely in the frame."""
    STRETCHED = 8
    """Covers far more pixels in the caricature than in the frame."""
    OUTSIDE_IMAGE = 16
    """Comes from beyond the frame's border."""
    OUTSIDE_MESH = 32
    """Off the caricature's mesh and not known to be background."""
    HAIR = 64
    """Hair on the scalp's triangles, or in the band around hair that sticks out of the mesh."""
    MOUTH = 128
    """Between the lips: teeth do not follow the mesh."""
    LIDS = 256
    BROWS = 512
    EARS = 1024
    EYEBALLS = 2048


def as_bits(names: Iterable[str]) -> Reason:
    """The bits of reasons by their names in lower case; raises `SettingsError` for an unknown one."""
    bits = Reason(0)
    for name in names:
        if name.upper() not in Reason.__members__:
            known = ", ".join(reason.name.lower() for reason in Reason)
            raise SettingsError(f"{name} is no reason to leave out pixels; known: {known}")
        bits |= Reason[name.upper()]
    return bits


def face_reasons(model: HeadModel, settings: Gtstar) -> UInt16[np.ndarray, "f"]:
    """What the head model alone says of each triangle, in every frame: from here come pixels and frozen surfels."""
    found = np.zeros(len(model.faces), np.uint16)
    for reason, regions in (
        (Reason.HAIR, settings.hair_regions),
        (Reason.MOUTH, settings.mouth_regions),
        (Reason.LIDS, settings.lid_regions),
        (Reason.BROWS, settings.brow_regions),
        (Reason.EARS, settings.ear_regions),
        (Reason.EYEBALLS, settings.eyeball_regions),
    ):
        found[model.face_region(*regions)] |= reason.value
    return found


class Hair(NamedTuple):
    """Hair as a frame shows it."""

    where: Bool[np.ndarray, "h w"]
    """The scalp's triangles, and what of the matte sticks out of the mesh by more than the outline's own blur."""
    length: float
    """Pixels by which it sticks out at most."""


def hair_in_frame(
    natural: Visibility, foreground: Float32[np.ndarray, "h w"], of_faces: UInt16[np.ndarray, "f"]
) -> Hair:
    """Find the hair of a frame from its mesh and its matte."""
    on_mesh = natural.face >= 0
    stray = (foreground > 0.5) & ~_dilate(on_mesh, 1)
    scalp = trace.shows(natural.face, (of_faces & np.uint16(Reason.HAIR.value)) > 0)
    return Hair(scalp | stray, float(_distance(on_mesh)[_halved(stray)].max(initial=0)) if stray.any() else 0.0)


def frame_reasons(natural: Visibility, hair: Hair, model: HeadModel, settings: Gtstar) -> UInt16[np.ndarray, "h w"]:
    """What a target must not fetch from the frame: hair with a band around it, and what is seen between the lips."""
    reasons = np.zeros(hair.where.shape, np.uint16)
    _add(reasons, Reason.HAIR, _dilate(hair.where, settings.hair_band))
    _between_lips(reasons, natural, model)
    return reasons


def add_target_reasons(
    reasons: UInt16[np.ndarray, "h w"],
    caricature: Visibility,
    hair: Hair,
    foreground: Float32[np.ndarray, "h w"],
    of_faces: UInt16[np.ndarray, "f"],
    model: HeadModel,
    settings: Gtstar,
) -> None:
    """Add, in place, what the caricature's own outline says.

    Off its mesh, by `background_ring` pixels, is background where the frame shows background, and also where it shows
    skin: that has moved away.  Only hair, and whatever else sticks out of the mesh, may be anywhere within its own
    length of where it is or of the scalp.
    """
    on_mesh = caricature.face >= 0
    scalp = trace.shows(caricature.face, (of_faces & np.uint16(Reason.HAIR.value)) > 0)
    _add(reasons, Reason.HAIR, on_mesh & _dilate(scalp, settings.hair_band))
    _between_lips(reasons, caricature, model)
    unknown = _dilate(foreground > 0, settings.background_ring) & ~on_mesh
    if unknown.any():
        near = _distance(hair.where | scalp) <= hair.length + settings.hair_band
        unknown &= _doubled(near)[: unknown.shape[0], : unknown.shape[1]]
    _add(reasons, Reason.OUTSIDE_MESH, ~on_mesh & (unknown | _dilate(on_mesh, settings.background_ring)))


def _add(reasons: UInt16[np.ndarray, "h w"], reason: Reason, where: Bool[np.ndarray, "h w"]) -> None:
    reasons |= np.multiply(where, np.uint16(reason.value), dtype=np.uint16)  # far cheaper than indexing by a mask


def _between_lips(reasons: UInt16[np.ndarray, "h w"], seen: Visibility, model: HeadModel) -> None:
    """Mark the pixels within the outline of the inner lips (iBUG landmarks 60..67) where there is mesh."""
    if model.landmarks68 is None:
        return
    lips = model.landmarks68[INNER_LIPS]
    if not (seen.points[lips, 2] > 0).all():
        return
    inside = np.zeros(reasons.shape, np.uint8)
    cv2.fillPoly(inside, [np.rint(seen.pixel[lips] - 0.5).astype(np.int32)], 1)
    _add(reasons, Reason.MOUTH, inside.view(bool) & (seen.face >= 0))


def _distance(mask: Bool[np.ndarray, "h w"]) -> Float32[np.ndarray, "h2 w2"]:
    """Pixels, to about two, from every block of 2 x 2 to the nearest one in the mask; infinite if there is none."""
    held = _halved(mask)
    if not held.any():
        return np.full(held.shape, np.inf, np.float32)
    return 2 * cv2.distanceTransform((~held).view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_3)


def _halved(mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h2 w2"]:
    """Whether any pixel of each block of 2 x 2 is in the mask."""
    if mask.shape[0] % 2 or mask.shape[1] % 2:
        mask = np.pad(mask, [(0, n % 2) for n in mask.shape])
    pairs = np.ascontiguousarray(mask).view(np.uint16)
    return (pairs[::2] | pairs[1::2]) > 0


def _doubled(blocks: Bool[np.ndarray, "h2 w2"]) -> Bool[np.ndarray, "h w"]:
    size = 2 * blocks.shape[1], 2 * blocks.shape[0]
    return cv2.resize(blocks.view(np.uint8), size, interpolation=cv2.INTER_NEAREST).view(bool)


def _dilate(mask: Bool[np.ndarray, "h w"], radius: int) -> Bool[np.ndarray, "h w"]:
    if radius <= 0:
        return mask
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    return cv2.dilate(mask.view(np.uint8), disc).view(bool)
