"""The GT* target of one frame: warped colours and mask flags."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, UInt16

from carigs.gtstar.mask_flags import add_target_mask_flags, frame_hair, frame_mask_flags
from carigs.gtstar.warp import warp_frame
from carigs.hair import CarriedHair
from carigs.head import HeadModel
from carigs.raster import Visibility
from carigs.raster.bit_masks import greater
from carigs.settings import Gtstar


@dataclass(frozen=True)
class Target:
    """A GT* image with its validity mask."""

    colour: Float32[np.ndarray, "h w 3"]
    mask_flags: UInt16[np.ndarray, "h w"]
    """Bits of `MaskFlag`; 0 where nothing speaks against the pixel."""
    caricature: Visibility
    """What the camera sees of the caricature."""
    front_visible: bool
    """Whether the camera sees mostly front faces, both of the natural mesh and of the caricature."""


def make_target(
    image: Float32[np.ndarray, "h w 3"],
    foreground: Float32[np.ndarray, "h w"],
    natural: Visibility,
    caricature: Visibility,
    model: HeadModel,
    face_flags: UInt16[np.ndarray, " f"],
    settings: Gtstar,
    background: float = 1.0,
    carried_hair: CarriedHair | None = None,
) -> Target:
    """Warp a frame to its caricature, and flag the pixels that cannot be trusted.

    Args:
        image: sRGB colours of the frame.
        foreground: Matte of the frame.
        natural: What the camera sees of the tracked mesh.
        caricature: What the camera sees of the caricature.
        model: The head model.
        face_flags: Flags of the triangles (`face_mask_flags`).
        settings: Settings of the stage.
        background: Grey value that the image was composited on.
        carried_hair: The hair of the subject; None if only what the frame shows of it is known.

    Returns:
        Colours and mask flags.
    """
    hair = frame_hair(natural, foreground, face_flags)
    frame_flags = frame_mask_flags(natural, hair, model)
    colour, flags = warp_frame(image, natural, caricature, face_flags, frame_flags, settings, background)
    carried = None
    if carried_hair is not None:
        shown = carried_hair.pixels(natural, caricature).astype(np.float32)
        carried = greater(shown, 0.5).dilated(carried_hair.radius(natural))
    add_target_mask_flags(flags, caricature, hair, foreground, face_flags, model, carried)
    return Target(colour, flags, caricature, all(_sees_front(seen) for seen in (natural, caricature)))


def _sees_front(visibility: Visibility) -> bool:
    """Whether most of the visible mesh shows its front; a camera inside the head sees back faces."""
    faces = visibility.face[::4, ::4]
    faces = faces[faces >= 0]
    return len(faces) > 0 and float(visibility.back_facing[faces].mean()) < 0.5
