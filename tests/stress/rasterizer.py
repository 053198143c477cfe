"""The surfel rasterizer on scenes that break numerics, against closed forms and a dense float64 reference.

Example:
    PYTHONPATH=tests python -m stress.rasterizer results/stress/rasterizer.csv
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
import torch
from jaxtyping import Float64

from carigs.capture import Camera
from carigs.splat.rasterizer.rasterize import FIELDS, OUTPUTS, WorldSurfels, rasterize
from carigs.splat.rasterizer.records import ALPHA_THRESHOLD, MIN_AREA, TRANSMITTANCE_THRESHOLD
from evaluation.command_line import run
from stress.case import Case, Measure, difference, run_suite, violations
from stress.surfel_gradients import Arrays, agreement, defined, leaves, loss, measured
from stress.surfel_reference import render
from stress.surfel_scenes import CAMERA, KINDS, scene

CAP = 0.99
FLAT = replace(CAMERA, fx=60, fy=60, cx=16.5, cy=13.5)
"""Camera whose optical axis goes through the centre of a pixel."""


def cases() -> Iterator[Case]:
    """All cases.

    Yields:
        Cases.
    """
    for kind, seed in product(KINDS, range(3)):
        yield Case(f"{kind} alone, {seed}", partial(drawn, scene([kind], seed), CAMERA))
        yield Case(
            f"{kind} among others, {seed}", partial(drawn, scene(["regular", kind, "regular"] * 3, seed), CAMERA)
        )
        yield Case(f"twenty {kind}, {seed}", partial(drawn, scene([kind] * 20, seed), CAMERA))
    for width, height in ((1, 1), (1, 9), (17, 1), (16, 16), (33, 27), (48, 5)):
        for count in (1, 15, 16, 17):
            camera = replace(CAMERA, width=width, height=height, cx=0.49 * width, cy=0.52 * height)
            arrays = scene((["regular", "tiny", "huge"] * count)[:count], count)
            yield Case(f"{count} surfels on {width} x {height} pixels", partial(drawn, arrays, camera))
    for view, camera in CAMERAS.items():
        yield Case(f"camera with {view}", partial(drawn, scene(["regular"] * 12, 3), camera))
    for scale, opacity in product((1e-12, 2e-12, 1e-9, 1e-6, 1e-3, 0.1, 1e3), (0.0, 0.003, 0.5, 0.99, 1.0)):
        yield Case(f"disc of {scale:g} m, opacity {opacity:g}", partial(head_on_disc, scale, opacity))
    for count, opacity in product((1, 100, 3000), (0.005, 0.3, 0.9, 1.0)):
        yield Case(f"{count} surfels of opacity {opacity:g} on one pixel", partial(pile, count, opacity))
    for count in (0, 1, 16):
        yield Case(f"{count} surfels that are not drawn", partial(nothing, count))
    for seed, kinds in product(range(4), (["regular"], ["regular", "tiny", "far", "close"])):
        name = " and ".join(kinds)
        yield Case(f"{name} in another order, {seed}", partial(permuted, scene(kinds * (24 // len(kinds)), seed), seed))
        yield Case(f"{name} by scalar code, {seed}", partial(scalar, scene(kinds * (24 // len(kinds)), seed)))
    for seed, kind in product(range(3), ("regular", "far", "close")):
        yield Case(f"finite differences, {kind}, {seed}", partial(finite_differences, scene([kind] * 6, seed), seed))
    for (field, name), value in product(enumerate(FIELDS), (np.nan, np.inf, -np.inf)):
        yield Case(f"{name} is {value}", partial(not_finite, field, value))
    for (field, name), size in product(enumerate(FIELDS[:3]), (1e6, 1e10, 1e20, 1e30, 1e38)):
        yield Case(f"{name} of {size:g} m", partial(enormous, field, size))
    for name, options in INVALID.items():
        yield Case(name, partial(refused, options), invalid=True)


CAMERAS = {
    "a principal point off the image": replace(CAMERA, cx=-20.0, cy=40.0),
    "a long focal length": replace(CAMERA, fx=3000.0, fy=3000.0),
    "a short focal length": replace(CAMERA, fx=2.0, fy=2.0),
    "pixels that are not square": replace(CAMERA, fx=300.0, fy=20.0),
}
INVALID = {
    "unknown backend": {"backend": "opengl"},
    "unknown output": {"outputs": ("colour", "albedo")},
    "cap of 0": {"alpha_cap": 0.0},
    "cap of 1": {"alpha_cap": 1.0},
    "cap that is not a number": {"alpha_cap": float("nan")},
}


def drawn(arrays: Arrays, camera: Camera) -> Iterator[Measure]:
    """Compare a scene with the reference, and its transmittance and distortion with their ranges.

    Args:
        arrays: Fields of the surfels.
        camera: The camera.

    Yields:
        Errors of images and gradients, and pixels out of range.
    """
    yield from agreement(arrays, camera)
    with torch.no_grad():
        rendering = rasterize(WorldSurfels(*leaves(arrays)), camera)
    yield violations("alpha beyond [0, 1]", ~((rendering.alpha >= 0) & (rendering.alpha <= 1)).numpy())
    depths = rendering.depth.abs().max().clamp_min(1.0)
    yield violations("negative distortion", (rendering.distortion < -1e-5 * depths).numpy())
    yield violations("normals longer than alpha", (rendering.normal.norm(dim=2) > rendering.alpha + 1e-5).numpy())


def head_on_disc(scale: float, opacity: float) -> Iterator[Measure]:
    """A round disc parallel to the image, on the optical axis at 2 m.

    Args:
        scale: Standard deviation in metres.
        opacity: Opacity.

    Yields:
        Errors of all images against the closed form.
    """
    arrays = [np.array([[0, 0, 2]]), np.array([[scale, 0, 0]]), np.array([[0, scale, 0]]), np.array([opacity])]
    arrays = [np.asarray(array, np.float32) for array in [*arrays, np.array([[0.2, 0.5, 1.0]])]]
    rendering = rasterize(WorldSurfels(*(torch.from_numpy(a) for a in arrays)), FLAT, background=0.25)
    x, y = np.meshgrid(np.arange(33) + 0.5 - FLAT.cx, np.arange(27) + 0.5 - FLAT.cy)
    squared = x**2 + y**2
    sigma = FLAT.fx * float(arrays[1][0, 0]) / 2
    raw = float(arrays[3][0]) * np.exp(-0.5 * squared / sigma**2)
    alpha = np.where(raw >= ALPHA_THRESHOLD, np.minimum(raw, CAP), 0.0)
    clear = np.abs(raw / ALPHA_THRESHOLD - 1) > 1e-4
    if float(arrays[1][0, 0]) ** 2 <= MIN_AREA:
        alpha = np.zeros_like(alpha)
    yield difference("alpha", rendering.alpha.numpy()[clear], alpha[clear], 1e-5)
    colour = alpha[..., None] * np.array([0.2, 0.5, 1.0]) + 0.25 * (1 - alpha[..., None])
    yield difference("colour", rendering.colour.numpy()[clear], colour[clear], 1e-5)
    yield difference("depth", rendering.depth.numpy()[clear], 2 * alpha[clear], 2e-5)
    yield difference("normal", rendering.normal.numpy()[clear], alpha[clear][:, None] * [[0, 0, -1]], 1e-5)
    yield difference("distortion of a single surfel", rendering.distortion, 0.0, 0.0)


def pile(count: int, opacity: float) -> Iterator[Measure]:
    """Many discs behind each other whose centres fall on one pixel.

    Args:
        count: Number of discs.
        opacity: Opacity of each.

    Yields:
        Errors of transmittance and depth there against the geometric series, and values that are not finite.
    """
    depth = np.linspace(1.0, 3.0, count, dtype=np.float32)
    zero = np.zeros(count, np.float32)
    arrays = [np.column_stack([zero, zero, depth]), np.tile(np.float32([0.01, 0, 0]), (count, 1))]
    arrays += [np.tile(np.float32([0, 0.01, 0]), (count, 1)), np.full(count, opacity, np.float32)]
    arrays += [np.ones((count, 3), np.float32)]
    found = measured(arrays, FLAT)
    yield violations("numbers that are not finite", ~np.concatenate([v.isfinite().ravel() for v in found.values()]))
    alpha = min(opacity, CAP)
    left = (1 - alpha) ** np.arange(count + 1)
    drawn_count = int((left[1:] > TRANSMITTANCE_THRESHOLD * (1 + 1e-9)).sum())
    weights = left[:drawn_count] * alpha
    # One disc more or less, where rounding decides which is the last.
    tolerance = 1e-4 + float(left[drawn_count]) * alpha * (count > drawn_count)
    yield difference("alpha", found.images[OUTPUTS.index("alpha")][13, 16], 1 - left[drawn_count], tolerance)
    expected = float(weights @ depth[:drawn_count])
    yield difference("depth", found.images[OUTPUTS.index("depth")][13, 16], expected, 3 * tolerance)


def nothing(count: int) -> Iterator[Measure]:
    """A scene without any visible surfel: the background, and no gradient.

    Args:
        count: Number of surfels, all behind the camera.

    Yields:
        Differences.
    """
    tensors = leaves(scene(["behind"] * count, 1))
    rendering = rasterize(WorldSurfels(*tensors), CAMERA, background=0.7)
    images = [getattr(rendering, name) for name in OUTPUTS]
    yield difference("colour", images[0].detach(), np.float32(0.7), 0.0)
    for name, image in zip(OUTPUTS[1:], images[1:], strict=True):
        yield difference(name, image.detach(), 0.0, 0.0)
    loss(images).backward()
    for name, tensor in zip(FIELDS, tensors, strict=True):
        yield difference(f"gradient of {name}", tensor.grad, 0.0, 0.0)
    yield violations("visible surfels", rendering.screen.visible.numpy())


def permuted(arrays: Arrays, seed: int) -> Iterator[Measure]:
    """Surfels in another order.

    Args:
        arrays: Fields of the surfels; their depths differ.
        seed: Seed of the order.

    Yields:
        Differences of images and gradients.
    """
    order = np.random.default_rng(seed).permutation(len(arrays[0]))
    usual, other = measured(arrays), measured([array[order] for array in arrays])
    for name, a, b in zip(OUTPUTS, usual.images, other.images, strict=True):
        yield difference(name, b, a, 0.0)
    for name, a, b in zip(FIELDS, usual.gradients, other.gradients, strict=True):
        yield difference(f"gradient of {name}, relative", b / a.abs().max(), a[order] / a.abs().max(), 1e-6)


def scalar(arrays: Arrays) -> Iterator[Measure]:
    """Vector code against plain loops.

    Args:
        arrays: Fields of the surfels.

    Yields:
        Differences in the pixels that are not at a threshold.
    """
    _, clear = defined(arrays)
    usual, other = (measured(arrays, clear=clear, backend=backend) for backend in ("cpu", "scalar"))
    for name, a, b in zip((*OUTPUTS, *FIELDS), usual.values(), other.values(), strict=True):
        size = b.abs().max().clamp_min(1e-30)
        yield difference(f"{name}, relative", a / size, b / size, 1e-4)


def finite_differences(arrays: Arrays, seed: int) -> Iterator[Measure]:
    """Gradients of the kernels against central differences of the reference, along a random direction for each field.

    Args:
        arrays: Fields of the surfels.
        seed: Seed of the directions.

    Yields:
        Errors relative to the length of the gradient.
    """
    _, clear = defined(arrays)
    found = measured(arrays, clear=clear)
    random = np.random.default_rng(seed)
    step = 1e-6
    for field, name in enumerate(FIELDS):
        size = np.abs(arrays[field]).max()
        direction = size * random.normal(size=arrays[field].shape)
        ends = [_loss_of_reference(arrays, field, sign * step * direction, clear) for sign in (1, -1)]
        numeric = (ends[0] - ends[1]) / (2 * step)
        gradient = found.gradients[field].double().numpy()
        error = abs(numeric - float((gradient * direction).sum()))
        length = float(np.linalg.norm(gradient) * np.linalg.norm(direction))
        yield Measure(f"derivative with respect to {name}", error / max(length, 1e-30), 1e-3)


def _loss_of_reference(arrays: Arrays, field: int, change: Float64[np.ndarray, "..."], clear: torch.Tensor) -> float:
    tensors = [torch.tensor(array, dtype=torch.float64) for array in arrays]
    tensors[field] = tensors[field] + torch.from_numpy(change)
    rendering = render(tensors, CAMERA)
    images = [rendering[name] * (clear if rendering[name].ndim == 2 else clear[..., None]) for name in OUTPUTS]
    return float(loss(images))


def not_finite(field: int, value: float) -> Iterator[Measure]:
    """A surfel with a number that is not finite is not drawn, and the others are drawn as without it.

    Args:
        field: Index of the field.
        value: The number.

    Yields:
        Differences.
    """
    arrays = scene(["regular"] * 20, field)
    arrays[field].reshape(20, -1)[4, 0] = value
    others = np.arange(20) != 4
    found, expected = measured(arrays), measured([array[others] for array in arrays])
    for name, a, b in zip(OUTPUTS, found.images, expected.images, strict=True):
        yield difference(name, a, b, 0.0)
    for name, a, b in zip(FIELDS, found.gradients, expected.gradients, strict=True):
        yield difference(f"gradient of {name}", a[others], b, 0.0)
        yield difference(f"gradient of {name} of the surfel itself", a[4], 0.0, 0.0)


def enormous(field: int, size: float) -> Iterator[Measure]:
    """A surfel with numbers near the end of float32 leaves everything finite.

    Args:
        field: Index of the field.
        size: The number in metres.

    Yields:
        Values that are not finite.
    """
    for count in (3, 20):
        arrays = scene(["regular"] * count, 5)
        arrays[field][1] = [size, 0, 0]
        arrays[field][2] = [0.3 * size, size, 0]
        found = measured(arrays)
        yield violations("numbers that are not finite", ~np.concatenate([v.isfinite().ravel() for v in found.values()]))


def refused(options: dict[str, object]) -> list[Measure]:
    """Options that do not exist or are out of range.

    Args:
        options: Arguments of `rasterize`.

    Returns:
        Nothing: they are an error.
    """
    rasterize(WorldSurfels(*leaves(scene(["regular"], 0))), CAMERA, **options)
    return []


if __name__ == "__main__":
    run(lambda: run_suite(__doc__, "rasterizer", cases()))
