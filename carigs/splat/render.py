"""From surfels and a posed mesh to an image: skinning, appearance, rasteriser."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor

from carigs.capture import Camera
from carigs.splat.colour.appearance import seen_colour
from carigs.splat.rasterizer.rasterize import Rendering, WorldSurfels, rasterize
from carigs.splat.rig.rig import FaceMotion, Rig
from carigs.splat.rig.skinning import skin
from carigs.splat.surfels.surfels import Surfels

RIGS = ("jbs", "jacobian")


class RenderedFrame(NamedTuple):
    """An image and what it is made of."""

    image: Float[Tensor, "h w 3"]
    """Over the background; not clamped."""
    rendering: Rendering
    world: WorldSurfels


def render(
    surfels: Surfels,
    rig: Rig,
    motion: FaceMotion,
    camera: Camera,
    *,
    kind: str = "jbs",
    rotate_harmonics: bool = True,
    background: float = 1.0,
    shade: Float32[np.ndarray, "f 3"] | None = None,
    outputs: tuple[str, ...] = (),
    backend: str = "cpu",
) -> RenderedFrame:
    """Render the surfels on a posed mesh; `outputs` are wanted beside the colour.

    `kind` is one of `RIGS`: `jbs` blends the neighbours' motions, `jacobian` takes the own face's.  With
    `rotate_harmonics` view-dependent colour turns with the head.  `shade` is a factor on the colours per triangle.
    """
    eye = camera.centre if surfels.sh_degree > 0 else None
    skinned = skin(surfels, rig, motion, blend=kind == "jbs", eye=eye, turning=rotate_harmonics)
    colour = seen_colour(surfels.colour, surfels.harmonics, skinned.direction, shade, surfels.binding)
    world = WorldSurfels(*skinned[:4], colour)
    rendering = rasterize(world, camera, backend=backend, outputs=("colour", *outputs), background=background)
    return RenderedFrame(rendering.colour, rendering, world)


def contribution(
    surfels: Surfels, rig: Rig, motion: FaceMotion, camera: Camera, *, kind: str = "jbs", backend: str = "cpu"
) -> Float[np.ndarray, "n"]:
    """Sum of every surfel's compositing weights over the pixels of a view: what it adds to the image.

    The gradient of the image's sum with respect to its colours, as LightGaussian's significance (Fan et al. 2024)
    without the volume: a surfel is flat.
    """
    with torch.no_grad():
        skinned = skin(surfels, rig, motion, blend=kind == "jbs")
    colour = torch.zeros(len(surfels), 3, requires_grad=True)
    image = rasterize(WorldSurfels(*skinned[:4], colour), camera, backend=backend, outputs=("colour",)).colour
    return torch.autograd.grad(image[..., 0].sum(), colour)[0][:, 0].double().numpy()
