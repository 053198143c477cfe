"""The `torch` backend: projection, lists and compositing in plain PyTorch, on the device of the surfels.

Exact and slow: every operation goes through memory. It follows the `cpu` backend step by step, so that results differ
by rounding only, and it is deterministic on any one device.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from carigs.splat.rasterizer.interface import Rendering, Screen, WorldSurfels
from carigs.splat.rasterizer.records import RECORD_COLUMN
from carigs.splat.rasterizer.torch_compositing import CHANNELS, composite
from carigs.splat.rasterizer.torch_lists import tile_lists
from carigs.splat.rasterizer.torch_projection import project_surfels

if TYPE_CHECKING:
    from carigs.capture.camera import Camera


def rasterize_torch(
    surfels: WorldSurfels,
    camera: Camera,
    outputs: tuple[str, ...],
    background: float = 0.0,
    alpha_cap: float = 0.99,
) -> Rendering:
    """Render surfels in plain PyTorch, as `rasterize`.

    Args:
        surfels: Surfels in world space, on any device.
        camera: Pinhole camera.
        outputs: Names of the images to compute.
        background: Grey value behind the surfels.
        alpha_cap: Upper limit of a surfel's alpha.

    Returns:
        The requested images on the surfels' device.
    """
    relative = WorldSurfels(
        surfels.centre, surfels.tangent_u, surfels.tangent_v, surfels.opacity, surfels.colour - background
    )
    projected = project_surfels(relative, camera)
    depth = projected.record[:, RECORD_COLUMN.depth - RECORD_COLUMN.u0].detach()
    lists = tile_lists(depth, projected.box, projected.visible, camera.width, camera.height)
    screen = Screen(visible=projected.visible)
    geometry = any(name not in ("colour", "alpha") for name in outputs)
    image = composite(projected, lists, camera.width, camera.height, alpha_cap, geometry, screen)
    images = {name: image[..., CHANNELS[name]] for name in outputs}
    if "colour" in images:
        images["colour"] = images["colour"] + background
    return Rendering(**images, screen=screen)
