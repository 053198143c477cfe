"""The `cuda` backend: projection in torch, tiles and compositing by gsplat's 2D Gaussian kernels (1.5.3).

gsplat's `rasterization_2dgs` takes rotations and scales. Tangents that are not orthogonal have those only after a
decomposition that is singular for round surfels. gsplat's tile kernels take any homography; the projection is therefore
done here. gsplat is Apache-2.0; only its published functions are called.

Differences from the `cpu` backend: the cap on alpha is compiled into gsplat (0.999 in 1.5, 0.99 in its main branch),
and sums have no fixed order, so that results differ in the last digits from run to run.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from carigs.errors import SettingsError
from carigs.splat.rasterizer.interface import Rendering, Screen, WorldSurfels
from carigs.splat.rasterizer.torch_projection import facing_normal, to_camera, transformed

if TYPE_CHECKING:
    from carigs.capture.camera import Camera

TILE_SIZE = 16
"""Pixels along a tile's side in gsplat's kernels."""
FAR_AWAY = 1e8
"""Pixels; the square is finite in float32."""


class GsplatSurfels(NamedTuple):
    """Surfels as gsplat's tile kernels take them; those that are culled have radius 0."""

    kept: Bool[Tensor, " n"]
    """Surfels that are not culled."""
    homography: Float[Tensor, "n 3 3"]
    """From disc coordinates (s, t, 1) to homogeneous pixel coordinates."""
    box_centre: Float[Tensor, "n 2"]
    """Centre in pixels of a box that contains all alphas of 1/255 or more."""
    radius: Int[Tensor, "n 2"]
    """Half sides of this box in pixels."""
    depth: Float[Tensor, " n"]
    """Depth of the centres in metres."""
    normal: Float[Tensor, "n 3"]
    """Unit normals in camera axes that face the camera."""
    opacity: Float[Tensor, " n"]
    """In [0, 1]."""
    colour: Float[Tensor, "n 3"]
    """RGB."""


def disc_homographies(surfels: WorldSurfels, camera: Camera) -> GsplatSurfels:
    """Homographies, boxes and normals of the surfels, with the culling of `projection.project_surfels`.

    Args:
        surfels: Surfels in world space.
        camera: Pinhole camera.

    Returns:
        The surfels in float32, differentiable except for `kept` and the box.
    """
    discs = to_camera(surfels, camera)
    intrinsics = (camera.fx, 0.0, camera.cx), (0.0, camera.fy, camera.cy), (0.0, 0.0, 1.0)
    columns = [transformed(axis, intrinsics) for axis in (discs.tangent_u, discs.tangent_v, discs.centre)]
    homography = torch.stack(columns, dim=2)
    with torch.no_grad():
        box_centre, half = _circle_box(homography, 2 * torch.log(255 * discs.opacity))
        low, high = box_centre - half, box_centre + half
        drawn = discs.kept & (high >= 0).all(dim=1) & (low[:, 0] <= camera.width) & (low[:, 1] <= camera.height)
        radius = torch.where(drawn[:, None], half.ceil(), 0).int()
    numbers = (homography, box_centre, discs.centre[:, 2], facing_normal(discs), discs.opacity, discs.colour)
    homography, box_centre, depth, normal, opacity, colour = (value.float() for value in numbers)
    return GsplatSurfels(discs.kept, homography, box_centre, radius, depth, normal, opacity, colour)


def _circle_box(
    homography: Float[Tensor, "n 3 3"], squared_radius: Float[Tensor, " n"]
) -> tuple[Float[Tensor, "n 2"], Float[Tensor, "n 2"]]:
    """Centre and half sides of the box of the projected circle s^2 + t^2 = r^2.

    The conic touches the vertical line x where x^2 C_ww - 2 x C_xw + C_xx = 0 with C = H diag(r^2, r^2, -1) H^T.
    """
    one = torch.ones_like(squared_radius)
    weighted = homography * torch.stack([squared_radius, squared_radius, -one], dim=1)[:, None, :]
    c = weighted @ homography.transpose(1, 2)
    centre = c[:, :2, 2] / c[:, 2, 2, None]
    squares = torch.stack([c[:, 0, 0], c[:, 1, 1]], dim=1) / c[:, 2, 2, None]
    return centre, (centre.square() - squares).clamp_min(0).sqrt()


def rasterize_cuda(
    surfels: WorldSurfels, camera: Camera, outputs: tuple[str, ...], background: float = 0.0
) -> Rendering:
    """Render surfels with gsplat, as `rasterize`.

    Args:
        surfels: Surfels in world space, on any device.
        camera: Pinhole camera.
        outputs: Names of the images to compute.
        background: Grey value behind the surfels.

    Returns:
        The requested images on the surfels' device.

    Raises:
        SettingsError: If there is no CUDA device or gsplat is not installed.
    """
    return rasterize_gsplat(load_gsplat(), surfels, camera, outputs, background, torch.device("cuda"))


def rasterize_gsplat(
    gsplat: Any,
    surfels: WorldSurfels,
    camera: Camera,
    outputs: tuple[str, ...],
    background: float,
    device: torch.device,
) -> Rendering:
    """Render surfels with functions of gsplat.

    Surfels that are on the device already stay there: nothing here waits for it. gsplat itself reads the number of its
    tile pairs back.

    Args:
        gsplat: The package, or its functions for another device.
        surfels: Surfels in world space, on any device.
        camera: Pinhole camera.
        outputs: Names of the images to compute.
        background: Grey value behind the surfels.
        device: Where to compute.

    Returns:
        The requested images on the surfels' device.
    """
    home, fields = surfels.centre.device, ("centre", "tangent_u", "tangent_v", "opacity", "colour")
    discs = disc_homographies(WorldSurfels(*(getattr(surfels, name).to(device) for name in fields)), camera)
    screen = Screen(visible=(discs.radius > 0).all(dim=1).to(home))
    # A shift of the surfels' images. The gradient with respect to it is that with respect to the projected centres;
    # gsplat's own (`densify`) reads sums that other threads still add to.
    shift = torch.zeros_like(discs.box_centre, requires_grad=True)
    shift.register_hook(lambda gradient: setattr(screen, "gradient", gradient.to(home)))
    rows = discs.homography
    homography = torch.cat([rows[:, :2] + shift[:, :, None] * rows[:, 2:], rows[:, 2:]], dim=1)

    tiles = -(-camera.width // TILE_SIZE), -(-camera.height // TILE_SIZE)
    _, pairs, order = gsplat.isect_tiles(
        discs.box_centre[None], discs.radius[None], discs.depth[None].detach(), TILE_SIZE, *tiles
    )
    offsets = gsplat.isect_offset_encode(pairs, 1, *tiles).reshape(1, tiles[1], tiles[0])
    # gsplat draws a low-pass filter, too: a disc in the image, here far outside of it. The other backends have none.
    no_lowpass = torch.full_like(discs.box_centre, FAR_AWAY)
    # gsplat computes the distortion of the last channel.
    features = torch.cat([discs.colour - background, discs.depth[:, None]], dim=1)
    image, alpha, normal, distortion, _ = gsplat.rasterize_to_pixels_2dgs(
        no_lowpass[None],
        homography[None],
        features[None],
        discs.opacity[None],
        discs.normal[None],
        torch.zeros_like(no_lowpass[None]),
        camera.width,
        camera.height,
        TILE_SIZE,
        offsets,
        order,
        distloss="distortion" in outputs,
    )
    images = {
        "colour": image[0, ..., :3] + background,
        "alpha": alpha[0, ..., 0],
        "depth": image[0, ..., 3],
        "normal": normal[0],
        "distortion": distortion[0, ..., 0],
    }
    return Rendering(**{name: images[name].to(home) for name in outputs}, screen=screen)


def load_gsplat() -> Any:
    """Import gsplat.

    Returns:
        The package.

    Raises:
        SettingsError: If there is no CUDA device or gsplat is not installed.
    """
    if not torch.cuda.is_available():
        raise SettingsError("backend cuda: torch sees no CUDA device here; use backend cpu")
    try:
        import gsplat
    except ImportError as error:
        raise SettingsError("backend cuda: gsplat is not installed (pip install 'carigs[cuda]')") from error
    return gsplat
