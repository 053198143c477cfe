"""Transforms along the kinematic chain against rotations of scipy, and their gradient against finite differences."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from carigs.splat.rig.joint_chain import joint_chain

PARENTS = np.array([-1, 0, 1, 1, 1, 0])


def chain(size, seed=0):
    rng = np.random.default_rng(seed)
    vectors, joints = size * rng.normal(size=(len(PARENTS), 3)), rng.normal(size=(len(PARENTS), 3))
    return torch.from_numpy(vectors), torch.from_numpy(joints)


@pytest.mark.parametrize("size", [0.0, 0.1, 3.0])
def test_each_joint_turns_what_hangs_on_it_about_its_own_position(size):
    vectors, joints = chain(size)
    local, transforms = (tensor.numpy() for tensor in joint_chain(vectors, joints, PARENTS))
    np.testing.assert_allclose(local, Rotation.from_rotvec(vectors.numpy()).as_matrix(), atol=1e-12)
    for j, k in enumerate(PARENTS):
        above = transforms[k] if k >= 0 else np.eye(3, 4)
        x = joints[j].numpy()
        np.testing.assert_allclose(transforms[j] @ [*x, 1], above @ [*x, 1], atol=1e-12)
        np.testing.assert_allclose(transforms[j, :, :3], above[:, :3] @ local[j], atol=1e-12)


@pytest.mark.parametrize("size", [0.0, 1e-5, 0.02, 0.3, 3.0])
def test_gradients_agree_with_finite_differences(size):
    vectors, joints = (tensor.requires_grad_(True) for tensor in chain(size, seed=1))
    assert torch.autograd.gradcheck(lambda v, x: joint_chain(v, x, PARENTS), (vectors, joints), eps=1e-5, atol=1e-8)
