"""The `cuda` backend: our projection in torch, tiles and compositing by gsplat (>= 1.5)'s 2D Gaussian kernels.

gsplat's `rasterization_2dgs` takes rotations and scales, which tangents that are not orthogonal do not have without a
decomposition that is singular for round surfels.  Its tile kernels take any homography, so the projection (a few lines)
is done here and no decomposition is needed.  gsplat is Apache-2.0; only its published functions are called.

Known differences from the `cpu` backend: the cap on alpha is compiled into gsplat (0.999 in 1.5, 0.99 in its main
branch), and sums are taken in no fixed order, so results differ in the last digits from run to run.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from carigs.errors import SettingsError
from carigs.splat.rasterizer import culling as limits

if TYPE_CHECKING:
    from carigs.capture.camera import Camera
    from carigs.splat.rasterizer.rasterize import Rendering, WorldSurfels

TILE = 16


class Projected(NamedTuple):
    """The surfels that can be drawn, as gsplat's tile kernels want them."""

    drawn: Bool[Tensor, "n"]
    """Which surfels follow, in order, in the other fields."""
    homography: Float[Tensor, "m 3 3"]
    """Rows: homogeneous pixel x, y, w as linear functions of the disc coordinates (s, t, 1)."""
    middle: Float[Tensor, "m 2"]
    """Middle of the box of the projected unit circle: centre of the low-pass filter."""
    radius: Int[Tensor, "m 2"]
    """Half sides in pixels of a box around `middle` that holds all alphas of 1/255 and more."""
    depth: Float[Tensor, "m"]
    normal: Float[Tensor, "m 3"]


def project(surfels: WorldSurfels, camera: Camera) -> Projected:
    """Homographies, boxes and normals in camera axes; the same rules of what is left out as in `projection.project`."""
    device = surfels.centre.device
    view = torch.as_tensor(camera.camera_from_world, dtype=torch.float32, device=device)
    intrinsics = torch.tensor(
        [[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]], dtype=torch.float32, device=device
    )
    centre = surfels.centre @ view[:3, :3].T + view[:3, 3]
    axes = torch.stack([surfels.tangent_u @ view[:3, :3].T, surfels.tangent_v @ view[:3, :3].T, centre], dim=2)
    with torch.no_grad():
        # In float64: products of scales of specks underflow.
        area = torch.linalg.cross(axes[:, :, 0].double(), axes[:, :, 1].double()).norm(dim=1)
        finite = (axes.sum((1, 2)) + surfels.opacity + surfels.colour.sum(1)).isfinite()
        rho2 = 2 * torch.log(255 * surfels.opacity)
        squared = (axes[:, 2, :2] / centre[:, 2:]).square().sum(1)
        horizon = (rho2 * squared - 1 < limits.HORIZON) & (squared - 1 < limits.HORIZON)
        drawn = finite & (centre[:, 2] > limits.NEAR) & (surfels.opacity >= limits.THRESHOLD)
        drawn &= (area > limits.SMALLEST_AREA) & horizon
    axes, rho2 = axes[drawn], rho2[drawn]
    homography = intrinsics @ axes
    # The circle s^2 + t^2 = r^2 touches the vertical line x where x^2 C_ww - 2 x C_xw + C_xx = 0, with
    # C = H diag(r^2, r^2, -1) H^T.
    middle, _ = _box(homography, torch.ones_like(rho2))
    with torch.no_grad():
        visible_middle, half = _box(homography, rho2)
        reach = torch.maximum((visible_middle - middle).abs() + half, (rho2 / 2).sqrt()[:, None])
        outside = (middle + reach < 0) | (middle - reach > torch.tensor([camera.width, camera.height], device=device))
        radius = torch.where(outside.any(1, keepdim=True), 0, reach.ceil()).int()
    normal = torch.linalg.cross(axes[:, :, 0], axes[:, :, 1])
    normal = torch.nn.functional.normalize(normal, dim=1, eps=limits.SMALLEST_AREA)
    facing = torch.where((normal * axes[:, :, 2]).sum(1, keepdim=True) > 0, -1.0, 1.0)
    return Projected(drawn, homography, middle, radius, axes[:, 2, 2], normal * facing)


def _box(homography: Float[Tensor, "m 3 3"], squared_radius: Float[Tensor, "m"]):
    """Middle and half sides of the box of a projected circle."""
    one = torch.ones_like(squared_radius)
    weighted = homography * torch.stack([squared_radius, squared_radius, -one], dim=1)[:, None, :]
    c = weighted @ homography.transpose(1, 2)
    middle = c[:, :2, 2] / c[:, 2, 2, None]
    squares = torch.stack([c[:, 0, 0], c[:, 1, 1]], dim=1) / c[:, 2, 2, None]
    return middle, (middle.square() - squares).clamp_min(0).sqrt()


def rasterize_cuda(
    surfels: WorldSurfels, camera: Camera, outputs: tuple[str, ...], background: float = 0.0
) -> Rendering:
    """As `carigs.splat.rasterizer.rasterize.rasterize`; images lie on the surfels' device.

    Raises SettingsError if there is no CUDA device or no gsplat.
    """
    from carigs.splat.rasterizer.rasterize import Rendering, Screen, WorldSurfels

    gsplat = _gsplat()
    device = surfels.centre.device
    fields = ("centre", "tangent_u", "tangent_v", "opacity", "colour")
    surfels = WorldSurfels(*(getattr(surfels, name).to("cuda") for name in fields))
    p = project(surfels, camera)
    count, index = len(surfels.centre), torch.nonzero(p.drawn)[:, 0]
    visible = torch.zeros(count, dtype=torch.bool, device="cuda")
    visible[index] = (p.radius > 0).all(1)
    screen = Screen(visible=visible.to(device))

    size = camera.width, camera.height
    tiles = -(-camera.width // TILE), -(-camera.height // TILE)
    _, pairs, order = gsplat.isect_tiles(p.middle[None].detach(), p.radius[None], p.depth[None].detach(), TILE, *tiles)
    offsets = gsplat.isect_offset_encode(pairs, 1, *tiles).reshape(1, tiles[1], tiles[0])
    probe = torch.zeros_like(p.middle[None], requires_grad=True)  # collects the gradient of the projected centres

    def keep(gradient: Tensor) -> None:
        screen.gradient = torch.zeros((count, 2), device="cuda").index_copy(0, index, gradient[0]).to(device)

    probe.register_hook(keep)
    # The last channel is taken as depth by the distortion.
    features = torch.cat([surfels.colour[index] - background, p.depth[:, None]], dim=1)
    image, alpha, normal, distortion, _ = gsplat.rasterize_to_pixels_2dgs(
        p.middle[None],
        p.homography[None],
        features[None],
        surfels.opacity[index][None],
        p.normal[None],
        probe,
        *size,
        TILE,
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
