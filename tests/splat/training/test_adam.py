"""Adam against PyTorch's."""

import numpy as np
import torch

from carigs.splat.surfels.surfels import flat_discs
from carigs.splat.training.adam import Adam


def test_adam_agrees_with_pytorch():
    rng = np.random.default_rng(0)
    surfels = flat_discs(np.arange(40), rng.normal(size=(40, 3)), np.ones(40), 0.5, rng.random((40, 3)))
    leaves = {name: value.detach().clone().requires_grad_(True) for name, value in surfels.attributes()}
    rates = {name: 0.01 * (i + 1) for i, name in enumerate(leaves)}
    theirs = torch.optim.Adam([{"params": [leaf], "lr": rates[name]} for name, leaf in leaves.items()], eps=1e-15)
    ours = Adam(surfels)
    for _ in range(12):
        for name, value in surfels.attributes():
            value.grad = torch.from_numpy(rng.normal(size=tuple(value.shape)).astype(np.float32))
            leaves[name].grad = value.grad.clone()
        ours.step(surfels, rates)
        theirs.step()
    for name, value in surfels.attributes():
        np.testing.assert_allclose(value.detach(), leaves[name].detach(), rtol=1e-5, atol=1e-6)
