"""gsplat's own PyTorch reference of the functions that `rasterizer.cuda` calls, so that it runs without a GPU.

Two of its parts exist for CUDA only: the search for the surfels of every pixel, and the sums along a ray, for which it
takes the package nerfacc. Both are written here, over the same tile lists. It has no distortion and no median depth.
"""

import sys
from contextlib import contextmanager
from types import ModuleType, SimpleNamespace

import numpy as np
import torch
from pytest import MonkeyPatch

CAP, THRESHOLD, END = 0.999, 1 / 255, 1e-4
"""Cap and threshold of alpha, and the transmittance at which a pixel is complete, in gsplat 1.5.3."""


@contextmanager
def functions():
    """The three functions, on the CPU; the rasterizer takes the arguments of the CUDA version."""
    from gsplat.cuda import _torch_impl, _torch_impl_2dgs, _wrapper

    def isect_tiles(*arguments):
        """With a stable sort, as that of the CUDA version: surfels at equal depths keep their order."""
        count, pairs, ids = _torch_impl._isect_tiles(*arguments, sort=False)
        pairs, order = torch.sort(pairs, stable=True)
        return count, pairs, ids[order]

    def rasterize(
        means, transforms, colors, opacities, normals, densify, width, height, tile, offsets, ids, *, distloss
    ):
        assert densify.shape == means.shape
        image, alpha, normal = _torch_impl_2dgs._rasterize_to_pixels_2dgs(
            means, transforms, colors, normals, opacities, width, height, tile, offsets, ids
        )
        return image, alpha, normal, torch.zeros_like(alpha), torch.zeros_like(alpha)

    nerfacc = ModuleType("nerfacc")
    nerfacc.render_weight_from_alpha, nerfacc.accumulate_along_rays = ray_weights, ray_sums
    with MonkeyPatch.context() as patch:  # not `patch.dict`, which would also forget modules imported meanwhile
        patch.setitem(sys.modules, "nerfacc", nerfacc)
        patch.setattr(_wrapper, "rasterize_to_indices_in_range_2dgs", pixel_surfels)
        yield SimpleNamespace(
            isect_tiles=isect_tiles,
            isect_offset_encode=_torch_impl._isect_offset_encode,
            rasterize_to_pixels_2dgs=rasterize,
        )


def ray_weights(alphas, ray_indices, n_rays):
    """Weights T alpha and transmittances T along rays whose samples are contiguous and in order."""
    first = torch.searchsorted(ray_indices, ray_indices)
    logs = torch.log1p(-alphas.double())
    before = torch.cat([logs.new_zeros(1), logs.cumsum(0)])
    transmittance = torch.exp(before[:-1] - before[first]).to(alphas.dtype)
    return transmittance * alphas, transmittance


def ray_sums(weights, values=None, ray_indices=None, n_rays=None):
    """Sums of weights, or of weighted values, over the samples of each ray."""
    terms = weights[:, None] if values is None else weights[:, None] * values
    return terms.new_zeros(n_rays, terms.shape[1]).index_add(0, ray_indices, terms)


@torch.no_grad()
def pixel_surfels(
    start, stop, transmittances, means2d, ray_transforms, opacities, width, height, tile_size, offsets, flatten_ids
):
    """Surfels, pixels and images of all contributions, pixel by pixel and front to back, of blocks start to stop."""
    block, across = tile_size**2, offsets.shape[-1]
    bounds = np.append(offsets.numpy().ravel(), len(flatten_ids))
    m, centre, opacity = (t[0].double().numpy() for t in (ray_transforms, means2d, opacities))
    surfels, pixels = [], []
    for y in range(height):
        for x in range(width):
            tile = y // tile_size * across + x // tile_size
            ids = flatten_ids[bounds[tile] : bounds[tile + 1]][start * block : stop * block].numpy()
            px, py = x + 0.5, y + 0.5
            ray = np.cross(px * m[ids, 2] - m[ids, 0], py * m[ids, 2] - m[ids, 1])
            with np.errstate(divide="ignore", invalid="ignore"):
                g3 = ((ray[:, :2] / ray[:, 2:]) ** 2).sum(axis=1)
            g2 = 2 * ((centre[ids] - [px, py]) ** 2).sum(axis=1)  # gsplat's low-pass filter
            alpha = np.minimum(CAP, opacity[ids] * np.exp(-0.5 * np.minimum(g3, g2)))
            kept = np.flatnonzero((ray[:, 2] != 0) & (alpha >= THRESHOLD))
            after = float(transmittances[0, y, x]) * np.cumprod(1 - alpha[kept])
            kept = kept[after > END]
            surfels.append(ids[kept])
            pixels.append(np.full(len(kept), y * width + x))
    surfels, pixels = (torch.from_numpy(np.concatenate(parts)).long() for parts in (surfels, pixels))
    return surfels, pixels, torch.zeros_like(pixels)
