"""Threshold losses and normal consistency against their formulas."""

import numpy as np
import pytest
import torch

from carigs.capture import Camera
from carigs.splat.surfels.surfels import flat_discs
from carigs.splat.training.regularizers import add_threshold_loss, normal_consistency_loss


def test_threshold_loss_adds_the_gradient_of_its_formula():
    rng = np.random.default_rng(1)
    n = 50
    surfels = flat_discs(np.arange(n), rng.normal(size=(n, 3)), 0.3 + 0.6 * rng.random(n), 0.5, rng.random((n, 3)))
    surfels.log_scale.data += 0.3 * torch.randn(n, 2, generator=torch.Generator().manual_seed(0))
    seen, limit = rng.random(n) < 0.7, 0.5 + rng.random(n)
    position = surfels.position.detach().double().requires_grad_(True)
    log_scale = surfels.log_scale.detach().double().requires_grad_(True)
    far = 0.01 * (position.norm(dim=1) - torch.from_numpy(limit)).relu()[seen].mean()
    wide = 2.0 * (log_scale.exp() - 0.6).relu().norm(dim=1)[seen].mean()
    (far + wide).backward()
    surfels.position.grad, surfels.log_scale.grad = torch.ones(n, 3), torch.ones(n, 2)
    value = add_threshold_loss(surfels, seen, limit, 0.01, 0.6, 2.0)
    assert value == pytest.approx((far + wide).item(), rel=1e-6)
    np.testing.assert_allclose(surfels.position.grad - 1, position.grad, atol=1e-6)
    np.testing.assert_allclose(surfels.log_scale.grad - 1, log_scale.grad.nan_to_num(), atol=1e-6)


def test_normal_consistency_of_a_plane():
    camera = Camera(np.eye(4), 60.0, 50.0, 15.0, 12.0, 32, 24)
    n = np.array([0.3, -0.2, -1.0])
    n /= np.linalg.norm(n)
    x = (np.arange(32) + 0.5 - 15) / 60
    y = (np.arange(24) + 0.5 - 12) / 50
    rays = np.stack([*np.meshgrid(x, y), np.ones((24, 32))], axis=2)
    depth = torch.from_numpy(n @ [0, 0, 2.0] / (rays @ n))
    half = torch.full((24, 32), 0.5, dtype=torch.float64)
    normal = torch.from_numpy(np.broadcast_to(0.5 * n, (24, 32, 3)).copy())
    assert normal_consistency_loss(normal, half * depth, half, camera).item() == pytest.approx(0, abs=1e-6)
    tilted = torch.from_numpy(np.broadcast_to([0.0, 0, -0.5], (24, 32, 3)).copy())
    expected = 0.5 * (1 + n[2])
    assert normal_consistency_loss(tilted, half * depth, half, camera).item() == pytest.approx(expected, abs=1e-6)
