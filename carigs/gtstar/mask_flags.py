"""The validity mask of a target: a bit field per pixel that says why the pixel cannot be trusted.

The masks of the paper, and where they are computed:

- visibility mask (newly visible triangles, appendix): `triangle_maps.flag_triangles`
- occlusion mask (section 3.2): `warp_kernels.warp`
- hair boundary mask (section 3.2): `frame_hair`, `frame_mask_flags`, `add_target_mask_flags`
- eyelids and ears (appendix): `face_mask_flags`
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, UInt16

from carigs.errors import SettingsError
from carigs.head import HeadModel
from carigs.head.facial_regions import EARS, EYEBALLS, LIDS, MOUTH, brow_faces
from carigs.raster import Visibility
from carigs.raster.bit_masks import BitMask, greater, or_into_image, pixels_of_faces
from carigs.raster.open_mouth import between_lips
from carigs.settings import Gtstar, MaskFlag

HAIR_DILATION = 2
"""Pixels by which the mask of hair is wider than hair (docs/notebook/targets.md)."""
BACKGROUND_MARGIN = 1
"""Pixels around mesh and foreground in which background does not count as known."""


def flags_from_names(names: Iterable[str]) -> MaskFlag:
    """Combine flags by name.

    Args:
        names: Names of `MaskFlag` in lower case.

    Returns:
        The combined flags.

    Raises:
        SettingsError: For an unknown name.
    """
    flags = MaskFlag(0)
    for name in names:
        if name.upper() not in MaskFlag.__members__:
            known = ", ".join(flag.name.lower() for flag in MaskFlag)
            raise SettingsError(f"{name} is not a mask flag; known: {known}")
        flags |= MaskFlag[name.upper()]
    return flags


def face_mask_flags(
    model: HeadModel, settings: Gtstar, covered: Bool[np.ndarray, " f"] | None = None
) -> UInt16[np.ndarray, " f"]:
    """Flags that hold for a triangle in every frame, from the regions of the head model.

    They mask pixels and also freeze the surfels of these triangles while targets supervise. Among them are the mask of
    the eyelids and the mask of the ears of the paper's appendix, and the scalp for the hair mask.

    Args:
        model: The head model.
        settings: Names of the regions that carry hair.
        covered: Triangles that something covers (`FoundHair.covered`); none if None. The scalp has its own flag.

    Returns:
        Bits of `MaskFlag`.
    """
    flags = np.zeros(len(model.faces), np.uint16)
    for flag, regions in (
        (MaskFlag.HAIR, settings.regions.hair),
        (MaskFlag.MOUTH, MOUTH),
        (MaskFlag.LIDS, LIDS),
        (MaskFlag.EARS, EARS),
        (MaskFlag.EYEBALLS, EYEBALLS),
    ):
        flags[model.face_region(*regions)] |= flag.value
    brows = brow_faces(model, model.v_template)
    if brows is not None:
        # With the triangles around them: their strands stand off the skin, and some cameras show them over those.
        inside = np.zeros(len(model.v_template), bool)
        inside[model.faces[brows]] = True
        flags[inside[model.faces].any(axis=1)] |= MaskFlag.BROWS.value
    if covered is not None:
        flags[covered & ((flags & MaskFlag.HAIR.value) == 0)] |= MaskFlag.COVERED.value
    return flags


class FrameHair(NamedTuple):
    """Hair in a frame."""

    mask: BitMask
    """The scalp's triangles, and foreground that sticks out of the mesh by more than the blur of its outline."""
    length: int
    """Largest distance in pixels by which it sticks out."""


def frame_hair(
    natural: Visibility, foreground: Float32[np.ndarray, "h w"], face_flags: UInt16[np.ndarray, " f"]
) -> FrameHair:
    """Find the hair of a frame: the scalp, and the hair boundary, which is foreground off the mesh.

    Args:
        natural: What the camera sees of the tracked mesh.
        foreground: Matte of the frame.
        face_flags: Flags of the triangles (`face_mask_flags`).

    Returns:
        Mask and length of the hair.
    """
    stray = greater(foreground, 0.5) - natural.on_mesh.dilated(1)
    return FrameHair(_scalp(natural, face_flags) | stray, natural.on_mesh.covering_radius(stray))


def frame_mask_flags(natural: Visibility, hair: FrameHair, model: HeadModel) -> UInt16[np.ndarray, "h w"]:
    """Flags of the pixels of a frame that a target must not sample: the hair boundary mask, and the open mouth.

    Args:
        natural: What the camera sees of the tracked mesh.
        hair: Hair of the frame.
        model: The head model.

    Returns:
        Bits of `MaskFlag`.
    """
    flags = np.zeros(natural.face.shape, np.uint16)
    or_into_image(flags, hair.mask.dilated(HAIR_DILATION).words, MaskFlag.HAIR.value)
    _flag_mouth(flags, natural, model)
    return flags


def add_target_mask_flags(
    flags: UInt16[np.ndarray, "h w"],
    caricature: Visibility,
    hair: FrameHair,
    foreground: Float32[np.ndarray, "h w"],
    face_flags: UInt16[np.ndarray, " f"],
    model: HeadModel,
    carried: BitMask | None = None,
) -> None:
    """Add the flags that depend on the caricature's outline: hair, outside of the mesh, and the open mouth.

    A pixel off the caricature's mesh is background if the frame shows background there, and also if it shows skin,
    because the skin has moved away. It is unknown in a ring around the mesh, and where hair may be: within the length
    of the hair around the scalp and around the hair in the frame, and where the scalp of the caricature carries it.

    Args:
        flags: Flags of the target's pixels, changed in place.
        caricature: What the camera sees of the caricature.
        hair: Hair of the frame.
        foreground: Matte of the frame.
        face_flags: Flags of the triangles (`face_mask_flags`).
        model: The head model.
        carried: Where the scalp of the caricature carries the hair.
    """
    on_mesh, scalp = caricature.on_mesh, _scalp(caricature, face_flags)
    unknown = greater(foreground, 0).dilated(BACKGROUND_MARGIN) - on_mesh
    if unknown:
        unknown &= (hair.mask | scalp).dilated(hair.length + HAIR_DILATION)
    if carried is not None:
        unknown |= carried - on_mesh
    outside = (unknown | on_mesh.dilated(BACKGROUND_MARGIN)) - on_mesh
    or_into_image(flags, (scalp.dilated(HAIR_DILATION) & on_mesh).words, MaskFlag.HAIR.value)
    or_into_image(flags, outside.words, MaskFlag.OUTSIDE_MESH.value)
    _flag_mouth(flags, caricature, model)


def _scalp(visibility: Visibility, face_flags: UInt16[np.ndarray, " f"]) -> BitMask:
    return pixels_of_faces(visibility.face, (face_flags & np.uint16(MaskFlag.HAIR.value)) > 0)


def _flag_mouth(flags: UInt16[np.ndarray, "h w"], visibility: Visibility, model: HeadModel) -> None:
    """Flag the pixels of the mesh within the outline of the inner lips."""
    flags[between_lips(visibility, model)] |= np.uint16(MaskFlag.MOUTH.value)
