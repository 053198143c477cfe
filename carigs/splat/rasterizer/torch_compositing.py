"""Front-to-back compositing in plain PyTorch, on any device: the twin of `forward` and, by autograd, of `backward`.

The tiles are taken in groups, and within a group all surfels meet all pixels of their tile at once. The number of such
meetings in a group is limited: so is memory, whatever the number of surfels and pixels. The backward pass computes each
group again instead of keeping it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from carigs.splat.rasterizer.forward import HALF_LOG2E, LOG2_ALPHA_THRESHOLD
from carigs.splat.rasterizer.interface import Screen
from carigs.splat.rasterizer.records import TRANSMITTANCE_THRESHOLD
from carigs.splat.rasterizer.torch_lists import TILE_SIZE, TileLists, sum_slots
from carigs.splat.rasterizer.torch_projection import ScreenSurfels

MAX_ELEMENTS, MAX_ELEMENTS_ON_GPU = 1 << 18, 1 << 20
"""Most meetings of a surfel and a pixel in a group of tiles; each takes about 270 bytes in the backward pass. A CPU is
fastest while they stay in its caches, a GPU where groups are large."""
CHANNELS = {"colour": slice(0, 3), "alpha": 3, "depth": 4, "normal": slice(5, 8), "distortion": 8}
"""Channels of the composited image."""
COLOUR_CHANNELS, ALL_CHANNELS = 4, 9


class Group(NamedTuple):
    """Tiles that are composited together: t tiles with k surfels each (the longest list) and p of their pixels."""

    surfel: Int[Tensor, "t k"]
    """Surfels, front to back."""
    slot: Int[Tensor, "t k"]
    """Gradient slots."""
    used: Bool[Tensor, "t k"]
    """Which of these are in the tile's list."""
    origin: Int[Tensor, "t 2"]
    """First column and row of each tile."""
    pixel: Int[Tensor, "p 2"]
    """Column and row of the pixels in a tile."""


def composite(
    surfels: ScreenSurfels,
    lists: TileLists,
    width: int,
    height: int,
    alpha_cap: float,
    geometry: bool,
    screen: Screen,
) -> Float[Tensor, "h w channels"]:
    """Composite the surfels of all tiles, see `forward`.

    Args:
        surfels: Surfels in image space.
        lists: Depth-sorted surfels of every tile.
        width: Image width in pixels.
        height: Image height in pixels.
        alpha_cap: Upper limit of a surfel's alpha.
        geometry: Whether to compute depth, normal and distortion.
        screen: Receives the gradient with respect to the projected centres in the backward pass.

    Returns:
        An image with the channels `CHANNELS`, over black, differentiable with respect to centres and records.
    """
    return _Composite.apply(surfels.centre, surfels.record, lists, width, height, alpha_cap, geometry, screen)


class _Composite(torch.autograd.Function):
    @staticmethod
    def forward(ctx, centre, record, lists, width, height, cap, geometry, screen):
        ctx.save_for_backward(centre, record)
        ctx.constants = lists, width, cap, geometry, screen
        image = record.new_zeros((height, width, ALL_CHANNELS if geometry else COLOUR_CHANNELS))
        for group in _groups(lists, width):
            _scatter(image, group, _composite(_rows(centre, record, group), group, cap, geometry))
        return image

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, upstream):
        centre, record = ctx.saved_tensors
        lists, width, cap, geometry, screen = ctx.constants
        slots = record.new_zeros((len(lists.slot), record.shape[1] + 2))
        for group in _groups(lists, width):
            rows = _rows(centre, record, group).requires_grad_(True)
            with torch.enable_grad():
                image = _composite(rows, group, cap, geometry)
            (gradient,) = torch.autograd.grad(image, rows, _gather(upstream, group))
            slots[group.slot[group.used]] += gradient[group.used]
        total = sum_slots(slots, lists, len(record))
        screen.gradient = -total[:, :2]  # rows hold offsets from the projected centre
        return -total[:, :2].to(centre.dtype), total[:, 2:], *[None] * 6


def _groups(lists: TileLists, width: int) -> Iterator[Group]:
    """Tiles of similar length together, longest first; the pixels of very long ones apart."""
    device, across = lists.surfel.device, -(-width // TILE_SIZE)
    most = MAX_ELEMENTS if device.type == "cpu" else MAX_ELEMENTS_ON_GPU
    order = torch.argsort(lists.count, descending=True, stable=True)
    counts = lists.count[order].tolist()
    at = torch.arange(TILE_SIZE * TILE_SIZE, device=device)
    pixel = torch.stack([at % TILE_SIZE, at // TILE_SIZE], dim=1)
    first = 0
    while first < len(counts) and counts[first] > 0:
        k = counts[first]
        stop = min(first + max(most // (k * len(pixel)), 1), len(counts))
        tile = order[first:stop]
        place = torch.arange(k, device=device)
        used = place < lists.count[tile][:, None]
        pair = torch.where(used, lists.start[tile][:, None] + place, 0)
        origin = TILE_SIZE * torch.stack([tile % across, tile // across], dim=1)
        for part in pixel.split(max(most // k, 1)):
            yield Group(lists.surfel[pair], lists.slot[pair], used, origin, part)
        first = stop


def _rows(centre: Float[Tensor, "n 2"], record: Float[Tensor, "n 15"], group: Group) -> Float[Tensor, "t k 17"]:
    """Offset of each tile's first pixel centre from the projected centre, and the record, in float32."""
    offset = (group.origin[:, None, :] + 0.5 - centre.detach()[group.surfel]).float()
    return torch.cat([offset, record.detach()[group.surfel]], dim=2)


def _composite(rows: Float[Tensor, "t k 17"], group: Group, cap: float, geometry: bool) -> Float[Tensor, "t p c"]:
    x, y, u0, u1, v0, v1, det, a3, b3, log2_opacity = rows[..., :10, None].unbind(dim=2)
    features = rows[..., 10:]
    dx, dy = x + group.pixel[:, 0], y + group.pixel[:, 1]
    zx, zy, zz = v1 * dx - u1 * dy, u0 * dy - v0 * dx, det + a3 * dx + b3 * dy
    with torch.no_grad():
        exponent = log2_opacity - ((zx / zz).square() + (zy / zz).square()) * float(HALF_LOG2E)
        valid = (exponent >= float(LOG2_ALPHA_THRESHOLD)) & group.used[..., None]  # false for NaN: grazing rays
    # Selected before the division: a gradient of zero times infinity would be NaN.
    zz = torch.where(valid, zz, 1.0)
    s, t = torch.where(valid, zx, 0.0) / zz, torch.where(valid, zy, 0.0) / zz
    exponent = log2_opacity - (s.square() + t.square()) * float(HALF_LOG2E)
    alpha = torch.exp2(torch.where(valid, exponent, 0.0)).clamp_max(cap)
    with torch.no_grad():
        # A pixel is complete before the surfel that would leave T <= 1e-4, and T never grows.
        counts = valid & (torch.where(valid, 1 - alpha, 1.0).cumprod(dim=1) > TRANSMITTANCE_THRESHOLD)
    alpha = torch.where(counts, alpha, 0.0)
    after = (1 - alpha).cumprod(dim=1)
    before = torch.cat([torch.ones_like(after[:, :1]), after[:, :-1]], dim=1)
    w = before * alpha
    colour = torch.einsum("tkp,tkc->tpc", w, features[..., :3])
    images = [colour, (1 - after[:, -1])[..., None]]
    if geometry:
        weighted = w * features[..., 3, None]
        in_front = weighted.cumsum(dim=1) - weighted
        distortion = 2 * (weighted * (1 - before) - w * in_front).sum(dim=1)
        images += [torch.einsum("tkp,tkc->tpc", w, features[..., 3:]), distortion[..., None]]
    return torch.cat(images, dim=2)


def _positions(
    group: Group, image: Float[Tensor, "h w c"]
) -> tuple[Int[Tensor, "t p"], Int[Tensor, "t p"], Bool[Tensor, "t p"]]:
    """Columns and rows of the group's pixels, and whether they are in the image."""
    x, y = (group.origin[:, None, :] + group.pixel).unbind(dim=2)
    return x, y, (x < image.shape[1]) & (y < image.shape[0])


def _scatter(image: Float[Tensor, "h w c"], group: Group, values: Float[Tensor, "t p c"]) -> None:
    x, y, inside = _positions(group, image)
    image[y[inside], x[inside]] = values[inside]


def _gather(image: Float[Tensor, "h w c"], group: Group) -> Float[Tensor, "t p c"]:
    """The group's pixels; 0 outside the image."""
    x, y, inside = _positions(group, image)
    found = image[y.clamp_max(image.shape[0] - 1), x.clamp_max(image.shape[1] - 1)]
    return torch.where(inside[..., None], found, 0.0)
