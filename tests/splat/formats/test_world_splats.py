"""Splats in world coordinates render as the avatar does; axes of sheared discs; rotation of harmonics."""

import numpy as np
import pytest
import torch
from avatars import CAMERA, ball_avatar, basis_values
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from carigs.splat.colour.harmonics_rotation import rotate_harmonics
from carigs.splat.colour.spherical_harmonics import SH_BASE, num_coefficients
from carigs.splat.formats.world_splats import WorldSplats, bake, orthogonal_disc_axes
from carigs.splat.rasterizer.rasterize import WorldSurfels, rasterize


def rendered(splats: WorldSplats, camera, background=1.0):
    """The image of splats by our rasterizer, with colours from the table of basis functions."""
    axes = Rotation.from_quat(splats.rotation, scalar_first=True).as_matrix()
    tangents = axes[:, :, :2] * splats.scale[:, None]
    away = splats.centre - camera.centre
    values = basis_values(away / np.linalg.norm(away, axis=1, keepdims=True))[:, : splats.harmonics.shape[1]]
    colour = 0.5 + SH_BASE * splats.colour + np.einsum("nk,nkc->nc", values, splats.harmonics)
    fields = (splats.centre, tangents[:, :, 0], tangents[:, :, 1], splats.opacity, np.maximum(colour, 0))
    world = WorldSurfels(*(torch.from_numpy(np.ascontiguousarray(field, np.float32)) for field in fields))
    return rasterize(world, camera, outputs=("colour",), background=background).colour.numpy().clip(0, 1)


@pytest.mark.parametrize("skinning", ["jbs", "jacobian", "similarity"])
@pytest.mark.parametrize(("degree", "turning"), [(0, True), (1, True), (2, False), (3, True), (3, False)])
def test_baked_splats_render_as_the_avatar(skinning, degree, turning):
    avatar = ball_avatar(sh_degree=degree, skinning=skinning, rotate_harmonics=turning)
    for timestep, level in ((0, 0.0), (1, 0.25), (2, 0.13)):
        image = avatar.render(timestep, level, CAMERA)
        assert image.std() > 0.05
        np.testing.assert_allclose(rendered(bake(avatar, timestep, level), CAMERA), image, atol=1e-4)


def test_levels_and_timesteps_differ():
    """Otherwise the test above would hold for a pose that never changes."""
    avatar = ball_avatar()
    images = [avatar.render(t, level, CAMERA) for t, level in ((0, 0.0), (1, 0.25), (2, 0.13), (2, 0.0))]
    for i, image in enumerate(images):
        assert all(np.abs(image - other).max() > 0.05 for other in images[i + 1 :])


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10**6), st.floats(-6, 0), st.floats(-6, 0))
def test_axes_of_a_sheared_disc_keep_its_covariance_and_normal(seed, log_u, log_v):
    rng = np.random.default_rng(seed)
    u, v = 10**log_u * rng.normal(size=(4, 3)), 10**log_v * rng.normal(size=(4, 3))
    axes, scale = orthogonal_disc_axes(u, v)
    covariance = np.einsum("ni,nj->nij", u, u) + np.einsum("ni,nj->nij", v, v)
    tangents = axes[:, :, :2] * scale[:, None]
    size = np.trace(covariance, axis1=1, axis2=2)[:, None, None]
    np.testing.assert_allclose((tangents @ tangents.transpose(0, 2, 1)) / size, covariance / size, atol=1e-12)
    np.testing.assert_allclose(axes @ axes.transpose(0, 2, 1), np.tile(np.eye(3), (4, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(axes), 1, atol=1e-12)
    assert (np.einsum("ni,ni->n", axes[:, :, 2], np.cross(u, v)) >= 0).all()


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_rotated_harmonics_give_the_same_colours_in_turned_axes(degree):
    rng = np.random.default_rng(degree)
    harmonics = rng.normal(size=(20, num_coefficients(degree), 3))
    rotation = Rotation.from_rotvec(2 * rng.normal(size=(20, 3))).as_matrix()
    direction = rng.normal(size=(20, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    before = np.einsum("nji,nj->ni", rotation, direction)
    k = num_coefficients(degree)
    expected = np.einsum("nk,nkc->nc", basis_values(before)[:, :k], harmonics)
    turned = rotate_harmonics(harmonics, rotation)
    np.testing.assert_allclose(np.einsum("nk,nkc->nc", basis_values(direction)[:, :k], turned), expected, atol=1e-12)
    # A rotation keeps the energy of each degree.
    np.testing.assert_allclose((turned**2).sum(axis=(1, 2)), (harmonics**2).sum(axis=(1, 2)))
