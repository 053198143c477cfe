"""Inputs and outputs of the rasterizer, independent of the backend."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from jaxtyping import Bool, Float

OUTPUTS = ("colour", "alpha", "depth", "normal", "distortion")
"""Images that `rasterize` can return."""


@dataclass
class WorldSurfels:
    """Flat Gaussians in world space, float32: exp(-(s^2 + t^2) / 2) at centre + s tangent_u + t tangent_v."""

    centre: Float[torch.Tensor, "n 3"]
    """Metres."""
    tangent_u: Float[torch.Tensor, "n 3"]
    """First axis times its standard deviation, in metres; need not be orthogonal to the second."""
    tangent_v: Float[torch.Tensor, "n 3"]
    """Second axis times its standard deviation, in metres."""
    opacity: Float[torch.Tensor, " n"]
    """In [0, 1]. Surfels below 1/255 are culled."""
    colour: Float[torch.Tensor, "n 3"]
    """RGB."""


@dataclass
class Screen:
    """Screen-space quantities for density control; not differentiable."""

    visible: Bool[torch.Tensor, " n"] | None = None
    """Whether the surfel's visible extent overlaps the image."""
    gradient: Float[torch.Tensor, "n 2"] | None = None
    """Gradient of the loss with respect to the projected centre in pixels; set by the backward pass."""


@dataclass
class Rendering:
    """Images of a rasterization: sums over the surfels of a pixel, weighted by w; None if not requested."""

    colour: Float[torch.Tensor, "h w 3"] | None = None
    """sum w colour + (1 - alpha) background."""
    alpha: Float[torch.Tensor, "h w"] | None = None
    """sum w."""
    depth: Float[torch.Tensor, "h w"] | None = None
    """sum w Z with the depth Z of the centres in metres; divide by alpha for the mean."""
    normal: Float[torch.Tensor, "h w 3"] | None = None
    """sum w n with unit normals n in camera axes that face the camera."""
    distortion: Float[torch.Tensor, "h w"] | None = None
    """sum_ij w_i w_j |Z_i - Z_j| in metres (2DGS, Huang et al. 2024, eq. 13)."""
    screen: Screen = field(default_factory=Screen)
    """Visibility and projected gradients of the surfels."""
