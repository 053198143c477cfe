"""Differentiable rasterization of 2D Gaussian surfels: one function, four backends.

- `cpu`: Numba, sixteen surfels or pixels at a time.
- `scalar`: the same algorithm in plain Numba loops, the readable reference; several times slower.
- `torch`: the same algorithm in plain PyTorch on the device of the surfels; slower still on a CPU.
- `cuda`: gsplat.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

# Before numba starts its threads: both then share one OpenMP pool instead of competing for the cores.
import torch  # isort: skip
import numba
import numpy as np

from carigs.errors import SettingsError
from carigs.simd.vectors import WIDTH
from carigs.splat.rasterizer import backward, backward_simd, binning, forward, forward_simd, projection, projection_simd
from carigs.splat.rasterizer.cuda import rasterize_cuda
from carigs.splat.rasterizer.interface import OUTPUTS, Rendering, Screen, WorldSurfels
from carigs.splat.rasterizer.records import (
    NUM_COLOUR_PLANES,
    NUM_GEOMETRY_PLANES,
    NUM_PLANES,
    RECORD_COLUMN,
    Compositing,
    Pinhole,
    SurfelArrays,
)
from carigs.splat.rasterizer.torch_rasterizer import rasterize_torch

if TYPE_CHECKING:
    from carigs.capture.camera import Camera

numba.config.THREADING_LAYER_PRIORITY = ["omp", "tbb", "workqueue"]

# Projection and compositing, each forward and backward.
_KERNELS = {
    "cpu": (
        projection_simd.project_surfels, forward_simd.composite, backward_simd.composite_backward,
        projection_simd.project_surfels_backward,
    ),
    "scalar": (
        projection.project_surfels, forward.composite, backward.composite_backward, projection.project_surfels_backward,
    ),
}  # fmt: skip
FIELDS = ("centre", "tangent_u", "tangent_v", "opacity", "colour")
"""Differentiable tensors of `WorldSurfels`."""


def rasterize(
    surfels: WorldSurfels,
    camera: Camera,
    *,
    backend: str = "cpu",
    outputs: tuple[str, ...] = OUTPUTS,
    background: float = 0.0,
    alpha_cap: float = 0.99,
) -> Rendering:
    """Render surfels over a uniform grey background, differentiably with respect to their five tensors.

    Culled surfels get zero gradients: those with a number that is not finite or beyond 1e9 m, without area, behind the
    camera, crossing the camera plane, or with an opacity below 1/255. The backends `cpu` and `scalar` use Numba's
    current number of threads; images and gradients do not depend on it.

    Args:
        surfels: Surfels in world space, float32.
        camera: Pinhole camera.
        backend: `cpu`, `scalar`, `torch` or `cuda`.
        outputs: Names of the images to compute, of OUTPUTS. Rendering is cheaper without distortion,
            and cheaper still without depth and normal.
        background: Grey value behind the surfels.
        alpha_cap: Upper limit of a surfel's alpha (2DGS and gsplat's main branch: 0.99); `cuda` uses gsplat's own.

    Returns:
        The requested images and the surfels' screen-space quantities.

    Raises:
        SettingsError: If the backend or an output is unknown, `alpha_cap` is out of range, or CUDA is not available.
        ValueError: If a tensor has the wrong shape or type.

    Example:
        >>> rendering = rasterize(surfels, camera, outputs=("colour", "alpha"), background=1.0)
        >>> (rendering.colour - photo).abs().mean().backward()
        >>> rendering.screen.gradient.norm(dim=1)  # for density control
    """
    unknown = [name for name in outputs if name not in OUTPUTS]
    if unknown:
        raise SettingsError(f"rasterize: unknown output {unknown[0]!r}; known: {', '.join(OUTPUTS)}")
    if not 0.0 < alpha_cap < 1.0:
        raise SettingsError(f"rasterize: alpha_cap must lie in (0, 1), not {alpha_cap}")
    _check(surfels)
    if backend == "cuda":
        return rasterize_cuda(surfels, camera, outputs, background)
    if backend == "torch":
        return rasterize_torch(surfels, camera, outputs, background, alpha_cap)
    if backend not in _KERNELS:
        raise SettingsError(f"rasterize: unknown backend {backend!r}; known: {', '.join(_KERNELS)}, torch, cuda")
    screen, names = Screen(), tuple(name for name in OUTPUTS if name in outputs)
    compositing = Compositing(int(camera.width), int(camera.height), np.float32(alpha_cap), np.float32(background))
    tensors = (getattr(surfels, name) for name in FIELDS)
    images = _Rasterize.apply(*tensors, _pinhole(camera), compositing, background, names, screen, _KERNELS[backend])
    return Rendering(**dict(zip(names, images, strict=True)), screen=screen)


def _check(surfels: WorldSurfels) -> None:
    count = len(surfels.centre)
    for name in FIELDS:
        tensor, expected = getattr(surfels, name), (count,) if name == "opacity" else (count, 3)
        if tensor.shape != expected or tensor.dtype != torch.float32:
            raise ValueError(f"surfels.{name}: expected float32 {expected}, got {tensor.dtype} {tuple(tensor.shape)}")


def _pinhole(camera: Camera) -> Pinhole:
    rotation, translation = camera.camera_from_world[:3, :3].reshape(-1), camera.camera_from_world[:3, 3]
    numbers = (camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height)
    return Pinhole(tuple(map(float, rotation)), tuple(map(float, translation)), *map(float, numbers))


_PLANES = {"colour": slice(1, 4), "alpha": 0, "depth": 4, "normal": slice(5, 8), "distortion": 8}
"""Planes of the kernels' images; plane 0 of an image holds the transmittance, of its gradient that of alpha."""

_OUTPUTS_OF_PLANES = {
    NUM_COLOUR_PLANES: ("alpha", "colour"),
    NUM_GEOMETRY_PLANES: ("alpha", "colour", "depth", "normal"),
    NUM_PLANES: OUTPUTS,
}
"""Outputs by the number of planes that hold them."""


def _num_planes(names: Iterable[str]) -> int:
    """The smallest number of planes that hold some outputs."""
    return min(count for count, outputs in _OUTPUTS_OF_PLANES.items() if set(names) <= set(outputs))


class _Rasterize(torch.autograd.Function):
    """Autograd function around the kernels. The images are views of one array of planes: nothing is copied."""

    @staticmethod
    def forward(
        ctx, centre, tangent_u, tangent_v, opacity, colour, camera, compositing, background, names, screen, kernels
    ):
        tensors = (centre, tangent_u, tangent_v, opacity, colour)
        surfels = SurfelArrays(*(tensor.detach().contiguous().numpy() for tensor in tensors))
        project, composite, ctx.composite_backward, ctx.project_backward = kernels
        if len(centre) < WIDTH:
            project, ctx.project_backward = projection.project_surfels, projection.project_surfels_backward
        projected = project(surfels, camera, background)
        depth, workers = projected.record[:, RECORD_COLUMN.depth], numba.get_num_threads()
        lists = binning.tile_lists(
            depth, projected.box, projected.num_tiles, compositing.width, compositing.height, workers
        )
        image = composite(projected, lists, compositing, _num_planes(names), workers)
        screen.visible = torch.from_numpy(projected.num_tiles > 0)
        ctx.set_materialize_grads(False)
        ctx.surfels, ctx.camera, ctx.compositing, ctx.names, ctx.screen = surfels, camera, compositing, names, screen
        ctx.projected, ctx.lists, ctx.image = projected, lists, image
        planes = torch.from_numpy(image)
        images = {name: planes[_PLANES[name]] for name in names}
        if "alpha" in images:
            images["alpha"] = 1.0 - images["alpha"]
        return tuple(image.permute(1, 2, 0) if image.ndim == 3 else image for image in images.values())

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, *image_gradients):
        gradients = {
            name: g.permute(2, 0, 1) if g.ndim == 3 else g
            for name, g in zip(ctx.names, image_gradients, strict=True)
            if g is not None
        }
        if list(gradients) == ["colour"]:
            upstream = gradients["colour"].contiguous()
        else:
            # Depth, normal and distortion that no loss term uses are left out of the backward pass, too.
            upstream = torch.empty((_num_planes(gradients), *ctx.image.shape[1:]))
            for name in _OUTPUTS_OF_PLANES[len(upstream)]:
                upstream[_PLANES[name]] = gradients.get(name, 0)
        slots = ctx.composite_backward(
            ctx.projected, ctx.lists, ctx.compositing, ctx.image, upstream.numpy(), numba.get_num_threads()
        )
        *surfel_gradients, projected_centre = ctx.project_backward(slots, ctx.lists.first_slot, ctx.surfels, ctx.camera)
        ctx.screen.gradient = torch.from_numpy(projected_centre)
        return *(torch.from_numpy(gradient) for gradient in surfel_gradients), *[None] * 6
