"""Render surfels on a posed mesh: skinning, colours, rasteriser."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor

from carigs.capture import Camera
from carigs.splat.colour.appearance import seen_colour
from carigs.splat.rasterizer.rasterize import Rendering, WorldSurfels, rasterize
from carigs.splat.rig.face_motion import FaceMotion
from carigs.splat.rig.rig import Rig
from carigs.splat.rig.similarity_motion import similarity_motion
from carigs.splat.rig.skinning import SkinnedSurfels, jacobian_blend_skinning
from carigs.splat.surfels.surfels import Surfels

SKINNINGS = ("jbs", "jacobian", "similarity")
"""`jbs` blends the motions of neighbouring triangles (paper equation 6), `jacobian` takes the own triangle's motion,
`similarity` its motion without stretch, as in GaussianAvatars."""


class RenderedFrame(NamedTuple):
    """An image and its intermediate results.

    Attributes:
        image: RGB over the background, not clamped.
        rendering: Outputs of the rasteriser.
        world: The surfels in world coordinates.
    """

    image: Float[Tensor, "h w 3"]
    rendering: Rendering
    world: WorldSurfels


def render(
    surfels: Surfels,
    rig: Rig,
    motion: FaceMotion,
    camera: Camera,
    *,
    skinning: str = "jbs",
    rotate_harmonics: bool = True,
    background: float = 1.0,
    shade: Float32[np.ndarray, "f 3"] | None = None,
    outputs: tuple[str, ...] = (),
    backend: str = "cpu",
) -> RenderedFrame:
    """Render the surfels on a posed mesh.

    Args:
        surfels: Surfels in the frames of the triangles.
        rig: Canonical mesh.
        motion: Motion of the triangles to the posed mesh.
        camera: View.
        skinning: One of `SKINNINGS`.
        rotate_harmonics: Whether view-dependent colour turns with the head.
        background: Grey value behind the head, in [0, 1].
        shade: Factor on the colours of every triangle; 1 if None.
        outputs: Outputs of the rasteriser besides the colour.
        backend: Rasteriser, see `rasterize`.

    Returns:
        The image, differentiable with respect to the surfels and, if its records are a tensor, the motion.
    """
    eye = camera.centre if surfels.sh_degree > 0 else None
    skinned = skin(surfels, rig, motion, skinning=skinning, eye=eye, rotate_harmonics=rotate_harmonics)
    colour = seen_colour(surfels.colour, surfels.harmonics, skinned.direction, shade, surfels.binding)
    world = WorldSurfels(*skinned[:4], colour)
    rendering = rasterize(world, camera, backend=backend, outputs=("colour", *outputs), background=background)
    return RenderedFrame(rendering.colour, rendering, world)


def skin(
    surfels: Surfels,
    rig: Rig,
    motion: FaceMotion,
    *,
    skinning: str = "jbs",
    eye: Float[np.ndarray, "3"] | None = None,
    rotate_harmonics: bool = True,
) -> SkinnedSurfels:
    """Carry the surfels to a posed mesh.

    Args:
        surfels: Surfels in the frames of the triangles.
        rig: Canonical mesh.
        motion: Motion of the triangles to the posed mesh.
        skinning: One of `SKINNINGS`.
        eye: Centre of the camera in world coordinates (metres), if view directions are needed.
        rotate_harmonics: Whether view-dependent colour turns with the head.

    Returns:
        The surfels in world coordinates, differentiable as `jacobian_blend_skinning` says.
    """
    if skinning == "similarity":
        motion = similarity_motion(rig, motion)
    return jacobian_blend_skinning(
        surfels, rig, motion, blend=skinning == "jbs", eye=eye, rotate_directions=rotate_harmonics
    )


def contribution(
    surfels: Surfels, rig: Rig, motion: FaceMotion, camera: Camera, *, skinning: str = "jbs", backend: str = "cpu"
) -> Float[np.ndarray, " n"]:
    """Sum of every surfel's compositing weights over the pixels of a view.

    This is the gradient of the image's sum with respect to the surfel's colour: the significance of LightGaussian (Fan
    et al. 2024) without the volume, since a surfel is flat.

    Args:
        surfels: Surfels in the frames of the triangles.
        rig: Canonical mesh.
        motion: Motion of the triangles to the posed mesh.
        camera: View.
        skinning: `jbs` or `jacobian`.
        backend: Rasteriser, see `rasterize`.

    Returns:
        Sums in pixels, float64.
    """
    with torch.no_grad():
        skinned = jacobian_blend_skinning(surfels, rig, motion, blend=skinning == "jbs")
    colour = torch.zeros(len(surfels), 3, requires_grad=True)
    image = rasterize(WorldSurfels(*skinned[:4], colour), camera, backend=backend, outputs=("colour",)).colour
    return torch.autograd.grad(image[..., 0].sum(), colour)[0][:, 0].double().numpy()
