"""GT* of one frame by the local warp: visibility at both ends, colours, reasons."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, UInt16

from carigs.capture import Camera
from carigs.gtstar.mask_flags import add_target_mask_flags, frame_mask_flags, hair_in_frame
from carigs.gtstar.warp import warp_frame
from carigs.head import HeadModel
from carigs.raster import Visibility, visible
from carigs.settings import Gtstar


@dataclass(frozen=True)
class Target:
    """A GT* image, and what speaks against its pixels."""

    colour: Float32[np.ndarray, "h w 3"]
    reasons: UInt16[np.ndarray, "h w"]
    """Bits of `Reason`; 0 where nothing does."""
    caricature: Visibility
    """What the camera sees of the caricature."""
    facing: bool
    """Whether the camera sees the front of any triangle, at both ends."""


def make_target(
    image: Float32[np.ndarray, "h w 3"],
    foreground: Float32[np.ndarray, "h w"],
    natural_vertices: Float[np.ndarray, "v 3"],
    caricature_vertices: Float[np.ndarray, "v 3"],
    camera: Camera,
    model: HeadModel,
    of_faces: UInt16[np.ndarray, "f"],
    settings: Gtstar,
    background: float = 1.0,
) -> Target:
    """Warp a frame and its matte to the caricature.

    Vertices are world points in metres; `of_faces` is what `face_reasons` says of the model's triangles.
    """
    natural = visible(natural_vertices, model.faces, camera)
    hair = hair_in_frame(natural, foreground, of_faces)
    of_frame = frame_mask_flags(natural, hair, model, settings)
    caricature = visible(caricature_vertices, model.faces, camera)
    colour, reasons = warp_frame(image, natural, caricature, of_faces, of_frame, settings, background)
    add_target_mask_flags(reasons, caricature, hair, foreground, of_faces, model, settings)
    facing = all(_sees_front(seen) for seen in (natural, caricature))
    return Target(colour, reasons, caricature, facing)


def _sees_front(seen: Visibility) -> bool:
    """Whether most of the mesh that is seen turns its front: from inside a head it does not."""
    faces = seen.face[::4, ::4]
    faces = faces[faces >= 0]
    return len(faces) > 0 and float(seen.back[faces].mean()) < 0.5
