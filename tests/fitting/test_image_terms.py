"""Costs of outlines and images: analytic outlines and images, and derivatives."""

import numpy as np
import pytest
import trimesh
from small_head import ring_of_cameras, small_head

from carigs.capture import Camera, look_at
from carigs.fitting.fitted_parameters import fitted_parameters
from carigs.fitting.head_points import HeadPoints
from carigs.fitting.outline_term import OUTLIER_INSIDE, OUTLIER_OUTSIDE, OutlineLines, OutlineTerm, outline_lines
from carigs.fitting.photometric_term import OUTLIER, WEIGHT, PhotometricTerm, sample_with_gradient
from carigs.fitting.triangulation import projection_matrices
from carigs.head import SurfacePoints
from carigs.raster import compute_visibility

CAMERA = Camera(look_at(np.array([0.0, 0.0, 1.0]), np.zeros(3)), 500, 500, 100, 100, 200, 200)
RADIUS = 0.1


def head_points(count: int = 12) -> HeadPoints:
    model = small_head(subdivisions=2)
    vertices = np.flatnonzero(model.v_template[:, 2] > 0.03)[:count]
    return HeadPoints(model, fitted_parameters(model, vertices), SurfacePoints.at_vertices(vertices))


def disc(radius: float) -> np.ndarray:
    """Coverage of a disc of a radius in pixels, with an edge one pixel wide."""
    x, y = np.meshgrid(np.arange(200) + 0.5, np.arange(200) + 0.5)
    return np.clip(radius - np.hypot(x - 100, y - 100) + 0.5, 0, 1).astype(np.float32)


def ball_lines(shift: float) -> OutlineLines:
    """Lines at the outline of a ball whose matte has a radius larger by some pixels."""
    ball = trimesh.creation.icosphere(subdivisions=5, radius=RADIUS)
    vertices = np.array(ball.vertices)
    visibility = compute_visibility(vertices, np.asarray(ball.faces), CAMERA)
    # The outline of a ball of radius r at the distance d is a circle of radius f r / sqrt(d^2 - r^2).
    radius = 500 * RADIUS / np.sqrt(1 - RADIUS**2)
    return outline_lines(visibility, vertices / RADIUS, disc(radius + shift), np.arange(len(vertices)))


@pytest.mark.parametrize("shift", [-1.5, 0.0, 0.7])
def test_the_lines_touch_the_outline_of_the_matte(shift):
    lines = ball_lines(shift)
    assert len(lines.point) > 60
    radius = 500 * RADIUS / np.sqrt(1 - RADIUS**2) + shift
    np.testing.assert_allclose(lines.offsets - lines.normals @ [100, 100], radius, atol=0.1)


def test_a_matte_without_an_outline_nearby_gives_no_lines():
    assert len(ball_lines(30.0).point) == 0


def check_derivatives(term, positions: np.ndarray, step: float = 1e-7, rtol: float = 1e-4) -> None:
    """The gradient is the derivative of the value; the curvature is symmetric and positive."""
    frames = slice(0, len(positions))
    cost = term.evaluate(positions, frames)
    for direction in np.random.default_rng(0).normal(size=(4, *positions.shape)):
        ends = [term.evaluate(positions + h * direction, frames).value for h in (step, -step)]
        np.testing.assert_allclose((cost.gradient * direction).sum(), (ends[0] - ends[1]) / (2 * step), rtol=rtol)
    np.testing.assert_allclose(cost.curvature, cost.curvature.swapaxes(-1, -2), atol=1e-6)
    assert np.linalg.eigvalsh(cost.curvature).min() > -1e-6 * np.abs(cost.curvature).max()


def test_the_cost_of_outlines_saturates_earlier_outside():
    points, projections = head_points(), projection_matrices([CAMERA])[None]
    positions = points.positions(np.zeros((1, points.fitted.frame_size)), np.zeros(len(points.fitted.shape)))
    pixels, _ = CAMERA.project(positions[0])

    def cost(offset: float) -> float:
        lines = OutlineLines(np.array([3]), np.array([[1.0, 0.0]]), pixels[3:4, 0] + offset, np.ones(1))
        return (
            OutlineTerm(points, projections, np.array([0]), np.array([0]), lines).evaluate(positions, slice(0, 1)).value
        )

    np.testing.assert_allclose([cost(1e3), cost(-1e3)], np.array([OUTLIER_OUTSIDE, OUTLIER_INSIDE]) ** 2 / 2, rtol=1e-4)
    np.testing.assert_allclose([cost(0.01), cost(-0.01)], 0.01**2 / 2, rtol=1e-3)


def test_derivatives_of_outlines():
    random, points = np.random.default_rng(2), head_points()
    cameras = ring_of_cameras(3)
    projections = np.tile(projection_matrices(cameras), (2, 1, 1, 1))
    positions = points.positions(0.02 * random.normal(size=(2, points.fitted.frame_size)), np.zeros(6))
    frame, camera, point = random.integers(2, size=30), random.integers(3, size=30), random.integers(12, size=30)
    normals = random.normal(size=(30, 2))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    at = np.stack(
        [cameras[c].project(positions[f, p][None])[0][0] for f, c, p in zip(frame, camera, point, strict=True)]
    )
    offsets = np.einsum("ki,ki->k", normals, at) + random.normal(size=30)
    lines = OutlineLines(point, normals, offsets, random.uniform(0.5, 2, 30))
    check_derivatives(OutlineTerm(points, projections, frame, camera, lines), positions)


def test_an_affine_image_is_sampled_exactly():
    x, y = np.meshgrid(np.arange(40) + 0.5, np.arange(30) + 0.5)
    images = np.stack([[0.3 * x + 0.1 * y, 0.5 * y]]).astype(np.float32)
    pixels = np.random.default_rng(0).uniform(1, 29, (50, 2))
    camera = np.repeat([0, 1], 25)
    values, gradients = sample_with_gradient(images, np.zeros(50, int), camera, pixels)
    expected = np.where(camera == 0, pixels @ [0.3, 0.1], 0.5 * pixels[:, 1])
    np.testing.assert_allclose(values, expected, atol=1e-5)
    np.testing.assert_allclose(gradients, np.where(camera[:, None] == 0, [0.3, 0.1], [0, 0.5]), atol=1e-5)


def test_derivatives_of_images():
    random, points = np.random.default_rng(4), head_points()
    cameras = ring_of_cameras(3)
    projections = np.tile(projection_matrices(cameras), (2, 1, 1, 1))
    positions = points.positions(0.02 * random.normal(size=(2, points.fitted.frame_size)), np.zeros(6))
    x, y = np.meshgrid(np.arange(200) + 0.5, np.arange(200) + 0.5)
    slopes = random.normal(size=(2, 3, 2, 1, 1))
    images = (0.01 * (slopes[:, :, 0] * (x - 100) + slopes[:, :, 1] * (y - 100))).astype(
        np.float32
    )  # bilinear sampling is exact
    visible, means, sigma = random.random((2, 3, 12)) < 0.7, random.normal(size=12), random.uniform(0.5, 2, 12)
    term = PhotometricTerm(points, images, visible, means, sigma, projections)
    check_derivatives(term, positions, step=1e-4, rtol=3e-3)  # images are float32


def test_the_cost_of_an_image_that_differs_entirely_is_bounded():
    points, projections = head_points(), projection_matrices([CAMERA])[None]
    positions = points.positions(np.zeros((1, points.fitted.frame_size)), np.zeros(6))
    images, visible = np.full((1, 1, 200, 200), 1e4, np.float32), np.ones((1, 1, 12), bool)
    cost = PhotometricTerm(points, images, visible, np.zeros(12), np.ones(12), projections).evaluate(
        positions, slice(0, 1)
    )
    np.testing.assert_allclose(cost.value, 12 * WEIGHT * OUTLIER**2 / 2, rtol=1e-3)
