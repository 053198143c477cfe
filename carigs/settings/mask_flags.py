"""The mask flags of GT* frames: why a pixel cannot be trusted. `carigs.gtstar.mask_flags` computes them."""

from __future__ import annotations

from enum import IntFlag


class MaskFlag(IntFlag):
    """Why a pixel of a target cannot be trusted. Flags can be combined; they are stored as 16-bit grey values."""

    NEWLY_VISIBLE = 1
    """The triangle turns its back to the camera in the frame and its front in the caricature, or conversely."""
    OCCLUDED = 2
    """A nearer surface hides the point in the frame."""
    GRAZING = 4
    """Seen too obliquely in the frame, and clearly less obliquely in the caricature."""
    STRETCHED = 8
    """The triangle covers far more pixels in the caricature than in the frame."""
    OUTSIDE_IMAGE = 16
    """The point lies outside the frame."""
    OUTSIDE_MESH = 32
    """Off the caricature's mesh and not known to be background."""
    HAIR = 64
    """Hair: triangles of the scalp, and a band around hair that sticks out of the mesh."""
    MOUTH = 128
    """Between the lips: teeth do not follow the mesh."""
    LIDS = 256
    """Triangles of the regions `left_eyelid` and `right_eyelid`."""
    BROWS = 512
    """Triangles of the region `brows`, or near the landmarks of the brows where the head model has no such region; and
    triangles that share a vertex with these."""
    EARS = 1024
    """Triangles of the regions `left_ear` and `right_ear`."""
    EYEBALLS = 2048
    """Triangles of the regions `left_eyeball` and `right_eyeball`."""
    COVERED = 4096
    """Something covers the triangle in the frames: hair that hangs over the skin, a collar, a hand."""


MASK_FLAGS = tuple(flag.name.lower() for flag in MaskFlag)
"""Names of all flags, as in `train.mask_flags`."""
DEFAULT_MASK_FLAGS = (
    "newly_visible",
    "occluded",
    "grazing",
    "outside_image",
    "outside_mesh",
    "hair",
    "mouth",
    "brows",
    "covered",
)
"""Flags that exclude pixels unless a variant changes them."""
