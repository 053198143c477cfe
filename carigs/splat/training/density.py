"""Density control: surfels are cloned, split and pruned; children inherit their parent's triangle.

The strategy of 3D Gaussian splatting (Kerbl et al. 2023) with the binding inheritance of GaussianAvatars (Qian et al.
2024), with these differences:

- Children of a split are scattered in the local units that positions have.
- Where a triangle would lose all its surfels, the most opaque one is kept.
- New surfels go to the largest gradients first until the budget is used up; then the surfels that contribute least to
  the images are removed to make room.
- Only gradients of real frames count (those of GT* frames if there are no others): surfels that are frozen in GT* steps
  are not neglected, and pixels that the warp stretched are not refined.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, Int

from carigs.capture import Camera
from carigs.settings import Density
from carigs.splat.rasterizer.rasterize import Screen
from carigs.splat.rig.rig import Rig
from carigs.splat.surfels.surfels import Surfels, from_arrays, to_arrays
from carigs.splat.training.adam import Adam

SPLIT_CHILDREN, SPLIT_SHRINK = 2, 1.6
"""Children of a split, and the factor by which they are smaller (Kerbl et al. 2023)."""

SPLIT_SCALE = 0.01
"""World scale, over the size of the scene, above which a surfel is split instead of cloned (Kerbl et al. 2023)."""


class GradientStatistics:
    """Mean screen-space positional gradient of every surfel over the views that saw it.

    Args:
        n: Number of surfels.
    """

    def __init__(self, n: int) -> None:
        self.total, self.views = np.zeros(n), np.zeros(n)

    def add(self, screen: Screen, camera: Camera) -> None:
        """Add the gradients of one view, in units of half the image (NDC) as the published thresholds.

        Args:
            screen: Screen-space gradients (1/pixel) and visibility of the surfels.
            camera: The view.
        """
        half = np.array([camera.width / 2, camera.height / 2])
        visible = screen.visible.numpy()
        self.total += np.where(visible, np.linalg.norm(screen.gradient.numpy() * half, axis=1), 0)
        self.views += visible

    def mean(self) -> Float[np.ndarray, " n"]:
        """Mean over the views.

        Returns:
            Gradients in NDC units; 0 for surfels that no view saw.
        """
        return self.total / np.maximum(self.views, 1)


def densify_and_prune(
    surfels: Surfels,
    adam: Adam,
    gradient: Float[np.ndarray, " n"],
    rig: Rig,
    extent: float,
    settings: Density,
    rng: np.random.Generator,
    importance: Callable[[], Float[np.ndarray, " n"]] | None = None,
    kept: Bool[np.ndarray, " n"] | None = None,
) -> Surfels:
    """Prune transparent surfels; clone small and split large surfels of large gradients.

    Args:
        surfels: Surfels before.
        adam: Their optimiser; reordered in place, new surfels start with zero moments.
        gradient: Mean screen-space gradients in NDC units.
        rig: Canonical mesh.
        extent: Size of the scene in metres, see `scene_extent`.
        settings: Thresholds and budget.
        rng: Places the children of splits.
        importance: Computes the contribution of every surfel to the images; called only if the budget is too small for
            all new surfels, to find those that make room.
        kept: Surfels that are not changed; None if all may be.

    Returns:
        Surfels after, sorted by triangle.
    """
    arrays = to_arrays(surfels)
    n = len(surfels)
    kept = np.zeros(n, bool) if kept is None else kept
    pruned = (1 / (1 + np.exp(-arrays["opacity"])) < settings.prune_opacity) & ~kept
    pruned = ~keep_one_per_face(arrays["binding"], pruned, arrays["opacity"])
    parents = np.flatnonzero((gradient >= settings.gradient_threshold) & ~pruned & ~kept)
    excess = n - pruned.sum() + len(parents) - settings.max_surfels
    if excess > 0 and importance is not None and settings.replace_fraction > 0:
        value = np.where(pruned, -np.inf, importance())
        value[parents] = value[kept] = np.inf
        count = pruned.sum() + min(excess, int(settings.replace_fraction * n))
        pruned[np.argsort(value, kind="stable")[:count]] = True
        pruned[parents] = pruned[kept] = False
        pruned = ~keep_one_per_face(arrays["binding"], pruned, arrays["opacity"])
    room = max(settings.max_surfels - int(n - pruned.sum()), 0)
    parents = np.sort(parents[np.argsort(-gradient[parents], kind="stable")[:room]])
    size = np.exp(arrays["log_scale"]).max(axis=1) * rig.scale[arrays["binding"]]
    large = size[parents] > SPLIT_SCALE * extent
    cloned, split = parents[~large], np.repeat(parents[large], SPLIT_CHILDREN)
    source = np.concatenate([np.arange(n), cloned, split])
    arrays = {name: value[source] for name, value in arrays.items()}
    children = np.arange(n + len(cloned), len(source))
    noise = np.exp(arrays["log_scale"][children]) * rng.standard_normal((len(children), 2))
    arrays["position"][children] += np.einsum("nij,nj->ni", _disc_axes(arrays["rotation"][children]), noise)
    arrays["log_scale"][children] -= np.float32(np.log(SPLIT_SHRINK))
    pruned[parents[large]] = True  # their children take their place
    left = np.flatnonzero(np.append(~pruned, np.ones(len(source) - n, bool)))
    left = left[np.argsort(arrays["binding"][left], kind="stable")]
    adam.reorder(source[left], left >= n)
    return from_arrays(**{name: value[left] for name, value in arrays.items()})


def keep_one_per_face(
    binding: Int[np.ndarray, " n"], pruned: Bool[np.ndarray, " n"], opacity: Float[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    """Find the surfels to keep so that no triangle loses all its surfels.

    Args:
        binding: Index of each surfel's triangle.
        pruned: Surfels that would be removed.
        opacity: Opacities or their logits.

    Returns:
        The surfels that are not pruned, and the most opaque one (the last of equals) of every triangle that would lose
        all.
    """
    keep = ~pruned
    order = np.lexsort((opacity, binding))
    last = np.append(binding[order][1:] != binding[order][:-1], True)
    most_opaque = order[last]
    has_surfel = np.zeros(int(binding.max(initial=-1)) + 1, bool)
    has_surfel[binding[keep]] = True
    keep[most_opaque[~has_surfel[binding[most_opaque]]]] = True
    return keep


def reset_opacity(
    surfels: Surfels, adam: Adam, highest: float = 0.01, kept: Bool[np.ndarray, " n"] | None = None
) -> None:
    """Cap the opacities (Kerbl et al. 2023): only surfels that the images need become opaque again.

    Args:
        surfels: Surfels, changed in place.
        adam: Their optimiser; the moments of the opacities are set to zero.
        highest: Largest opacity afterwards.
        kept: Surfels that are not changed; None if all may be.
    """
    opacity = surfels.opacity.detach()
    capped = opacity.clamp(max=float(np.log(highest / (1 - highest))))
    opacity.copy_(capped if kept is None else torch.where(torch.from_numpy(kept).to(opacity.device), opacity, capped))
    adam.first["opacity"][:] = 0
    adam.second["opacity"][:] = 0


def scene_extent(cameras: dict[int, Camera]) -> float:
    """Size of a scene: 1.1 times the largest distance of a camera from the mean camera centre (NeRF++).

    Args:
        cameras: Cameras by index.

    Returns:
        Extent in metres.
    """
    centres = np.array([camera.centre for camera in cameras.values()])
    return float(1.1 * np.linalg.norm(centres - centres.mean(axis=0), axis=1).max())


def _disc_axes(quaternion: Float32[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 3 2"]:
    w, x, y, z = (quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)).T
    first = [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)]
    second = [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)]
    return np.stack([np.stack(first, axis=1), np.stack(second, axis=1)], axis=2)
