"""The solver of tracking: derivatives against finite differences, bounds, fields on the surface, corrections."""

import numpy as np
import pytest
from heads import random_model
from scipy.optimize import lsq_linear

from carigs.fitting.fitted_parameters import fitted_parameters
from carigs.fitting.head_points import HeadPoints
from carigs.fitting.levenberg_marquardt import Bounds, minimise
from carigs.fitting.normal_equations import NormalEquations
from carigs.fitting.objective import Prior
from carigs.head import SurfacePoints
from carigs.head.joint_transforms import rotation_matrices
from carigs.tracking.cameras import Cameras
from carigs.tracking.solver.objective import LandmarkObjective, Shared, small_cholesky
from carigs.tracking.solver.personal_expressions import landmark_errors, learn_corrections
from carigs.tracking.solver.shared_estimate import SHAPE_STIFFNESS, SHAPE_WIDTH
from carigs.tracking.start import template_poses
from carigs.tracking.surface_fields import SurfaceField

TWO = Cameras(
    np.array([900.0, 800.0]),
    np.array([[256.0, 256.0], [250.0, 200.0]]),
    np.array([[np.pi, 0, 0, 0, 0, 6.0], [np.pi * 0.99, 0.2, 0.1, 0.1, 0, 6.0]]),
)

ONE = Cameras(TWO.focal[:1], TWO.centres[:1], np.array([[np.pi, 0, 0, 0, 0, 6.0]]))

ORBIT = Cameras(
    np.array([900.0, 900.0, 700.0, 900.0]),
    np.full((4, 2), 250.0),
    np.array([[np.pi, 0, 0, 0, 0, 6.0], [3, 0.2, 0.1, 0.1, 0, 6.0], [3, -0.4, 0, 0, 0.2, 5.0], [3, 0.4, 0.1, 0, 0, 7]]),
    np.array([0, 0, 1, 0]),
)
"""Two lenses."""


def problem(seed=0, outlier=1e6, frames=3, cameras=TWO):
    """A random head before cameras, near no minimum."""
    rng, model = np.random.default_rng(seed), random_model(expressions=6, identities=8)
    points = SurfacePoints(rng.integers(0, 30, (7, 3)), rng.dirichlet(np.ones(3), 7))
    fitted = fitted_parameters(model, np.arange(30), max_shape=4, max_expression=3)
    shared = Shared(len(fitted.shape), len(points), cameras.size)
    prior = Prior(
        np.ones(fitted.frame_size), rng.uniform(1, 2, shared.size), rng.uniform(1, 2, (frames - 1, fitted.frame_size))
    )
    seen = (frames, len(cameras.focal), len(points), 2)
    pixels, half = 250 + 20 * rng.normal(size=seen), rng.normal(size=(*seen, 2))
    objective = LandmarkObjective(
        HeadPoints(model, fitted, points), cameras, shared, pixels, half @ half.swapaxes(-1, -2), outlier, prior
    )
    return objective, 0.1 * rng.normal(size=(frames, fitted.frame_size)), 0.02 * rng.normal(size=shared.size)


def rigid(vectors, shifts):
    """Rigid transformations."""
    found = np.tile(np.eye(4), (len(vectors), 1, 1))
    found[:, :3, :3], found[:, :3, 3] = rotation_matrices(np.asarray(vectors)), shifts
    return found


def differences(function, at, step=1e-6):
    """Central differences of a function of an array."""
    found = np.zeros_like(at)
    for index in np.ndindex(at.shape):
        low, high = at.copy(), at.copy()
        low[index] -= step
        high[index] += step
        found[index] = (function(high) - function(low)) / (2 * step)
    return found


@pytest.mark.parametrize(("outlier", "cameras", "count"), [(1e6, TWO, 3), (30.0, TWO, 3), (30.0, ORBIT, 1)])
def test_gradients_are_those_of_finite_differences(outlier, cameras, count):
    objective, frames, vector = problem(outlier=outlier, cameras=cameras, frames=count)
    _, equations = objective.linearise(frames, vector)
    of_frames = differences(lambda x: objective.value(x, vector), frames)
    of_shared = differences(lambda x: objective.value(frames, x), vector)
    np.testing.assert_allclose(equations.frame_gradient, of_frames, rtol=1e-5, atol=1e-6 * np.abs(of_frames).max())
    np.testing.assert_allclose(equations.shape_gradient, of_shared, rtol=1e-5, atol=1e-6 * np.abs(of_shared).max())


@pytest.mark.parametrize(("cameras", "count"), [(ONE, 3), (TWO, 3), (ORBIT, 1)])
def test_the_matrix_is_that_of_the_jacobians(cameras, count):
    objective, frames, vector = problem(cameras=cameras, frames=count)
    roots = np.linalg.cholesky(objective.information)

    def residuals(x, y):
        points, cameras, coefficients = objective._at(y)
        pixels, _ = cameras.project(points.positions(x, coefficients))
        return np.einsum("tcnba,tcnb->tcna", roots, pixels - objective.pixels).ravel()

    def jacobian(function, at):
        columns = []
        for index in np.ndindex(at.shape):
            step = np.zeros_like(at)
            step[index] = 1e-6
            columns.append((function(at + step) - function(at - step)) / 2e-6)
        return np.stack(columns, axis=1)

    of_frames, of_shared = (
        jacobian(lambda x: residuals(x, vector), frames),
        jacobian(lambda y: residuals(frames, y), vector),
    )
    _, equations = objective.linearise(frames, vector)
    shared = of_shared.T @ of_shared + np.diag(objective.prior.shape)
    np.testing.assert_allclose(equations.shape, shared, atol=1e-5 * np.abs(shared).max())
    border = (of_frames.T @ of_shared).reshape(equations.border.shape)
    np.testing.assert_allclose(equations.border, border, atol=1e-5 * np.abs(border).max())
    within = (of_frames.T @ of_frames).reshape(*frames.shape, *frames.shape)
    within = np.einsum("tqtr->tqr", within) + objective.prior.equations(frames, vector).frames
    np.testing.assert_allclose(equations.frames, within, atol=1e-5 * np.abs(within).max())


@pytest.mark.parametrize("rank", range(4))
@pytest.mark.parametrize("size", [2, 3])
def test_small_cholesky_factors_give_the_matrices_back_whatever_their_rank(size, rank):
    half = np.random.default_rng(rank).normal(size=(50, size, rank)) * np.logspace(-6, 6, 50)[:, None, None]
    matrices = half @ half.swapaxes(-1, -2)
    lower = small_cholesky(matrices)
    assert not np.triu(lower, 1).any()
    scale = np.abs(matrices).max(axis=(1, 2), keepdims=True) + 1e-300
    np.testing.assert_allclose(lower @ lower.swapaxes(-1, -2) / scale, matrices / scale, atol=1e-7)


class Quadratic:
    """Half the squared distance of A x from b, for one frame and nothing shared."""

    def __init__(self, matrix, target):
        self.matrix, self.target = matrix, target

    def value(self, frames, shape):
        return 0.5 * float(((self.matrix @ frames[0] - self.target) ** 2).sum())

    def linearise(self, frames, shape):
        q = self.matrix.shape[1]
        gradient = self.matrix.T @ (self.matrix @ frames[0] - self.target)
        matrix = (self.matrix.T @ self.matrix)[None]
        empty = np.zeros((0, 0))
        equations = NormalEquations(matrix, np.zeros((0, q)), np.zeros((1, q, 0)), empty, gradient[None], np.zeros(0))
        return self.value(frames, shape), equations


@pytest.mark.parametrize("seed", range(5))
def test_bounds_hold_and_the_minimum_is_the_constrained_one(seed):
    rng = np.random.default_rng(seed)
    matrix, target = rng.normal(size=(9, 5)), 3 * rng.normal(size=9)
    bounds = Bounds(np.zeros(5), np.ones(5))
    found, _ = minimise(
        Quadratic(matrix, target), np.full((1, 5), 0.5), np.zeros(0), bounds=bounds, steps=500, tolerance=1e-15
    )
    expected = lsq_linear(matrix, target, (0, 1), tol=1e-14).x
    assert (found >= 0).all() and (found <= 1).all()
    np.testing.assert_allclose(found[0], expected, atol=1e-4)


def grid(n=21, side=0.1):
    """A flat square of triangles, in metres."""
    x, y = np.meshgrid(*[np.linspace(0, side, n)] * 2)
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate(
        [np.stack([corner, corner + 1, corner + n], 1), np.stack([corner + 1, corner + n + 1, corner + n], 1)]
    )
    return np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1), faces.astype(np.int32)


def test_a_field_follows_smooth_values_and_ends_at_the_parts_without_points():
    vertices, faces = grid()
    both = np.concatenate([vertices, vertices + np.array([0.2, 0, 0])])
    all_faces = np.concatenate([faces, faces + len(vertices)])
    points = SurfacePoints.at_vertices(np.arange(0, len(vertices), 2))
    values = np.cos(vertices[points.corners[:, 0]] @ [[20.0], [15.0], [0]])
    field = SurfaceField(both, all_faces, points).fit(values)
    assert np.abs(points.interpolate(field) - values).max() < 0.05
    assert np.abs(field[len(vertices) :]).max() < 1e-9


def test_a_field_knows_no_distance_but_along_the_surface():
    vertices, faces = grid()
    behind = vertices + np.array([0, 0, 0.001])  # another sheet, a millimetre away
    points = SurfacePoints.at_vertices(np.array([len(vertices) // 2]))
    field = SurfaceField(np.concatenate([vertices, behind]), np.concatenate([faces, faces + len(vertices)]), points)
    found = field.fit(np.ones((1, 1)))
    assert found[len(vertices) // 2] > 0.5 and np.abs(found[len(vertices) :]).max() < 1e-9


def test_a_persons_shape_keeps_what_is_smooth_and_loses_what_each_landmark_errs_for_itself():
    """Landmarks a centimetre apart, a shape of 2 mm that changes over centimetres, errors of a millimetre."""
    vertices, faces = grid(n=41, side=0.2)
    index = np.arange(41 * 41).reshape(41, 41)
    points = SurfacePoints.at_vertices(index[::2, ::2].ravel())
    shape = 0.002 * np.sin(vertices @ [[30.0], [25.0], [0]])
    errors = 0.001 * np.random.default_rng(6).normal(size=(len(points), 1))
    inner = index[8:-8, 8:-8].ravel()

    def left(errors, **settings):
        field = SurfaceField(vertices, faces, points, **settings).fit(points.interpolate(shape) + errors)
        return np.sqrt(((field - shape)[inner] ** 2).mean())

    own = {"width": SHAPE_WIDTH, "stiffness": SHAPE_STIFFNESS}
    assert left(0 * errors, **own) < 0.0002
    assert left(errors, **own) < 0.7 * left(errors)


def test_corrections_of_expressions_are_learned_from_their_errors():
    rng, model = np.random.default_rng(3), random_model(expressions=6, identities=8)
    fitted = fitted_parameters(model, np.arange(30), max_shape=2, max_expression=3)
    points = HeadPoints(model, fitted, SurfacePoints.at_vertices(np.arange(12))).of_person(
        np.zeros(2), np.zeros((5, 3))
    )
    true = 0.02 * rng.normal(size=(12, 3, 3))
    frames = 0.05 * rng.normal(size=(60, fitted.frame_size))
    frames[:, fitted.expression_slice] = rng.uniform(0, 1, (60, 3))
    pixels, _ = TWO.project(points.with_expressions(true).positions(frames, np.zeros(0)))
    blendshapes, found = points.expressions(), np.zeros((12, 3, 3))
    for _ in range(3):
        errors = landmark_errors(
            points.with_expressions(found), TWO, frames, pixels, np.full(pixels.shape[:3], 100.0), 1e6
        )
        found = learn_corrections(errors, frames[:, fitted.expression_slice], blendshapes, found)
    assert np.abs(found - true).max() < 0.1 * np.abs(true).max()


def test_without_expressions_there_is_nothing_to_correct():
    objective, frames, _ = problem()
    points = objective.points.of_person(np.zeros(4), np.zeros((5, 3)))
    errors = landmark_errors(points, TWO, frames, objective.pixels, np.ones(objective.pixels.shape[:3]), 5.0)
    before = np.zeros((len(objective.points.barycentric), 3, 3))
    assert learn_corrections(errors, np.zeros((3, 3)), points.expressions(), before) is before


def test_merged_points_move_like_the_points_where_weights_are_equal():
    rng, model = np.random.default_rng(4), random_model(expressions=6, identities=8)
    same = SurfacePoints(np.repeat(rng.integers(0, 30, (5, 1)), 3, axis=1), rng.dirichlet(np.ones(3), 5))
    fitted = fitted_parameters(model, np.arange(30), max_shape=2, max_expression=3)
    frames = 0.2 * rng.normal(size=(4, fitted.frame_size))
    points = HeadPoints(model, fitted, same)
    np.testing.assert_allclose(
        points.merged().positions(frames, np.ones(2)), points.positions(frames, np.ones(2)), atol=1e-12
    )


def test_the_template_is_placed_where_it_was():
    rng = np.random.default_rng(5)
    template = 0.08 * rng.normal(size=(20, 3))
    one = Cameras(TWO.focal[:1], TWO.centres[:1], np.zeros((1, 6)))
    true = rigid([np.pi, 0, 0] + 0.4 * rng.normal(size=(6, 3)), [0, 0, 1] + 0.05 * rng.normal(size=(6, 3)))
    pixels = one.project(template @ true[:, :3, :3].swapaxes(1, 2) + true[:, None, :3, 3])[0][:, 0]
    seen = np.ones(pixels.shape[:2], bool)
    seen[2, 5:] = False  # five landmarks are too few
    poses = template_poses(template, pixels, seen, one.focal[0], one.centres[0])
    assert np.isnan(poses[2]).all()
    kept = [0, 1, 3, 4, 5]
    np.testing.assert_allclose(poses[kept], true[kept], atol=1e-4)
