"""Records of the browser's splats."""

import numpy as np
import torch

from carigs.splat.rasterizer.interface import WorldSurfels
from carigs.viewer.splat_records import SCENE_SCALE, splat_records


def surfels(n=50, size=5e-4):
    random = np.random.default_rng(0)
    arrays = [0.1 * random.normal(size=(n, 3)), size * random.normal(size=(n, 3)), size * random.normal(size=(n, 3))]
    arrays += [random.random(n), 1.5 * random.random((n, 3)) - 0.2]
    return WorldSurfels(*(torch.tensor(array, dtype=torch.float32) for array in arrays))


def covariances(records):
    upper = np.ascontiguousarray(records[:, 4:7]).view(np.float16).astype(np.float64)
    return upper[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)


def test_records_hold_centre_covariance_and_colour():
    given = surfels()
    records = splat_records(given)
    np.testing.assert_array_equal(records[:, :3].view(np.float32), (SCENE_SCALE * given.centre).numpy())
    u, v = (SCENE_SCALE * tangent.numpy().astype(np.float64) for tangent in (given.tangent_u, given.tangent_v))
    expected = u[:, :, None] * u[:, None] + v[:, :, None] * v[:, None]
    largest = np.abs(expected).max(axis=(1, 2), keepdims=True)
    assert (np.abs(covariances(records) - expected) / largest).max() < 1e-3  # half precision of half a millimetre
    rgba = np.ascontiguousarray(records[:, 7:]).view(np.uint8).reshape(-1, 4)
    np.testing.assert_allclose(rgba[:, :3] / 255, given.colour.numpy().clip(0, 1), atol=0.5 / 255 + 1e-6)
    np.testing.assert_allclose(rgba[:, 3] / 255, given.opacity.numpy(), atol=0.5 / 255 + 1e-6)


def test_covariances_are_rounded_as_numpy_rounds():
    for size in (1e-6, 3e-5, 1e-3, 0.1):  # below, at and above the smallest normal number in half precision
        given = surfels(400, size)
        given.tangent_v[:] = 0
        u = SCENE_SCALE * given.tangent_u.numpy()
        product = (np.float32(SCENE_SCALE) ** 2 * (given.tangent_u[:, :1] * given.tangent_u).numpy()).astype(np.float16)
        found = covariances(splat_records(given))[:, 0]
        np.testing.assert_array_equal(found.astype(np.float16), product)
        assert np.isfinite(u).all()


def test_what_is_not_finite_is_transparent():
    given = surfels(4)
    given.centre[0, 1], given.tangent_u[1, 0], given.tangent_v[2, 2] = np.nan, np.inf, 1e9
    records = splat_records(given)
    rgba = np.ascontiguousarray(records[:, 7:]).view(np.uint8).reshape(-1, 4)
    assert (rgba[:3, 3] == 0).all() and rgba[3, 3] > 0
    assert np.isfinite(covariances(records)).all() and np.isfinite(records[:, :3].view(np.float32)).all()
