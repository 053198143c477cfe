"""Density control: surfels are cloned, split and pruned, and children inherit their parent's triangle.

The strategy of 3D Gaussian splatting (Kerbl et al. 2023) with GaussianAvatars' binding inheritance.  Differences, on
purpose: the children of a split are scattered in the *local* units that positions have; where a face would lose all its
surfels, its most opaque one stays; within the budget new surfels go to the largest gradients first, and those that add
least to the images make room.  Gradients are those of real frames alone (of GT* frames where no others are used):
frozen surfels are not starved, and pixels that the warp stretched not refined.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from carigs.capture import Camera
from carigs.settings import Density
from carigs.splat.rasterizer.rasterize import Screen
from carigs.splat.rig.rig import Rig
from carigs.splat.surfels.surfels import Surfels, from_arrays, to_arrays
from carigs.splat.training.adam import Adam

SPLIT_CHILDREN, SPLIT_SHRINK = 2, 1.6


class GradientStatistics:
    """Running mean of each surfel's screen-space positional gradient over the views that saw it."""

    def __init__(self, n: int) -> None:
        self.total, self.views = np.zeros(n), np.zeros(n)

    def add(self, screen: Screen, camera: Camera) -> None:
        """Count one view: pixel gradients in units of half the image (NDC), as the published thresholds."""
        half = np.array([camera.width / 2, camera.height / 2])
        visible = screen.visible.numpy()
        self.total += np.where(visible, np.linalg.norm(screen.gradient.numpy() * half, axis=1), 0)
        self.views += visible

    def mean(self) -> Float[np.ndarray, "n"]:
        """Mean gradient in NDC units; 0 where never seen."""
        return self.total / np.maximum(self.views, 1)


def refine(
    surfels: Surfels,
    adam: Adam,
    gradient: Float[np.ndarray, "n"],
    rig: Rig,
    extent: float,
    settings: Density,
    rng: np.random.Generator,
    importance: Callable[[], Float[np.ndarray, "n"]] | None = None,
) -> Surfels:
    """Prune transparent surfels, clone small and split large ones of large gradients.

    `extent` is the scene's size in metres.  `adam` follows: survivors keep their moments, new ones start from zero.
    Where the budget does not suffice, the least important surfels make room; `importance` is not called elsewhere.
    """
    arrays = to_arrays(surfels)
    n = len(surfels)
    leaving = 1 / (1 + np.exp(-arrays["opacity"])) < settings.prune_opacity
    leaving = ~keep_one_per_face(arrays["binding"], leaving, arrays["opacity"])
    wanted = np.flatnonzero((gradient >= settings.gradient_threshold) & ~leaving)
    short = n - leaving.sum() + len(wanted) - settings.max_surfels
    if short > 0 and importance is not None and settings.replace_fraction > 0:
        value = np.where(leaving, -np.inf, importance())
        value[wanted] = np.inf
        count = leaving.sum() + min(short, int(settings.replace_fraction * n))
        leaving[np.argsort(value, kind="stable")[:count]] = True
        leaving[wanted] = False
        leaving = ~keep_one_per_face(arrays["binding"], leaving, arrays["opacity"])
    room = max(settings.max_surfels - int(n - leaving.sum()), 0)
    wanted = np.sort(wanted[np.argsort(-gradient[wanted], kind="stable")[:room]])
    size = np.exp(arrays["log_scale"]).max(axis=1) * rig.scale[arrays["binding"]]
    large = size[wanted] > settings.split_scale * extent
    cloned, split = wanted[~large], np.repeat(wanted[large], SPLIT_CHILDREN)
    source = np.concatenate([np.arange(n), cloned, split])
    arrays = {name: value[source] for name, value in arrays.items()}
    children = np.arange(n + len(cloned), len(source))
    noise = np.exp(arrays["log_scale"][children]) * rng.standard_normal((len(children), 2))
    arrays["position"][children] += np.einsum("nij,nj->ni", _disc_axes(arrays["rotation"][children]), noise)
    arrays["log_scale"][children] -= np.float32(np.log(SPLIT_SHRINK))
    leaving[wanted[large]] = True  # their children take their place
    kept = np.flatnonzero(np.append(~leaving, np.ones(len(source) - n, bool)))
    kept = kept[np.argsort(arrays["binding"][kept], kind="stable")]
    adam.take(source[kept], kept >= n)
    binding = arrays.pop("binding")
    return from_arrays(binding[kept], **{name: value[kept] for name, value in arrays.items()})


def keep_one_per_face(
    binding: Int[np.ndarray, "n"], doomed: Bool[np.ndarray, "n"], opacity: Float[np.ndarray, "n"]
) -> Bool[np.ndarray, "n"]:
    """Which surfels stay: the others, and the most opaque (the last of equals) of every face that would lose all."""
    keep = ~doomed
    order = np.lexsort((opacity, binding))
    last = np.append(binding[order][1:] != binding[order][:-1], True)
    best = order[last]
    served = np.zeros(int(binding.max(initial=-1)) + 1, bool)
    served[binding[keep]] = True
    keep[best[~served[binding[best]]]] = True
    return keep


def reset_opacity(surfels: Surfels, adam: Adam, highest: float = 0.01) -> None:
    """Cap opacities, so that only what the images need grows opaque again."""
    logit = np.float32(np.log(highest / (1 - highest)))
    values = surfels.opacity.detach().numpy()
    np.minimum(values, logit, out=values)
    adam.first["opacity"][:] = 0
    adam.second["opacity"][:] = 0


def scene_extent(cameras: dict[int, Camera]) -> float:
    """1.1 x the largest distance of a camera from the mean camera centre, in metres (NeRF++)."""
    centres = np.array([camera.centre for camera in cameras.values()])
    return float(1.1 * np.linalg.norm(centres - centres.mean(axis=0), axis=1).max())


def _disc_axes(quaternion: Float32[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 3 2"]:
    w, x, y, z = (quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)).T
    first = [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)]
    second = [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)]
    return np.stack([np.stack(first, axis=1), np.stack(second, axis=1)], axis=2)
