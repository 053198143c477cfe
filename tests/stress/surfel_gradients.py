"""Images of surfels and gradients of a linear functional of them: of the kernels, and of the float64 reference."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32

from carigs.capture import Camera
from carigs.splat.rasterizer.rasterize import FIELDS, OUTPUTS, WorldSurfels, rasterize
from stress.case import Measure, violations
from stress.surfel_reference import render
from stress.surfel_scenes import CAMERA

CLEAR = 1e-4
"""Relative distance from thresholds below which a pixel is not compared: float32 may fall on the other side."""
Arrays = Sequence[Float32[np.ndarray, "..."]]


class Drawn(NamedTuple):
    """Images in the order of `OUTPUTS`, and gradients in the order of `FIELDS`."""

    images: list[torch.Tensor]
    gradients: list[torch.Tensor]

    def values(self) -> list[torch.Tensor]:
        """All tensors.

        Returns:
            Images, then gradients.
        """
        return [*self.images, *self.gradients]


def leaves(arrays: Arrays, dtype: torch.dtype = torch.float32) -> list[torch.Tensor]:
    """Tensors with gradients.

    Args:
        arrays: Fields of surfels.
        dtype: Type of the tensors.

    Returns:
        Leaf tensors of the same values.
    """
    return [torch.tensor(array).to(dtype).requires_grad_(True) for array in arrays]


def loss(images: Sequence[torch.Tensor]) -> torch.Tensor:
    """A linear functional of images.

    Args:
        images: The images.

    Returns:
        Their sum, weighted by fixed random numbers.
    """
    generator = torch.Generator().manual_seed(5)
    return sum((image * torch.randn(image.shape, generator=generator)).sum() for image in images)


def measured(
    arrays: Arrays, camera: Camera = CAMERA, clear: Bool[torch.Tensor, "h w"] | None = None, backend: str = "cpu"
) -> Drawn:
    """Images and gradients of the kernels.

    Args:
        arrays: Fields of the surfels.
        camera: The camera.
        clear: Pixels that count; the others are set to zero.
        backend: Backend of the rasterizer.

    Returns:
        Images and gradients.
    """
    tensors = leaves(arrays)
    rendering = rasterize(WorldSurfels(*tensors), camera, backend=backend)
    images = [_masked(getattr(rendering, name), clear) for name in OUTPUTS]
    loss(images).backward()
    return Drawn([image.detach() for image in images], [tensor.grad for tensor in tensors])


def defined(
    arrays: Arrays,
    camera: Camera = CAMERA,
    clear: Bool[torch.Tensor, "h w"] | None = None,
    shift: tuple[float, float] = (0.0, 0.0),
) -> tuple[Drawn, Bool[torch.Tensor, "h w"]]:
    """Images and gradients of the reference.

    Args:
        arrays: Fields of the surfels.
        camera: The camera.
        clear: Pixels that count; by default those in which no quantity is near its threshold.
        shift: Of the camera's principal point in pixels.

    Returns:
        Images and gradients, and the pixels that count.
    """
    tensors = leaves(arrays, torch.float64)
    rendering = render(tensors, replace(camera, cx=camera.cx + shift[0], cy=camera.cy + shift[1]))
    clear = rendering["margin"] > CLEAR if clear is None else clear
    images = [_masked(rendering[name], clear) for name in OUTPUTS]
    total = loss(images)
    gradients = [torch.zeros_like(tensor) for tensor in tensors]
    if total.requires_grad:  # false where nothing is drawn
        found = torch.autograd.grad(total, tensors, allow_unused=True)
        gradients = [g if f is None else f for f, g in zip(found, gradients, strict=True)]
    return Drawn([image.detach() for image in images], gradients), clear


def agreement(arrays: Arrays, camera: Camera = CAMERA, backend: str = "cpu") -> Iterator[Measure]:
    """Compare the kernels with the reference.

    Where the image of a surfel is thinner than the float32 spacing of pixel positions, differences count beyond the
    effect of that spacing.

    Args:
        arrays: Fields of the surfels.
        camera: The camera.
        backend: Backend of the rasterizer.

    Yields:
        Errors of images and gradients.
    """
    expected, clear = defined(arrays, camera)
    found = measured(arrays, camera, clear, backend)
    yield violations("numbers that are not finite", ~np.concatenate([v.isfinite().ravel() for v in found.values()]))
    slack = Drawn(*([torch.zeros_like(value) for value in values] for values in expected))
    measures = list(_errors(found, expected, slack))
    if not all(measure.holds for measure in measures):
        measures = list(_errors(found, expected, _blur(arrays, camera, expected, clear)))
    yield from measures


def _masked(image: torch.Tensor, clear: torch.Tensor | None) -> torch.Tensor:
    return image if clear is None else image * (clear if image.ndim == 2 else clear[..., None])


def _blur(arrays: Arrays, camera: Camera, expected: Drawn, clear: Bool[torch.Tensor, "h w"]) -> Drawn:
    """Change of images and gradients when pixel positions move by one float32 spacing."""
    digit = float(np.spacing(np.float32(max(camera.width, camera.height))))
    total = [torch.zeros_like(value) for value in expected.values()]
    for shift in ((digit, 0.0), (0.0, digit)):
        moved, _ = defined(arrays, camera, clear, shift)
        total = [t + (a - b).abs() for t, a, b in zip(total, moved.values(), expected.values(), strict=True)]
    return Drawn(total[: len(OUTPUTS)], total[len(OUTPUTS) :])


def _errors(found: Drawn, expected: Drawn, slack: Drawn) -> Iterator[Measure]:
    """Images to 1e-5, each gradient to 1e-4, and each surfel to 1e-3: one with huge gradients would hide the others."""
    for name, f, e, s in zip(OUTPUTS, found.images, expected.images, slack.images, strict=True):
        scale = max(float(e.abs().max()), 1.0)
        yield Measure(f"error of {name}", float(((f - e).abs() - s).max()) / scale, 1e-5)
    for name, f, e, s in zip(FIELDS, found.gradients, expected.gradients, slack.gradients, strict=True):
        error, own = _row_norms(f - e), _row_norms(e)
        yield Measure(f"error of the gradient of {name}", _ratio(error.norm() - s.norm(), own.norm()), 1e-4)
        typical = own[own > 0].median() if own.any() else torch.tensor(0.0)
        worst = max(
            (_ratio(a, b) for a, b in zip(error - _row_norms(s), own.clamp_min(typical), strict=True)), default=0
        )
        yield Measure(f"error of the gradient of a surfel's {name}", worst, 1e-3)


def _ratio(error: torch.Tensor, size: torch.Tensor) -> float:
    """Relative error; infinite if something that should be zero is not."""
    return 0.0 if error <= 0 else float(error / size) if size > 0 else np.inf


def _row_norms(gradient: torch.Tensor) -> Float[torch.Tensor, " n"]:
    return gradient.reshape(len(gradient), -1).norm(dim=1)
