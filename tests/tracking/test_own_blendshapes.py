"""Principal components and turns of displacements, against what they are by definition."""

from dataclasses import replace

import numpy as np
from small_head import small_head

from carigs.head import HeadParameters, flame_joints, pose
from carigs.tracking.own_blendshapes import principal_shapes, skinning_turns


def test_all_components_give_the_displacements_back_and_fewer_the_nearest_ones():
    moved = np.random.default_rng(0).normal(size=(6, 10, 3)) * np.linspace(1, 3, 10)[:, None]
    shapes, coefficients = principal_shapes(moved, 20)
    np.testing.assert_allclose(np.einsum("nxk,tk->tnx", shapes, coefficients), moved, atol=1e-12)
    np.testing.assert_allclose((coefficients**2).mean(axis=0), 1)
    few, some = principal_shapes(moved, 4)
    left_over = np.linalg.norm(np.einsum("nxk,tk->tnx", few, some) - moved)
    singular = np.linalg.svd(moved.reshape(6, -1), compute_uv=False)
    np.testing.assert_allclose(left_over, np.linalg.norm(singular[4:]))


def test_turns_are_the_derivative_of_the_posed_head():
    """By pose correctives and joints that stay, a displacement of a vertex that makes no joint is turned alone."""
    model = small_head()
    model = replace(model, joint_regressor=np.eye(len(model.parents), len(model.v_template), dtype=np.float32))
    frame = replace(
        HeadParameters.zeros(model), rotation=np.array([0.3, -0.5, 0.2]), joints=flame_joints(jaw=[0.4, 0, 0])
    )
    offset = np.random.default_rng(1).normal(0, 1e-3, model.v_template.shape)
    offset[: len(model.parents)] = 0
    found = np.einsum("nxy,ny->nx", skinning_turns(model, [frame], model.weights)[0], offset)
    np.testing.assert_allclose(
        found, pose(model, replace(frame, static_offset=offset)) - pose(model, frame), atol=1e-12
    )
