"""Light transfer, the fit of light to skin, and relighting."""

from dataclasses import replace

import numpy as np
from miniature import ball_cameras, ball_model, sheet
from scipy.spatial.transform import Rotation

from carigs.light import Observation, Shading, fibonacci_sphere, fit_light, irradiance_ratio, light_transfer, relight
from carigs.mesh.triangle_mesh import vertex_normals
from carigs.raster import compute_visibility

BALD = replace(ball_model(), regions={})


def ball() -> np.ndarray:
    return ball_model().v_template.astype(np.float64)


def test_light_from_everywhere_reaches_a_convex_surface_evenly():
    """Irradiance of a uniform sky is 1 at every normal (to the spacing of the directions), and nothing is hidden."""
    reach = light_transfer(ball(), BALD.faces, fibonacci_sphere(64))
    np.testing.assert_allclose(reach[:, :-1].sum(axis=1), 1, atol=0.1)
    assert np.median(reach[:, -1]) < 0.02


def test_a_wall_shadows_the_floor():
    """A high wall hides half of the sky."""
    floor, faces = sheet(21, 0.2, 0.2)
    floor = floor[:, [1, 2, 0]]  # y is up
    wall, wall_faces = sheet(3, 0.8, 0.8)
    wall = wall[:, [2, 1, 0]] + [0.005, 0, 0]
    both = np.vstack([floor, wall])
    sky = fibonacci_sphere(64)
    reach = light_transfer(both, np.vstack([faces, wall_faces + len(floor)]), sky)
    open_floor = light_transfer(floor, faces, sky)
    near = np.abs(floor).max(axis=1) < 0.03
    assert open_floor[near, :-1].sum(axis=1).min() > 0.9
    beside = near & (floor[:, 0] < 0)
    assert 0.35 < np.median(reach[: len(floor)][beside, :-1].sum(axis=1)) < 0.65


def test_light_fitted_to_a_turning_head_predicts_the_shading_of_another_surface():
    """A lamp and a dim sky on a ball of spotted skin, seen in eight attitudes; then the ball is an ellipsoid."""
    rng = np.random.default_rng(0)
    lamp, albedo = np.array([0.6, 0.64, 0.48]), rng.uniform(0.2, 0.6, (len(ball()), 3))

    def irradiance(vertices):
        normals = vertex_normals(vertices, BALD.faces)
        return np.maximum(normals @ lamp, 0)[:, None] * [2.0, 1.8, 1.5] + 0.3 * (1.2 + normals[:, 1:2])

    turns = Rotation.from_rotvec(rng.normal(size=(8, 3))).as_matrix()
    seen = np.ones(len(albedo))
    observations = [Observation(ball() @ turn.T, albedo * irradiance(ball() @ turn.T), seen) for turn in turns]
    shading = Shading(*fit_light(observations, BALD.faces), 1.0, 1e9, np.zeros(len(BALD.faces), bool))
    flat = ball() * [1.5, 1, 0.5]
    factors = shading.vertex_factors(*(shading.transfer(vertices, BALD.faces) for vertices in (ball(), flat)))
    true = irradiance(flat) / irradiance(ball())
    assert np.ptp(true) > 2
    assert np.abs(np.log(factors / true)).mean() < 0.04


def test_a_timestep_without_skin_changes_nothing():
    """Also where the coarse fit would have selected it."""
    rng = np.random.default_rng(1)
    seen = np.ones(len(ball()))
    one, other = (Observation(ball() * stretch, rng.random((len(ball()), 3)), seen) for stretch in (1, [1, 1.2, 0.8]))
    unseen = Observation(ball(), np.zeros((len(ball()), 3)), 0 * seen)
    for found, expected in zip(
        fit_light([unseen, one, unseen, other, unseen], BALD.faces), fit_light([one, other], BALD.faces), strict=True
    ):
        np.testing.assert_array_equal(found, expected)


def test_without_skin_the_light_is_zero():
    """Without observations, the light is 0."""
    unseen = Observation(ball(), np.zeros((len(ball()), 3)), np.zeros(len(ball())))
    _, light = fit_light([unseen], BALD.faces)
    assert (light == 0).all()


def test_the_irradiance_ratio_is_one_without_a_change_and_bounded():
    rng = np.random.default_rng(0)
    light = rng.random((65, 3))
    one, other = rng.random((2, 50, 65)).astype(np.float32) ** 8
    np.testing.assert_array_equal(irradiance_ratio(light, one, one, 0.7, 2.0), 1.0)
    bounded = irradiance_ratio(light, one * 1e-4, other, 1.0, 2.0)
    assert bounded.max() <= 2.0
    there, back = (irradiance_ratio(light, *ends, 1.0, 1e9) for ends in ((one, other), (other, one)))
    np.testing.assert_allclose(there * back, 1, rtol=1e-5)
    np.testing.assert_array_equal(irradiance_ratio(np.zeros_like(light), one, other, 1.0, 2.0), 1.0)


def test_relighting_by_factor_one_changes_nothing():
    seen = compute_visibility(ball(), BALD.faces, ball_cameras()[0])
    image = np.random.default_rng(0).random((48, 40, 3)).astype(np.float32)
    lit = relight(image, seen, np.ones((len(ball()), 3)), np.zeros(len(BALD.faces), bool))
    np.testing.assert_allclose(lit, image, atol=1e-6)
