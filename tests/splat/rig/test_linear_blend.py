"""Linear blend skinning against its formula, and its gradient against finite differences."""

import torch

from carigs.splat.rig.linear_blend import linear_blend_skinning


def arrays(vertices, joints):
    generator = torch.Generator().manual_seed(vertices)
    rest = torch.randn(vertices, 3, dtype=torch.float64, generator=generator)
    transforms = torch.randn(joints, 3, 4, dtype=torch.float64, generator=generator)
    weights = torch.rand(vertices, joints, dtype=torch.float64, generator=generator)
    weights[::3, 0] = 0  # left out
    return rest, transforms, weights


def test_vertices_are_the_weighted_sums_of_their_transformed_positions():
    rest, transforms, weights = arrays(50, 5)
    moved = torch.einsum("jrc,vc->vjr", transforms[:, :, :3], rest) + transforms[:, :, 3]
    expected = (weights[:, :, None] * moved).sum(dim=1)
    torch.testing.assert_close(linear_blend_skinning(rest, transforms, weights), expected, rtol=0, atol=1e-13)


def test_a_rigid_motion_of_all_joints_moves_vertices_rigidly():
    rest, transforms, weights = arrays(50, 4)
    rotation = torch.linalg.qr(transforms[0, :, :3]).Q
    rigid = torch.cat([rotation, transforms[1, :, 3:]], dim=1).expand(4, 3, 4)
    weights = weights / weights.sum(dim=1, keepdim=True)
    expected = rest @ rotation.T + transforms[1, :, 3]
    torch.testing.assert_close(linear_blend_skinning(rest, rigid, weights), expected, rtol=0, atol=1e-13)


def test_the_gradient_agrees_with_finite_differences():
    rest, transforms, weights = arrays(7, 3)
    rest.requires_grad_(True)
    transforms.requires_grad_(True)
    torch.autograd.gradcheck(lambda *moving: linear_blend_skinning(*moving, weights), (rest, transforms))
