"""Why a pixel of a target cannot be trusted: a bit field, and what the head model and the frame say of it."""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntFlag
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float32, UInt16

from carigs.errors import SettingsError
from carigs.head import HeadModel
from carigs.raster import Visibility
from carigs.raster import bit_masks as bits
from carigs.raster.bit_masks import Bits
from carigs.settings import Gtstar

INNER_LIPS = slice(60, 68)


class MaskFlag(IntFlag):
    """One bit each, so that reasons can overlap; stored as 16-bit grey values."""

    NEWLY_VISIBLE = 1
    """Turned away from the camera in the frame, and no longer in the caricature."""
    OCCLUDED = 2
    """Hidden by something nearer in the frame."""
    GRAZING = 4
    """Seen too obliquely in the frame, and clearly less so in the caricature."""
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


def flags_from_names(names: Iterable[str]) -> MaskFlag:
    """The bits of reasons by their names in lower case; raises `SettingsError` for an unknown one."""
    bits = MaskFlag(0)
    for name in names:
        if name.upper() not in MaskFlag.__members__:
            known = ", ".join(reason.name.lower() for reason in MaskFlag)
            raise SettingsError(f"{name} is no reason to leave out pixels; known: {known}")
        bits |= MaskFlag[name.upper()]
    return bits


def face_mask_flags(model: HeadModel, settings: Gtstar) -> UInt16[np.ndarray, "f"]:
    """What the head model alone says of each triangle, in every frame: from here come pixels and frozen surfels."""
    found = np.zeros(len(model.faces), np.uint16)
    for reason, regions in (
        (MaskFlag.HAIR, settings.hair_regions),
        (MaskFlag.MOUTH, settings.mouth_regions),
        (MaskFlag.LIDS, settings.lid_regions),
        (MaskFlag.BROWS, settings.brow_regions),
        (MaskFlag.EARS, settings.ear_regions),
        (MaskFlag.EYEBALLS, settings.eyeball_regions),
    ):
        found[model.face_region(*regions)] |= reason.value
    return found


class Hair(NamedTuple):
    """Hair as a frame shows it."""

    where: Bits
    """The scalp's triangles, and what of the matte sticks out of the mesh by more than the outline's own blur."""
    length: int
    """Pixels by which it sticks out at most."""


def hair_in_frame(
    natural: Visibility, foreground: Float32[np.ndarray, "h w"], of_faces: UInt16[np.ndarray, "f"]
) -> Hair:
    """Find the hair of a frame from its mesh and its matte."""
    stray = bits.above(foreground, 0.5) - natural.on_mesh.grown(1)
    return Hair(_scalp(natural, of_faces) | stray, natural.on_mesh.reach(stray))


def frame_mask_flags(natural: Visibility, hair: Hair, model: HeadModel, settings: Gtstar) -> UInt16[np.ndarray, "h w"]:
    """What a target must not fetch from the frame: hair with a band around it, and what is seen between the lips."""
    reasons = np.zeros(natural.face.shape, np.uint16)
    bits.add(reasons, hair.where.grown(settings.hair_dilation).words, MaskFlag.HAIR.value)
    _add_between_lips(reasons, natural, model)
    return reasons


def add_target_mask_flags(
    reasons: UInt16[np.ndarray, "h w"],
    caricature: Visibility,
    hair: Hair,
    foreground: Float32[np.ndarray, "h w"],
    of_faces: UInt16[np.ndarray, "f"],
    model: HeadModel,
    settings: Gtstar,
) -> None:
    """Add, in place, what the caricature's own outline says.

    Off its mesh, by `background_margin` pixels, is background where the frame shows background, and also where it shows
    skin: that has moved away.  Only hair, and whatever else sticks out of the mesh, may be anywhere within its own
    length of where it is or of the scalp.
    """
    on_mesh, scalp = caricature.on_mesh, _scalp(caricature, of_faces)
    unknown = bits.above(foreground, 0).grown(settings.background_margin) - on_mesh
    if unknown:
        unknown &= (hair.where | scalp).grown(hair.length + settings.hair_dilation)
    outside = (unknown | on_mesh.grown(settings.background_margin)) - on_mesh
    bits.add(reasons, (scalp.grown(settings.hair_dilation) & on_mesh).words, MaskFlag.HAIR.value)
    bits.add(reasons, outside.words, MaskFlag.OUTSIDE_MESH.value)
    _add_between_lips(reasons, caricature, model)


def _scalp(seen: Visibility, of_faces: UInt16[np.ndarray, "f"]) -> Bits:
    return bits.chosen(seen.face, (of_faces & np.uint16(MaskFlag.HAIR.value)) > 0)


def _add_between_lips(reasons: UInt16[np.ndarray, "h w"], seen: Visibility, model: HeadModel) -> None:
    """Mark the pixels within the outline of the inner lips (iBUG landmarks 60..67) where there is mesh."""
    if model.landmarks68 is None:
        return
    lips = model.landmarks68[INNER_LIPS]
    if not (seen.points[lips, 2] > 0).all():
        return
    outline = np.rint(seen.pixel[lips] - 0.5).astype(np.int32)
    low = np.clip(outline.min(axis=0), 0, reasons.shape[::-1])
    high = np.clip(outline.max(axis=0) + 1, low, reasons.shape[::-1])
    box = slice(low[1], high[1]), slice(low[0], high[0])
    inside = np.zeros(reasons[box].shape, np.uint8)
    if inside.size:
        cv2.fillPoly(inside, [outline - low], 1)
        reasons[box] |= np.uint16(MaskFlag.MOUTH.value) * (inside.view(bool) & (seen.face[box] >= 0))
