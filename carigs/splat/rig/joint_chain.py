"""Transforms of the joints along their kinematic chain, differentiable with respect to rotation vectors and joints."""

from __future__ import annotations

import math

import numpy as np
import torch
from jaxtyping import Float64, Int
from torch import Tensor

from carigs.head.joint_transforms import joint_transforms, rotation_matrices
from carigs.simd import matrix3
from carigs.simd.kernels import kernel
from carigs.simd.tuples import add, multiply, write_row
from carigs.simd.vectors import scalar_or_simd
from carigs.splat.rig.skinning_arguments import read3


def joint_chain(
    rotation_vectors: Float64[Tensor, "j 3"], joints: Float64[Tensor, "j 3"], parents: Int[np.ndarray, " j"]
) -> tuple[Float64[Tensor, "j 3 3"], Float64[Tensor, "j 3 4"]]:
    """Rotations of joints and their transforms from the rest frame to the world.

    Written with its gradient: in PyTorch it would be dozens of operations on single matrices, each with its overhead.

    Args:
        rotation_vectors: Rotation of every joint relative to its parent, in radians.
        joints: Position of every joint at rest, in metres.
        parents: Parent of every joint, before it in the order; -1 for the root.

    Returns:
        The relative rotations as matrices, and world_from_rest [R | t] of every joint.
    """
    return _JointChain.apply(rotation_vectors, joints, parents)


class _JointChain(torch.autograd.Function):
    @staticmethod
    def forward(ctx, rotation_vectors, joints, parents):
        vectors, positions = rotation_vectors.detach().numpy(), joints.detach().numpy()
        local = rotation_matrices(vectors)
        transforms = joint_transforms(local[None], positions[None], parents)[0]
        ctx.arrays = vectors, positions, parents, local, transforms[:, :, :3]
        return torch.from_numpy(local), torch.from_numpy(transforms)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, g_local, g_transforms):
        to_vectors, to_joints = _chain_backward(*ctx.arrays, g_local.contiguous().numpy(), g_transforms.numpy())
        return torch.from_numpy(to_vectors), torch.from_numpy(to_joints), None


@kernel
def _chain_backward(vectors, joints, parents, local, rotation, g_local, g_transforms):
    # World rotations are R_j = R_k L_j with the parent k, positions p_j = p_k + R_k (x_j - x_k), and t = p - R x.
    g_local, g_rotation = g_local.copy(), g_transforms[:, :, :3].copy()
    g_position, g_joints = g_transforms[:, :, 3].copy(), np.zeros_like(joints)
    g_vectors = np.empty_like(vectors)
    for j in range(len(parents) - 1, -1, -1):  # parents come first: all gradients of a joint are complete
        k = parents[j]
        for r in range(3):
            for c in range(3):
                g_rotation[j, r, c] -= g_transforms[j, r, 3] * joints[j, c]
                g_joints[j, c] -= rotation[j, r, c] * g_transforms[j, r, 3]
        if k < 0:
            g_local[j] += g_rotation[j]
            g_joints[j] += g_position[j]
        else:
            g_position[k] += g_position[j]
            for r in range(3):
                for c in range(3):
                    g_rotation[k, r, c] += g_position[j, r] * (joints[j, c] - joints[k, c])
                    g_joints[j, c] += rotation[k, r, c] * g_position[j, r]
                    g_joints[k, c] -= rotation[k, r, c] * g_position[j, r]
                    for i in range(3):
                        g_rotation[k, r, c] += g_rotation[j, r, i] * local[j, c, i]
                        g_local[j, r, c] += rotation[k, i, r] * g_rotation[j, i, c]
        write_row(g_vectors, j, _vector_gradient(read3(vectors, j), matrix3.load(local, j), matrix3.load(g_local, j)))
    return g_vectors, g_joints


@scalar_or_simd
def _vector_gradient(v, rotation, upstream):
    """J^T torque: d exp(v) = [J dv] exp(v), J = I + b [v] + c [v]^2 the left Jacobian (Sola et al. 2018, eq. 145)."""
    m = matrix3.product(upstream, matrix3.transpose(rotation))
    torque = (m[7] - m[5], m[2] - m[6], m[3] - m[1])
    square = matrix3.dot(v, v)
    # (1 - cos t) / t^2 and (t - sin t) / t^3; by their series where the differences lose digits.
    b, c = 0.5 - square * (1 / 24 - square / 720), 1 / 6 - square * (1 / 120 - square / 5040)
    if square > 1e-3:
        angle = math.sqrt(square)
        b, c = (1 - math.cos(angle)) / square, (angle - math.sin(angle)) / (angle * square)
    once = matrix3.cross(v, torque)
    return add(torque, add(multiply(-b, once), multiply(c, matrix3.cross(v, once))))
