"""Points on a posed head: equal to `pose`, with derivatives equal to its finite differences."""

from dataclasses import replace

import numpy as np
import pytest
from small_head import small_head

from carigs.fitting.fitted_parameters import FittedParameters, fitted_parameters
from carigs.fitting.head_points import HeadPoints
from carigs.head import HeadModel, SurfacePoints, pose
from carigs.head.model_arrays import RestJoints

STEP = 1e-6


def random_state(fitted: FittedParameters, frames: int = 2) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(3)
    return 0.5 * random.normal(size=(frames, fitted.frame_size)), random.normal(size=len(fitted.shape))


def posed(model: HeadModel, fitted: FittedParameters, frames: np.ndarray, shape: np.ndarray) -> np.ndarray:
    return np.stack([pose(model, fitted.head_parameters(model, frame, shape)) for frame in frames])


def surface_points(model: HeadModel, corners: int) -> SurfacePoints:
    random = np.random.default_rng(1)
    chosen = random.choice(len(model.faces), 40, replace=False)
    if corners == 1:
        return SurfacePoints.at_vertices(model.faces[chosen, 0])
    return SurfacePoints(model.faces[chosen], random.dirichlet(np.ones(3), 40))


def own_joints(model: HeadModel) -> HeadModel:
    """Joints that are not regressed, and correctives of the last two joints alone."""
    basis = 0.01 * np.random.default_rng(2).normal(size=model.joint_basis.shape)
    joints = RestJoints(model.joint_template.astype(np.float32), basis.astype(np.float32))
    return replace(model, rest_joints=joints, posedirs=model.posedirs[:, :, :18])


@pytest.mark.parametrize("change", [lambda m: m, own_joints, lambda m: replace(m, posedirs=m.posedirs[:, :, :0])])
@pytest.mark.parametrize("corners", [1, 3])
def test_positions_and_derivatives_are_those_of_the_posed_head(change, corners):
    model = change(small_head(subdivisions=2))
    fitted = FittedParameters(np.array([0, 2, 5]), np.array([1, 4]), np.array([1, 2, 4]))
    chosen = surface_points(model, corners)
    points = HeadPoints(model, fitted, chosen)
    frames, shape = random_state(fitted)

    def expected(frames: np.ndarray, shape: np.ndarray) -> np.ndarray:
        return np.stack([chosen.interpolate(vertices) for vertices in posed(model, fitted, frames, shape)])

    positions, by_frame, by_shape = points.linearise(frames, shape)
    np.testing.assert_allclose(positions, expected(frames, shape), atol=1e-7)
    np.testing.assert_array_equal(points.positions(frames, shape), positions)
    for k, step in enumerate(STEP * np.eye(fitted.frame_size)):
        difference = (expected(frames + step, shape) - expected(frames - step, shape)) / (2 * STEP)
        np.testing.assert_allclose(by_frame[..., k], difference, atol=1e-7, err_msg=f"parameter {k}")
    for k, step in enumerate(STEP * np.eye(len(shape))):
        difference = (expected(frames, shape + step) - expected(frames, shape - step)) / (2 * STEP)
        np.testing.assert_allclose(by_shape[..., k], difference, atol=1e-7, err_msg=f"shape {k}")


def test_blendshapes_that_move_nothing_and_joints_without_points_are_left_out():
    model = small_head(subdivisions=2)
    shapedirs = model.shapedirs.copy()
    shapedirs[:, :, [1, 7]] = 0
    model = replace(model, shapedirs=shapedirs)
    fitted = fitted_parameters(model, np.arange(len(model.v_template)))
    np.testing.assert_array_equal(fitted.shape, [0, 2, 3, 4, 5])
    np.testing.assert_array_equal(fitted.expression, [0, 2, 3, 4])
    np.testing.assert_array_equal(fitted.joints, [1, 2])
    above = np.flatnonzero(model.v_template[:, 1] > 0.01)
    np.testing.assert_array_equal(fitted_parameters(model, above).joints, [1])


def test_of_many_blendshapes_the_largest_are_fitted():
    model = small_head(subdivisions=2)
    size = np.array([1, 5, 3, 9, 2, 4, 1, 2, 3, 4, 5])
    model = replace(model, shapedirs=(model.shapedirs / np.linalg.norm(model.shapedirs, axis=(0, 1)) * size))
    fitted = fitted_parameters(model, np.arange(10), max_shape=3, max_expression=2)
    np.testing.assert_array_equal(fitted.shape, [1, 3, 5])
    np.testing.assert_array_equal(fitted.expression, [3, 4])
