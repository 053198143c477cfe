"""Differentiable rendering of 2D Gaussian surfels: one function with backends.

`cpu`: Numba, sixteen pixels at a time; `plain`: the same in plain loops; `cuda`: gsplat.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

# Before numba starts its threads: both then share one OpenMP pool instead of fighting for the cores.
import torch  # isort: skip
import numba
from jaxtyping import Bool, Float

from carigs.errors import SettingsError
from carigs.simd.vectors import WIDTH
from carigs.splat.rasterizer import backward, backward_simd, binning, forward, forward_simd, projection, projection_simd

if TYPE_CHECKING:
    from carigs.capture.camera import Camera

numba.config.THREADING_LAYER_PRIORITY = ["omp", "tbb", "workqueue"]

# Projection and compositing, each forward and backward: sixteen surfels or pixels at a time, or in plain loops that
# anyone can read and check.
_KERNELS = {
    "cpu": (
        projection_simd.project, forward_simd.composite, backward_simd.composite_backward,
        projection_simd.project_backward,
    ),
    "scalar": (projection.project, forward.composite, backward.composite_backward, projection.project_backward),
}  # fmt: skip
OUTPUTS = ("colour", "alpha", "depth", "normal", "distortion")


@dataclass
class WorldSurfels:
    """Flat Gaussians in world space: all that a rasteriser needs, float32."""

    centre: Float[torch.Tensor, "n 3"]
    tangent_u: Float[torch.Tensor, "n 3"]
    """First half axis at one sigma in metres: contains the scale; need not be orthogonal to the second."""
    tangent_v: Float[torch.Tensor, "n 3"]
    opacity: Float[torch.Tensor, "n"]
    """In [0, 1]; below 1/255 a surfel is not drawn."""
    colour: Float[torch.Tensor, "n 3"]


@dataclass
class Screen:
    """What density control wants to know about the surfels in one view; not differentiable."""

    visible: Bool[torch.Tensor, "n"] | None = None
    """Whether the surfel's visible extent reaches into the image."""
    gradient: Float[torch.Tensor, "n 2"] | None = None
    """After the backward pass: gradient of the loss with respect to the projected centre in pixels."""


@dataclass
class Rendering:
    """Sums over the surfels of each pixel, weighted by alpha compositing; None where not asked for."""

    colour: Float[torch.Tensor, "h w 3"] | None = None
    """Sum of weighted colours + (1 - alpha) * background."""
    alpha: Float[torch.Tensor, "h w"] | None = None
    """Sum of the weights."""
    depth: Float[torch.Tensor, "h w"] | None = None
    """Weighted sum of the centres' depths in metres (divide by alpha for the mean)."""
    normal: Float[torch.Tensor, "h w 3"] | None = None
    """Weighted sum of unit normals in camera axes, each turned towards the camera."""
    distortion: Float[torch.Tensor, "h w"] | None = None
    """Sum over pairs of surfels of w_i w_j |Z_i - Z_j| in metres."""
    screen: Screen = field(default_factory=Screen)


def rasterize(
    surfels: WorldSurfels,
    camera: Camera,
    *,
    backend: str = "cpu",
    outputs: tuple[str, ...] = OUTPUTS,
    background: float = 0.0,
    alpha_cap: float = 0.99,
) -> Rendering:
    """Render surfels before a uniform grey `background`, differentiably with respect to all five of their tensors.

    `outputs` names what is wanted; without depth, normal and distortion their cost is saved.  `alpha_cap` limits a
    surfel's alpha (2D Gaussian Splatting and gsplat's main branch: 0.99; the `cuda` backend has its own).  Surfels that
    have no image (a number that is not finite, no area, behind the camera or crossing its plane, opacity < 1/255) are
    left out and get zero gradients.
    Backend `cpu` uses numba's current number of threads; its images and gradients do not depend on it.  `plain` is the
    same in plain loops, several times slower.

    Raises SettingsError for an unknown backend or output, ValueError for tensors of a wrong shape or type.
    """
    unknown = [name for name in outputs if name not in OUTPUTS]
    if unknown:
        raise SettingsError(f"rasterize: unknown output {unknown[0]!r}; known: {', '.join(OUTPUTS)}")
    if not 0.0 < alpha_cap < 1.0:
        raise SettingsError(f"rasterize: alpha_cap must lie in (0, 1), not {alpha_cap}")
    _check(surfels)
    if backend == "cuda":
        from carigs.splat.rasterizer.cuda import rasterize_cuda

        return rasterize_cuda(surfels, camera, outputs, background)
    if backend not in _KERNELS:
        raise SettingsError(f"rasterize: unknown backend {backend!r}; known: {', '.join(_KERNELS)}, cuda")
    geometry = any(name in outputs for name in ("depth", "normal", "distortion"))
    screen, wanted = Screen(), tuple(name for name in OUTPUTS if name in outputs)
    tensors = (surfels.centre, surfels.tangent_u, surfels.tangent_v, surfels.opacity, surfels.colour)
    images = _Rasterize.apply(*tensors, camera, wanted, geometry, background, alpha_cap, screen, _KERNELS[backend])
    return Rendering(**dict(zip(wanted, images, strict=True)), screen=screen)


def _check(surfels: WorldSurfels) -> None:
    count = len(surfels.centre)
    for name, shape in (("centre", (3,)), ("tangent_u", (3,)), ("tangent_v", (3,)), ("opacity", ()), ("colour", (3,))):
        tensor = getattr(surfels, name)
        if tensor.shape != (count, *shape) or tensor.dtype != torch.float32:
            expected = ("n", *shape)
            raise ValueError(f"surfels.{name}: expected float32 {expected}, got {tensor.dtype} {tuple(tensor.shape)}")


_PLACES = {"colour": slice(1, 4), "alpha": 0, "depth": 4, "normal": slice(5, 8), "distortion": 8}
"""Planes of the kernels' images that hold each output; plane 0 is the transmittance, but the gradient of alpha."""


class _Rasterize(torch.autograd.Function):
    """Arrays in, planes out; the images handed to torch are views of planes, so that nothing is copied."""

    @staticmethod
    def forward(
        ctx, centre, tangent_u, tangent_v, opacity, colour, camera, wanted, geometry, background, cap, screen, kernels
    ):
        arrays = [t.detach().contiguous().numpy() for t in (centre, tangent_u, tangent_v, opacity, colour)]
        view = tuple(float(x) for x in camera.camera_from_world[:3].reshape(-1))
        intrinsics = (float(camera.fx), float(camera.fy), float(camera.cx), float(camera.cy))
        size = (int(camera.width), int(camera.height))
        project, composite, ctx.composite_backward, ctx.project_backward = kernels
        if len(centre) < WIDTH:
            project, ctx.project_backward = projection.project, projection.project_backward
        record, box, tiles = project(*arrays, view, intrinsics, *size, binning.TILE, background)
        lists = binning.tile_lists(record[:, projection.DEPTH], box, tiles, *size, _workers())
        image = composite(
            record, box, lists.surfel, lists.start, lists.order, *size, cap, geometry, background, _workers()
        )
        screen.visible = torch.from_numpy(tiles > 0)
        ctx.set_materialize_grads(False)
        ctx.arrays, ctx.view, ctx.intrinsics, ctx.size = arrays, view, intrinsics, size
        ctx.record, ctx.box, ctx.lists, ctx.image, ctx.wanted = record, box, lists, image, wanted
        ctx.background, ctx.cap, ctx.screen = background, cap, screen
        planes = torch.from_numpy(image)
        images = {name: planes[_PLACES[name]] for name in wanted}
        if "alpha" in images:
            images["alpha"] = 1.0 - images["alpha"]
        return tuple(image.permute(1, 2, 0) if image.ndim == 3 else image for image in images.values())

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, *given):
        gradients = {
            name: g.permute(2, 0, 1) if g.ndim == 3 else g
            for name, g in zip(ctx.wanted, given, strict=True)
            if g is not None
        }
        # Geometry that no loss term used needs no geometry in the backward either.
        geometry = any(name not in ("colour", "alpha") for name in gradients)
        if list(gradients) == ["colour"]:
            upstream = gradients["colour"].contiguous()
        else:
            upstream = torch.zeros((forward.PLANES if geometry else forward.COLOUR_PLANES, *ctx.image.shape[1:]))
            for name, gradient in gradients.items():
                upstream[_PLACES[name]] = gradient
        lists = ctx.lists
        slots = ctx.composite_backward(
            ctx.record,
            ctx.box,
            lists.surfel,
            lists.slot,
            lists.start,
            lists.order,
            ctx.image,
            upstream.numpy(),
            *ctx.size,
            ctx.cap,
            geometry,
            ctx.background,
            _workers(),
        )
        centre, tangent_u, tangent_v, opacity, _ = ctx.arrays
        *surfel_gradients, pixel = ctx.project_backward(
            slots, lists.first_slot, centre, tangent_u, tangent_v, opacity, ctx.view, ctx.intrinsics
        )
        ctx.screen.gradient = torch.from_numpy(pixel)
        return *(torch.from_numpy(g) for g in surfel_gradients), *[None] * 7


def _workers() -> int:
    return numba.get_num_threads()
