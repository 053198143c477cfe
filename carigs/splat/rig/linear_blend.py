"""Linear blend skinning of vertices in float64, differentiable with respect to vertices and joint transforms."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float64
from torch import Tensor

from carigs.simd.kernels import kernel


def linear_blend_skinning(
    rest: Float64[Tensor, "v 3"], transforms: Float64[Tensor, "j 3 4"], weights: Float64[Tensor, "v j"]
) -> Float64[Tensor, "v 3"]:
    """Move each vertex by the weighted sum of the joints' transforms: sum_j w_j (R_j x + t_j).

    Written as a kernel with its gradient: PyTorch's products of small matrices take almost three times as long.

    Args:
        rest: Vertices in the rest frame, in metres.
        transforms: world_from_rest [R | t] of every joint.
        weights: Weights of the joints at each vertex.

    Returns:
        World vertices in metres.
    """
    return _LinearBlend.apply(rest, transforms, weights)


class _LinearBlend(torch.autograd.Function):
    @staticmethod
    def forward(ctx, rest, transforms, weights):
        ctx.arrays = [tensor.detach().contiguous().numpy() for tensor in (rest, transforms, weights)]
        return torch.from_numpy(_blend(*ctx.arrays))

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, upstream):
        to_rest, to_transforms = _blend_backward(*ctx.arrays, upstream.contiguous().numpy())
        return torch.from_numpy(to_rest), torch.from_numpy(to_transforms), None


@kernel
def _blend(rest, transforms, weights):
    posed = np.zeros_like(rest)
    for i in range(len(rest)):
        for j in range(len(transforms)):
            w = weights[i, j]
            if w == 0.0:
                continue
            for r in range(3):
                t = transforms[j, r]
                posed[i, r] += w * (t[0] * rest[i, 0] + t[1] * rest[i, 1] + t[2] * rest[i, 2] + t[3])
    return posed


@kernel
def _blend_backward(rest, transforms, weights, upstream):
    to_rest, to_transforms = np.zeros_like(rest), np.zeros_like(transforms)
    for i in range(len(rest)):
        for j in range(len(transforms)):
            w = weights[i, j]
            if w == 0.0:
                continue
            for r in range(3):
                g = w * upstream[i, r]
                for c in range(3):
                    to_rest[i, c] += g * transforms[j, r, c]
                    to_transforms[j, r, c] += g * rest[i, c]
                to_transforms[j, r, 3] += g
    return to_rest, to_transforms
