"""The `cuda` backend: projection in torch, tiles and compositing by gsplat's 2D Gaussian kernels (>= 1.5).

gsplat's `rasterization_2dgs` takes rotations and scales. Tangents that are not orthogonal have those only after a
decomposition that is singular for round surfels. gsplat's tile kernels take any homography; the projection is therefore
done here. gsplat is Apache-2.0; only its published functions are called.

Differences from the `cpu` backend: the cap on alpha is compiled into gsplat (0.999 in 1.5, 0.99 in its main branch),
and sums have no fixed order, so that results differ in the last digits from run to run.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from carigs.errors import SettingsError
from carigs.splat.rasterizer.interface import Rendering, Screen, WorldSurfels
from carigs.splat.rasterizer.records import (
    ALPHA_THRESHOLD,
    CAMERA_PLANE_MARGIN,
    MAX_SQUARED_LENGTH,
    MIN_AREA,
    NEAR_PLANE,
)

if TYPE_CHECKING:
    from carigs.capture.camera import Camera

TILE_SIZE = 16
"""Pixels along a tile's side in gsplat's kernels."""


class GsplatSurfels(NamedTuple):
    """The m surfels that are not culled, as gsplat's tile kernels take them."""

    kept: Bool[Tensor, " n"]
    """Surfels that are not culled; they follow, in order, in the other fields."""
    homography: Float[Tensor, "m 3 3"]
    """From disc coordinates (s, t, 1) to homogeneous pixel coordinates."""
    lowpass_centre: Float[Tensor, "m 2"]
    """Centre of the box of the projected unit circle in pixels (gsplat: means2d)."""
    radius: Int[Tensor, "m 2"]
    """Half sides in pixels of a box around `lowpass_centre` that contains all alphas of 1/255 or more."""
    depth: Float[Tensor, " m"]
    """Depth of the centres in metres."""
    normal: Float[Tensor, "m 3"]
    """Unit normals in camera axes that face the camera."""


def disc_homographies(surfels: WorldSurfels, camera: Camera) -> GsplatSurfels:
    """Homographies, boxes and normals of the surfels, with the culling of `projection.project_surfels`.

    Args:
        surfels: Surfels in world space.
        camera: Pinhole camera.

    Returns:
        The surfels that are not culled, differentiable except for `kept` and `radius`.
    """
    device = surfels.centre.device
    camera_from_world = torch.as_tensor(camera.camera_from_world, dtype=torch.float32, device=device)
    rotation = camera_from_world[:3, :3]
    intrinsics = torch.tensor(
        [[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]], dtype=torch.float32, device=device
    )
    centre = surfels.centre @ rotation.T + camera_from_world[:3, 3]
    axes = torch.stack([surfels.tangent_u @ rotation.T, surfels.tangent_v @ rotation.T, centre], dim=2)
    with torch.no_grad():
        # In float64: in float32 the products of very small scales underflow.
        area = torch.linalg.cross(axes[:, :, 0].double(), axes[:, :, 1].double()).norm(dim=1)
        finite = (surfels.opacity + surfels.colour.sum(1)).isfinite()
        finite &= axes.double().square().sum((1, 2)) < MAX_SQUARED_LENGTH
        rho2 = 2 * torch.log(255 * surfels.opacity)
        squared = (axes[:, 2, :2] / centre[:, 2:]).square().sum(1)
        in_front = (rho2 * squared - 1 < CAMERA_PLANE_MARGIN) & (squared - 1 < CAMERA_PLANE_MARGIN)
        kept = finite & (centre[:, 2] > NEAR_PLANE) & (surfels.opacity >= ALPHA_THRESHOLD)
        kept &= (area > MIN_AREA) & in_front
    axes, rho2 = axes[kept], rho2[kept]
    homography = intrinsics @ axes
    lowpass_centre, _ = _circle_box(homography, torch.ones_like(rho2))
    with torch.no_grad():
        visible_centre, half = _circle_box(homography, rho2)
        reach = torch.maximum((visible_centre - lowpass_centre).abs() + half, (rho2 / 2).sqrt()[:, None])
        size = torch.tensor([camera.width, camera.height], device=device)
        outside = (lowpass_centre + reach < 0) | (lowpass_centre - reach > size)
        radius = torch.where(outside.any(1, keepdim=True), 0, reach.ceil()).int()
    normal = torch.linalg.cross(axes[:, :, 0], axes[:, :, 1])
    normal = torch.nn.functional.normalize(normal, dim=1, eps=MIN_AREA)
    sign = torch.where((normal * axes[:, :, 2]).sum(1, keepdim=True) > 0, -1.0, 1.0)
    return GsplatSurfels(kept, homography, lowpass_centre, radius, axes[:, 2, 2], normal * sign)


def _circle_box(
    homography: Float[Tensor, "m 3 3"], squared_radius: Float[Tensor, " m"]
) -> tuple[Float[Tensor, "m 2"], Float[Tensor, "m 2"]]:
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
    gsplat = _gsplat()
    device = surfels.centre.device
    fields = ("centre", "tangent_u", "tangent_v", "opacity", "colour")
    surfels = WorldSurfels(*(getattr(surfels, name).to("cuda") for name in fields))
    discs = disc_homographies(surfels, camera)
    count, index = len(surfels.centre), torch.nonzero(discs.kept)[:, 0]
    visible = torch.zeros(count, dtype=torch.bool, device="cuda")
    visible[index] = (discs.radius > 0).all(1)
    screen = Screen(visible=visible.to(device))

    tiles = -(-camera.width // TILE_SIZE), -(-camera.height // TILE_SIZE)
    _, pairs, order = gsplat.isect_tiles(
        discs.lowpass_centre[None].detach(), discs.radius[None], discs.depth[None].detach(), TILE_SIZE, *tiles
    )
    offsets = gsplat.isect_offset_encode(pairs, 1, *tiles).reshape(1, tiles[1], tiles[0])
    # gsplat returns the gradient of the projected centres as that of this tensor.
    densify = torch.zeros_like(discs.lowpass_centre[None], requires_grad=True)

    def keep_gradient(gradient: Tensor) -> None:
        screen.gradient = torch.zeros((count, 2), device="cuda").index_copy(0, index, gradient[0]).to(device)

    densify.register_hook(keep_gradient)
    # gsplat computes the distortion of the last channel.
    features = torch.cat([surfels.colour[index] - background, discs.depth[:, None]], dim=1)
    image, alpha, normal, distortion, _ = gsplat.rasterize_to_pixels_2dgs(
        discs.lowpass_centre[None],
        discs.homography[None],
        features[None],
        surfels.opacity[index][None],
        discs.normal[None],
        densify,
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
    return Rendering(**{name: images[name].to(device) for name in outputs}, screen=screen)


def _gsplat():
    if not torch.cuda.is_available():
        raise SettingsError("backend cuda: torch sees no CUDA device here; use backend cpu")
    try:
        import gsplat
    except ImportError as error:
        raise SettingsError("backend cuda: gsplat is not installed (pip install 'carigs[cuda]')") from error
    return gsplat
